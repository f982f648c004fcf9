"""Narrowing of objects' places by `reachable`: shares in closed form, and the picture of them."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
import pytest
from scipy import ndimage

from sceniris_gym.commands.narrowing import Narrowing, narrow, narrowing, picture
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.crane import RADIUS, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu

FLOOR = 4.0  # area of the crane's floor [m2]


@pytest.mark.parametrize("layouts", [200, 1000, 5000])
def test_narrowing_is_the_share_that_is_left_however_many_are_looked_at(crane: CompiledScene, layouts: int):
    """The crane's ring of the floor, within four standard deviations of chance."""
    figures = narrowing(crane, layouts, 0).figures()
    assert set(figures) == {"thing"}
    share = np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) / FLOOR
    assert figures["thing"]["candidates"] > 0.9 * layouts
    assert figures["thing"]["kept"] == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / layouts))
    assert figures["thing"]["unreachable"] > 0


def test_narrowing_counts_what_later_stages_refuse(tmp_path: Path):
    """A crane that does not turn all around reaches a part of its ring alone, which `ik` finds without a map."""
    asset, cube = crane_mjcf(tmp_path, turn=1.0), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    found = narrowing(compile_on_cpu(crane_scene(asset, cube, reachable="ik"), bank=4), 400, 0)
    share = np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) / FLOOR * (1.0 / np.pi)
    assert found.figures()["thing"]["kept"] == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 400))


def test_a_picture_needs_something_to_reach(tmp_path: Path):
    """Without `reachable` there is nothing to say, and a picture of it is refused."""
    cube = box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    plain = compile_on_cpu({"floor": {"size": [1.0, 1.0]}, "objects": {"thing": {"asset": cube, "on": "floor"}}})
    assert narrow(plain, 8, 0) == {}
    with pytest.raises(SceneKeyError, match="no object has it"):
        narrow(plain, 8, 0, tmp_path / "x.png")


def test_the_picture_has_dots_where_objects_lie():
    """Without the word on the left, with it on the right, x to the right and y upwards; a disc is at the base."""
    before = np.array([[0.3, 0.4], [-0.6, 0.2]])
    found = Narrowing(
        before={"mug": before},
        after={"mug": before[:1]},
        kept={"mug": 0.5},
        rejections={"mug": {"unreachable": 1, "no_ik": 0, "blocked": 0}},
        bases=np.array([[0.5, -0.5, np.pi / 2]]),
        lower=np.array([-1.0, -1.0]),
        upper=np.array([1.0, 1.0]),
    )
    drawn = np.asarray(picture(found, "desk")).astype(int)
    drawn = drawn[30:-40]  # between title and legend, which is written in the colour of the dots
    middle = drawn.shape[1] // 2
    left, right = dots(drawn[:, :middle]), dots(drawn[:, middle:])
    assert (len(left), len(right)) == (2, 1)
    scale = (left[1][0] - left[0][0]) / 0.9  # pixels a metre, by the two dots on the left, which are 0.9 m apart in x
    assert left[0][1] - left[1][1] == pytest.approx(scale * 0.2, abs=2)
    assert right[0][1] == pytest.approx(left[1][1], abs=2)
    arm = (np.abs(drawn[:, :middle] - [90, 96, 104]).sum(axis=2) == 0).nonzero()
    assert arm[1].mean() - left[1][0] == pytest.approx(scale * 0.2, abs=2)
    assert arm[0].max() - 7 - left[1][1] == pytest.approx(scale * 0.9, abs=2)
    assert found.figures() == {"mug": {"kept": 0.5, "candidates": 2, "unreachable": 1, "no_ik": 0, "blocked": 0}}


def dots(drawn: np.ndarray) -> list[tuple[float, float]]:
    """Return column and row of the middle of each orange dot, from left to right."""
    orange = (drawn[..., 0] > 190) & (drawn[..., 1] < 130) & (drawn[..., 2] < 80)
    labels, count = cast(tuple[np.ndarray, int], ndimage.label(orange))
    middles = ndimage.center_of_mass(orange, labels, range(1, count + 1))
    return sorted((column, row) for row, column in middles)
