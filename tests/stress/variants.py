"""Layouts of objects with variants, each judged in a scene of its own, in which its variants are plain objects.

python -m tests.stress.variants --layouts 20000
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.audit.auditor import Auditor, Report
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.model import SceneModel

Words = dict[str, Any]
Choice = tuple[tuple[str, str], ...]

_FLOOR = {"floor": {"size": [1.6, 1.6]}}
_TABLE = {"asset": "table", "kind": "static"}
SCENES: dict[str, Words] = {
    "crowded": {
        **_FLOOR,
        "objects": {
            "table": _TABLE,
            "a": {"variants": {n: {"asset": n} for n in ("can", "mug", "bowl", "book")}, "on": "table"},
            "b": {"variants": {n: {"asset": n} for n in ("pan", "banana", "glass")}, "on": "table"},
            "c": {"variants": {"one": {"asset": "brick"}, "two": {"asset": "brick", "scale": 1.6}}, "on": "table"},
        },
    },
    "related": {
        **_FLOOR,
        "objects": {
            "shelf": {
                "variants": {n: {"asset": n} for n in ("plate", "tin", "bowl")},
                "kind": "fixture",
                "on": "floor",
                "region": {"box": [[-0.2, -0.2], [0.2, 0.2]]},
            },
            "a": {
                "variants": {"pear": {"asset": "pear", "orientation": "stable"}, "peg": {"asset": "peg", "weight": 3}},
                "on": "floor",
                "relations": [{"near": "shelf", "measure": "bounds", "distance": {"max": 0.1}}],
            },
            "b": {
                "asset": "mug",
                "on": "floor",
                "relations": [{"beside": "a", "side": "left"}],
            },
            "c": {"asset": "chair", "on": "floor", "orientation": {"face_to": "shelf"}},
        },
    },
    "reached": {
        **_FLOOR,
        "robot": {"asset": "panda", "base": [0.0, -0.36, 0.4], "yaw": 90},
        "objects": {
            "table": _TABLE,
            "a": {
                "variants": {n: {"asset": n} for n in ("can", "block", "bottle", "orange")},
                "on": "table",
                "reachable": "clear",
                "region": {"box": [[-0.24, -0.01], [0.24, 0.24]]},
            },
            "b": {"variants": {n: {"asset": n} for n in ("tin", "cereal_box")}, "on": "table"},
        },
    },
}
"""Scenes in which all variants are written at length, so that `own_words` can take them apart."""


def own_words(words: Words, choice: Choice) -> Words:
    """Return a scene in which each object with variants is the plain object of one of them."""
    objects = dict(words["objects"])
    for name, variant in choice:
        shared = {word: value for word, value in objects[name].items() if word != "variants"}
        own = {word: value for word, value in objects[name]["variants"][variant].items() if word != "weight"}
        objects[name] = {**shared, **own}
    return {**words, "objects": objects}


def by_choice(words: Words, slots: tuple[str, ...], table: LayoutTable) -> Iterator[tuple[Choice, np.ndarray]]:
    """Yield each choice of variants that comes up, and the rows that have it."""
    names = {name: list(part["variants"]) for name, part in words["objects"].items() if "variants" in part}
    there = [table.present[:, [slots.index(f"{n}/{v}") for v in variants]] for n, variants in names.items()]
    assert all((each.sum(axis=1) == 1).all() for each in there)
    drawn = np.stack([each.argmax(axis=1) for each in there], axis=1)
    for numbers in np.unique(drawn, axis=0):
        choice = tuple((name, variants[i]) for i, (name, variants) in zip(numbers, names.items(), strict=True))
        yield choice, np.flatnonzero((drawn == numbers).all(axis=1))


def own_table(full: mujoco.MjModel, own: SceneModel, choice: Choice, table: LayoutTable) -> LayoutTable:
    """Return layouts as states of a scene of their own, element by element by the names of joints and bodies."""
    mjm, renamed = own.mjm, {name: f"{name}/{variant}" for name, variant in choice}

    def theirs(name: str) -> str:
        owner, _, rest = name.partition("/")
        return "/".join(filter(None, (renamed.get(owner, owner), rest)))

    qpos = np.zeros((len(table), mjm.nq), np.float32)
    for i, adr in enumerate(mjm.jnt_qposadr.tolist()):
        width = (mjm.jnt_qposadr.tolist() + [mjm.nq])[i + 1] - adr
        first = int(full.jnt_qposadr[full.joint(theirs(mjm.joint(i).name)).id])
        qpos[:, adr : adr + width] = table.qpos[:, first : first + width]
    pos, quat = np.zeros((len(table), mjm.nmocap, 3)), np.zeros((len(table), mjm.nmocap, 4))
    for body in np.flatnonzero(mjm.body_mocapid >= 0).tolist():
        number = int(full.body_mocapid[full.body(theirs(mjm.body(body).name)).id])
        pos[:, mjm.body_mocapid[body]] = table.mocap_pos[:, number]
        quat[:, mjm.body_mocapid[body]] = table.mocap_quat[:, number]
    names = (*own.config.objects, *own.config.all_robots)
    return LayoutTable.from_states(qpos, pos, quat, np.ones((len(table), len(names)), bool))


def judged(words: Words, layouts: int, settled: int, seed: int = 0) -> Iterator[tuple[Choice, Report]]:
    """Yield the audit's verdict on the layouts of each choice of variants, in a scene of their own."""
    compiled = compile_scene(words, "cpu")
    table = make_table(compiled, layouts, seed)
    table = table[table.valid]
    for choice, rows in by_choice(words, compiled.slots, table):
        own = build_model(SceneConfig.load(own_words(words, choice)))
        states = own_table(compiled.mjm, own, choice, table[rows])
        yield choice, Auditor(own.mjm, own.config, own.bodies).judge(states, settled=min(settled, len(rows)))


def faults(report: Report) -> Mapping[str, int]:
    """Return the faults of a report by kind."""
    return {
        "missed collisions": len(report.conflicts),
        "penetrations over 0.1 mm": int(report.depth > 1e-4),
        "misplaced": len(report.misplaced),
        "relations": report.relation_violations,
        "moved": sum(report.moved.values()),
    }


def main() -> None:
    """Print a line for each scene."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layouts", type=int, default=20_000)
    parser.add_argument("--settled", type=int, default=20, help="layouts of each choice that are stepped for 0.5 s")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    for name, words in SCENES.items():
        found: dict[str, int] = {}
        number = choices = 0
        for _, report in judged(words, args.layouts, args.settled, args.seed):
            found = {kind: found.get(kind, 0) + count for kind, count in faults(report).items()}
            number, choices = number + report.layouts, choices + 1
        print(f"{name}: {number} layouts of {choices} choices of variants: {found}", flush=True)


if __name__ == "__main__":
    main()
