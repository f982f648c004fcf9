"""Every arm: it holds its start pose, follows commands, grips, and touches itself where the eye sees it."""

from __future__ import annotations

from importlib.resources import files
from itertools import combinations

import fcl
import mujoco
import numpy as np
import pytest

from tests.assets.geometry import VISUAL, geoms, load, mesh

ARMS = ["panda", "ur5e", "heron"]
# Of each arm: mass [kg], the lightest and the heaviest link [kg], and the opening of its gripper [m].
MASSES = {"panda": (15, 20, 0.4, 4), "ur5e": (18, 24, 0.3, 9), "heron": (8, 12, 0.15, 3)}
# Greatest speeds of the joints [rad/s]: published ones of the Panda and the UR5e.
SPEEDS = {"panda": [2.175] * 4 + [2.61] * 3, "ur5e": [np.pi] * 6, "heron": [2.5] * 3 + [3.5] * 2 + [4.0]}
OPENINGS = {"panda": 0.08, "ur5e": 0.095, "heron": 0.088}


def joints(model: mujoco.MjModel) -> int:
    """Return the number of joints that an arm has before its two fingers."""
    return model.njnt - 2


@pytest.mark.parametrize("name", ARMS)
def test_the_first_axis_stands_in_the_origin_and_the_tcp_on_the_last_axis(name):
    """Joint 1 is vertical through the base's origin; the TCP lies on the last joint's axis, along its own z."""
    model, data = load(name)
    n = joints(model)
    generator = np.random.default_rng(5)
    for _ in range(10):
        data.qpos[:n] = generator.uniform(*model.jnt_range[:n].T)
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(data.xaxis[0], [0, 0, 1], atol=1e-9)
        np.testing.assert_allclose(data.xanchor[0][:2], 0.0, atol=1e-9)
        away = data.site("tcp").xpos - data.xanchor[n - 1]
        np.testing.assert_allclose(np.cross(away, data.xaxis[n - 1]), 0.0, atol=1e-9)
        np.testing.assert_allclose(data.site("tcp").xmat.reshape(3, 3)[:, 2], data.xaxis[n - 1], atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_the_tcp_is_midway_between_the_fingertips_which_close_along_y(name):
    """In the TCP's frame the open pads are mirrored about the plane y = 0, reach over the TCP, and open as stated."""
    model, data = load(name)
    frame = data.site("tcp").xmat.reshape(3, 3)
    bounds = []
    for side in ("left", "right"):
        corners = (mesh(model, data, model.geom(f"{side}_pad").id).vertices - data.site("tcp").xpos) @ frame
        bounds.append((corners.min(axis=0), corners.max(axis=0)))
    (left_low, left_high), (right_low, right_high) = bounds
    np.testing.assert_allclose(left_low[1] - right_high[1], OPENINGS[name], atol=1e-6)
    np.testing.assert_allclose([left_low[1], left_high[1]], [-right_high[1], -right_low[1]], atol=1e-6)
    np.testing.assert_allclose(left_low[[0, 2]], right_low[[0, 2]], atol=1e-6)
    np.testing.assert_allclose(left_low[0] + left_high[0], 0.0, atol=1e-6)
    assert left_low[2] < 0 < left_high[2]
    np.testing.assert_allclose(
        data.body("left_finger").xpos @ frame[:, 1] - data.site("tcp").xpos @ frame[:, 1], OPENINGS[name] / 2, atol=1e-6
    )


@pytest.mark.parametrize("name", ARMS)
def test_the_start_pose_holds_without_touching_itself(name):
    """From `home`, gripper open, TCP pointing down, the arm moves by less than 1e-3 in 1 s and has no contact."""
    model, data = load(name)
    n = joints(model)
    np.testing.assert_allclose(data.ctrl[:n], data.qpos[:n], atol=1e-9)
    np.testing.assert_allclose(data.qpos[n:], model.jnt_range[n:, 1], atol=1e-9)
    np.testing.assert_allclose(data.site("tcp").xmat.reshape(3, 3)[:, 2], [0, 0, -1], atol=1e-6)
    assert data.ncon == 0
    mujoco.mj_step(model, data, nstep=500)
    np.testing.assert_allclose(data.qpos, model.key("home").qpos, atol=1e-3)
    assert data.ncon == 0


@pytest.mark.parametrize("integrator", ["mjINT_EULER", "mjINT_IMPLICITFAST"])
@pytest.mark.parametrize("name", ARMS)
def test_an_arm_follows_its_commands(name, integrator):
    """A step of 0.2 rad on every joint is reached within 1 s to 0.01 rad, without shaking, under both integrators."""
    model, data = load(name)
    n = joints(model)
    model.opt.integrator = getattr(mujoco.mjtIntegrator, integrator)
    data.ctrl[:n] += 0.2
    mujoco.mj_step(model, data, nstep=500)
    np.testing.assert_allclose(data.qpos[:n], data.ctrl[:n], atol=0.01)
    assert np.abs(data.qvel).max() < 0.05


@pytest.mark.parametrize(("integrator", "timestep"), [("mjINT_EULER", 0.002), ("mjINT_IMPLICITFAST", 0.005)])
@pytest.mark.parametrize("name", ARMS)
def test_joints_are_as_fast_as_stated_and_stop_where_they_should(name, integrator, timestep):
    """Told to go 1.2 rad, a joint comes within 2% of its greatest speed, not 1% over it, and overshoots < 0.01 rad."""
    model, data = load(name)
    model.opt.integrator, model.opt.timestep = getattr(mujoco.mjtIntegrator, integrator), timestep
    for joint, greatest in enumerate(SPEEDS[name]):
        mujoco.mj_resetDataKeyframe(model, data, 0)
        way = 1.2 if data.qpos[joint] + 1.2 < model.jnt_range[joint, 1] else -1.2
        data.ctrl[joint] += way
        fastest, furthest = 0.0, 0.0
        for _ in range(round(1.5 / timestep)):
            mujoco.mj_step(model, data)
            fastest = max(fastest, abs(data.qvel[joint]))
            furthest = max(furthest, np.sign(way) * (data.qpos[joint] - data.ctrl[joint]))
        assert 0.98 * greatest < fastest < 1.01 * greatest
        assert furthest < 0.01
        assert abs(data.qpos[joint] - data.ctrl[joint]) < 0.005


@pytest.mark.parametrize("name", ARMS)
def test_the_gripper_closes_evenly_and_opens_again(name):
    """Fingers meet when told to close, both half way when told so, and are 0.1 mm from their ends when opened."""
    model, data = load(name)
    n = joints(model)
    travel = model.jnt_range[n, 1]
    for share in (0.0, 0.5, 1.0):
        data.ctrl[n] = share * travel
        mujoco.mj_step(model, data, nstep=500)
        np.testing.assert_allclose(data.qpos[n:], share * travel, atol=1e-3 if share == 0.0 else 1e-4)


def with_box(name: str, half: float, mass: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """An arm that has just been told to close its fingers around a cube in the air."""
    model, data = load(name)
    spec = mujoco.MjSpec.from_file(str(files("sceniris_gym.assets") / f"{name}.xml"))
    cube = spec.worldbody.add_body(name="cube", pos=data.site("tcp").xpos, quat=data.body("hand").xquat)
    cube.add_freejoint()
    cube.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3, mass=mass)
    spec.delete(spec.keys[0])
    grip = spec.compile()
    state = mujoco.MjData(grip)
    state.qpos[: model.nq], state.ctrl[:-1] = data.qpos, data.ctrl[:-1]
    return grip, state


@pytest.mark.parametrize("name", ARMS)
def test_the_gripper_holds_a_cube(name):
    """A 40 mm cube of 0.2 kg between the fingers moves less than 2 mm in 2 s of gravity."""
    grip, state = with_box(name, 0.02, 0.2)
    start = state.qpos[-7:-4].copy()
    # Gravity sets in once the fingers have closed.
    grip.opt.gravity[2] = 0.0
    mujoco.mj_step(grip, state, nstep=300)
    grip.opt.gravity[2] = -9.81
    mujoco.mj_step(grip, state, nstep=1000)
    assert np.linalg.norm(state.body("cube").xpos - start) < 0.002


@pytest.mark.parametrize("name", ARMS)
def test_links_have_plausible_masses_and_every_body_is_seen(name):
    """Links and the whole arm weigh what is stated, inertias obey the triangle inequality, nothing is bare."""
    model, _ = load(name)
    least, most, lightest, heaviest = MASSES[name]
    arm = [body for body in range(1, model.nbody) if "finger" not in model.body(body).name]
    assert lightest < model.body_mass[arm].min()
    assert model.body_mass[arm].max() < heaviest
    assert least < model.body_mass.sum() < most
    largest = model.body_inertia[1:].max(axis=1)
    assert (largest < model.body_inertia[1:].sum(axis=1) - largest).all()
    assert (model.body_inertia[1:] > 1e-6).all()
    assert {int(model.geom_bodyid[g]) for g in geoms(model, VISUAL)} == set(range(1, model.nbody))


class Eye:
    """Visible bodies of an arm as meshes for FCL, which finds overlaps of bodies that are not joined to each other."""

    def __init__(self, name: str):
        self.model, self.data = load(name)
        self.shapes = []
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        weld = self.model.body_weldid
        # The hand moves with the last link.
        self.owners = [b for b in range(1, self.model.nbody) if "finger" not in self.model.body(b).name]
        for body in self.owners:
            seen = [mesh(self.model, self.data, g) for g in geoms(self.model, VISUAL, self.model.body(body).name)]
            rotation = self.data.xmat[body].reshape(3, 3)
            tree = fcl.BVHModel()
            tree.beginModel(sum(len(shape.faces) for shape in seen), sum(len(shape.vertices) for shape in seen))
            for shape in seen:
                tree.addSubModel((shape.vertices - self.data.xpos[body]) @ rotation, shape.faces)
            tree.endModel()
            self.shapes.append(fcl.CollisionObject(tree))
        parent = {int(weld[b]): int(weld[self.model.body_parentid[weld[b]]]) for b in self.owners}
        self.pairs = [
            (i, j)
            for i, j in combinations(range(len(self.owners)), 2)
            if weld[self.owners[i]] != weld[self.owners[j]] and parent[weld[self.owners[j]]] != weld[self.owners[i]]
        ]

    def pose(self, q: np.ndarray) -> None:
        """Take a joint state, in MuJoCo and in FCL."""
        self.data.qpos[: len(q)] = q
        mujoco.mj_forward(self.model, self.data)
        for shape, body in zip(self.shapes, self.owners, strict=True):
            shape.setTransform(fcl.Transform(self.data.xmat[body].reshape(3, 3), self.data.xpos[body]))

    def meet(self, i: int, j: int) -> bool:
        """Say whether two surfaces intersect."""
        return fcl.collide(self.shapes[i], self.shapes[j], fcl.CollisionRequest(), fcl.CollisionResult()) > 0

    def touching(self) -> set[tuple[int, int]]:
        """Pairs of `owners` (indices) between which MuJoCo reports a contact."""
        bodies = self.model.geom_bodyid[self.data.contact.geom]
        found = {(int(min(a, b)), int(max(a, b))) for a, b in bodies}
        places = {body: i for i, body in enumerate(self.owners)}
        return {(places[a], places[b]) for a, b in found if a in places and b in places}


@pytest.mark.parametrize("name", ["ur5e", "heron"])
def test_an_arm_touches_itself_where_the_eye_sees_it(name):
    """In 500 random states MuJoCo's self contacts are between bodies whose surfaces meet, and few such are missed.

    Surfaces of fillets lie up to 10 mm outside the pieces, so a graze may be no contact.
    """
    eye = Eye(name)
    n = joints(eye.model)
    generator = np.random.default_rng(8)
    free, met, missed = 0, 0, 0
    for _ in range(500):
        eye.pose(generator.uniform(*eye.model.jnt_range[:n].T))
        seen = {pair for pair in eye.pairs if eye.meet(*pair)}
        felt = eye.touching()
        assert felt <= seen
        free += not seen
        met += bool(seen)
        missed += bool(seen) and not felt
    assert free > 100
    assert met > 15
    assert missed <= 0.1 * met
