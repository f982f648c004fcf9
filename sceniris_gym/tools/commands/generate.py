"""The `generate` command: writes a data set of layouts, together with their model."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.archive import write_zip
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.tools.files import replacing

_OF_REACH = ("grasp", "grasp_pose", "grasp_qpos", "pregrasp_qpos")


def write_dataset(compiled: CompiledScene, table: LayoutTable, folder: Path) -> None:
    """Write `layouts.npz`, and `scene.zip`, which stock MuJoCo opens; neither is ever left half written.

    If an object has `reachable`, its grasps are written too.

    Args:
        compiled: The compiled scene.
        table: Its layouts.
        folder: The folder to write to; created if it does not exist.

    Raises:
        SceneKeyError: The scene's model is a MjModel, of which no `scene.zip` can be written.
    """
    if (spec := compiled.scene.spec) is None:
        raise SceneKeyError(
            f"{compiled.config.where}: model: scene.zip cannot be written of a MjModel, which MuJoCo cannot turn back "
            "into MJCF. Give 'model' as a mujoco.MjSpec or as the path of an MJCF file."
        )
    columns: dict[str, Any] = {f.name: getattr(table, f.name) for f in fields(LayoutTable)}
    columns["object_names"] = np.array(compiled.object_names)
    if compiled.reaching is None:
        columns = {name: column for name, column in columns.items() if name not in _OF_REACH}
    else:
        columns["reachable_names"] = np.array(compiled.reaching.names)
    with replacing(folder / "scene.zip") as scene, replacing(folder / "layouts.npz") as layouts:
        with scene.open("wb") as file:
            write_zip(spec, file)
        with layouts.open("wb") as file:
            np.savez(file, **columns)
