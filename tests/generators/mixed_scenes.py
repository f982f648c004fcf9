"""Random scenes that mix all that may meet: stacks, variants, drawn physics and joints, starts, tight regions, groups.

Scene i is a function of its seed. A third are the stacks of `stack_models` with draws and groups, a few are shipped
scenes with draws and starts, and the others are things of `mixed_things` on shipped furniture, some with an arm.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.generators import stack_models
from tests.generators.mixed_things import SHIPPED, MixedThing, ThingMaker
from tests.generators.stack_models import Maker

HELD = ("apple", "banana", "block", "bottle", "brick", "can", "glass", "lemon", "mug", "orange", "pear", "peg")
CARRIERS: dict[str, tuple[dict[str, Any], tuple[dict[str, Any], ...]]] = {
    "ground": ({}, ({"on": "floor"},)),
    "table": ({"asset": "table", "kind": "static"}, ({"on": "carrier"},)),
    "dining_table": ({"asset": "dining_table", "kind": "fixture"}, ({"on": "carrier"},)),
    "counter": ({"asset": "counter", "kind": "static"}, ({"on": "carrier"}, {"on": "carrier/sink"})),
    "shelf": ({"asset": "shelf", "kind": "fixture"}, ({"in": "carrier"}, {"on": "carrier"}, {"inside": "carrier"})),
    "cupboard": ({"asset": "cupboard", "kind": "static"}, ({"in": "carrier"}, {"on": "carrier"})),
    "cabinet": ({"asset": "cabinet", "kind": "static"}, ({"in": "carrier/upper_drawer"}, {"on": "carrier"})),
    "free cabinet": ({"asset": "cabinet"}, ({"in": "carrier/upper_drawer"}, {"on": "carrier"})),
    "free chest": ({"asset": "chest"}, ({"on": "carrier/lid"}, {"on": "floor"})),
}
"""Furniture by name: its words, and places on it."""
BASES: dict[str, tuple[tuple[str, ...], str, str]] = {
    "drawer_open_pick": (("apple", "banana"), "banana", "upper_handle*"),
    "drawer_pick": (("apple", "banana"), "", ""),
    "tabletop_lift": (("can", "lemon", "block", "tin"), "can", ""),
    "tabletop_lift_any": (("target", "first", "second"), "target", ""),
    "clutter": (("mug", "apple", "book", "pan"), "", ""),
    "kitchen": (("bottle", "pan", "book", "lemon", "plate"), "", ""),
    "table_top": (("mug", "banana"), "", ""),
}
"""Shipped scenes by name: free objects, what the arm may hold, and the handles that it may hold, if there are some."""
_JOINTS = {"cupboard": "door", "cabinet": "upper", "free cabinet": "*", "free chest": "lid"}
_FREE = ("cabinet", "chest")
_ARMS = {"robot": {"asset": "panda", "base": [0.0, -0.36, 0.4], "yaw": 90}}
_BEFORE_THE_ARM = {"box": [[-0.24, -0.01], [0.24, 0.24]]}


@dataclass(frozen=True)
class MixedScene:
    """A scene as its author writes it.

    Attributes:
        seed: Its seed.
        words: The scene, in which FOLDER stands for the folder of its files.
        files: Text by name of file.
        features: What it mixes.
    """

    seed: int
    words: Mapping[str, Any]
    files: Mapping[str, str]
    features: frozenset[str]

    def write(self, folder: Path) -> dict[str, Any]:
        """Write its files to a folder, and return the scene."""
        for name, text in self.files.items():
            (folder / name).write_text(text)
        return json.loads(json.dumps(self.words).replace("FOLDER", str(folder)))


def make(seed: int) -> MixedScene:
    """Return the scene of a seed."""
    mixer = _Mixer(seed)
    kind = mixer.rng.choice(["stacks", "based", "furnished"], p=[0.3, 0.1, 0.6])
    scene = getattr(mixer, str(kind))()
    mixer.draw_physics(scene)
    mixer.make_tight(scene)
    return MixedScene(seed, scene, mixer.files, frozenset(mixer.features))


class _Mixer:
    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._maker = Maker(1_000_000 + seed)
        self._things = ThingMaker(self._maker)
        self._jointed: dict[str, bool] = {}
        self.features: set[str] = set()
        self._own_files: dict[str, str] = {}
        self.chance, self.uniform, self.rng = self._maker.chance, self._maker.uniform, self._maker.rng

    @property
    def files(self) -> dict[str, str]:
        return {**self._own_files, **self._things.files, **self._maker.meshes}

    def stacks(self) -> dict[str, Any]:
        """Return random stacks on foreign furniture."""
        made = stack_models.make(self._seed)
        self.features |= {"stack", "own model"}
        self._own_files = {"model.xml": made.model, **made.meshes}
        return {"model": "FOLDER/model.xml", "objects": json.loads(json.dumps(made.objects))}

    def based(self) -> dict[str, Any]:
        """Return a shipped scene, with starts where it has an arm and something to grasp."""
        name = str(self.rng.choice(list(BASES)))
        free, target, handle = BASES[name]
        self.features |= {"based", name}
        scene: dict[str, Any] = {"base": name, "objects": {each: {} for each in free}}
        if target and self.chance(0.8):
            self._add_starts(scene, target, handle)
        return scene

    def furnished(self) -> dict[str, Any]:
        """Return things on furniture, and on each other; on a table also before an arm."""
        arm = self.chance(0.3)
        carrier = "table" if arm else str(self.rng.choice(list(CARRIERS)))
        words, places = CARRIERS[carrier]
        self.features.add(carrier)
        objects: dict[str, Any] = {}
        scene: dict[str, Any] = {"floor": {"size": [2.4, 2.0]}, "objects": objects}
        if words:
            standing = {"on": "floor", "region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}}
            objects["carrier"] = {**words, **({} if words.get("kind") == "static" else standing)}
            self._jointed["carrier"] = carrier in _JOINTS
        if carrier in _JOINTS and (self.chance(0.7) or carrier == "free chest"):
            low = 0.0 if carrier == "free chest" else self.uniform(0.0, 0.6)
            ends = [low, 0.0] if carrier == "free chest" else [round(low, 2), round(self.uniform(low, 1.0), 2)]
            objects["carrier"]["joints"] = {_JOINTS[carrier]: {"fraction": ends}}
            self.features.add("joints")
        if arm:
            self._add_arm(scene)
        self._add_things(scene, places, before_arm=arm)
        if not arm and self.chance(0.15):
            self._add_tower(scene, places[0])
        if self.chance(0.06):
            scene["geometry"] = "visual"
            self.features.add("visual")
        return scene

    def _add_tower(self, scene: dict[str, Any], place: dict[str, Any]) -> None:
        """Add a stack of two to four things by the word for it."""
        self.features.add("tower")
        names = [f"tower{i}" for i in range(int(self.rng.integers(2, 5)))]
        lower = [str(asset) for asset in self.rng.choice(["book", "block", "can", "tin", "cereal_box"], len(names) - 1)]
        for name, asset in zip(names, [*lower, str(self.rng.choice(SHIPPED))], strict=True):
            scene["objects"][name] = {"asset": asset}
        scene["stacks"] = {"tower": {"of": names, "on": next(iter(place.values()))}}
        if self.chance(0.5):
            scene["stacks"]["tower"]["offset"] = [0.0, 0.01]

    def _add_things(self, scene: dict[str, Any], places: tuple[dict[str, Any], ...], *, before_arm: bool) -> None:
        """Add two to seven things, some of them on others, some with variants, some that may be absent."""
        objects, tops = scene["objects"], dict[str, float]()
        names = [f"thing{i}" for i in range(int(self.rng.integers(1, 4) if before_arm else self.rng.integers(2, 8)))]
        carrying = set[str]()
        for name in names:
            onto = str(self.rng.choice(list(tops))) if tops and self.chance(0.45) else None
            width = self.uniform(0.04, 0.12) if onto is None else self.uniform(0.5, 1.2) * tops[onto]
            thing = self._things.make(name, max(width, 0.025))
            self.features |= thing.features
            if self.chance(0.2):
                thing = self._with_variants(name, thing)
            objects[name] = {**thing.words, **self._place(onto, tops, places, before_arm=before_arm)}
            if self.chance(0.12):
                objects[name]["gap"] = round(self.uniform(0.0001, 0.0048), 4)
                self.features.add("gap")
            if onto is None and len(objects) > 2 and self.chance(0.12):
                objects[name]["relations"] = [{"near": list(objects)[-2], "distance": {"max": 0.4}}]
                self.features.add("near")
            self._jointed[name] = bool(thing.joints)
            if onto is not None:
                self.features.add("stack")
                carrying.add(onto)
                tops.pop(onto)
            if thing.top > 0.03:
                tops[name] = thing.top
        leaves = [name for name in names if name not in carrying and "variants" not in objects[name]]
        if len(leaves) > 1 and self.chance(0.15):
            self.features.add("group")
            scene["groups"] = {"some": {"of": leaves[:3], "count": [0, len(leaves[:3])]}}

    def _with_variants(self, name: str, thing: MixedThing) -> MixedThing:
        """Return a thing as one of two to four variants."""
        members: dict[str, Any] = {}
        for i in range(int(self.rng.integers(2, 5))):
            if self.chance(0.75) or thing.joints:
                other: dict[str, Any] = {"asset": str(self.rng.choice(SHIPPED))}
            else:
                other = self._things.make(f"{name}_{i}", thing.span).words
            members[f"v{i}"] = {word: value for word, value in other.items() if word != "joints"}
            if self.chance(0.2):
                members[f"v{i}"]["weight"] = 3.0
        if not thing.joints:
            members["own"] = thing.words
        self.features.add("variants")
        return MixedThing({"variants": members}, 0.0, thing.span, thing.features)

    def _place(
        self, onto: str | None, tops: dict[str, float], places: tuple[dict[str, Any], ...], *, before_arm: bool
    ) -> dict[str, Any]:
        """Return words that put a thing on another one, or on the furniture."""
        if onto is not None:
            words: dict[str, Any] = {"on": onto}
            if self.chance(0.4):
                words["region"] = {"fraction": [[0.35, 0.35], [0.65, 0.65]]}
            return words
        words = dict(places[int(self.rng.integers(len(places)))])
        if self.chance(0.3):
            words["ratio_on_support"] = float(self.rng.choice([0.5, 1.0]))
        if before_arm and words["on"] == "carrier":
            words["region"] = _BEFORE_THE_ARM
        return words

    def _add_arm(self, scene: dict[str, Any]) -> None:
        """Add an arm behind a table, something to grasp, and kinds of starts."""
        scene["robot"] = {**_ARMS["robot"], "asset": str(self.rng.choice(["panda", "panda", "ur5e", "heron"]))}
        tier = str(self.rng.choice(["map", "clear"]))
        target: dict[str, Any] = {"on": "carrier", "reachable": tier, "region": _BEFORE_THE_ARM, "ratio_on_support": 1}
        if self.chance(0.3):
            assets = self.rng.choice(HELD, 3, replace=False)
            target["variants"] = {str(asset): {"asset": str(asset)} for asset in assets}
            self.features.add("variants")
        else:
            target["asset"] = str(self.rng.choice(HELD))
        scene["objects"]["target"] = target
        self._jointed["target"] = False
        if "asset" in target and self.chance(0.3):
            scene["objects"]["goal"] = {"kind": "marker", "on": "carrier", "region": _BEFORE_THE_ARM}
        self._add_starts(scene, "target", "")

    def _add_starts(self, scene: dict[str, Any], target: str, handle: str) -> None:
        """Add kinds of starts, and perhaps draws of the arm's physics."""
        kinds: list[dict[str, Any]] = [
            {},
            {"robot": "pregrasp", "of": target},
            {"robot": "grasp", "of": target},
            {"robot": "grasp", "of": target, "lift": [0.03, 0.2]},
            {"robot": "grasp", "of": target, "robot_joints": {"joint*": {"noise": 0.4}}},
        ]
        if handle:  # of a drawer, in which the target is
            joints = {"cabinet/upper": {"fraction": [0.9, 1.0]}}
            kinds = [{**kind, "joints": joints} if "of" in kind else kind for kind in kinds]
            kinds.append({"robot": "grasp", "of": "cabinet", "grasp": handle, "joints": joints})
        if "goal" in scene["objects"]:
            kinds.append({"place": {target: "goal"}})
        chosen = [kind for kind in kinds if self.chance(0.5)] or kinds[3:4]
        names = (kind.get("robot", "place" if "place" in kind else "home") for kind in chosen)
        self.features |= {"start", *(f"start {name}" for name in names)}
        self.features |= {"start held" for kind in chosen if "lift" in kind or "robot_joints" in kind}
        scene["start"] = chosen
        if self.chance(0.4):
            self.features.add("drawn robot")
            draws = {"friction": {"scale": [0.5, 1.2]}, "gains": {"scale": [0.6, 1.4]}}
            draws["forcerange"] = {"scale": [0.6, 1.0]}
            scene.setdefault("robot", {})["randomize"] = {word: d for word, d in draws.items() if self.chance(0.6)}

    def draw_physics(self, scene: dict[str, Any]) -> None:
        """Draw physics of some objects, and gravity."""
        for name, words in scene["objects"].items():
            if words.get("kind", "free") != "free" or name == "goal" or not self.chance(0.6):
                continue
            draws = self._draws()
            if self.chance(0.3):
                draws["mass"]["distribution"] = "log_uniform"
            likely = {"mass": 0.6, "ipos": 0.4, "friction": 0.4, "solref": 0.25, "solimp": 0.1, "frictionloss": 0.5}
            chosen = {word: draw for word, draw in draws.items() if self.chance(likely[word])}
            if not self._jointed.get(name):
                chosen.pop("frictionloss", None)
            if chosen:
                words["randomize"] = chosen
                self.features |= {f"drawn {word}" for word in chosen}
            if words.get("joints"):
                self.features.add("joints")
        if self.chance(0.1):
            scene["randomize"] = {"gravity": {"abs": [[0.0, 0.0, -10.5], [0.0, 0.0, -9.0]]}}
            self.features.add("drawn gravity")

    def _draws(self) -> dict[str, dict[str, Any]]:
        """Return draws of an object by word."""
        low, high = round(self.uniform(0.001, 0.012), 4), round(self.uniform(0.001, 0.012), 4)
        soft = [[round(self.uniform(0.005, 0.02), 4), 1.0], [round(self.uniform(0.02, 0.05), 4), 1.2]]
        return {
            "mass": {"scale": [round(self.uniform(0.2, 1.0), 2), round(self.uniform(1.0, 4.0), 2)]},
            "ipos": {"add": [[-low, -low, -0.003], [high, high, 0.003]]},
            "friction": {"scale": [round(self.uniform(0.2, 1.0), 2), round(self.uniform(1.0, 1.5), 2)]},
            "solref": {"abs": soft},
            "solimp": {"abs": [[0.8, 0.9, 0.001, 0.5, 2.0], [0.95, 0.99, 0.003, 0.5, 2.0]]},
            "frictionloss": {"scale": [0.5, 1.5]},
        }

    def make_tight(self, scene: dict[str, Any]) -> None:
        """Give some scenes little room and few attempts, so that many worlds take a layout from the bank."""
        scene["bank"] = int(self.rng.choice([8, 16, 32]))
        if not self.chance(0.5):
            return
        self.features.add("tight")
        scene["attempts"], scene["restarts"] = int(self.rng.integers(1, 5)), int(self.rng.integers(0, 3))
        half = round(self.uniform(0.08, 0.2), 3)
        for words in scene["objects"].values():
            has_room = (
                "relations" in words or words.get("region") == _BEFORE_THE_ARM or words.get("kind", "free") != "free"
            )
            if words.get("on") in ("floor", "carrier", "table") and not has_room and words.get("asset") not in _FREE:
                words["region"] = {"box": [[-half, -half], [half, half]]}
