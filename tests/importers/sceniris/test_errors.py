"""Errors of the scene that was made, told by the keys of the configuration it was made from."""

from __future__ import annotations

import pytest

from sceniris_gym import read_sceniris
from sceniris_gym.errors import CycleError, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.importers.sceniris.errors import in_its_keys, origin
from tests.importers.sceniris.configurations import ONE, mug

WRONG: dict[str, tuple] = {
    "a negative distance": (
        mug(constraints=[{**ONE, "distance": -1.0, "distance_type": "less"}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.0\.distance: -1.0 should be at least 0",
    ),
    "a relaxation that is none": (
        mug(constraints=[{"anchor_object_ids": []}, {**ONE, "distance": 1.0, "distance_relax": 0.0}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.1\.distance_relax: 0.0 should be at least 0.0001 m",
    ),
    "an angle that is too wide": (
        mug(constraints=[{**ONE, "direction": "left", "direction_tolerance_angle": 200}]),
        SceneKeyError,
        r"objects\.mug\.constraints\.0\.direction_tolerance_angle: 200.0 should be at most 180",
    ),
    "an anchor that is the object itself": (
        mug(constraints=[{"anchor_object_ids": ["mug"], "direction": "left"}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints\.0\.anchor_object_ids: 'mug' should be a different object",
    ),
    "too many constraints": (
        mug(constraints=[{**ONE, "direction": "left"}] * 5),
        SceneKeyError,
        r"original configuration: objects\.mug\.constraints: .* 4 values at most",
    ),
    "joints the wrong way round": (
        mug(asset_path="cabinet", joint_states=[{"joint_ids": ["upper"], "min": 0.9, "max": 0.1}]),
        SceneKeyError,
        r"original configuration: objects\.mug\.joint_states\.0: .* low <= high",
    ),
    "a floor without end": (mug() | {"env": {"env_size": 1e6}}, SceneKeyError, r"configuration: env\.env_size: 1"),
    "objects on each other": (
        {"objects": [{"id": a, "asset_path": "mug", "parent_id": b} for a, b in ("ab", "ba")]},
        CycleError,
        "original configuration: objects are placed relative to each other: a -> b -> a",
    ),
}


@pytest.mark.parametrize(("cfg", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_an_error_of_the_scene_names_the_key_of_the_configuration(cfg: dict, error: type[ScenirisError], says: str):
    """Keys that the scene refuses, its words' limits, and circles."""
    with pytest.raises(error, match=says):
        read_sceniris(cfg)


ORIGINS = {"objects.mug": "objects.0", "objects.mug.region": "objects.0.position", "floor.size": "env.env_size"}


@pytest.mark.parametrize(
    ("path", "key"),
    [
        ("floor.size", "env.env_size"),
        ("floor.size.1", "env.env_size"),
        ("objects.mug.region.fraction.0.1", "objects.0.position"),
        ("objects.mug.regional", "objects.0"),
        ("objects.mugs", "objects.mugs"),
        ("floor", "floor"),
        ("attempts", "attempts"),
    ],
)
def test_a_path_leads_to_the_key_of_the_smallest_part_that_holds_it(path: str, key: str):
    """Whole words of the path count, and a part that nothing is known of keeps its path."""
    assert origin(path, ORIGINS) == key


def test_every_line_of_an_error_is_told_by_its_own_key():
    """The kind of the error and what is said after the place stay."""
    error = SceneKeyError("scene: floor.size.0: is too large.\nscene: objects.mug.region: scene: is wrong.")
    told = in_its_keys(error, ORIGINS)
    assert type(told) is SceneKeyError
    assert str(told).splitlines() == [
        "original configuration: env.env_size: is too large.",
        "original configuration: objects.0.position: scene: is wrong.",
    ]


def test_the_parts_of_an_error_are_carried_over():
    """Names and circles can still be asked for."""
    unknown = in_its_keys(UnknownNameError("object", "mgu", "scene: objects.mug.region", ["mug", "can"]), ORIGINS)
    assert isinstance(unknown, UnknownNameError)
    assert (unknown.kind, unknown.name, unknown.valid) == ("object", "mgu", ["can", "mug"])
    assert unknown.where == "original configuration: objects.0.position"
    circle = in_its_keys(CycleError("scene", ["a", "b"], "objects are placed relative to each other"), ORIGINS)
    assert isinstance(circle, CycleError)
    assert (circle.where, circle.names) == ("original configuration", ["a", "b"])
