"""Accuracy of every keyword of the placement language: one line per keyword, with the worst violation found.

python -m tests.stress.relations --layouts 100000 [--device cuda:0] [--jobs 16] [--words near between]

Layouts are generated on the device; numpy and shapely check them, in up to `--jobs` processes, with code that imports
nothing from the generator. The exit status is 1 if a keyword is violated by more than 1e-4 m or 1e-3 rad.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import mujoco

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.relations import Kept
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import judge_language
from tests.layout.related import ONE_ANCHOR, Shapes, near_middle, related

_FLOOR = {"size": [2.0, 2.0]}

# Relations of the object `q` to `a` (an L), `b` (a bar) and `c` (a cube), whose poses are sampled in every layout.
RELATIONS: dict[str, tuple[dict[str, Any], ...]] = {
    **{word: (relation,) for word, (relation, _) in ONE_ANCHOR.items()},
    "angle of 2": ({"left_of": "a", "angle": 2},),
    "near, max": ({"near": "a", "distance": {"max": 0.3}},),
    "distance max": ({"left_of": "a", "angle": 40, "distance": {"max": 0.5}},),
    "distance min and max": ({"near": "a", "distance": {"min": 0.2, "max": 0.6}},),
    "side by bounds, equal": ({"front_of": "a", "measure": "bounds", "distance": {"equal": 0.1}},),
    "between two, width": ({"between": ["a", "b"], "width": 0.2},),
    "between two": ({"between": ["a", "b"]},),
    "between three": ({"between": ["a", "b", "c"]},),
    "two relations": ({"front_of": "a", "distance": {"min": 0.2}}, {"right_of": "b", "angle": 80}),
    "four relations": (
        {"front_of": "a", "distance": {"min": 0.1}},
        {"right_of": "b", "angle": 170},
        {"near": "b", "measure": "bounds", "distance": {"max": 0.9}},
        {"between": ["a", "b"], "width": 1.5},
    ),
}

# Orientations of `q`, combined with a relation.
ORIENTATIONS: dict[str, dict[str, Any]] = {
    "fixed": {"orientation": "fixed"},
    "yaw": {"orientation": {"yaw": [-20, 70]}},
    "stable": {"orientation": {"stable": {"yaw": [-20, 70]}}},
    "any": {"orientation": "any"},
    "face_to": {"orientation": {"face_to": "a", "yaw": [-5, 5]}},
    "with": {"orientation": {"with": "a", "yaw": [-5, 5]}},
}


def scenes(shapes: Shapes) -> dict[str, dict[str, Any]]:
    """Return a scene for each keyword, by name."""
    anchors = {
        "a": near_middle(shapes.odd, -0.2, 0.0),
        "b": near_middle(shapes.bar, 0.5, 0.3),
        "c": near_middle(shapes.cube, 0.1, 0.7),
    }
    found = {word: _scene({**anchors, "q": related(shapes.odd, *words)}) for word, words in RELATIONS.items()}
    near, own = RELATIONS["distance min and max"], RELATIONS["between two"]
    for word, words in ORIENTATIONS.items():
        found[word] = _scene({**anchors, "q": related(shapes.odd, *near, **words)})
    for word in ("stable", "any"):
        found[f"between two, {word}"] = _scene({**anchors, "q": related(shapes.odd, *own, **ORIENTATIONS[word])})
    cubes = {name: {"asset": shapes.cube, "kind": "fixture", "on": "floor"} for name in "abcdefgh"}
    found["between eight"] = _scene({**cubes, "q": related(shapes.bar, {"between": list(cubes)})})
    slab = {"slab": near_middle(shapes.slab, orientation={"yaw": [-180, 180]})}
    on_it = {"asset": shapes.odd, "on": "slab", "region": {"fraction": [[0.4, 0.4], [0.6, 0.6]]}}
    turned = related(shapes.bar, {"left_of": "a", "frame": "support", "angle": 30}, on="slab")
    found["frame support, turned"] = _scene({**slab, "a": on_it, "q": turned})
    case = near_middle(shapes.drawer, joints={"slide": {"fraction": [0.8, 1.0]}})
    inside = {"asset": shapes.cube, "in": "case/drawer"}
    by_it = {**inside, "relations": [{"near": "a", "distance": {"max": 0.1}}]}
    found["in a drawer"] = _scene({"case": case, "a": inside, "q": by_it})
    found["measure bounds, drawn joints"] = _scene(
        {"a": {**case, "joints": {"*": {"fraction": [0, 1]}}}, "q": related(shapes.bar, *RELATIONS["near by bounds"])}
    )
    box = {"region": {"box": [[-0.9, -0.9, 0.3], [0.9, 0.9, 0.6]]}, "orientation": "any"}
    found["in space"] = _scene({**anchors, "q": {"asset": shapes.odd, **box, "relations": list(near)}})
    lattice = {"region": {"points": [[x / 10.0, y / 10.0] for x in range(-9, 10) for y in range(-9, 10)]}}
    found["points"] = _scene({**anchors, "q": related(shapes.odd, *near, **lattice)})
    groups = {"some": {"of": ["a", "b", "c"], "count": [0, 3], "missing": "drop"}}
    absent = related(shapes.bar, *RELATIONS["between three"], {"front_of": "a"}, orientation={"face_to": "b"})
    found["groups"] = {**_scene({**anchors, "q": absent}), "groups": groups}
    return found


def _scene(objects: Mapping[str, Any]) -> dict[str, Any]:
    return {"floor": _FLOOR, "objects": dict(objects)}


def _judge(mjm: mujoco.MjModel, config: SceneConfig, bodies: Mapping[str, int], rows: LayoutTable) -> list[Kept]:
    return judge_language(Auditor(mjm, config, bodies), rows)


def _line(word: str, layouts: int, fresh: int, kept: Sequence[Kept]) -> dict[str, Any]:
    """Return how often a tolerance was exceeded, and the worst violation of `q` by unit (negative: none)."""
    found: dict[str, Any] = {"word": word, "layouts": layouts, "fresh": fresh, "broken": sum(k.broken for k in kept)}
    for unit in ("m", "rad"):
        worst = [k.worst for k in kept if k.name == "q" and k.word != "upright" and k.unit == unit and k.checked]
        found |= {f"worst_{unit}": max(worst)} if worst else {}
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Measure the requested keywords; return 1 if any is violated, else 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--layouts", type=int, default=100_000)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes that check layouts")
    parser.add_argument("--words", nargs="*", help="prefixes of the keywords to measure; all if none is given")
    args = parser.parse_args(argv)
    broken = 0
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(args.jobs, multiprocessing.get_context("spawn")) as pool,
    ):
        pending: list[tuple[str, int, Future[list[Kept]]]] = []
        for word, scene in scenes(Shapes(Path(folder))).items():
            if not args.words or word.startswith(tuple(args.words)):
                compiled = compile_scene(SceneConfig.load(scene, {"bank": 8}), args.device)
                table = make_table(compiled, args.layouts, 0)
                judged = pool.submit(_judge, compiled.mjm, compiled.config, compiled.scene.bodies, table)
                pending.append((word, int(table.valid.sum()), judged))
        for word, fresh, judged in pending:
            kept = judged.result()
            broken += sum(k.broken for k in kept)
            print(json.dumps(_line(word, args.layouts, fresh, kept)), flush=True)
    return 1 if broken else 0


if __name__ == "__main__":
    raise SystemExit(main())
