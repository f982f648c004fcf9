"""Fixtures with joints as variants: a world moves as a model of its own pieces of furniture would."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

import sceniris_gym
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.variants import fields_of_variants

UNITS = ("cabinet", "cupboard", "chest")
NWORLD = 24
SLIDE, HINGE = int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE)


def words(*units: Any) -> dict[str, Any]:
    """Return a scene of a row of units with drawn joints, and a can in front of them."""
    opened = {"kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0.2, 0.6]}}}
    objects: dict[str, Any] = {
        f"unit{i}": {**opened, "asset": unit, "region": {"box": [[2.0 * i, 0.6], [2.0 * i + 0.1, 0.7]]}}
        for i, unit in enumerate(units)
    }
    objects["can"] = {"asset": "can", "on": "floor", "region": {"box": [[0.0, -1.0], [2.0, -0.5]]}}
    return {"bank": 4, "floor": {"size": [10, 6]}, "objects": objects}


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def compiled(request: pytest.FixtureRequest) -> CompiledScene:
    """Two places with one of three units each."""
    return compile_scene(words(list(UNITS), list(UNITS)), request.param)


def batch_of(scene: SceneModel, device: str) -> Batch:
    """Return worlds whose steps have the same bits in every run."""
    batch = Batch(scene, NWORLD, device)
    if device != "cpu":
        batch.model.opt.deterministic = int(mjw.DeterminismType.ALL)
    return batch


def simulated(compiled: CompiledScene) -> ResetRandomizer:
    """Return worlds after a reset."""
    batch = batch_of(compiled.scene, compiled.device)
    randomizer = ResetRandomizer.of_batch(batch, compiled, seed=5)
    randomizer.reset()
    return randomizer


def own_joints(mjm: mujoco.MjModel, name: str) -> dict[str, int]:
    """Return the joints below a body by kind and number, as the names of shared parts have them."""
    found: dict[str, int] = {}
    for joint in range(mjm.njnt):
        if mjm.joint(joint).name.startswith(f"{name}/"):
            kind = {SLIDE: "slide", HINGE: "hinge"}[int(mjm.jnt_type[joint])]
            found[f"{kind}_{sum(key.startswith(kind) for key in found)}"] = joint
    return found


def used(compiled: CompiledScene, variants: np.ndarray) -> np.ndarray:
    """Return which degrees of freedom the variants of each world use, shape (nworld, nv)."""
    sim, full = compiled.sim_mjm, compiled.mjm
    found = np.ones((len(variants), sim.nv), bool)
    for k, (name, members) in enumerate(compiled.config.variants.items()):
        for label, joint in own_joints(sim, name).items():
            has = np.array([label in own_joints(full, member) for member in members])
            found[:, sim.jnt_dofadr[joint]] = has[variants[:, k]]
    return found


def step(model: mjw.Model, data: mjw.Data, steps: int) -> None:
    """Step worlds."""
    with wp.ScopedDevice(data.qpos.device):
        for _ in range(steps):
            mjw.step(model, data)


def test_a_unit_moves_as_its_own_asset(compiled: CompiledScene):
    """Drawers, doors and lids that are pushed, in each world to the last bit; joints that it lacks stay at 0."""
    randomizer, sim = simulated(compiled), compiled.sim_mjm
    drawn, data = randomizer.variants.cpu().numpy(), randomizer.data
    assert {tuple(row) for row in drawn.tolist()} >= {(0, 1), (1, 2), (2, 0), (2, 2)}
    pushed = np.where(used(compiled, drawn), 0.3, 0.0) * np.array([sim.jnt_type[j] != 0 for j in sim.dof_jntid])
    start = {name: getattr(data, name).numpy().copy() for name in ("qpos", "mocap_pos", "mocap_quat")}
    data.qvel.assign(pushed.astype(np.float32))
    step(randomizer.model, data, 60)
    ours = data.qpos.numpy(), data.qvel.numpy()
    for pair in ((0, 1), (1, 2), (2, 0), (2, 2)):  # each unit in each place
        rows = (drawn == pair).all(axis=1)
        own = build_model(SceneConfig.load(words(*(UNITS[i] for i in pair))))
        alone, mjm, places = batch_of(own, compiled.device), own.mjm, {}
        for i in range(2):
            joints = own_joints(mjm, f"unit{i}")
            places |= {joint: own_joints(sim, f"unit{i}")[label] for label, joint in joints.items()}
        places[mjm.joint("can/free").id] = sim.joint("can/free").id
        state = {name: getattr(alone.data, name).numpy().copy() for name in ("qpos", "qvel", "mocap_pos", "mocap_quat")}
        for joint, shared in places.items():
            nq, nv = (7, 6) if mjm.jnt_type[joint] == 0 else (1, 1)
            to, of = mjm.jnt_qposadr[joint], sim.jnt_qposadr[shared]
            state["qpos"][:, to : to + nq] = start["qpos"][:, of : of + nq]
            to, of = mjm.jnt_dofadr[joint], sim.jnt_dofadr[shared]
            state["qvel"][:, to : to + nv] = pushed[:, of : of + nv]
        for i in range(2):
            to, of = (m.body_mocapid[m.body(f"unit{i}").id] for m in (mjm, sim))
            for name in ("mocap_pos", "mocap_quat"):
                state[name][:, to] = start[name][:, of]
        for name, values in state.items():
            getattr(alone.data, name).assign(values)
        step(alone.model, alone.data, 60)
        for joint, shared in places.items():
            if mjm.jnt_type[joint] != 0:  # the can touches the floor
                theirs = alone.data.qpos.numpy()[:, mjm.jnt_qposadr[joint]]
                mine = ours[0][:, sim.jnt_qposadr[shared]]
                assert (mine[rows] != start["qpos"][rows, sim.jnt_qposadr[shared]]).all()
                assert mine[rows].tobytes() == theirs[rows].tobytes(), (pair, mjm.joint(joint).name)
    assert not ours[1][~used(compiled, drawn)].any()


def test_joints_that_a_world_lacks_stay_at_zero(compiled: CompiledScene):
    """Over resets that change the variants, after steps with pushed doors."""
    randomizer = simulated(compiled)
    scalar = np.isin(compiled.sim_mjm.jnt_type, [SLIDE, HINGE])
    adr, dof = compiled.sim_mjm.jnt_qposadr[scalar], compiled.sim_mjm.jnt_dofadr[scalar]
    for turn in range(4):
        lacks = ~used(compiled, randomizer.variants.cpu().numpy())[:, dof]
        assert lacks.any()
        randomizer.data.qvel.assign(np.where(used(compiled, randomizer.variants.cpu().numpy()), 0.2, 0.0))
        step(randomizer.model, randomizer.data, 20)
        qpos, qvel = randomizer.data.qpos.numpy()[:, adr], randomizer.data.qvel.numpy()[:, dof]
        assert not qpos[lacks].any()
        assert not qvel[lacks].any()
        assert qpos[~lacks].all()
        randomizer.reset(np.arange(NWORLD) % 2 == turn % 2)


def test_masked_resets_change_nothing_else(compiled: CompiledScene):
    """State and model of the other worlds keep their bits; rows of stored layouts bring their units and joints."""
    randomizer = simulated(compiled)
    step(randomizer.model, randomizer.data, 3)
    names = fields_of_variants(compiled.scene)
    assert {"jnt_range", "body_pos", "qpos0"} <= {*names}

    def state() -> dict[str, np.ndarray]:
        found = {name: getattr(randomizer.data, name).numpy().copy() for name in ("qpos", "qvel", "mocap_pos")}
        return found | {name: getattr(randomizer.model, name).numpy().copy() for name in names}

    before, mask = state(), np.arange(NWORLD) % 3 == 0
    randomizer.reset(mask)
    after = state()
    for name, values in before.items():
        assert values[~mask].tobytes() == after[name][~mask].tobytes(), name
    assert (before["jnt_range"][mask] != after["jnt_range"][mask]).any()
    table = make_table(compiled, NWORLD, seed=40)
    randomizer.write(table, np.arange(NWORLD))
    drawn, sim, full = randomizer.variants.cpu().numpy(), compiled.sim_mjm, compiled.mjm
    for k, (name, members) in enumerate(compiled.config.variants.items()):
        shared = own_joints(sim, name)
        for world in range(NWORLD):
            own = own_joints(full, members[drawn[world, k]])
            qpos = randomizer.data.qpos.numpy()[world]
            found = {label: qpos[sim.jnt_qposadr[joint]] for label, joint in shared.items()}
            expected = {label: np.float32(table.qpos[world, full.jnt_qposadr[joint]]) for label, joint in own.items()}
            assert found == dict.fromkeys(shared, 0.0) | expected


def test_a_snapshot_and_a_redraw_keep_the_units(compiled: CompiledScene):
    """A snapshot restores joints of all variants; where the can is drawn anew, units keep state and fields."""
    randomizer = simulated(compiled)
    step(randomizer.model, randomizer.data, 5)
    taken = randomizer.snapshot()
    step(randomizer.model, randomizer.data, 5)
    there = randomizer.data.qpos.numpy().copy()
    randomizer.reset()
    randomizer.restore(taken)
    step(randomizer.model, randomizer.data, 5)
    assert randomizer.data.qpos.numpy().tobytes() == there.tobytes()
    sim = compiled.sim_mjm
    can = sim.jnt_qposadr[sim.joint("can/free").id]
    others = np.delete(np.arange(sim.nq), np.arange(can, can + 7))
    randomizer.redraw(["can"], np.ones(NWORLD, bool))
    after = randomizer.data.qpos.numpy()
    assert after[:, others].tobytes() == there[:, others].tobytes()
    assert (after[:, can] != there[:, can]).mean() > 0.9


def test_a_unit_starts_at_its_own_keyframe(tmp_path: Path):
    """Joints that no word draws have the positions of the asset's keyframe `home`, others 0."""
    geom, door = '<geom type="box" size=".1 .1 .1"/>', '<joint name="door" range="0 1" limited="true"/>'
    body = f'<body name="odd">{geom}<body pos="0 0 .3">{door}{geom}</body></body>'
    key = '<keyframe><key name="home" qpos=".5"/></keyframe>'
    (tmp_path / "odd.xml").write_text(f"<mujoco><worldbody>{body}</worldbody>{key}</mujoco>")
    unit = {"asset": ["cupboard", str(tmp_path / "odd.xml")], "kind": "fixture", "on": "floor"}
    randomizer = simulated(compile_scene({"bank": 2, "floor": {"size": [4, 4]}, "objects": {"unit": unit}}, "cpu"))
    starts = np.array([0.0, 0.5], np.float32)[randomizer.variants.numpy()]
    assert len({*starts.ravel().tolist()}) == 2
    np.testing.assert_array_equal(randomizer.data.qpos.numpy(), starts)


def test_generated_furniture_is_one_object(tmp_path: Path):
    """A pattern of files: the shared tree has the joints of the unit with most; layouts keep a unit's own ranges."""
    sceniris_gym.furniture(tmp_path / "furniture", n=24, seed=3)
    (tmp_path / "row.yaml").write_text(json.dumps(words("furniture/base_*.xml")))
    compiled = compile_scene(tmp_path / "row.yaml", "cpu")
    sim, members = compiled.sim_mjm, compiled.config.variants["unit0"]
    most = {label for member in members for label in own_joints(compiled.mjm, member)}
    assert {*own_joints(sim, "unit0")} == most
    assert len(most) < sum(len(own_joints(compiled.mjm, member)) for member in members) / 4
    randomizer = simulated(compiled)
    drawn, ranges = randomizer.variants.cpu().numpy()[:, 0], randomizer.model.jnt_range.numpy()
    for world, number in enumerate(drawn):
        for label, joint in own_joints(compiled.mjm, members[number]).items():
            shared = own_joints(sim, "unit0")[label]
            np.testing.assert_array_equal(ranges[world, shared], compiled.mjm.jnt_range[joint].astype(np.float32))


def test_drawn_physics_of_joints_scales_what_the_present_unit_has():
    """Damping and stiffness, with a factor of its own for each world; a shelf has no joints, and is no error."""
    scene = words([*UNITS, "shelf"])
    scene["objects"]["unit0"] |= {"joints": {}, "randomize": {"damping": {"scale": [0.5, 1.5]}}}
    compiled = compile_scene(scene, "cpu")
    randomizer, sim, full = simulated(compiled), compiled.sim_mjm, compiled.mjm
    found, factors = randomizer.model.dof_damping.numpy(), []
    for world, number in enumerate(randomizer.variants.numpy()[:, 0]):
        own = own_joints(full, compiled.config.variants["unit0"][number])
        rest = dict.fromkeys(own_joints(sim, "unit0"), 0.0)
        value = {label: found[world, sim.jnt_dofadr[joint]] for label, joint in own_joints(sim, "unit0").items()}
        nominal = rest | {label: full.dof_damping[full.jnt_dofadr[joint]] for label, joint in own.items()}
        factor = max((value[label] / nominal[label] for label in own), default=1.0)
        assert value == pytest.approx({label: factor * nominal[label] for label in rest}, rel=1e-5)
        factors += [factor] if own else []
    assert 0.5 <= min(factors) < 0.8 < 1.2 < max(factors) <= 1.5
    scene["objects"]["unit0"]["asset"] = ["shelf", "counter"]
    with pytest.raises(SceneKeyError, match=r"unit0\.randomize\.damping: .* no selected element"):
        build_model(SceneConfig.load(scene))


@pytest.mark.parametrize(("form", "ends"), [("scale", [0.5, 2.0]), ("abs", [4.0, 5.0]), ("add", [1.0, 2.0])])
def test_drawn_masses_leave_out_what_the_present_unit_lacks(form: str, ends: list[float]):
    """A body that a world does not use stays massless and at rest, and its joint without friction."""
    scene = words([*UNITS])
    scene["objects"]["unit0"] |= {"randomize": {"mass": {form: ends}, "frictionloss": {form: ends}}}
    compiled = compile_scene(scene, "cpu")
    randomizer, sim, full = simulated(compiled), compiled.sim_mjm, compiled.mjm
    mass, inertia, friction = (
        getattr(randomizer.model, name).numpy() for name in ("body_mass", "body_inertia", "dof_frictionloss")
    )
    for world, number in enumerate(randomizer.variants.numpy()[:, 0]):
        own = own_joints(full, compiled.config.variants["unit0"][number])
        for label, shared in own_joints(sim, "unit0").items():
            body, dof = sim.jnt_bodyid[shared], sim.jnt_dofadr[shared]
            theirs = own.get(label)
            weight = 0.0 if theirs is None else full.body_mass[full.jnt_bodyid[theirs]]
            turned = np.zeros(3) if theirs is None else full.body_inertia[full.jnt_bodyid[theirs]]
            factor = mass[world, body] / weight if weight else 1.0
            np.testing.assert_allclose(inertia[world, body], factor * turned, rtol=1e-5)
            assert (mass[world, body] != weight) == (weight > 0.0)
            nominal = 0.0 if theirs is None else full.dof_frictionloss[full.jnt_dofadr[theirs]]
            assert (friction[world, dof] > 0.0) == (nominal > 0.0)
    unused = ~used(compiled, randomizer.variants.numpy())
    randomizer.data.qvel.assign(np.where(unused, 0.0, 0.2).astype(np.float32))
    step(randomizer.model, randomizer.data, 20)
    qvel = randomizer.data.qvel.numpy()
    assert np.isfinite(qvel).all()
    assert not qvel[unused].any()


def test_weights_follow_drawn_masses_as_in_the_present_unit(tmp_path: Path):
    """Inverse weights are those that MuJoCo C computes of each unit with the drawn mass, at its own poses and axes."""
    geom = '<geom type="box" size=".1 .2 .05" pos=".1 .02 0" mass="2"/>'
    knob = f'<body pos="0 .1 .2" euler="0 40 0"><joint type="slide" axis="0 1 1"/>{geom}</body>'
    door = f'<body pos=".2 0 .3" euler="20 0 30"><joint pos="0 .3 .1" axis="1 2 0"/>{geom}{knob}</body>'
    door += f'<body euler="9 0 5">{geom}{knob}</body>'
    for name, body in (("odd", door), ("other", door.replace("20 0 30", "0 70 0").replace("1 2 0", "0 1 3"))):
        text = f'<mujoco><worldbody><body name="{name}">{geom}{body}</body></worldbody></mujoco>'
        (tmp_path / f"{name}.xml").write_text(text)
    scene = words([*UNITS, str(tmp_path / "odd.xml"), str(tmp_path / "other.xml")])
    scene["objects"]["unit0"] |= {"joints": {}, "randomize": {"mass": {"scale": [0.5, 2.0]}}}
    compiled = compile_scene(scene, "cpu")
    randomizer, full, bodies_of = simulated(compiled), compiled.mjm, compiled.scene.sim_bodies
    mass, of_bodies, of_dofs = (
        getattr(randomizer.model, name).numpy() for name in ("body_mass", "body_invweight0", "dof_invweight0")
    )
    members = compiled.config.variants["unit0"]
    for world, number in enumerate(randomizer.variants.numpy()[:, 0]):
        bodies, own = np.array(compiled.scene.subtree(members[number])), copy.copy(full)
        own.body_mass[bodies] = mass[world, bodies_of[bodies]]
        own.body_inertia[bodies] *= (own.body_mass / np.maximum(full.body_mass, 1e-9))[bodies, None]
        mujoco.mj_setConst(own, mujoco.MjData(own))
        np.testing.assert_allclose(of_bodies[world, bodies_of[bodies]], own.body_invweight0[bodies], rtol=1e-4)
        for joint in np.flatnonzero(np.isin(full.jnt_bodyid, bodies)):
            dof = compiled.sim_mjm.jnt_dofadr[compiled.scene.sim_joint(joint)]
            assert of_dofs[world, dof] == pytest.approx(own.dof_invweight0[full.jnt_dofadr[joint]], rel=1e-4)
    assert {*range(len(members))} == {*randomizer.variants.numpy()[:, 0].tolist()}
