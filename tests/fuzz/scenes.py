"""Scenes gone wrong: small ones whose values are replaced, by the config's own fields, and models whose numbers are."""

from __future__ import annotations

import copy
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.section import Section
from tests.fuzz.values import number, value

_CRATE = """<mujoco><worldbody><body name="{0}"><geom type="box" size=".03 .02 .04" pos="0 0 .04"/></body></worldbody>
</mujoco>"""
_SHELF = """<mujoco><worldbody><body name="shelf"><geom type="box" size=".2 .1 .01" pos="0 0 .01"/>
  <body name="tray" pos="0 0 .1"><joint name="slide" type="slide" axis="0 1 0" range="0 .1"/>
    <geom type="box" size=".2 .1 .01"/></body></body></worldbody></mujoco>"""
_MODEL = """<mujoco><option timestep="{}" gravity="0 0 {}"/><worldbody>
  <geom type="plane" size="1 1 .1"/>
  <body name="mug" pos="{} 0 {}"><freejoint/>
    <geom type="box" size="{} .02 .03" friction="{} 1 1" pos="{} 0 0" margin="{}"/></body>
  <body name="arm" pos="1 1 1"><joint name="turn" type="hinge" limited="true" range="{} {}"/>
    <geom type="sphere" size="{}" mass="{}"/></body>
</worldbody></mujoco>"""
_SANE = (0.002, -9.81, 0.1, 0.1, 0.02, 1, 0, 0, -10, 10, 0.05, 1)


def write_assets(folder: Path) -> None:
    """Write what the scenes consist of."""
    for name in ("crate", "cup"):
        (folder / f"{name}.xml").write_text(_CRATE.format(name))
    (folder / "shelf.xml").write_text(_SHELF)


def base_scene(folder: Path) -> dict[str, Any]:
    """A scene in which every section of a scene file stands, and that can be made."""
    crate, shelf = str(folder / "crate.xml"), str(folder / "shelf.xml")
    return {
        "floor": {"size": [1.0, 1.0]},
        "bank": 2,
        "attempts": 20,
        "restarts": 4,
        "objects": {
            "shelf": {"asset": shelf, "kind": "fixture", "on": "floor", "joints": {"slide": {"fraction": [0.0, 1.0]}}},
            "apple": {"asset": crate, "on": "floor", "gap": 0.001, "clearance": 0.002, "orientation": {"yaw": [0, 90]}},
            "pear": {
                "asset": str(folder / "cup.xml"),
                "in": "shelf",
                "region": {"box": [[-0.2, -0.1], [0.2, 0.1]]},
                "orientation": {"stable": {"yaw": [-10, 10]}},
                "ratio_on_support": 0.5,
            },
            "plum": {
                "asset": crate,
                "on": "floor",
                "relations": [{"left_of": "apple", "angle": 80, "distance": {"min": 0.01, "max": 0.6}}],
            },
            "goal": {"kind": "marker", "region": {"box": [[-0.2, -0.2, 0.2], [0.2, 0.2, 0.4]]}},
        },
        "groups": {"some": {"of": ["apple"], "count": [1, 1]}},
    }


def fields(section: type[Section] = SceneConfig, depth: int = 0) -> Iterator[tuple[str, ...]]:
    """Paths of all keys that sections have, with `*` for a name or a place in a list."""
    for name, field in section.model_fields.items():
        key = field.alias or name
        yield (key,)
        for part, stars in _sections(field.annotation):
            if depth < 4:
                yield from ((key, *["*"] * stars, *rest) for rest in fields(part, depth + 1))


def _sections(kind: Any, stars: int = 0) -> Iterator[tuple[type[Section], int]]:
    if isinstance(kind, type) and issubclass(kind, Section):
        yield kind, stars
    origin = typing.get_origin(kind)
    inside = stars + (origin in (dict, tuple, list))
    if origin in (dict, tuple, list, typing.Union, types.UnionType, typing.Annotated):
        for argument in typing.get_args(kind):
            yield from _sections(argument, inside)


FIELDS = tuple(dict.fromkeys(fields()))


def wrong_scene(draws: np.random.Generator, folder: Path) -> dict[str, Any]:
    """The base scene with one to three values replaced, removed, or put where they do not belong."""
    scene = copy.deepcopy(base_scene(folder))
    if draws.random() < 0.5:
        leaves = list(_numbers(scene))
        for _ in range(int(draws.integers(1, 4))):
            part, key = leaves[int(draws.integers(len(leaves)))]
            part[key] = number(draws)
        return scene
    for _ in range(1 if draws.random() < 0.7 else 3):
        path = FIELDS[int(draws.integers(len(FIELDS)))]
        _put(scene, path, draws)
    return scene


def _numbers(part: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the place of each number in a scene, as its container and its key."""
    for key, inside in part.items() if isinstance(part, dict) else enumerate(part):
        if isinstance(inside, dict | list):
            yield from _numbers(inside)
        elif isinstance(inside, int | float):
            yield part, key


def _put(part: Any, path: tuple[str, ...], draws: np.random.Generator) -> None:
    for key in path[:-1]:
        if isinstance(part, dict) and part:
            names = list(part)
            wanted = names[int(draws.integers(len(names)))] if key == "*" else key
            part = part.setdefault(wanted, {})
        elif isinstance(part, list) and part:
            part = part[int(draws.integers(len(part)))]
    if isinstance(part, dict):
        if draws.random() < 0.1:
            part.pop(path[-1], None)
        elif draws.random() < 0.8 and isinstance(part.get(path[-1]), int | float | list):
            part[path[-1]] = _shaken(part[path[-1]], draws)
        else:
            part[path[-1]] = value(draws)


def _shaken(kept: Any, draws: np.random.Generator) -> Any:
    """The same form with another number in it."""
    if isinstance(kept, list) and kept:
        i = int(draws.integers(len(kept)))
        return [_shaken(part, draws) if k == i else part for k, part in enumerate(kept)]
    return number(draws)


def wrong_model(draws: np.random.Generator, folder: Path) -> dict[str, Any]:
    """A model of one's own with some numbers replaced."""
    numbers = [n if draws.random() < 0.85 else float(np.float64(_finite(number(draws)))) for n in _SANE]
    path = folder / "own.xml"
    path.write_text(_MODEL.format(*numbers))
    turned = {"kind": "static", "joints": {"turn": {"fraction": [0, 1]}}}
    words = {"floor": {"size": [1, 1]}, "bank": 2}
    return {"model": str(path), "objects": {"mug": {"on": "floor"}, "arm": turned}, **words}


def _finite(found: Any) -> float:
    try:
        return float(found)
    except OverflowError:
        return 1e308
