"""Orientations in scene files: what each form means, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.orientation import DrawnOrientation, Orientation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError
from tests.config.scenes import NEIGHBOURS, SMALL, refused


@pytest.mark.parametrize(
    ("orientation", "yaw"),
    [(None, (-math.pi, math.pi)), ("fixed", (0, 0)), ({"yaw": [-90, 45]}, (-math.pi / 2, math.pi / 4))],
)
def test_yaw_is_an_interval_in_radians(orientation: Any, yaw: tuple[float, float]):
    """Degrees in files, radians in the API; any yaw by default."""
    config = SceneConfig.load(SMALL, {"objects.apple.orientation": orientation})
    assert config.objects["apple"].drawn_orientation.yaw == pytest.approx(yaw)


@pytest.mark.parametrize(
    ("orientation", "turn"),
    [
        (None, DrawnOrientation("yaw", (-math.pi, math.pi))),
        ("fixed", DrawnOrientation("yaw", (0.0, 0.0))),
        ({"yaw": [-90, 45]}, DrawnOrientation("yaw", (-math.pi / 2, math.pi / 4))),
        ("any", DrawnOrientation("any", (-math.pi, math.pi))),
        ("stable", DrawnOrientation("stable", (-math.pi, math.pi))),
        ({"stable": {}}, DrawnOrientation("stable", (-math.pi, math.pi))),
        ({"stable": {"yaw": "free"}}, DrawnOrientation("stable", (-math.pi, math.pi))),
        ({"stable": {"yaw": [0, 90]}}, DrawnOrientation("stable", (0.0, math.pi / 2))),
        ({"face_to": "mug"}, DrawnOrientation("face_to", (0.0, 0.0), "mug")),
        ({"with": "mug"}, DrawnOrientation("with", (0.0, 0.0), "mug")),
        ({"with": "mug", "yaw": [90, 90]}, DrawnOrientation("with", (math.pi / 2, math.pi / 2), "mug")),
        ({"face_to": "mug", "yaw": [-90, 90]}, DrawnOrientation("face_to", (-math.pi / 2, math.pi / 2), "mug")),
    ],
)
def test_an_orientation_has_a_meaning(orientation: Any, turn: DrawnOrientation):
    """Every form of it; angles are degrees in files and radians here."""
    apple = SceneConfig.load(NEIGHBOURS, {"objects.apple.orientation": orientation}).objects["apple"]
    assert (apple.drawn_orientation.kind, apple.drawn_orientation.target) == (turn.kind, turn.target)
    assert apple.drawn_orientation.yaw == pytest.approx(turn.yaw)


WRONG: dict[str, tuple] = {
    "wrong orientation": ({"objects.apple.orientation": "fixd"}, SceneKeyError, ["orientation: 'fixd'", "'fixed'"]),
    "a misspelt word": ({"objects.apple.orientation": "stabel"}, SceneKeyError, ["orientation: 'stabel'", "'stable'?"]),
    "no form": ({"objects.apple.orientation": {}}, SceneKeyError, ["orientation: {}", "has none"]),
    "two forms": (
        {"objects.apple.orientation": {"stable": {}, "yaw": [0, 1]}},
        SceneKeyError,
        ["objects.apple.orientation:", "has yaw and stable"],
    ),
    "two targets": (
        {"objects.apple.orientation": {"face_to": "mug", "with": "mug"}},
        SceneKeyError,
        ["objects.apple.orientation:", "a yaw next to face_to or with", "has face_to and with"],
    ),
    "a misspelt with": ({"objects.apple.orientation": {"wiht": "mug"}}, SceneKeyError, ["mean 'with'"]),
    "an unknown form": ({"objects.apple.orientation": {"faceto": "mug"}}, SceneKeyError, ["'face_to'"]),
    "a misspelt yaw": (
        {"objects.apple.orientation": {"stable": {"yaw": "fre"}}},
        SceneKeyError,
        ["orientation.stable.yaw: 'fre'", "mean 'free'"],
    ),
    "a word for a stable pose": (
        {"objects.apple.orientation": {"stable": "free"}},
        SceneKeyError,
        ["orientation.stable: 'free'", "mapping of keys"],
    ),
}


@pytest.mark.parametrize(("overrides", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_orientation_is_refused(tmp_path: Path, overrides: dict, error: type[ScenirisError], says: list[str]):
    """Forms and words that there are not, or that do not go together."""
    refused(tmp_path, NEIGHBOURS, overrides, error, says)


def test_an_orientation_made_in_python_is_judged_by_itself():
    """Errors name the class where there is no file."""
    assert Orientation(yaw=(0.0, 180.0)).drawn.yaw == pytest.approx((0.0, math.pi))
    with pytest.raises(
        SceneKeyError, match=r"Orientation: .*should have exactly one of yaw, any, stable, face_to, with"
    ):
        Orientation(any=True, face_to="mug")
    assert Orientation(with_="mug").drawn == DrawnOrientation("with", (0.0, 0.0), "mug")
