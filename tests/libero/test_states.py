"""Stored start states: mapped to the scene's joints as robosuite orders them, and read without executing code."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.errors import SceneFileError, SceneMismatchError
from sceniris_gym.importers.libero.reader import LiberoTask, read_bddl
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.libero.states import read_states
from sceniris_gym.program.compiled import CompiledScene
from tests.importers.libero.problems import KITCHEN, write

pytestmark = pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
ARM = [0.1, -0.2, 0.3, -2.4, 0.5, 2.2, 0.7, 0.02, -0.03]
POSES = {  # in the order of robosuite's model: classes as they first occur
    "akita_black_bowl_1": [0.1, 0.0, 0.95, 0.5**0.5, 0.0, 0.0, 0.5**0.5],
    "akita_black_bowl_2": [-0.2, 0.1, 0.95, 1.0, 0.0, 0.0, 0.0],
    "ketchup_1": [0.2, 0.3, 1.0, 0.5, 0.5, 0.5, 0.5],
}
UPRIGHT = {"ketchup_1": [0.2, 0.3, 1.0, 0.5**0.5, 0.0, 0.0, 0.5**0.5]}
"""Poses of boxes that stand in for models whose y axis points up: a quarter turn about x less."""
HINGES = {
    "wooden_cabinet_1/top_level": -0.15,
    "wooden_cabinet_1/middle_level": -0.05,
    "wooden_cabinet_1/bottom_level": 0.0,
    "flat_stove_1/button": 1.5,
}
ROW = [0.0, *ARM, *(number for pose in POSES.values() for number in pose), *HINGES.values()]
STATES = np.array([[*row, *([0.0] * (9 + 18 + 4))] for row in (ROW, ROW)])


def problem(folder: Path, **arguments: Any) -> LiberoTask:
    """Read the kitchen with bowls of which the second comes after an object of another class."""
    objects = "akita_black_bowl_1 - akita_black_bowl ketchup_1 - ketchup akita_black_bowl_2 - akita_black_bowl"
    text = KITCHEN.replace("akita_black_bowl_1 akita_black_bowl_2 - akita_black_bowl\n    plate_1 - plate", objects)
    return read_bddl(write(folder, text.replace("plate_1", "ketchup_1")), **arguments)


@pytest.fixture(scope="module")
def kitchen(tmp_path_factory: pytest.TempPathFactory) -> tuple[LiberoTask, CompiledScene]:
    """Return the kitchen with an arm."""
    task = problem(tmp_path_factory.mktemp("kitchen"), robot="panda")
    return task, compile_scene(task.scene, "cpu")


def test_each_joint_gets_its_position(kitchen: tuple[LiberoTask, CompiledScene], tmp_path: Path):
    """Origins of objects as MuJoCo C sees them, drawers, the knob, and the arm, whose fingers both open upwards."""
    task, compiled = kitchen
    torch.save(STATES, tmp_path / "kitchen.pruned_init")
    table, mjm = read_states(tmp_path / "kitchen.pruned_init", compiled, task.problem), compiled.mjm
    data = mujoco.MjData(mjm)
    table.put(data, 1)
    mujoco.mj_kinematics(mjm, data)
    for name, pose in (POSES | UPRIGHT).items():
        body = mjm.body(f"{name}/object").id
        np.testing.assert_allclose([*data.xpos[body], *data.xquat[body]], pose, atol=1e-6)
    for name, position in HINGES.items():
        assert data.joint(name).qpos == pytest.approx(position)
    arm = [data.joint(f"panda/joint{i}").qpos[0] for i in range(1, 8)]
    fingers = [data.joint(f"panda/finger_joint{i}").qpos[0] for i in (1, 2)]
    np.testing.assert_allclose([*arm, *fingers], np.abs(ARM) * np.sign([*ARM[:8], 1]), atol=1e-6)
    assert StoredLayouts(compiled, table, 4).layouts.nworld == 4


def test_states_of_another_problem_are_refused(kitchen: tuple[LiberoTask, CompiledScene], tmp_path: Path):
    """By their number of positions and velocities."""
    task, compiled = kitchen
    torch.save(STATES[:, 1:], tmp_path / "other.pruned_init")
    with pytest.raises(SceneMismatchError, match=r"a time, 34 positions, 31 velocities, got shape \(2, 65\)"):
        read_states(tmp_path / "other.pruned_init", compiled, task.problem)


class Harmful:
    """An object that makes a folder when it is unpickled."""

    def __reduce__(self) -> Any:
        return os.mkdir, ("harmed",)


def test_a_file_with_code_is_refused(
    kitchen: tuple[LiberoTask, CompiledScene], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Before the code is executed. A missing and a damaged file are named, too."""
    monkeypatch.chdir(tmp_path)
    task, compiled = kitchen
    torch.save(Harmful(), "harmful.pruned_init")
    Path("damaged.pruned_init").write_bytes(b"PK\x03\x04")
    for name in ("harmful", "damaged", "missing"):
        with pytest.raises(SceneFileError, match=rf"{name}\.pruned_init' cannot be read: .*Give a file of LIBERO's"):
            read_states(f"{name}.pruned_init", compiled, task.problem)
    assert not Path("harmed").exists()
