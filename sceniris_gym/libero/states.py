"""`read_states`: LIBERO's stored start states as layouts of a scene."""

import codecs
import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sceniris_gym.config.loader import user_path
from sceniris_gym.errors import SceneFileError, SceneMismatchError
from sceniris_gym.geometry.rotations import product
from sceniris_gym.importers.libero.kinds import OBJECTS, ROTATION
from sceniris_gym.importers.libero.problem import Problem
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable

_WHERE = "read_states"
_ARM = [*(f"joint{i}" for i in range(1, 8)), "finger_joint1", "finger_joint2"]
_NUMPY: list[Any] = [np.zeros(0).__reduce__()[0], np.ndarray, np.dtype, type(np.dtype(float)), codecs.encode]
_SAFE: list[Any] = [*_NUMPY, (_NUMPY[0], "numpy.core.multiarray._reconstruct")]  # as NumPy 1 names it


def read_states(path: str | Path, compiled: CompiledScene, problem: Problem) -> LayoutTable:
    """Read the start states that LIBERO stores for a problem (`.pruned_init`), for `layout_source`.

    Objects, joints of fixtures, and the joints of the arm `panda` get their stored positions, at rest. The files do not
    have the poses of fixtures. LIBERO draws them at each reset. Here, they are the poses of layouts of the scene.

    Args:
        path: The file. Only arrays are read from it, and code in the file is not executed.
        compiled: The scene of the problem.
        problem: The problem.

    Returns:
        A layout for each state.

    Raises:
        SceneFileError: The file cannot be read, or has something other than an array.
        SceneMismatchError: The number of positions and velocities in a state is not the number that the problem has in
            robosuite's model.
    """
    file, mjm = user_path(path, Path(), _WHERE), compiled.mjm
    try:
        with torch.serialization.safe_globals(_SAFE):
            states = np.atleast_2d(torch.load(file, weights_only=True))
    except (OSError, ValueError, RuntimeError, pickle.UnpicklingError, zipfile.BadZipFile) as error:
        why = "it does not exist" if not file.exists() else str(error).partition("\n")[0]
        raise SceneFileError(f"{_WHERE}: '{file}' cannot be read: {why}. Give a file of LIBERO's init_files.") from None
    objects, fixtures = (_grouped(things) for things in (problem.objects, problem.fixtures))
    inside = [list(compiled.scene.joints(name).values()) for name in fixtures if name in compiled.scene.bodies]
    hinges = [joint for joints in inside for joint in joints]
    nq, nv = len(_ARM) + 7 * len(objects) + len(hinges), len(_ARM) + 6 * len(objects) + len(hinges)
    if states.shape[1:] != (1 + nq + nv,):
        raise SceneMismatchError(
            f"{_WHERE}: '{file}' should have states of {problem.path.name}: a time, {nq} positions, {nv} velocities, "
            f"got shape {states.shape}. Give the states of this problem, read without clutter."
        )
    table = make_table(compiled, len(states), 0)
    arm, thing, hinge, _ = np.split(states[:, 1:], np.cumsum([len(_ARM), 7 * len(objects), len(hinges)]), axis=1)
    robot = compiled.scene.joints("robot") if compiled.config.robot is not None else {}
    if list(robot) == _ARM:
        table.qpos[:, mjm.jnt_qposadr[list(robot.values())]] = np.column_stack([arm[:, :-1], -arm[:, -1]])
    for name, pose in zip(objects, np.split(thing, len(objects), axis=1), strict=True):
        adr = int(mjm.jnt_qposadr[mjm.body_jntadr[compiled.scene.bodies[name]]])
        back = np.multiply(ROTATION[OBJECTS[problem.objects[name]].up], [1.0, -1.0, -1.0, -1.0])
        table.qpos[:, adr : adr + 7] = [[*row[:3], *product(row[3:], back)] for row in pose]
    table.qpos[:, mjm.jnt_qposadr[hinges]] = hinge
    return LayoutTable.from_states(table.qpos, table.mocap_pos, table.mocap_quat, table.present)


def _grouped(things: Mapping[str, str]) -> list[str]:
    """Return names in the order of LIBERO's model: classes as they first occur, then names as in the file."""
    classes = list(dict.fromkeys(things.values()))
    return sorted(things, key=lambda name: classes.index(things[name]))
