"""A scene of which all that can be a param of layouts is one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tests.layout.scenes import box_mjcf, write_mjcf

_DOOR = """<geom type="box" size=".05 .05 .05" pos="0 0 .05"/>
<body name="door"><joint name="door" type="slide" range="0 1"/>
<geom type="box" size=".01 .01 .01" pos="0 0 .2" contype="0" conaffinity="0"/></body>"""


def scene_with_params(folder: Path, **words: Any) -> dict[str, Any]:
    """All that can be a param of layouts: joints, counts, weights, distances, and regions on a support and in space."""
    box = box_mjcf(folder, "box", 0.04, 0.04, 0.04)
    door = write_mjcf(folder, "cabinet", _DOOR)
    objects: dict[str, Any] = {
        "cabinet": {"asset": door, "kind": "fixture", "on": "floor", "joints": {"door": {"range": [0.0, 0.8]}}},
        **{name: {"asset": box, "on": "floor"} for name in ("a", "b", "c", "d")},
        "near": {"asset": box, "on": "floor", "relations": [{"near": "cabinet", "distance": {"min": 0.2, "max": 0.5}}]},
        "spot": {"asset": box, "on": "floor", "region": {"polygon": [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5]]}},
        "high": {"asset": box, "region": {"box": [[-0.5, -0.5, 0.6], [0.5, 0.5, 0.9]]}},
    }
    groups = {"some": {"of": ["a", "b", "c", "d"], "count": [0, 4], "weights": {"a": 2.0}}}
    scene: dict[str, Any] = {"floor": {"size": [1.2, 1.2]}, "objects": objects, "groups": groups}
    scene |= {"attempts": 8, "bank": 4}
    scene["start"] = [{}, {"weight": 3.0, "joints": {"cabinet/door": {"range": [0.9, 0.95]}}}]
    for key, value in words.items():
        place: Any = scene
        *path, last = key.split("__")
        for part in path:
            place = place[part]
        place[last] = value
    return scene
