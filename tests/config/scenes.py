"""Scenes that the tests of scene files begin with, and how a wrong one is refused."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.relations import Relation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ScenirisError

SMALL = {
    "floor": {"size": [1.0, 2.0]},
    "objects": {
        "shelf": {"asset": "cabinet", "kind": "fixture", "on": "floor"},
        "apple": {"asset": "apple", "on": "shelf"},
        "goal": {"kind": "marker", "region": {"box": [[0, 0, 0], [1, 1, 1]]}},
    },
}
NEIGHBOURS = {
    "floor": {"size": [2.0, 2.0]},
    "objects": {
        "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor"},
        "apple": {"asset": "apple", "on": "floor"},
        "mug": {"asset": "mug", "on": "cabinet"},
        "post": {"asset": "mug", "kind": "static"},
        "goal": {"kind": "marker", "on": "floor"},
    },
}
TABLE = {
    "floor": {"size": [2.0, 2.0]},
    "objects": {
        "table": {"asset": "table", "kind": "fixture", "on": "floor"},
        "can": {"asset": "can", "on": "table"},
        "mug": {"asset": "mug", "on": "table"},
        "bowl": {"asset": "bowl", "on": "table"},
        "apple": {"asset": "apple", "on": "table"},
        "post": {"asset": "mug", "kind": "static"},
    },
}
NEAR = {"near": "mug", "distance": {"max": 0.3}}
CLUTTER = {"of": ["can", "mug", "bowl"], "count": [1, 3]}


def write(folder: Path, name: str, text: str) -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def related(*relations: Any, **overrides: Any) -> SceneConfig:
    """Return the scene in which the apple has the relations."""
    return SceneConfig.load(NEIGHBOURS, {"objects.apple.relations": list(relations), **overrides})


def only(relation: dict) -> Relation:
    """Return the apple's only relation."""
    return related(relation).objects["apple"].relations[0]


def grouped(group: Any, **overrides: Any) -> SceneConfig:
    """Return the scene with a group `clutter`."""
    return SceneConfig.load(TABLE, {"groups.clutter": group, **overrides})


def refusal(scene: str | Path | Mapping | SceneConfig, overrides: Mapping[str, Any], error: type[ScenirisError]) -> str:
    """Return how the scene with the overrides is refused, after checking that no foreign traceback comes with it."""
    with pytest.raises(error) as caught:
        SceneConfig.load(scene, overrides)
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__ or caught.value.__context__ is None
    return str(caught.value)


def refused(
    folder: Path, scene: Mapping, overrides: Mapping[str, Any], error: type[ScenirisError], says: list[str]
) -> None:
    """Assert that the scene with the overrides, read from a file, is refused by that file and with these words."""
    path = write(folder, "wrong.yaml", json.dumps(scene))
    said = refusal(path, overrides, error)
    for text in (str(path), *says):
        assert text in said
