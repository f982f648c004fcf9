"""Words of `randomize`: forms, distributions, and errors that name what would be right."""

from __future__ import annotations

from typing import Any

import pytest

from sceniris_gym.config.randomize import DrawConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError

CAN = {"asset": "can", "on": "floor"}


def load(draws: Any = None, **scene: Any) -> SceneConfig:
    """Return a scene with a can whose physics are drawn by these words."""
    can = CAN if draws is None else CAN | {"randomize": draws}
    return SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": {"can": can}} | scene)


@pytest.mark.parametrize(
    ("randomize", "error"),
    [
        ({"mas": {"scale": [1, 2]}}, "objects.can.randomize.mas: 'mas' should be one of .* Did you mean 'mass'"),
        ({"mass": {"scal": [1, 2]}}, "randomize.mass.scal: unknown key. Did you mean 'scale'"),
        ({"mass": {"scale": [2, 1]}}, r"randomize.mass: .* should be \[low, high\] with low <= high"),
        ({"mass": {"scale": 2}}, r"mass.scale: 2 should be \[low, high\]"),
        ({"mass": {"scale": [1, 2], "abs": [1, 2]}}, "should have exactly one of scale, add, abs, choice"),
        ({"mass": {"scale": [0, 2], "distribution": "log_uniform"}}, "because the distribution is log_uniform"),
        ({"mass": {"scale": [1, -1], "distribution": "normal"}}, "a standard deviation of 0 or more"),
        ({"mass": {"choice": [1], "distribution": "normal"}}, "'choice' or 'distribution', not both"),
        ({"mass": {"scale": [1, 2], "distribution": "gauss"}}, "should be 'uniform', 'log_uniform' or 'normal'"),
        ({"rgba": {"abs": [[0, 0], [1]]}}, "the same number of values in low and high"),
    ],
)
def test_wrong_words_are_told(randomize: dict, error: str):
    """Each with its place and what would be right."""
    with pytest.raises(SceneKeyError, match=error):
        load(randomize)


def test_lights_cameras_and_materials_have_words_of_their_own():
    """A word of one of them is unknown in another."""
    with pytest.raises(SceneKeyError, match=r"lights.lamp.fovy: 'fovy' should be one of pos, dir"):
        load(randomize={"lights": {"lamp": {"fovy": {"scale": [1, 2]}}}})
    with pytest.raises(SceneKeyError, match=r"randomize.light: unknown key. Did you mean 'lights'"):
        load(randomize={"light": {}})


def test_a_form_replaces_another_one_in_overrides():
    """As only one of them can be given; scenes without draws are written as before."""
    scene = load({"mass": {"scale": [0.5, 2]}})
    other = SceneConfig.load(scene, {"objects.can.randomize.mass.abs": [0.1, 0.2]})
    assert other.objects["can"].randomize["mass"] == DrawConfig(abs=((0.1,), (0.2,)))
    lamp = load(randomize={"lights": {"lamp": {"pos": {"add": [-1, 1]}}}})
    other = SceneConfig.load(lamp, {"randomize.lights.lamp.pos.scale": [1, 2]})
    assert other.randomize is not None
    assert other.randomize.lights["lamp"]["pos"].form == "scale"
    assert not load().is_randomized
    assert scene.is_randomized
    assert "randomize" not in load().canonical()
