"""Configurations of the original package that its tests begin with, and how they are read."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from benchmarks.paper.sceniris.keys import KeysLeftOutWarning
from benchmarks.paper.sceniris.reader import read_sceniris
from sceniris_gym.config.relations import Relation
from sceniris_gym.config.scene import SceneConfig

QUARTER_TURN = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
ONE = {"anchor_object_ids": ["drawer"]}


def read(cfg: dict, **others: Any) -> tuple[SceneConfig, list[str]]:
    """Return the scene and the keys that are left out."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        config = read_sceniris(cfg, **others)
    assert all(isinstance(warning.message, KeysLeftOutWarning) for warning in caught)
    return config, [key for warning in caught for key in getattr(warning.message, "keys", ())]


def mug(**keys: Any) -> dict:
    """Return a configuration of a drawer, a mug and an apple, the mug with the keys."""
    return {
        "objects": [
            {"id": "mug", "asset_path": "mug", **keys},
            {"id": "drawer", "asset_path": "cabinet"},
            {"id": "apple", "asset_path": "apple"},
        ]
    }


def relation(constraint: dict) -> Relation:
    """Return what a constraint of the mug becomes, with nothing left out."""
    config, left_out = read(mug(constraints=[constraint]))
    assert left_out == []
    (relation,) = config.objects["mug"].relations
    return relation
