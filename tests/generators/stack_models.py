"""Random scenes of 2 to 8 foreign things that stand on each other, on tables and shelves, in trays and in drawers.

Scene i is a function of its seed. Its model is MJCF, its meshes are OBJ files, and every thing has a level foot.
Nothing rolls: what is round stands upright.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

CARRIERS = ("table", "shelf", "drawer", "tray")
SHAPES = ("box", "cylinder", "prism", "frustum", "tee", "bridge", "stool", "hull")
_OFTEN = (0.2, 0.14, 0.14, 0.14, 0.12, 0.12, 0.1, 0.04)
"""How often each shape comes; nothing stands on a hull, so it ends a chain."""
_COLUMN, _WIDE = 0.035, 0.12
"""Least and greatest width [m] of a thing that stands on the ground floor."""
_SAFE = 0.6
"""Share of the things that stand well inside of what carries them, so that high stacks come about."""


@dataclass(frozen=True)
class StackScene:
    """A scene as its author writes it.

    Attributes:
        seed: Its seed.
        model: The MJCF.
        meshes: File name -> text of an OBJ file.
        objects: The words of its objects.
        features: The carrier, the shapes, and "high" for a chain of more than three things.
        words: Other words of the scene.
    """

    seed: int
    model: str
    meshes: Mapping[str, str]
    objects: Mapping[str, Any]
    features: frozenset[str] = frozenset()
    words: Mapping[str, Any] = field(default_factory=dict)

    def write(self, folder: Path) -> dict[str, Any]:
        """Write the files of the model to a folder, and return the scene."""
        for name, text in {"model.xml": self.model, **self.meshes}.items():
            (folder / name).write_text(text)
        return {"model": str(folder / "model.xml"), "objects": dict(self.objects), **self.words}


@dataclass
class Thing:
    """A thing that may carry others.

    Attributes:
        geoms: Its geoms as MJCF.
        top: Least width of its top [m]; 0 if nothing stands on it.
        words: How it is turned.
        depth: Number of free things up to it, with itself.
        span: Greatest width [m].
    """

    geoms: str
    top: float
    words: dict[str, Any]
    depth: int = 0
    span: float = 0.0


class Maker:
    """Random numbers and shapes; what they have is in `features`, and meshes are in `meshes` as OBJ files by name."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng((seed, 35))
        self.meshes: dict[str, str] = {}
        self.features: set[str] = set()

    def uniform(self, low: float, high: float) -> float:
        """Return a number between two."""
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """Return true in this share of the calls."""
        return bool(self.rng.random() < share)

    def thing(self, name: str, width: float) -> Thing:
        """Return a thing of about this width [m]."""
        shape = str(self.rng.choice(SHAPES, p=_OFTEN))
        self.features.add(shape)
        made = getattr(self, f"_{shape}")(name, width)
        made.span = width
        return made

    def mesh(self, name: str, points: np.ndarray) -> str:
        """Keep the convex hull of points (n, 3) as an OBJ file; return its geom."""
        hull = ConvexHull(points)
        corners = {int(v): i + 1 for i, v in enumerate(hull.vertices)}
        lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in points[hull.vertices]]
        for simplex, normal in zip(hull.simplices, hull.equations[:, :3], strict=True):
            a, b, c = points[simplex]
            turned = simplex if np.cross(b - a, c - a) @ normal > 0 else simplex[::-1]
            lines.append("f " + " ".join(str(corners[int(v)]) for v in turned))
        self.meshes[f"{name}.obj"] = "\n".join(lines) + "\n"
        return f'<geom name="{name}_hull" type="mesh" mesh="{name}"/>'

    def _box(self, name: str, width: float) -> Thing:
        x, y, z = width, width * self.uniform(0.5, 1.0), width * self.uniform(0.3, 1.6)
        return Thing(box_geom(name, (0, 0, z / 2), (x, y, z)), y, self._turned())

    def _cylinder(self, name: str, width: float) -> Thing:
        z = width * self.uniform(0.3, 1.6)
        geom = f'<geom name="{name}_round" type="cylinder" size="{width / 2:.6f} {z / 2:.6f}" pos="0 0 {z / 2:.6f}"/>'
        return Thing(geom, 0.7 * width, {})

    def _prism(self, name: str, width: float) -> Thing:
        n, z = int(self.rng.integers(3, 9)), width * self.uniform(0.3, 1.6)
        turn = 2 * np.pi * np.arange(n) / n
        ring = 0.5 * width * np.column_stack([np.cos(turn), np.sin(turn)])
        points = np.vstack([np.column_stack([ring, np.full(n, height)]) for height in (0, z)])
        return Thing(self.mesh(name, points), 0.5 * width, {})

    def _frustum(self, name: str, width: float) -> Thing:
        """Two level polygons, the upper one smaller or larger and shifted, as far as it stands by itself."""
        z, layers = width * self.uniform(0.4, 1.2), []
        for height, scale in ((0.0, 1.0), (z, self.uniform(0.6, 1.2))):
            turn = np.sort(self.rng.uniform(0, 0.6, 6) + np.arange(6)) * np.pi / 3
            ring = 0.5 * width * scale * np.column_stack([np.cos(turn), np.sin(turn)])
            shift = self.rng.uniform(-0.15, 0.15, 2) * width * (height > 0)
            layers.append(np.column_stack([ring + shift, np.full(6, height)]))
        return Thing(self.mesh(name, np.vstack(layers)), 0.45 * width, {})

    def _hull(self, name: str, width: float) -> Thing:
        """The hull of random points in any pose in which it rests; nothing stands on it."""
        points = self.rng.normal(size=(12, 3))
        points *= (0.5 * width / np.linalg.norm(points, axis=1))[:, None]
        return Thing(self.mesh(name, points * [1.0, 0.8, 0.7]), 0.0, {"orientation": "stable"})

    def _tee(self, name: str, width: float) -> Thing:
        """A plate on a post."""
        z, post = width * self.uniform(0.4, 1.0), width * self.uniform(0.4, 0.8)
        geoms = box_geom(f"{name}_post", (0, 0, z / 2), (post, post, z))
        plate = box_geom(f"{name}_plate", (0, 0, z + 0.005), (width, width, 0.01))
        return Thing(geoms + plate, width, {})

    def _bridge(self, name: str, width: float) -> Thing:
        """A plate on two walls."""
        z, thick = width * self.uniform(0.3, 0.8), 0.25 * width
        side = 0.5 * (width - thick)
        walls = [
            box_geom(f"{name}_wall{i}", (x, 0, z / 2), (thick, 0.8 * width, z)) for i, x in enumerate((-side, side))
        ]
        plate = box_geom(f"{name}_plate", (0, 0, z + 0.005), (width, 0.8 * width, 0.01))
        return Thing("".join(walls) + plate, 0.8 * width, {})

    def _stool(self, name: str, width: float) -> Thing:
        """A round seat on three or four legs."""
        n, z, leg = int(self.rng.integers(3, 5)), width * self.uniform(0.3, 0.8), 0.1 * width
        turn = 2 * np.pi * np.arange(n) / n
        legs = [
            f'<geom name="{name}_leg{i}" type="cylinder" size="{leg:.6f} {z / 2:.6f}" '
            f'pos="{0.36 * width * np.cos(a):.6f} {0.36 * width * np.sin(a):.6f} {z / 2:.6f}"/>'
            for i, a in enumerate(turn)
        ]
        seat = f'<geom name="{name}_seat" type="cylinder" size="{width / 2:.6f} .005" pos="0 0 {z + 0.005:.6f}"/>'
        return Thing("".join(legs) + seat, 0.7 * width, {})

    def place(self, onto: str, side: str, thing: Thing, things: Mapping[str, Thing]) -> dict[str, Any]:
        """Return words that put a thing on another one: on one side of it, near its middle, or anywhere."""
        words: dict[str, Any] = {"on": onto}
        if side:
            x0, x1 = (0.1, 0.3) if side == "left" else (0.7, 0.9)
            words["region"] = {"fraction": [[x0, 0.2], [x1, 0.8]]}
        elif self.chance(_SAFE):
            words["region"] = {"fraction": [[0.4, 0.4], [0.6, 0.6]]}
        elif thing.span < 0.7 * things[onto].top and self.chance(0.5):
            words["ratio_on_support"] = 1.0
        elif thing.span < 0.9 * things[onto].top and self.chance(0.5):
            words["ratio_on_support"] = 0.5
        return words

    def _turned(self) -> dict[str, Any]:
        return {"orientation": "stable"} if self.chance(0.2) else {}


def make(seed: int) -> StackScene:
    """Return the scene of a seed."""
    maker = Maker(seed)
    carrier = CARRIERS[int(maker.rng.integers(len(CARRIERS)))]
    count = int(maker.rng.integers(2, 9))
    bodies, objects = [], {}
    fixed, places, trays = _carrier(maker, carrier)
    objects.update(fixed)
    bodies += trays
    count -= len(trays)
    things: dict[str, Thing] = {}
    open_places: list[tuple[str, str]] = []
    branching = 0.0 if maker.chance(0.3) else maker.uniform(0.0, 0.6)
    for i in range(max(count, 1)):
        name = f"thing{i}"
        onto, side = None, ""
        if open_places and not maker.chance(0.5 * branching):
            onto, side = open_places.pop(-1 if maker.chance(0.7) else int(maker.rng.integers(len(open_places))))
        thing = maker.thing(name, width_on(maker, things[onto].top if onto else None, side))
        thing.depth = things[onto].depth + 1 if onto else 1
        words = maker.place(onto, side, thing, things) if onto else places[int(maker.rng.integers(len(places)))]
        things[name], objects[name] = thing, {**thing.words, **words}
        bodies.append(_body(name, thing.geoms, maker.uniform(100.0, 3000.0), maker.uniform(-0.05, 0.05)))
        if thing.top > 0.06 and maker.chance(branching):
            open_places += [(name, "left"), (name, "right")]
        elif thing.top > 0.025:
            open_places.append((name, ""))
    if max(t.depth for t in things.values()) > 3:
        maker.features.add("high")
    features = frozenset({carrier, *maker.features})
    return StackScene(seed, _model(maker, _FURNITURE, bodies), maker.meshes, objects, features)


_FURNITURE = """
    <body name="table"><geom name="table" type="box" size=".4 .4 .2" pos="0 0 .2"/></body>
    <body name="shelf" pos="2 0 0">
      <geom name="board0" type="box" size=".3 .2 .01" pos="0 0 .1"/>
      <geom name="board1" type="box" size=".3 .2 .01" pos="0 0 .8"/>
      <geom name="side0" type="box" size=".01 .2 .8" pos="-.31 0 .8"/>
      <geom name="side1" type="box" size=".01 .2 .8" pos=".31 0 .8"/></body>
    <body name="cabinet" pos="4 0 0"><geom name="case" type="box" size=".2 .25 .15" pos="0 0 .15"/>
      <body name="drawer" pos="0 0 .35"><joint name="slide" type="slide" axis="0 -1 0" range="0 .4" damping="5"
        frictionloss="20"/>
        <geom name="bottom" type="box" size=".18 .2 .01"/>
        <geom name="front" type="box" size=".18 .01 .05" pos="0 -.21 .05"/>
        <geom name="back" type="box" size=".18 .01 .05" pos="0 .21 .05"/>
        <geom name="left" type="box" size=".01 .22 .05" pos="-.19 0 .05"/>
        <geom name="right" type="box" size=".01 .22 .05" pos=".19 0 .05"/></body></body>"""


def width_on(maker: Maker, room: float | None, side: str) -> float:
    """Return the width [m] of a thing on the ground floor (`room` None), on something, or on one side of something."""
    low, high = (_COLUMN, _WIDE) if room is None else (0.3 * room, 0.5 * room) if side else (0.5 * room, 1.3 * room)
    return min(max(maker.uniform(low, high), 0.025), _WIDE)


def _carrier(maker: Maker, carrier: str) -> tuple[dict[str, Any], list[dict[str, Any]], list[str]]:
    """Return the words of a carrier and of things on it, in one or several places, and free bodies of its own."""
    if carrier == "table":
        return {"table": {"kind": "static"}}, [{"on": "table"}], []
    if carrier == "shelf":
        return {"shelf": {"kind": "static"}}, [{"in": "shelf"}, {"on": "shelf"}, {"inside": "shelf"}], []
    if carrier == "drawer":
        words = {"kind": "static", "joints": {"slide": {"fraction": [0.3, 1.0]}}}
        return {"cabinet": words}, [{"on": "cabinet/drawer"}], []
    wall = [
        box_geom(f"rim{i}", (x, y, 0.025), (0.01 if x else 0.3, 0.3 if x else 0.01, 0.03))
        for i, (x, y) in enumerate([(-0.155, 0), (0.155, 0), (0, -0.155), (0, 0.155)])
    ]
    geoms = box_geom("tray_floor", (0, 0, 0.005), (0.32, 0.32, 0.01)) + "".join(wall)
    words = {"tray": {"on": "table", "ratio_on_support": 1.0 if maker.chance(0.7) else 0.0}}
    return {"table": {"kind": "static"}, **words}, [{"in": "tray"}], [_body("tray", geoms, 500.0, 0.0)]


def box_geom(name: str, pos: tuple[float, ...], size: tuple[float, ...]) -> str:
    """Return a box with full edge lengths `size` [m]."""
    half, at = (" ".join(f"{v:.6f}" for v in values) for values in (np.array(size) / 2, pos))
    return f'<geom name="{name}_box" type="box" size="{half}" pos="{at}"/>'


def _body(name: str, geoms: str, density: float, shift: float) -> str:
    """Return a free body whose frame is shifted from its foot [m]; densities are in kg/m3."""
    dense = geoms.replace("<geom ", f'<geom density="{density:.1f}" ')
    return f'<body name="{name}" pos="0 0 9"><freejoint/><frame pos="{shift:.4f} 0 0">{dense}</frame></body>'


def _model(maker: Maker, furniture: str, bodies: list[str]) -> str:
    timestep = maker.rng.choice(["0.001", "0.002", "0.004"])
    solref = maker.rng.choice(["0.02 1", "0.02 1", "0.01 1", "0.03 1.2"])
    flags = '<flag multiccd="enable"/>' if maker.chance(0.125) else ""
    meshes = "".join(f'<mesh name="{file[:-4]}" file="{file}"/>' for file in maker.meshes)
    apart = [body.replace('pos="0 0 9"', f'pos="{10 + i} 0 9"', 1) for i, body in enumerate(bodies)]
    return (
        f'<mujoco><option timestep="{timestep}">{flags}</option><default><geom solref="{solref}"/></default>'
        f"<asset>{meshes}</asset><worldbody>{furniture}{''.join(apart)}</worldbody></mujoco>"
    )
