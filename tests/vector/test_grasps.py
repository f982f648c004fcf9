"""The accepted grasp and its joints, as a task sees them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.state import State
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu

NWORLD = 6


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
    batch = Batch(compiled.scene, NWORLD, "cpu")
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
    assert 0 < absent.sum() < NWORLD
    assert torch.equal(absent, s.pose("other")[:, :2].norm(dim=1) > 10.0)
    assert s.grasp_qpos("thing").shape == (NWORLD, 4)
    assert s.grasp_qpos("thing").isnan().all()


def test_the_arm_stands_in_the_grasp_in_the_joints_that_are_given(worlds: dict[str, CompiledScene]):
    """MuJoCo C puts the TCP of those joints into the grasp, and 8 cm back along it before."""
    compiled = worlds["clear"]
    s, batch = seen(compiled)
    assert compiled.reaching is not None
    mjm, data = compiled.mjm, mujoco.MjData(compiled.mjm)
    base = compiled.scene.bodies["robot"]
    for qpos, back in ((s.grasp_qpos("thing"), 0.0), (s.pregrasp_qpos("thing"), 0.08)):
        for i in range(NWORLD):
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
    mask = torch.arange(NWORLD) % 2 == 0
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
