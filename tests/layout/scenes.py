"""Scenes and their layouts for these tests: made on the CPU, read back as MuJoCo states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts, LayoutStatus
from sceniris_gym.layout.pipeline import LayoutPipeline
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause
from sceniris_gym.scene.layout_table import LayoutTable

FLOOR = {"size": [1.0, 1.0]}
ANYWHERE = [[-0.2, -0.2, 0.2], [0.2, 0.2, 0.6]]


@dataclass(frozen=True)
class Rows:
    """Layouts as numpy arrays, one row a world."""

    qpos: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray
    status: np.ndarray
    attempts: np.ndarray

    def bits(self) -> bytes:
        """Return all of it, for comparisons bit by bit."""
        return b"".join(a.tobytes() for a in (self.qpos, self.mocap_pos, self.mocap_quat, self.status, self.attempts))

    def __getitem__(self, index: Any) -> Rows:
        return Rows(*(a[index] for a in (self.qpos, self.mocap_pos, self.mocap_quat, self.status, self.attempts)))


def bank_rows(compiled: CompiledScene, split: str) -> slice:
    """Return the rows of `CompiledScene.bank` that worlds of a split ("train" or "eval") fall back on."""
    first, end = int(compiled.bank.ntrain), int(compiled.bank.qpos.shape[0])
    return slice(first, end) if split == "eval" else slice(0, first)


def prefetched(generator: LayoutGenerator, *, graph: bool = True) -> Any:
    """The layouts of a generator, made ahead: a LayoutPipeline whose `ahead` is there."""
    return LayoutPipeline(generator, ahead=Ahead(generator, graph=graph))


def compile_on_cpu(
    scene: Mapping[str, Any] | str, overrides: Mapping[str, Any] | None = None, *, bank: int | None = None
) -> CompiledScene:
    """Build a scene's CompiledScene on the CPU, with `bank` rows for worlds that run out of restarts."""
    words = {**(overrides or {}), **({} if bank is None else {"bank": bank})}
    return compile_scene(SceneConfig.load(scene, words), "cpu")


def compiled_from(model: Any, objects: Mapping[str, Any], **words: Any) -> CompiledScene:
    """Compile the scene of a model in memory, with a small bank."""
    return compile_scene({"model": model, "objects": objects, "home": "init_state", "bank": 2, **words}, "cpu")


def full_tray(folder: Path, **words: Any) -> CompiledScene:
    """Compile a tray that is so full that one attempt and no restart fail most of the time; with more words."""
    crate = box_mjcf(folder, "crate", 0.1, 0.1, 0.05)
    objects = {f"crate_{i}": {"asset": crate, "on": "floor", "orientation": "fixed"} for i in range(3)}
    scene = {"floor": {"size": [0.4, 0.4]}, "attempts": 1, "restarts": 0, "objects": objects}
    return compile_on_cpu(scene | words, bank=16)


def read(layouts: Layouts) -> Rows:
    """Copy the rows of a batch."""
    arrays = (layouts.qpos, layouts.mocap_pos, layouts.mocap_quat, layouts.status, layouts.attempts)
    return Rows(*(a.cpu().numpy().copy() for a in arrays))


def make(compiled: CompiledScene, nworld: int, **options: Any) -> Rows:
    """Make the layouts of one episode."""
    generator = LayoutGenerator(compiled, nworld, **options)
    generator.generate()
    return read(generator.layouts)


def posed(compiled: CompiledScene, rows: Rows | LayoutTable) -> Iterator[mujoco.MjData]:
    """Yield the model in the state of each row, posed by MuJoCo C; one MjData, reused."""
    data = mujoco.MjData(compiled.mjm)
    for i in range(len(rows.qpos)):
        data.qpos[:] = rows.qpos[i]
        if compiled.mjm.nmocap:
            data.mocap_pos[:], data.mocap_quat[:] = rows.mocap_pos[i], rows.mocap_quat[i]
        mujoco.mj_kinematics(compiled.mjm, data)
        yield data


def valid(rows: Rows) -> Rows:
    """Return the rows that are fresh and valid."""
    return rows[rows.status == LayoutStatus.VALID]


def collisions(scene: Mapping, name: str, nworld: int = 200) -> tuple[int, int]:
    """Return the number of `nworld` single candidates of an object that collide, and the number of valid worlds."""
    compiled = compile_on_cpu({"attempts": 1, "restarts": 0, **scene}, bank=1)
    generator = LayoutGenerator(compiled, nworld)
    generator.generate()
    count = generator.layouts.rejections.cpu().numpy()[compiled.placed.index(name), Cause.COLLISION]
    return int(count), int((generator.layouts.status.cpu().numpy() == LayoutStatus.VALID).sum())


def write_mjcf(folder: Path, name: str, body: str, rest: str = "") -> str:
    """Write an asset whose root body holds `body`; return its path."""
    path = folder / f"{name}.xml"
    path.write_text(f'<mujoco><worldbody><body name="{name}">{body}</body></worldbody>{rest}</mujoco>')
    return str(path)


def box_mjcf(folder: Path, name: str, x: float, y: float, z: float, extra: str = "") -> str:
    """Write a box of full extents [m] that stands on its origin; return the file's path."""
    geom = f'<geom type="box" size="{x / 2} {y / 2} {z / 2}" pos="0 0 {z / 2}" {extra}/>'
    return write_mjcf(folder, name, geom)
