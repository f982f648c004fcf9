"""Things of mixed scenes, each as the MJCF of an asset: with level feet, with curved feet, with joints, or shipped."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.generators.stack_models import Maker, box_geom

SHIPPED = (
    *("apple", "banana", "block", "book", "bottle", "bowl", "brick", "can", "cereal_box", "glass", "lemon", "mug"),
    *("orange", "pan", "pear", "peg", "plate", "spatula", "tin"),
)
TOPS = {"block": 0.045, "book": 0.15, "can": 0.05, "tin": 0.06, "cereal_box": 0.065, "peg": 0.04}
"""Shipped things that carry others, and the width of their tops [m]."""
CURVED = ("ball", "egg", "pill", "dome", "drum", "roller", "disc")
JOINTED = ("laptop", "oven", "dresser", "jack", "pendulum")


@dataclass
class MixedThing:
    """A thing of a scene.

    Attributes:
        words: Its words, without those that place it; files are in FOLDER.
        top: Width of its top [m]; 0 if nothing stands on it.
        span: Its own width [m].
        features: What it has.
        joints: Names of its joints.
    """

    words: dict[str, Any]
    top: float
    span: float
    features: set[str]
    joints: list[str] = field(default_factory=list)


class ThingMaker:
    """Makes things; their files are in `files` by name.

    Args:
        maker: Random numbers, and shapes with level feet.
    """

    def __init__(self, maker: Maker) -> None:
        self._maker = maker
        self.files: dict[str, str] = {}

    def make(self, name: str, width: float) -> MixedThing:
        """Return a thing of about this width [m]."""
        kind = self._maker.rng.choice(["shipped", "level", "curved", "jointed"], p=[0.45, 0.2, 0.2, 0.15])
        return getattr(self, f"_{kind}")(name, width)

    def _shipped(self, name: str, width: float) -> MixedThing:
        asset = str(self._maker.rng.choice(SHIPPED))
        words: dict[str, Any] = {"asset": asset}
        if self._maker.chance(0.2):
            words["scale"] = round(self._maker.uniform(0.7, 1.4), 2)
        if self._maker.chance(0.2):
            words["orientation"] = "stable"
        top = TOPS.get(asset, 0.0) if "orientation" not in words else 0.0
        return MixedThing(words, top * words.get("scale", 1.0), 0.1, {"shipped"})

    def _level(self, name: str, width: float) -> MixedThing:
        thing = self._maker.thing(name, width)
        density = f'density="{self._maker.uniform(100.0, 3000.0):.1f}"'
        path = self._file(name, thing.geoms.replace("<geom ", f"<geom {density} "))
        return MixedThing({"asset": path, **thing.words}, thing.top, width, {"level"})

    def _curved(self, name: str, width: float) -> MixedThing:
        """Return a thing with a round foot or top; some of them are upright by a low centre of mass."""
        kind, r = str(self._maker.rng.choice(CURVED)), 0.5 * width
        uniform, chance = self._maker.uniform, self._maker.chance
        h, off = uniform(0.15, 1.5) * r, uniform(-0.1, 0.1) * r * chance(0.5)

        def geom(part: str, shape: str, size: tuple[float, ...], pos: tuple[float, ...], more: str = "") -> str:
            numbers = (" ".join(f"{v:.6f}" for v in values) for values in (size, pos))
            return '<geom name="{}_{}" type="{}" size="{}" pos="{}" {}/>'.format(name, part, shape, *numbers, more)

        def ballast(z: float) -> str:
            return geom("ballast", "sphere", (0.2 * r,), (off, 0, z), 'density="9000"')

        ball = geom("ball", "sphere", (r,), (0, 0, r), f'density="{uniform(50, 800):.1f}"')
        egg = geom("egg", "ellipsoid", (r, r, uniform(0.6, 1.4) * r), (0, 0, 0))
        lid = box_geom(f"{name}_lid", (0, 0, 2 * r), (width, width, 0.01))
        post = geom("post", "cylinder", (0.6 * r, h), (0, 0, h))
        geoms, top = {
            "ball": (ball + ballast(0.3 * r) * chance(0.5), 0.0),
            "egg": (egg + ballast(-0.3 * r) * chance(0.5), 0.0),
            "pill": (geom("pill", "capsule", (r, r), (0, 0, 2 * r)) + ballast(0.3 * r), 0.0),
            "dome": (ball + ballast(0.3 * r) + lid, width),
            "drum": (geom("drum", "cylinder", (r, h), (0, 0, h)), 0.7 * width),
            "roller": (geom("roller", "cylinder", (r, h), (0, 0, r), 'euler="90 0 0"'), 0.0),
            "disc": (post + geom("disc", "cylinder", (r, 0.006), (0, 0, 2 * h + 0.006)), 0.7 * width),
        }[kind]
        return MixedThing({"asset": self._file(name, geoms)}, top, width, {"curved", kind})

    def _jointed(self, name: str, width: float) -> MixedThing:
        """Return a thing whose joints are drawn; dry friction holds them."""
        kind = str(self._maker.rng.choice(JOINTED))
        w, h, t = width, width * self._maker.uniform(0.4, 1.0), 0.008
        base = box_geom(f"{name}_base", (0, 0, h / 2), (w, w, h))
        mass = f'density="{self._maker.uniform(100, 3000):.1f}"'
        axis, place, limits, part, kept = {
            "laptop": ("0 1 0", (-w / 2, 0, h + t), "-110 0", ((w / 2, 0, 0), (w, w, t)), True),
            "oven": ("0 -1 0", (w / 2 + t, 0, 0.6 * h), "0 150", ((0, 0, 0.3 * w), (t, w, 0.6 * w)), False),
            "dresser": ("1 0 0", (0, 0, h + t + 0.03), "0 .9", ((0, 0, 0), (w, 0.8 * w, 0.04)), True),
            "jack": ("0 0 1", (w / 2 + 2 * t, 0, 0.7 * h), "-1 0.2", ((0, 0, 0), (t, t, 0.5 * h)), False),
            "pendulum": ("0 1 0", (0, 0, h + 0.02), "-100 100", ((0, 0, 0.4 * w), (0.2 * w, 0.2 * w, 0.8 * w)), False),
        }[kind]
        slides = kind in ("dresser", "jack")
        if slides:
            limits = " ".join(f"{float(v) * w:.5f}" for v in limits.split())
        joint = f'<joint name="{name}_joint" type="{"slide" if slides else "hinge"}" axis="{axis}" range="{limits}"'
        held = 'limited="true" damping="5" frictionloss="20" armature="0.001"/>'
        inner = box_geom(f"{name}_part", *part).replace("<geom ", f"<geom {mass} ")
        at = " ".join(f"{v:.6f}" for v in place)
        body = f'{base}<body name="{name}_moving" pos="{at}">{joint} {held}{inner}</body>'
        low = float(np.round(self._maker.uniform(0.0, 0.6), 2))
        joints = {f"{name}_joint": {"fraction": [low, float(np.round(self._maker.uniform(low, 1.0), 2))]}}
        words: dict[str, Any] = {"asset": self._file(name, body), "joints": joints}
        return MixedThing(words, w if kept and kind == "laptop" else 0.0, w, {"jointed", kind}, [f"{name}_joint"])

    def _file(self, name: str, geoms: str) -> str:
        """Keep an asset, with the meshes that it has; return its path."""
        own = [file for file in self._maker.meshes if file.startswith(f"{name}.")]
        meshes = "".join(f'<mesh name="{file[:-4]}" file="{file}"/>' for file in own)
        self.files[f"{name}.xml"] = (
            f'<mujoco><asset>{meshes}</asset><worldbody><body name="{name}">{geoms}</body></worldbody></mujoco>'
        )
        return f"FOLDER/{name}.xml"
