"""Axes: params at each grade, and the reasons why a task lacks an axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sceniris_gym import ImageConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.suites.axes import Axis, Base, axes_of
from tests.suites.conftest import WIDE
from tests.vector.conftest import SCENE

PAN, SLIDE = "robot.joints.arm/pan", "objects.cabinet.joints.slide"


def base(changes: dict[str, Any] | None = None, scene: dict = WIDE, images: Any = None) -> Base:
    """Return the base of a suite of five grades."""
    return Base.of(compile_scene(SceneConfig.load(scene, changes), "cpu"), images, 5)


def drawn(axis: Axis, grade: int) -> list[dict[str, Any]]:
    """Return params of 40 cases."""
    return [axis.draw(grade, np.random.default_rng(i)) for i in range(40)]


def test_grades_are_those_of_the_law():
    """A start by 0.1 g rad, factors of 1 - 0.15 g or 1 + 0.15 g, 5% g of a joint, and counts up to the greatest."""
    axes = axes_of(base())
    assert list(axes) == ["robot", "clutter", "joint", "variant", "mass", "friction"]
    for grade in (1, 5):
        starts = {round(abs(found[PAN][0]), 6) for found in drawn(axes["robot"], grade)}
        assert starts == {round(0.1 * grade, 6)}
        for word in ("mass", "friction"):
            key = f"objects.block.randomize.{word}"
            factors = {round(found[key][0], 6) for found in drawn(axes[word], grade)}
            assert factors == {round(1 - 0.15 * grade, 6), round(1 + 0.15 * grade, 6)}
            assert all(low == high for found in drawn(axes[word], grade) for low, high in found.values())
        # from 40% to 90% of 0.2 m, with more room below
        assert drawn(axes["joint"], grade)[0] == {SLIDE: pytest.approx([0.08 - 0.01 * grade] * 2)}
    assert [axes["clutter"].draw(g, np.random.default_rng(0))["groups.cans.count"][0] for g in range(1, 6)] == [
        0,
        1,
        1,
        2,
        2,
    ]
    assert axes["robot"].widened == {PAN: {"range": pytest.approx([-0.6, 0.6])}}
    assert axes["robot"].nominal == {PAN: pytest.approx([-0.1, 0.1])}
    kinds = {tuple(found["objects.thing.weights"]) for found in drawn(axes["variant"], 1)}
    assert kinds == {(1.0, 0.0), (0.0, 1.0)}


def test_held_out_variants_are_those_of_the_other_split():
    """Nominal cases have the split train then, whose seeds no training uses."""
    axis = axes_of(base({"objects.thing.holdout": 0.5}), ["variant"])["variant"]
    assert (axis.grades, axis.split, axis.draw(1, np.random.default_rng(0))) == ((1,), "eval", {})


def test_draws_of_the_scene_stay_nominal():
    """A drawn factor is widened. Draws of another form are left alone, or the axis is refused."""
    axis = axes_of(base({"objects.block.randomize.mass": {"scale": [0.1, 1.5]}}), ["mass"])["mass"]
    key = "objects.block.randomize.mass"
    assert (axis.nominal[key], axis.widened[key]) == ([0.1, 1.5], {"scale": [0.1, 1.75]})
    only = {"objects.block.randomize.mass": {"abs": [0.1, 0.2]}}
    with pytest.raises(ArgumentError, match="--axes mass: the scene has nothing that this axis can scale"):
        axes_of(base(only, SCENE), ["mass"])


def test_light_and_cameras_are_axes_of_tasks_with_pictures():
    """Cameras move by 2 cm and turn by 2 degrees a grade; scenes that draw them already lack the axis."""
    seen = ImageConfig(cameras={"overview": {"size": (8, 8)}})
    axes = axes_of(base(images=seen), ["light", "camera"])
    assert axes["light"].nominal == {"randomize.lights.*.diffuse": [1.0, 1.0]}
    for found in drawn(axes["camera"], 3):
        low, high = found["randomize.cameras.overview.pos"]
        assert low == high
        assert np.linalg.norm(low) == pytest.approx(0.06)
        assert np.linalg.norm(found["randomize.cameras.overview.quat"][0]) == pytest.approx(6.0)
    draws = {"randomize": {"cameras": {"overview": {"fovy": {"add": [-1, 1]}}}}}
    with pytest.raises(ArgumentError, match=r"--axes camera: .*that the scene keeps still"):
        axes_of(base(draws, images=seen), ["camera"])


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("robot", "draws no joint of its robot"),
        ("variant", "no object with variants"),
        ("light", "sees no pictures"),
        ("camera", "sees no pictures"),
    ],
)
def test_a_task_without_an_axis_is_told_why(name: str, why: str):
    """If it is asked for. Without names, the axis is left out."""
    small = base(scene=SCENE)
    with pytest.raises(ArgumentError, match=rf"--axes {name}: .*{why}"):
        axes_of(small, [name])
    assert name not in axes_of(small)


def test_clutter_without_groups_adds_objects():
    """On the support of the object to reach, one more per grade. Without a support, there is no place for them."""
    axis = axes_of(base(scene=SCENE), ["clutter"])["clutter"]
    assert axis.nominal == {"groups.confounders.count": [0, 0]}
    assert axis.draw(3, np.random.default_rng(0)) == {"groups.confounders.count": [3, 3]}
    assert axis.widened["objects.confounder_can"] == {"asset": "can", "on": "floor"}
    assert axis.widened["groups.confounders"]["count"] == [0, 5]
    still = {"spot": {"asset": "can"}}
    with pytest.raises(ArgumentError, match=r"--axes clutter: .*no object on a support"):
        axes_of(base(scene={**SCENE, "objects": still}), ["clutter"])


def test_a_joint_without_room_is_no_axis():
    """Neither below nor above its interval."""
    with pytest.raises(ArgumentError, match=r"--axes joint: .*has room beyond its interval"):
        axes_of(base({"objects.cabinet.joints": {"*": {"fraction": [0.0, 1.0]}}}, SCENE), ["joint"])
