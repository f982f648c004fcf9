"""The settled poses of the things of heaps, and the support that they fill."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sceniris_gym.errors import HeapError
from sceniris_gym.geometry.supports import SupportSurface, rectangle
from sceniris_gym.scene.heaps import filled_body, read_rows, rigid_part, rigid_thing
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import Support

_AROUND = 1e-3  # m that the surface which stands for all rows extends beyond the roots


@dataclass(frozen=True)
class HeapPoses:
    """The settled poses of one thing of a heap, relative to the body that the heap fills.

    Attributes:
        pos: Position of its root [m], shape (nrow, 3).
        quat: Its orientation, wxyz, shape (nrow, 4).
        stream: The random stream that the row is drawn from, one for all things of the heap.
        together: All bodies that settled together: those of the things, and those fixed to the filled body.
        settled_with: Identifies the shapes and masses that the poses were settled with; see `scene.heaps`.
        support: The support that the heap fills.
        surface: A rectangle around the roots in all rows, seen from above, as high as the highest of them.
    """

    pos: np.ndarray
    quat: np.ndarray
    stream: int
    together: frozenset[int]
    settled_with: str
    support: Support
    surface: SupportSurface


def heap_poses(scene: SceneModel) -> dict[str, HeapPoses]:
    """Read the settled poses of all things of heaps, by name.

    Raises:
        HeapError: There are no rows, or they are of other things.
        NotSupportedError: A thing with joints of its own, or a heap that fills the world.
    """
    found: dict[str, HeapPoses] = {}
    for key, heap in scene.config.heaps.items():
        where = f"{scene.config.where}: heaps.{key}"
        if heap.rows is None:
            raise HeapError(
                f"{where}.rows: is missing. Make them with `sceniris-gym settle SCENE -o ROWS.npz`, and name the file."
            )
        rows = read_rows(Path(heap.rows), heap, where)
        body = filled_body(scene, heap, where)
        low, high = rows.pos.min(axis=(0, 1)) - _AROUND, rows.pos.max(axis=(0, 1)) + _AROUND
        things = [thing for name in heap.of for thing in rigid_thing(scene, name, where)]
        shared = {
            "stream": 1 + list(scene.config.objects).index(heap.of[0]),
            "together": frozenset([*things, *rigid_part(scene.mjm, body)]),
            "settled_with": rows.settled_with,
            "support": scene.support(heap.fill, f"{where}.fill"),
            "surface": replace(rectangle(low, high), body=body, height=float(high[2])),
        }
        found |= {name: HeapPoses(rows.pos[:, i], rows.quat[:, i], **shared) for i, name in enumerate(heap.of)}
    return found
