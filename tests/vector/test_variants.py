"""Variants as a task sees them: which is there, how large it is, and the grasp that it was accepted for."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.bodies import Bounds, ContactSensor
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu
from tests.vector.stepping import memory_of_a_world

NWORLD = 12
HEIGHTS = {"low": 0.03, "tall": 0.06}
NWORLD_OF_GRASPS = 6


class Look(Task):
    """Sees the variant and the height of its top, and does nothing."""

    action_size = 1

    def bind(self, s: State) -> None:
        """Find the box around the thing."""
        self.bounds = Bounds(s, ("thing",))

    def apply(self, s: State, action: torch.Tensor) -> None:
        """Do nothing."""

    def observe(self, s: State) -> Observation:
        """Return the variant as numbers of its own."""
        return {"policy": {"variant": s.variant("thing", one_hot=True), "extent": s.extent("thing")}}

    def reward(self, s: State, action: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return nothing."""
        return {"none": torch.zeros(s.num_envs)}

    def success(self, s: State) -> torch.Tensor:
        """Never succeed."""
        return torch.zeros(s.num_envs, dtype=torch.bool)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A crane that is to reach one of two boxes, and a cube."""
    folder: Path = tmp_path_factory.mktemp("crane")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    boxes = {name: {"asset": box_mjcf(folder, name, 0.04, 0.04, height)} for name, height in HEIGHTS.items()}
    scene = crane_scene(asset, cube, reachable="clear")
    thing = {word: value for word, value in scene["objects"].pop("thing").items() if word != "asset"}
    scene["objects"] |= {"thing": {"variants": boxes, **thing}, "other": {"asset": cube, "on": "floor"}}
    return compile_on_cpu(scene, bank=4)


def test_memory_has_the_fields_in_which_variants_differ(compiled: CompiledScene):
    """Within a tenth of what is taken."""
    told, taken = memory_of_a_world(lambda num_envs: SceneVectorEnv(Look, num_envs, scene=compiled, device="cpu"))
    assert told == pytest.approx(taken, rel=0.1)


@pytest.fixture(scope="module")
def envs(compiled: CompiledScene) -> SceneVectorEnv:
    """Worlds after a reset."""
    made = SceneVectorEnv(Look, NWORLD, scene=compiled, device="cpu")
    made.reset(seed=3)
    return made


def test_a_task_sees_the_variant_that_is_there(envs: SceneVectorEnv, compiled: CompiledScene):
    """By its number and in columns, as `info` and the layouts have it."""
    s = envs.state
    index = s.variant("thing")
    columns = [compiled.slots.index(f"thing/{name}") for name in HEIGHTS]
    assert (index.numpy() == envs.randomizer.layouts.present.numpy()[:, columns].argmax(1)).all()
    assert set(index.tolist()) == {0, 1}
    assert torch.equal(s.variant("thing", one_hot=True), torch.eye(2)[index])
    observation, info = envs.reset(seed=3)
    assert torch.equal(info["layout"]["variants"]["thing"], index)
    assert observation["policy"].shape == (NWORLD, 5)
    assert s.present(("thing", "other")).all()


def test_a_task_sees_that_an_object_with_variants_is_absent(tmp_path: Path):
    """By -1, by a row of zeros, and by `present`; its box is that of its first variant."""
    boxes = {name: {"asset": box_mjcf(tmp_path, name, 0.04, 0.04, height)} for name, height in HEIGHTS.items()}
    lamp = {"asset": boxes["low"]["asset"], "on": "floor"}
    objects = {"lamp": lamp, "thing": {"variants": boxes, "on": "floor", "unless": "lamp"}}
    groups = {"some": {"of": ["lamp"], "count": [0, 1]}}
    scene = {"floor": {"size": [1, 1]}, "bank": 4, "objects": objects, "groups": groups}
    envs = SceneVectorEnv(Look, NWORLD, scene=compile_on_cpu(scene), device="cpu")
    envs.reset(seed=1)
    s = envs.state
    number, there = s.variant("thing"), s.present(("lamp", "thing"))
    assert set(number.tolist()) == {-1, 0, 1}
    assert torch.equal(there, torch.stack([number < 0, number >= 0], dim=1))
    assert torch.equal(s.variant("thing", one_hot=True), torch.eye(2)[number] * (number >= 0)[:, None])
    assert torch.allclose(s.extent("thing")[number < 0, 2], torch.tensor(HEIGHTS["low"]))


def test_boxes_are_those_of_the_variant(envs: SceneVectorEnv):
    """Its extents, and the height of its lowest corner, which lies on the floor."""
    s = envs.state
    height = torch.tensor(list(HEIGHTS.values()))[s.variant("thing")]
    assert torch.allclose(s.extent("thing"), torch.stack([torch.full_like(height, 0.04)] * 2 + [height], dim=1))
    assert torch.allclose(s.extent("other"), torch.full((NWORLD, 3), 0.04))
    lowest = envs.task.bounds.lowest(s.poses(("thing",)))  # pyrefly: ignore[missing-attribute]
    base = s.pose("robot")[:, 2:3] if "robot" in s.scene.bodies else torch.zeros(1)
    assert (lowest - lowest.mean() + base.mean() - base).abs().max() < 0.002


def test_the_grasp_is_that_of_the_variant(envs: SceneVectorEnv, compiled: CompiledScene):
    """It moves with the body that is simulated, and joints are those that were solved for it."""
    s, layouts = envs.state, envs.randomizer.layouts
    assert compiled.reaching is not None
    grasp, joints = s.grasp("thing"), s.grasp_qpos("thing")
    assert grasp.isfinite().all()
    index, names = s.variant("thing").tolist(), list(HEIGHTS)
    for world in range(NWORLD):
        column = compiled.reaching.names.index(f"thing/{names[index[world]]}")
        assert layouts.grasp.numpy()[world, column] >= 0
        np.testing.assert_array_equal(
            joints[world].numpy(), layouts.grasp_qpos.numpy()[world, column, : joints.shape[1]]
        )
    middle = s.pose("thing")[:, 2] + torch.tensor(list(HEIGHTS.values()))[s.variant("thing")] / 2
    assert (grasp[:, 2] - middle).abs().max() < 0.03


def test_a_variant_that_need_not_be_reached_has_no_grasp(compiled: CompiledScene):
    """Nothing but NaN in its worlds, and a grasp in those of the other."""
    config = SceneConfig.load(compiled.config, {"objects.thing/tall.reachable": False})
    envs = SceneVectorEnv(Look, NWORLD, scene=compile_scene(config, "cpu"), device="cpu")
    envs.reset(seed=3)
    s = envs.state
    for values in (s.grasp("thing"), s.grasp_qpos("thing"), s.pregrasp_qpos("thing")):
        assert torch.equal(values.isfinite().all(dim=1), s.variant("thing") == 0)
        assert torch.equal(values.isnan().all(dim=1), s.variant("thing") == 1)


def test_contacts_are_those_of_the_variant(envs: SceneVectorEnv):
    """Whichever it is, it stands on the floor, and it touches the cube in the world where that was put against it."""
    envs.reset(seed=3)
    s, touch = envs.state, ContactSensor(envs.state, ("thing",), ("world", "other"))
    pose = s.pose("thing")
    pose[:, 0] += 0.0395  # both are 4 cm wide
    s.put_pose("other", pose, torch.arange(NWORLD) == 1)
    for _ in range(10):
        envs.step(torch.zeros(NWORLD, 1))
    found = touch(s)[:, 0]
    assert found[:, 0].all()
    assert found[:, 1].tolist() == [world == 1 for world in range(NWORLD)]


def test_an_unknown_object_is_named_with_those_that_there_are(envs: SceneVectorEnv):
    """An object without variants, and a variant instead of its object."""
    with pytest.raises(UnknownNameError, match=r"object with variants 'other'.*thing"):
        envs.state.variant("other")
    with pytest.raises(UnknownNameError, match=r"reachable object 'other'.*thing"):
        envs.state.grasp("other")


def test_the_same_seed_brings_the_same_variants(envs: SceneVectorEnv):
    """Whatever came between; the next episode has others."""
    first = envs.reset(seed=11)[1]["layout"]["variants"]["thing"]
    second = envs.reset()[1]["layout"]["variants"]["thing"]
    again = envs.reset(seed=11)[1]["layout"]["variants"]["thing"]
    assert torch.equal(first, again)
    assert not torch.equal(first, second)


def test_a_snapshot_brings_its_variants_back(envs: SceneVectorEnv):
    """In other worlds, too: the same variants, fields of the model, and steps to the same bits."""
    envs.reset(seed=21)
    kept = envs.snapshot(np.arange(NWORLD) < 5)
    action = torch.zeros(NWORLD, 1)
    first, sizes = envs.step(action)[0]["policy"][:5], envs.batch.model.geom_size.numpy()[:5].copy()
    poses = envs.state.pose("thing")[:5].clone()
    envs.reset(seed=22)
    envs.reset(options={"state": kept, "reset_mask": np.arange(NWORLD) >= NWORLD - 5})
    again = envs.step(action)[0]["policy"][-5:]
    assert torch.equal(first, again)
    assert torch.equal(envs.state.pose("thing")[-5:], poses)
    np.testing.assert_array_equal(envs.batch.model.geom_size.numpy()[-5:], sizes)


def test_factors_are_of_the_variant_that_a_world_has(compiled: CompiledScene):
    """Masses of boxes of two heights, scaled in every episode anew; inertias too."""

    class Heavy(Look):
        model_fields = ("body_mass",)

        def on_reset(self, s: State, mask: torch.Tensor) -> None:
            s.scale_field("body_mass", "thing", 1.0 + s.random("thing"), mask)

    envs = SceneVectorEnv(Heavy, NWORLD, scene=compiled)
    envs.reset(seed=0)
    for mask in (np.arange(NWORLD) % 2 == 0, np.arange(NWORLD) % 3 == 0):
        envs.reset(options={"reset_mask": mask})
        s = envs.state
        bodies = np.array([compiled.scene.bodies[f"thing/{name}"] for name in HEIGHTS])[s.variant("thing").numpy()]
        factor, mjm = 1.0 + s.random("thing").numpy(), compiled.mjm
        mass, inertia = (s.model_field(f"body_{name}", "thing").numpy() for name in ("mass", "inertia"))
        np.testing.assert_allclose(mass, factor * mjm.body_mass[bodies], rtol=1e-6)
        np.testing.assert_allclose(inertia, factor[:, None] * mjm.body_inertia[bodies], rtol=1e-6)


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> dict[str, CompiledScene]:
    """A crane that is to reach a cube, by its map and clear of all else; another cube is there or not."""
    folder = tmp_path_factory.mktemp("crane")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    found = {}
    for tier in ("map", "clear"):
        scene = crane_scene(asset, cube, reachable=tier)
        scene["objects"]["other"] = {"asset": cube, "on": "floor", "reachable": "map"}
        scene["groups"] = {"some": {"of": ["other"], "count": [0, 1]}}
        found[tier] = compile_on_cpu(scene, bank=4)
    return found


def seen(compiled: CompiledScene) -> tuple[State, Batch]:
    """Return the state that a task sees after a reset, and its batch."""
    batch = Batch(compiled.scene, NWORLD_OF_GRASPS, "cpu")
    randomizer = ResetRandomizer(compiled, batch.model, batch.data, seed=5)
    randomizer.reset()
    return State(batch, randomizer.layouts), batch


def pose_of(quat: np.ndarray, pos: np.ndarray) -> np.ndarray:
    """A pose as a matrix (4, 4)."""
    frame, mat = np.eye(4), np.zeros(9)
    mujoco.mju_quat2Mat(mat, np.asarray(quat, float))
    frame[:3, :3], frame[:3, 3] = mat.reshape(3, 3), pos
    return frame


def test_a_grasp_is_where_its_object_is(worlds: dict[str, CompiledScene]):
    """In the robot's base frame, at the cube's middle and from above; absent objects have none."""
    s, _ = seen(worlds["map"])
    grasp, thing = s.grasp("thing"), s.pose("thing")
    assert torch.allclose(grasp[:, :2], thing[:, :2], atol=1e-5)
    assert torch.allclose(grasp[:, 2], thing[:, 2] + 0.02, atol=1e-5)
    for row in grasp.double().numpy():
        assert pose_of(row[3:], row[:3])[2, 2] == pytest.approx(-1.0, abs=1e-5)
    absent = s.grasp("other").isnan().all(dim=1)
    assert 0 < absent.sum() < NWORLD_OF_GRASPS
    assert torch.equal(absent, s.pose("other")[:, :2].norm(dim=1) > 10.0)
    assert s.grasp_qpos("thing").shape == (NWORLD_OF_GRASPS, 4)
    assert s.grasp_qpos("thing").isnan().all()


def test_the_arm_stands_in_the_grasp_in_the_joints_that_are_given(worlds: dict[str, CompiledScene]):
    """MuJoCo C puts the TCP of those joints into the grasp, and 8 cm back along it before."""
    compiled = worlds["clear"]
    s, batch = seen(compiled)
    assert compiled.reaching is not None
    mjm, data = compiled.mjm, mujoco.MjData(compiled.mjm)
    base = compiled.scene.bodies["robot"]
    for qpos, back in ((s.grasp_qpos("thing"), 0.0), (s.pregrasp_qpos("thing"), 0.08)):
        for i in range(NWORLD_OF_GRASPS):
            data.qpos[:] = batch.data.qpos.numpy()[i]
            data.qpos[compiled.reaching.arms[0].arm.qposadr] = qpos[i].numpy()
            mujoco.mj_kinematics(mjm, data)
            tcp = pose_of(_quat(data.site("crane/tcp").xmat), data.site("crane/tcp").xpos)
            stands = np.linalg.inv(pose_of(data.xquat[base], data.xpos[base])) @ tcp
            grasp = s.grasp("thing")[i].double().numpy()
            wanted = pose_of(grasp[3:], grasp[:3])
            wanted[:3, 3] -= back * wanted[:3, 2]
            assert np.abs(stands[:3, 3] - wanted[:3, 3]).max() < 1e-3
            assert np.trace(stands[:3, :3].T @ wanted[:3, :3]) > 1.0 + 2.0 * np.cos(np.radians(0.5))


def test_a_task_starts_before_the_grasp(worlds: dict[str, CompiledScene]):
    """The arm of masked worlds stands at rest in its pre-grasp, as seen by the task at once; the others stay."""
    s, _ = seen(worlds["clear"])
    mask = torch.arange(NWORLD_OF_GRASPS) % 2 == 0
    before, pregrasp = s.qpos("crane").clone(), s.pregrasp_qpos("thing")
    s.put_joints("crane", pregrasp, mask)
    after = s.qpos("crane")
    assert torch.equal(after[mask, :4], pregrasp[mask])
    assert torch.equal(after[~mask], before[~mask])
    assert torch.equal(after[:, 4:], before[:, 4:])
    tcp, grasp = s.site("crane/tcp"), s.grasp("thing")
    assert torch.allclose(tcp[mask, :2], grasp[mask, :2], atol=1e-3)
    assert torch.allclose(tcp[mask, 2], grasp[mask, 2] + 0.08, atol=1e-3)
    s.put_joints("crane", torch.full_like(pregrasp, torch.nan), ~mask)
    assert torch.equal(s.qpos("crane")[~mask], before[~mask])
    assert (s.qvel("crane") == 0.0).all()


def test_only_reachable_objects_have_grasps(worlds: dict[str, CompiledScene], tmp_path: Path):
    """The message names those that have; in a scene without any it names none."""
    s, _ = seen(worlds["map"])
    with pytest.raises(UnknownNameError, match=r"State\.grasp: unknown reachable object 'crane'.*Valid: other, thing"):
        s.grasp("crane")
    cube = box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    plain = compile_on_cpu({"floor": {"size": [1.0, 1.0]}, "objects": {"thing": {"asset": cube, "on": "floor"}}})
    with pytest.raises(UnknownNameError, match=r"State\.grasp_qpos: .*Valid: none"):
        seen(plain)[0].grasp_qpos("thing")


def _quat(mat: np.ndarray) -> np.ndarray:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, mat)
    return quat
