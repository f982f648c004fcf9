"""Tiers without the map or the arm that they need are refused, and those that fall back on `ik` are told."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import MapError, ReachWarning
from sceniris_gym.program.checks.reach import check_reach
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.layout.crane import crane_map, crane_mjcf, crane_scene


def reaching(scene: dict[str, Any]) -> Any:
    """The arms and reach targets of a scene, checked."""
    plan = build_plan(build_model(SceneConfig.load(scene)))
    check_reach(plan)
    return plan.reaching


def test_an_arm_without_a_map_is_told_how_to_build_one(folder: Path, cube: str):
    """For a map tier; `ik` needs none, and decides by default."""
    asset = crane_mjcf(folder, "unmapped")
    for tier in ("map", "map_strict"):
        with pytest.raises(
            MapError, match=r"objects\.thing\.reachable: .*'sceniris-gym reach .*--build -o .*unmapped\.reach'"
        ):
            reaching(crane_scene(asset, cube, reachable=tier))
    for word in ("ik", True):
        assert reaching(crane_scene(asset, cube, reachable=word)).targets[0].tier == Tier.IK


@pytest.mark.parametrize(
    ("form", "error", "says"),
    [
        ({"tilt": 0.1}, {}, "first joint"),
        ({"offset": 0.02}, {}, "TCP is 20 mm off"),
        ({}, {"turn_error": 0.2}, "a map does not know"),
        (
            {},
            {"false_accepts": 0.0051},
            r"too coarse: 0\.51% of the poses .* \(build it with finer steps than --step 0\.2",
        ),
    ],
    ids=["leaning", "off axis", "limited", "coarse"],
)
def test_an_arm_that_a_map_does_not_fit_goes_through_ik(
    folder: Path, cube: str, form: dict[str, Any], error: dict[str, Any], says: str
):
    """With a warning where a map was asked for, without one where the default was."""
    asset = crane_mjcf(folder, f"odd_{'_'.join([*form, *error])}", **form)
    if error:
        crane_map(asset, **error)
    with pytest.warns(ReachWarning, match=f"objects.thing.reachable: .*{says}.*, so 'ik' decides"):
        assert reaching(crane_scene(asset, cube)).targets[0].tier == Tier.IK
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        assert reaching(crane_scene(asset, cube, reachable=True)).targets[0].tier == Tier.IK
        assert reaching(crane_scene(asset, cube, reachable="clear")).targets[0].tier == Tier.CLEAR


@pytest.mark.parametrize("false_accepts", [None, 0.0, 0.005])
def test_a_map_that_is_right_often_enough_decides(folder: Path, cube: str, false_accepts: float | None):
    """So does one from before this was measured; nothing is said about it."""
    asset = crane_mjcf(folder, f"right_{false_accepts}")
    crane_map(asset, false_accepts=false_accepts)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        for word in ("map", True):
            assert reaching(crane_scene(asset, cube, reachable=word)).targets[0].tier == Tier.MAP
