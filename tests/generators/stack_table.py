"""Scenes in which something falls although nothing touches, one for each way in which that comes about."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tests.generators.stack_models import StackScene

_ON_FLOOR = {"on": "floor"}
_CUBE = '<geom name="{name}" type="box" size=".025 .025 .025"/>'


def table() -> dict[str, StackScene]:
    """Return the scenes by name."""
    blocks = {name: _CUBE.format(name=name) for name in "abcde"}
    rows = {
        "five blocks near the middle": _scene(blocks, _chain("abcde", region={"fraction": [[0.2, 0.2], [0.8, 0.8]]})),
        "book on a free block": _shipped({"block": {"asset": "block", **_ON_FLOOR}, "book": _on("book", "block")}),
        "plate on a block": _scene(
            {"a": _box("a", 0.03, 0.03, 0.03), "b": _box("b", 0.15, 0.15, 0.01, "3000")}, _chain("ab")
        ),
        "centre of mass outside of the foot": _scene({"a": _OVERHANG}, _chain("a", orientation={"yaw": [0, 90]})),
        "two cubes at ratio 0": _scene(_first(blocks, 2), _chain("ab")),
        "three cubes at ratio 0": _scene(_first(blocks, 3), _chain("abc")),
        "five cubes at ratio 0": _scene(blocks, _chain("abcde")),
        "five cubes at ratio 0.5": _scene(blocks, _chain("abcde", ratio_on_support=0.5)),
        "brick on the overhang of a stool": _scene(
            {"stool": _STOOL, "brick": _box("brick", 0.04, 0.02, 0.02, "12000")},
            {"stool": _ON_FLOOR, "brick": {"on": "stool", "ratio_on_support": 1.0}},
        ),
        "100 kg on 10 g": _scene(
            {"a": '<geom name="a" type="box" size=".1 .1 .02" mass=".01"/>', "b": _box("b", 0.1, 0.1, 0.1, "12500")},
            _chain("ab", region={"fraction": [[0.45, 0.45], [0.55, 0.55]]}),
        ),
        "contact that sinks 5 cm": _scene({"a": _SOFT}, _chain("a")),
        "contact bits": _scene({"a": _bits("a", "2", "2")}, _on_bench("a")),
        "exclude": _scene(
            _first(blocks, 1), _on_bench("a"), rest='<contact><exclude body1="bench" body2="a"/></contact>'
        ),
        "contacts switched off": _scene(_first(blocks, 2), _chain("ab"), option='<flag contact="disable"/>'),
        "gravity along y": _scene(_first(blocks, 2), _chain("ab"), gravity="0 -9.81 0"),
        "gravity at 60 degrees": _scene(_first(blocks, 2), _chain("ab"), gravity="0 -8.5 -4.9"),
        "gravity upward": _scene(_first(blocks, 2), _chain("ab"), gravity="0 0 9.81"),
        "gravity along y, stable": _scene(_first(blocks, 1), _chain("a", orientation="stable"), gravity="0 -9.81 0"),
        "gravity upward, stable": _scene(_first(blocks, 1), _chain("a", orientation="stable"), gravity="0 0 9.81"),
        "gravcomp 1.5": _scene(_first(blocks, 2), _chain("ab"), words={"b": 'gravcomp="1.5"'}),
        "seesaw": _scene(_first(blocks, 1), {"beam": {"kind": "static"}, "a": {"on": "beam/board"}}, furniture=_SEESAW),
        "lid that opens downward": _scene(
            _first(blocks, 1), {"beam": {"kind": "static"}, "a": {"on": "beam/board"}}, furniture=_LID
        ),
    }
    return rows


_OVERHANG = _CUBE.format(name="foot") + '<geom name="head" type="box" size=".1 .025 .025" pos=".1 0 .05"/>'
_STOOL = """<geom name="post" type="box" size=".03 .03 .05" density="200"/>
  <geom name="seat" type="box" size=".12 .12 .01" pos="0 0 .06" density="200"/>"""
_SOFT = '<geom name="a" type="box" size=".05 .05 .05" solref="1.5 1" priority="1"/>'
_SEESAW = """<body name="beam"><geom name="stand" type="box" size=".02 .1 .1" pos="0 0 .1"/>
  <body name="board" pos="0 0 .22"><joint name="turn" axis="0 1 0"/>
    <geom name="board" type="box" size=".3 .1 .01"/></body></body>"""
_LID = """<body name="beam"><geom name="wall" type="box" size=".02 .1 .1" pos="0 0 .1"/>
  <body name="board" pos=".03 0 .19"><joint name="turn" axis="0 1 0" damping=".01"/>
    <geom name="board" type="box" size=".15 .1 .01" pos=".15 0 0"/></body></body>"""
_BENCH = '<body name="bench"><geom name="bench" type="box" size=".3 .3 .2" pos="0 0 .2"/></body>'


def _box(name: str, x: float, y: float, z: float, density: str = "1000") -> str:
    return f'<geom name="{name}" type="box" size="{x} {y} {z}" density="{density}"/>'


def _bits(name: str, contype: str, conaffinity: str) -> str:
    return _CUBE.format(name=name).replace("/>", f' contype="{contype}" conaffinity="{conaffinity}"/>')


def _first(blocks: Mapping[str, str], count: int) -> dict[str, str]:
    return dict(list(blocks.items())[:count])


def _chain(names: str, **words: Any) -> dict[str, Any]:
    """Return objects each of which is on the one before it, the first one on the floor."""
    first = {word: value for word, value in words.items() if word == "orientation"}
    return {a: {"on": b, **(words if b != "floor" else first)} for b, a in zip(("floor", *names), names, strict=False)}


def _on_bench(name: str) -> dict[str, Any]:
    return {"bench": {"kind": "static"}, name: {"on": "bench"}}


def _on(asset: str, support: str) -> dict[str, str]:
    return {"asset": asset, "on": support}


def _shipped(objects: Mapping[str, Any]) -> StackScene:
    """Return a scene of assets of this project."""
    return StackScene(0, "<mujoco/>", {}, objects, words={"floor": {"size": [1.0, 1.0]}})


def _scene(
    geoms: Mapping[str, str],
    objects: Mapping[str, Any],
    *,
    furniture: str = _BENCH,
    gravity: str = "0 0 -9.81",
    option: str = "",
    rest: str = "",
    words: Mapping[str, str] | None = None,
) -> StackScene:
    """Return a scene of free bodies on a floor, or on something that is there."""
    needed = furniture if "bench" in objects or "beam" in objects else ""
    extra = words or {}
    bodies = "".join(
        f'<body name="{name}" pos="{5 + i} 0 2" {extra.get(name, "")}><freejoint/>{text}</body>'
        for i, (name, text) in enumerate(geoms.items())
    )
    model = (
        f'<mujoco><option gravity="{gravity}">{option}</option><worldbody>{needed}{bodies}</worldbody>{rest}</mujoco>'
    )
    return StackScene(0, model, {}, objects, words={"floor": {"size": [0.6, 0.6]}})
