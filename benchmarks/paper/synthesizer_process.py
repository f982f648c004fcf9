"""A process in which Scene Synthesizer makes scenes of Mid. It knows nothing of the rest of this package.

Reads a line of JSON: `cabinet`, `apple` and `banana`, files; `floor`, its edges [m]; `joints`, name -> range [m];
`drawer`, the name of the link that carries the banana; `attempts`; `seconds`; `seed`. Loads each file once, makes
scenes until the time is over, and answers with a line of JSON: `load_s`; `first_s`, for the first scene; `elapsed_s`,
for all of them; `made`; and `scenes`, the valid ones: joints [m] and poses, 4 x 4.
"""

from __future__ import annotations

import importlib
import json
import logging
import sys
import time
from collections.abc import Mapping
from typing import Any

_FLOOR_THICKNESS = 0.01  # m


def make_scene(synth: Any, assets: Mapping[str, Any], words: Mapping[str, Any], rng: Any) -> dict[str, Any] | None:
    """Return a scene in which everything could be placed, or None."""
    scene = synth.Scene(seed=rng)
    scene.add_object(assets["floor"], "floor", translation=[0.0, 0.0, -_FLOOR_THICKNESS / 2])
    scene.label_support("floor", obj_ids="floor", erosion_distance=0.0)
    # `max_iter` is the number of retries: one less than the number of attempts
    place = {"max_iter": words["attempts"] - 1}
    if not scene.place_object("cabinet", assets["cabinet"], support_id="floor", **place):
        return None
    joints = {name: rng.uniform(low, high) for name, (low, high) in words["joints"].items()}
    scene.update_configuration(list(joints.values()), obj_id="cabinet", joint_ids=list(joints))
    if not scene.place_object("apple", assets["apple"], support_id="floor", **place):
        return None
    scene.label_support("drawer", geom_ids=f"cabinet/{words['drawer']}", erosion_distance=0.0)
    if not scene.place_object("banana", assets["banana"], support_id="drawer", **place):
        return None
    poses = {name: scene.get_transform(name).tolist() for name in ("cabinet", "apple", "banana")}
    return {"joints": joints, "poses": poses}


def main() -> None:
    """See the module."""
    words = json.loads(sys.stdin.readline())
    import numpy as np

    synth = importlib.import_module("scene_synthesizer")

    logging.disable(logging.WARNING)
    start = time.perf_counter()
    rng = np.random.default_rng(words["seed"])
    assets = {name: synth.Asset(words[name]) for name in ("cabinet", "apple", "banana")}
    assets["floor"] = synth.BoxAsset([*words["floor"], _FLOOR_THICKNESS])
    loaded = time.perf_counter()
    times, scenes = [loaded], []
    while len(times) == 1 or times[-1] - loaded < words["seconds"]:
        scenes.append(make_scene(synth, assets, words, rng))
        times.append(time.perf_counter())
    found = {
        "load_s": loaded - start,
        "first_s": times[1] - loaded,
        "elapsed_s": times[-1] - loaded,
        "made": len(scenes),
        "scenes": [scene for scene in scenes if scene is not None],
    }
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
