"""Scenes of simple shapes for relations, and their layouts as the audit judges them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.relations import Kept
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import judge_language
from tests.layout.scenes import box_mjcf, compile_on_cpu, write_mjcf

FLOOR = {"size": [2.0, 2.0]}
GENTLE = 0.03  # half width [m] of the box that keeps anchors near the middle
SIDES = ("left", "right", "front", "back")
ENDS = ("front", "back", "middle")
ONE_ANCHOR: dict[str, tuple[dict[str, Any], int]] = {
    **{f"{side} of": ({f"{side}_of": "a"}, 1) for side in SIDES},
    **{
        f"{frame} frame": ({"left_of": "a", "frame": frame, "angle": 20}, 1)
        for frame in ("anchor", "support", "world", "b")
    },
    **{f"angle of {angle}": ({"left_of": "a", "angle": angle}, 1) for angle in (5, 45, 120, 175, 180)},
    **{f"{side} across": ({f"{side}_of": "a", "angle": 60, "frame": "world"}, 1) for side in SIDES},
    "direction": ({"direction": [-1, -0.1], "of": "a", "angle": 33}, 1),
    "near": ({"near": "a", "distance": {"min": 0.1, "max": 0.4}}, 1),
    "equal": ({"near": "a", "distance": {"equal": 0.3}}, 1),
    "equal within 1 mm": ({"near": "a", "distance": {"equal": 0.3, "tolerance": 0.001}}, 1),
    "slice of a ring": ({"left_of": "a", "angle": 40, "distance": {"min": 0.2, "max": 0.5}}, 2),
    "far": ({"back_of": "a", "distance": {"min": 0.6}}, 2),
    "near by bounds": ({"near": "a", "measure": "bounds", "distance": {"min": 0.05, "max": 0.1}}, 1),
    "equal by bounds": ({"near": "a", "measure": "bounds", "distance": {"equal": 0.1}}, 1),
    "side by bounds": ({"front_of": "a", "measure": "bounds", "distance": {"min": 0.02, "max": 0.1}}, 2),
    **{f"beside {side}": ({"beside": "a", "side": side, "gap": 0.02}, 1) for side in SIDES},
    **{f"beside {side} in the world": ({"beside": "a", "side": side, "frame": "world"}, 1) for side in SIDES},
    **{f"beside right, {align} in line": ({"beside": "a", "side": "right", "align": align}, 1) for align in ENDS},
    "beside front, left in line": ({"beside": "a", "side": "front", "align": "left", "frame": "b"}, 1),
    "beside in another's frame": ({"beside": "a", "side": "left", "frame": "b"}, 1),
}
"""Relations of an object to `a`, some in the frame of `b`, and how many measures the audit takes of each."""


def odd_mjcf(folder: Path, name: str, scale: float = 1.0) -> str:
    """Write an L of two boxes whose origin is at neither a corner nor the centre; return the file's path."""
    a, b = 0.05 * scale, 0.02 * scale
    geoms = f'<geom type="box" size="{a} {b} {b}" pos="{a} 0 {b}"/>'
    geoms += f'<geom type="box" size="{b} {a} {b}" pos="0 {a} {b}"/>'
    return write_mjcf(folder, name, geoms)


def drawer_mjcf(folder: Path, name: str) -> str:
    """Write a case with a drawer that slides out to the front (-y) by up to 0.2 m; return the file's path."""
    wall = "".join(
        f'<geom type="box" size="{x} {y} {z}" pos="{px} {py} {pz}"/>'
        for x, y, z, px, py, pz in (
            (0.15, 0.1, 0.005, 0, 0, 0.005),
            (0.15, 0.1, 0.005, 0, 0, 0.145),
            (0.005, 0.1, 0.065, -0.145, 0, 0.075),
            (0.005, 0.1, 0.065, 0.145, 0, 0.075),
        )
    )
    drawer = (
        '<body name="drawer" pos="0 0 0.02"><joint name="slide" type="slide" axis="0 -1 0" range="0 0.2"/>'
        '<geom type="box" size="0.135 0.095 0.004" pos="0 0 0.004"/>'
        '<geom type="box" size="0.135 0.004 0.03" pos="0 -0.095 0.03"/></body>'
    )
    return write_mjcf(folder, name, wall + drawer, '<keyframe><key name="home" qpos="0"/></keyframe>')


def lid_mjcf(folder: Path, name: str) -> str:
    """Write a low box with a lid that turns up about its back edge by up to 86 degrees; return the file's path."""
    base = '<geom type="box" size="0.2 0.15 0.05" pos="0 0 0.05"/>'
    lid = (
        '<body name="lid" pos="0 0.15 0.101"><joint name="hinge" type="hinge" axis="-1 0 0" range="-86 0"/>'
        '<geom type="box" size="0.2 0.15 0.005" pos="0 -0.15 0.005"/></body>'
    )
    return write_mjcf(folder, name, base + lid)


def cart_mjcf(folder: Path, name: str) -> str:
    """Write a block of which all slides to the right (x) by up to 0.3 m; return the file's path."""
    joint = '<joint name="slide" type="slide" axis="1 0 0" range="0 0.3"/>'
    return write_mjcf(folder, name, f'<body>{joint}<geom type="box" size="0.04 0.04 0.02" pos="0 0 0.02"/></body>')


class Shapes:
    """Paths of assets: `odd` (an L), `bar` (0.12 x 0.04 m), `cube` (5 cm), a `slab`, and `drawer`, `lid` and `cart`.

    Args:
        folder: where they are written.
        airy: whether they touch nothing, by their contact bits.
    """

    def __init__(self, folder: Path, *, airy: bool = False) -> None:
        self.odd, self.bar = odd_mjcf(folder, "odd"), box_mjcf(folder, "bar", 0.12, 0.04, 0.03)
        self.cube, self.slab = box_mjcf(folder, "cube", 0.05, 0.05, 0.05), box_mjcf(folder, "slab", 1.2, 0.9, 0.05)
        self.drawer, self.lid = drawer_mjcf(folder, "case"), lid_mjcf(folder, "chest")
        self.cart = cart_mjcf(folder, "cart")
        for path in vars(self).values() if airy else ():
            _make_airy(path)


def near_middle(asset: str, x: float = 0.0, y: float = 0.0, /, **words: Any) -> dict[str, Any]:
    """A fixture on the floor within `GENTLE` of (x, y)."""
    box = [[x - GENTLE, y - GENTLE], [x + GENTLE, y + GENTLE]]
    return {"asset": asset, "kind": "fixture", "on": "floor", "region": {"box": box}, **words}


def related(asset: str | None, *relations: Mapping[str, Any], **words: Any) -> dict[str, Any]:
    """An object on the floor with relations."""
    return {"asset": asset, "on": "floor", "relations": list(relations), **words}


def scene(objects: Mapping[str, Any], **words: Any) -> CompiledScene:
    """The CompiledScene of these objects on a floor of 2 m x 2 m; none has to stand, as some touch nothing."""
    fall = {name: {"stands": False, **part} for name, part in objects.items()}
    return compile_on_cpu({"floor": FLOOR, "objects": fall, **words}, bank=8)


def table_of(compiled: CompiledScene, n: int, seed: int = 0) -> LayoutTable:
    """Make layouts; at least nine of ten are valid."""
    table = make_table(compiled, n, seed)
    assert table.valid.mean() >= 0.9
    return table


def judged(compiled: CompiledScene, table: LayoutTable) -> list[Kept]:
    """Return the audit's verdicts on the relations, orientations and groups of the layouts."""
    return judge_language(Auditor(compiled.mjm, compiled.config, compiled.scene.bodies), table)


def _make_airy(path: str) -> None:
    file = Path(path)
    file.write_text(file.read_text().replace("<geom ", '<geom contype="2" conaffinity="0" '))
