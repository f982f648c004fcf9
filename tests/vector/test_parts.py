"""Parts of furniture as a task sees them: joints and grasps of the unit that each world has."""

from __future__ import annotations

import json
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

import sceniris_gym
from sceniris_gym.commands.replay import LayoutId, describe, replay
from sceniris_gym.errors import ArgumentError, SceneKeyError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.bodies import ContactSensor
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.sim.test_jointed_variants import step

NWORLD = 24
FIRST = {"base_doors": "front_0", "base_drawers": "front_0", "base_lid": "lid", "base_shelves": None}
"""Kind of unit -> the joint that its part `opening` is."""


def scene_of(folder: Path) -> Path:
    """Write generated furniture, and a scene of two units and a cabinet."""
    sceniris_gym.furniture(folder / "furniture", n=24, seed=3)
    unit: dict[str, Any] = {"asset": "furniture/base_*.xml", "kind": "fixture", "on": "floor"}
    unit |= {"parts": {"opening": {"default": "front_*", "base_lid_*": "lid"}}}
    unit |= {"joints": {"opening": {"fraction": [0.3, 0.8]}}}
    cabinet = {"asset": "cabinet", "kind": "fixture", "on": "floor", "parts": {"top": "upper_drawer"}}
    regions = ({"box": [[2.0 * i, 0.5], [2.0 * i + 0.1, 0.7]]} for i in range(3))
    names = {"unit_1": unit, "unit_2": unit, "cabinet": cabinet | {"joints": {"*": {"fraction": [0.2, 0.6]}}}}
    objects = {name: {**part, "region": region} for (name, part), region in zip(names.items(), regions, strict=True)}
    (folder / "row.yaml").write_text(json.dumps({"bank": 4, "floor": {"size": [10, 6]}, "objects": objects}))
    return folder / "row.yaml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene and furniture."""
    return scene_of(tmp_path_factory.mktemp("row")).parent


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def compiled(request: pytest.FixtureRequest, folder: Path) -> CompiledScene:
    """Two places with one of sixteen units each, and a cabinet."""
    return compile_scene(folder / "row.yaml", request.param)


@pytest.fixture
def worlds(compiled: CompiledScene) -> tuple[ResetRandomizer, State]:
    """Worlds after a reset, and their state."""
    batch = Batch(compiled.scene, NWORLD, compiled.device)
    randomizer = ResetRandomizer.of_batch(batch, compiled, seed=5)
    randomizer.reset()
    return randomizer, State(batch, randomizer.layouts, variants=randomizer.variants)


def own_part(folder: Path, variant: str) -> tuple[mujoco.MjModel, int | None]:
    """Return the model of a variant's own file, and the joint that its part `opening` is."""
    mjm = mujoco.MjModel.from_xml_path(str(folder / "furniture" / f"{variant}.xml"))
    name = FIRST[variant[:-5]]
    return mjm, None if name is None else mjm.joint(name).id


def test_a_part_is_a_joint_of_the_present_unit(worlds: tuple[ResetRandomizer, State], folder: Path):
    """MuJoCo's kinematics of a unit's own file, at the part's position, gives its grasps; also after steps and resets.

    The share is that of the file's own range. Worlds with open shelves have NaN.
    """
    randomizer, s = worlds
    seen = set()
    for turn in range(3):
        for name in ("unit_1", "unit_2"):
            members = randomizer.compiled.config.variants[name]
            joint, grasps = s.joint(name, "opening").cpu().numpy(), s.grasp(name, part="opening").cpu().numpy()
            pose, numbers = s.pose(name).cpu().numpy(), s.variant(name).tolist()
            for world, number in enumerate(numbers):
                variant = members[number].partition("/")[2]
                mjm, own = own_part(folder, variant)
                seen.add((variant[:-5], turn))
                if own is None:
                    assert np.isnan(joint[world]).all()
                    assert np.isnan(grasps[world]).all()
                    continue
                low, high = mjm.jnt_range[own]
                assert joint[world, 1] == pytest.approx((joint[world, 0] - low) / (high - low), abs=1e-5)
                assert 0.3 - 1e-5 <= joint[world, 1] <= 0.8 + 1e-5 or turn == 1
                data = mujoco.MjData(mjm)
                mjm.body_pos[1], mjm.body_quat[1] = pose[world, :3], pose[world, 3:]
                data.qpos[mjm.jnt_qposadr[own]] = joint[world, 0]
                mujoco.mj_kinematics(mjm, data)
                sites = [i for i in range(mjm.nsite) if fnmatch(mjm.site(i).name, f"grasp_{mjm.joint(own).name}_*")]
                np.testing.assert_allclose(grasps[world, : len(sites), :3], data.site_xpos[sites], atol=2e-6)
                for found, site in zip(grasps[world, :, 3:], sites, strict=False):
                    matrix = np.zeros(9)
                    mujoco.mju_quat2Mat(matrix, found.astype(float))
                    np.testing.assert_allclose(matrix, data.site_xmat[site], atol=2e-6)
                assert np.isnan(grasps[world, len(sites) :]).all()
        if turn == 0:
            qvel = randomizer.data.qvel.numpy()
            randomizer.data.qvel.assign(np.where(randomizer.data.qpos.numpy() != 0.0, 0.5, 0.0).astype(qvel.dtype))
            step(randomizer.model, randomizer.data, 10)
        else:
            randomizer.reset()
        s._batch.update()
    assert {kind for kind, _ in seen} == {*FIRST}


def test_handles_that_turn_are_parts_of_doors(tmp_path: Path):
    """Two levels: pushed doors, their handles and drawers move as in MuJoCo C with only the unit's own file."""
    sceniris_gym.furniture(tmp_path / "furniture", n=12, seed=3, turning=True)
    unit: dict[str, Any] = {"asset": str(tmp_path / "furniture" / "base_[dl]*.xml"), "kind": "fixture", "on": "floor"}
    unit |= {"parts": {"opening": {"default": "front_*", "base_lid_*": "lid"}, "handle": "*_handle"}}
    unit |= {"joints": {"*": {"fraction": [0.2, 0.6]}}}
    compiled = compile_scene({"bank": 4, "floor": {"size": [10, 6]}, "objects": {"unit": unit}}, "cpu")
    labels = {compiled.sim_mjm.joint(i).name for i in range(compiled.sim_mjm.njnt)}
    assert labels >= {"unit/hinge_0", "unit/hinge_0/hinge_0", "unit/hinge_1/hinge_0", "unit/slide_0"}
    batch = Batch(compiled.scene, NWORLD, "cpu")
    randomizer = ResetRandomizer.of_batch(batch, compiled, seed=5)
    randomizer.reset()
    s = State(batch, randomizer.layouts, variants=randomizer.variants)
    randomizer.data.qvel.assign(np.where(randomizer.data.qpos.numpy() != 0.0, 0.3, 0.0).astype(np.float32))
    names = {local for member in compiled.config.variants["unit"] for local in compiled.scene.joints(member)}
    before, pose = {name: s.joint("unit", name).numpy().copy() for name in names}, s.pose("unit").numpy().copy()
    step(randomizer.model, randomizer.data, 30)
    batch.update()
    seen = set()
    for world, number in enumerate(s.variant("unit").tolist()):
        variant = compiled.config.variants["unit"][number].partition("/")[2]
        spec = mujoco.MjSpec.from_file(str(tmp_path / "furniture" / f"{variant}.xml"))
        spec.option = compiled.scene.spec.option  # pyrefly: ignore[missing-attribute]
        mjm = spec.compile()
        mjm.body_pos[1], mjm.body_quat[1] = np.split(pose[world], [3])
        data, joints = mujoco.MjData(mjm), {mjm.joint(i).name: i for i in range(mjm.njnt)}
        for name, joint in joints.items():
            data.qpos[mjm.jnt_qposadr[joint]], data.qvel[mjm.jnt_dofadr[joint]] = before[name][world, 0], 0.3
        mujoco.mj_step(mjm, data, 30)
        for name, joint in joints.items():
            found = float(s.joint("unit", name)[world, 0])
            assert found == pytest.approx(data.qpos[mjm.jnt_qposadr[joint]], abs=2e-4), (variant, name)
            assert found != before[name][world, 0]
        handles = [name for name in joints if name.endswith("_handle")]
        part = np.nan if not handles else data.qpos[mjm.jnt_qposadr[joints[handles[0]]]]
        assert float(s.joint("unit", "handle")[world, 0]) == pytest.approx(part, abs=2e-4, nan_ok=True)
        seen.add(bool(handles))
    assert seen == {True, False}


def test_a_joint_by_its_own_name(worlds: tuple[ResetRandomizer, State], folder: Path):
    """Of a fixture without variants, also by its part and a body's name; a unit without this joint has NaN."""
    randomizer, s = worlds
    mjm = randomizer.compiled.mjm
    joint = mjm.joint("cabinet/upper").id
    found, (low, high) = s.joint("cabinet", "upper").cpu().numpy(), mjm.jnt_range[joint]
    np.testing.assert_array_equal(found[:, 0], s.qpos("cabinet/upper")[:, 0].cpu().numpy())
    np.testing.assert_allclose(found[:, 1], (found[:, 0] - low) / (high - low), rtol=1e-5)
    np.testing.assert_array_equal(found, s.joint("cabinet", "top").cpu().numpy())
    has_lid = np.array(["base_lid" in randomizer.compiled.config.variants["unit_1"][i] for i in s.variant("unit_1")])
    lid, opening = (s.joint("unit_1", name).cpu().numpy() for name in ("lid", "opening"))
    assert 0 < has_lid.sum() < NWORLD
    np.testing.assert_array_equal(lid, np.where(has_lid[:, None], opening, np.nan))


class Look(Task):
    """Observes the part that opens, and does nothing."""

    action_size = 1

    def apply(self, s: State, action: torch.Tensor) -> None:
        """Do nothing."""

    def observe(self, s: State) -> Observation:
        """Return the joint and the grasps of the part, with -1 where there is none."""
        grasps = s.grasp("unit_1", part="opening").flatten(1)
        return {"policy": {"joint": s.joint("unit_1", "opening").nan_to_num(-1.0), "grasps": grasps.nan_to_num(-1.0)}}

    def reward(self, s: State, action: torch.Tensor) -> dict[str, torch.Tensor]:
        """Return nothing."""
        return {"none": torch.zeros(s.num_envs, device=s.device)}

    def success(self, s: State) -> torch.Tensor:
        """Never succeed."""
        return torch.zeros(s.num_envs, dtype=torch.bool, device=s.device)


def test_observations_follow_the_units_of_episodes(compiled: CompiledScene):
    """After automatic resets, restored states and chosen layouts, which bring other units, also in a captured step."""
    envs = SceneVectorEnv(Look, NWORLD, scene=compiled, device=compiled.device, max_episode_steps=3)
    first, info = envs.reset(seed=0)
    units = [info["layout"]["variants"]["unit_1"].tolist()]
    state, action = envs.snapshot(), torch.zeros(NWORLD, 1, device=envs.state.device)
    for _ in range(8):
        seen, *_ = envs.step(action)
        units.append(envs.state.variant("unit_1").tolist())
        opening = envs.state.joint("unit_1", "opening").nan_to_num(-1.0)
        names = [compiled.config.variants["unit_1"][i] for i in units[-1]]
        lacks = torch.tensor(["shelves" in name for name in names], device=opening.device)
        assert ((opening == -1.0).all(dim=1) == lacks).all()
        assert (seen["policy"][:, :2] == opening).all()
    assert units[0] != units[-1]
    for options in ({"state": state}, {"layouts": info["layout"]}):
        envs.step(action)
        again, _ = envs.reset(options=options)
        assert envs.state.variant("unit_1").tolist() == units[0]
        torch.testing.assert_close(again["policy"], first["policy"])


def test_layouts_have_the_same_parts(worlds: tuple[ResetRandomizer, State]):
    """As the worlds after a reset; and replay names the part of the present unit."""
    randomizer, s = worlds
    found = randomizer.layouts.joint("unit_2/opening").cpu().numpy()
    np.testing.assert_array_equal(found, s.joint("unit_2", "opening")[:, 0].cpu().numpy())
    np.testing.assert_array_equal(randomizer.layouts.joint("cabinet/top").cpu(), s.qpos("cabinet/upper")[:, 0].cpu())
    table = replay(randomizer.compiled, LayoutId.parse(randomizer.layout_ids()[3]))
    told = describe(randomizer.compiled, table)["objects"]
    (unit,) = (part for name, part in told.items() if name.startswith("unit_2/"))
    assert unit["joints"].get("opening", np.nan) == pytest.approx(float(found[3]), nan_ok=True)
    with pytest.raises(UnknownNameError, match="unknown joint 'unit_2/openin'"):
        randomizer.layouts.joint("unit_2/openin")


def test_wrong_names_of_joints(worlds: tuple[ResetRandomizer, State]):
    """Errors name the object's joints and parts."""
    s = worlds[1]
    with pytest.raises(UnknownNameError, match=r"State\.joint: unknown joint of 'unit_1' 'openin'.*opening"):
        s.joint("unit_1", "openin")
    with pytest.raises(UnknownNameError, match="unknown body 'unit'"):
        s.joint("unit", "opening")
    with pytest.raises(UnknownNameError, match="unknown joint of 'cabinet' 'opening'"):
        s.grasp("cabinet", part="opening")
    with pytest.raises(UnknownNameError, match=r"ContactSensor: .* 'unit_1/openin'\. Did you mean 'unit_1/opening'"):
        ContactSensor(s, "unit_2/opening", ["cabinet/top", "unit_1/openin"])


def test_a_part_without_grasps(tmp_path: Path):
    """An error names the part."""
    body = '<body name="b"><geom size=".1"/><body name="c"><joint name="d"/><geom size=".1"/></body></body>'
    (tmp_path / "box.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    unit = {"asset": str(tmp_path / "box.xml"), "kind": "fixture", "on": "floor"}
    compiled = compile_scene({"bank": 1, "floor": {"size": [4, 4]}, "objects": {"box": unit}}, "cpu")
    batch = Batch(compiled.scene, 2, "cpu")
    s = State(batch, ResetRandomizer.of_batch(batch, compiled).layouts)
    assert np.isnan(s.joint("box", "d")[:, 1].numpy()).all()  # without limits
    with pytest.raises(ArgumentError, match=r"State\.grasp: part 'd' of 'box' has no sites 'grasp_\*'"):
        s.grasp("box", part="d")


def test_an_arm_reaches_and_starts_at_a_part(folder: Path):
    """The accepted grasps are those of the part in each unit, and a start draws the part's joint.

    A unit without the part has no grasp, and a joint that is no part differs between units.
    """
    files = [str(folder / "furniture" / f"{name}.xml") for name in ("base_doors_0001", "base_drawers_0000")]
    unit: dict[str, Any] = {"asset": files, "kind": "fixture", "on": "floor", "orientation": "fixed"}
    unit |= {"region": {"box": [[0.3, 0.55], [0.5, 0.65]]}, "parts": {"opening": "front_*"}}
    unit |= {"joints": {"opening": {"fraction": [0.1, 0.3]}}, "reachable": {"tier": "ik", "grasp": "opening"}}
    closed = {"robot": "grasp", "of": "unit", "joints": {"unit/opening": {"value": 0.0}}}
    scene: dict[str, Any] = {"bank": 2, "floor": {"size": [6, 6]}, "robot": {"asset": "panda"}}
    scene |= {"objects": {"unit": unit}, "start": [{"robot": "home"}, closed]}
    compiled = compile_scene(scene, "cpu")
    batch = Batch(compiled.scene, 12, "cpu")
    randomizer = ResetRandomizer.of_batch(batch, compiled, seed=5)
    randomizer.reset()
    s = State(batch, randomizer.layouts, variants=randomizer.variants)
    own, accepted, joint = s.grasp("unit", part="opening").numpy(), s.grasp("unit").numpy(), s.joint("unit", "opening")
    assert len({*s.variant("unit").tolist()}) == len({*s.start.tolist()}) == 2
    np.testing.assert_allclose(accepted[:, :3], own[:, 0, :3], atol=1e-5)
    np.testing.assert_array_equal(s.joint("panda", "joint4")[:, 0], s.qpos("robot")[:, 3])
    share = joint[:, 1].numpy()
    at_start = s.start.numpy() == 1
    assert not share[at_start].any()
    assert ((share[~at_start] > 0.099) & (share[~at_start] < 0.301)).all()
    any_front = scene | {"objects": {"unit": unit | {"reachable": "ik"}}, "start": [closed | {"grasp": "opening"}]}
    own = compile_scene(any_front, "cpu")
    table = make_table(own, 12, seed=5)
    assert own.reaching is not None
    for k, target in enumerate(own.reaching.targets):
        rows = table.grasp[:, k] >= 0
        names = {target.grasp_set.grasps[i].name for i in table.grasp[rows, k]}
        assert rows.any()
        assert all(name.startswith("grasp_front_0_") for name in names)
        assert any(grasp.name.startswith("grasp_front_1_") for grasp in target.grasp_set.grasps)
    with pytest.raises(
        SceneKeyError, match=r"start\.1\.joints: 'unit' has variants.* Name one of its 'parts', not 'lid'"
    ):
        compile_scene(scene | {"start": [{"robot": "home"}, closed | {"joints": {"unit/lid": {"value": 0.0}}}]}, "cpu")
    unit |= {"parts": {"opening": {"default": "front_*", "base_drawers_0000": None}}}
    with pytest.raises(SceneKeyError, match=r"objects\.unit/base_drawers_0000\.grasp: it lacks the part 'opening'"):
        compile_scene(scene, "cpu")
    unit |= {"parts": {"opening": "front_*"}, "reachable": {"tier": "ik", "grasp": "openin"}}
    with pytest.raises(UnknownNameError, match=r"unknown grasp 'openin'\. Did you mean 'opening'"):
        compile_scene(scene, "cpu")
