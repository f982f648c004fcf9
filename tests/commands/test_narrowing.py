"""Narrowing of objects' places by `reachable`: shares in closed form, and the picture of them."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from sceniris_gym.commands.narrowing import Narrowing, _corners, narrow, narrowing, picture
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.crane import RADIUS, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu
from tests.layout.starting import starting

FLOOR = 4.0  # area of the crane's floor [m2]


@pytest.mark.parametrize("layouts", [200, 1000, 5000])
def test_narrowing_is_the_share_that_is_left_however_many_are_looked_at(crane: CompiledScene, layouts: int):
    """The crane's ring of the floor, within four standard deviations of chance."""
    figures = narrowing(crane, layouts, 0).figures
    assert set(figures) == {"thing"}
    share = np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) / FLOOR
    assert figures["thing"]["candidates"] > 0.9 * layouts
    assert figures["thing"]["kept"] == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / layouts))
    assert figures["thing"]["unreachable"] > 0
    assert [*figures["thing"]] == ["kept", "candidates", "unreachable", "no_ik", "blocked", "no_path"]


def test_narrowing_counts_what_later_stages_refuse(tmp_path: Path):
    """A crane that does not turn all around reaches a part of its ring alone, which `ik` finds without a map."""
    asset, cube = crane_mjcf(tmp_path, turn=1.0), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    found = narrowing(compile_on_cpu(crane_scene(asset, cube, reachable="ik"), bank=4), 400, 0)
    share = np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) / FLOOR * (1.0 / np.pi)
    assert found.figures["thing"]["kept"] == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 400))


def test_a_scene_without_reachable_has_a_picture_of_one_panel(tmp_path: Path):
    """There is nothing to say about reach, and objects lie where they do: over all of the region, and there alone."""
    cube = {"asset": box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04), "on": "floor"}
    objects = {
        "thing": {**cube, "region": {"box": [[0.3, -0.9], [0.9, 0.9]]}},
        "post": {"asset": cube["asset"], "kind": "static"},
    }
    plain = compile_on_cpu({"floor": {"size": [2.0, 2.0]}, "objects": objects})
    assert narrow(plain, 8, 0) == {}
    path = tmp_path / "x.png"
    assert narrow(plain, 200, 0, path) == {"picture": str(path)}
    drawn = np.asarray(Image.open(path).convert("RGB")).astype(int)[30:-40]
    columns, rows = np.transpose(dots(drawn))
    height, width = drawn.shape[:2]
    assert abs(width - height) < 60  # one panel, of a square floor
    assert 0.6 * width < columns.min() < 0.7 * width < 0.9 * width < columns.max() < 0.97 * width
    assert rows.min() < 0.15 * height < 0.85 * height < rows.max()


def test_a_picture_of_no_valid_layout_is_empty(tmp_path: Path):
    """As one is of a scene that is too hard, even if nothing else gives the picture a size."""
    nothing = Narrowing({}, {"thing": np.zeros((0, 2))}, {}, np.zeros((0, 3)), *_corners([np.zeros((0, 2))], None))
    assert picture(nothing, "none").size[0] > 10


def test_a_long_legend_goes_on_in_the_next_line():
    """So that each object can be found by its colour; the picture is higher by the lines."""
    lines = {}
    for number in (1, 3, 12):
        after = {f"object number {i}": np.zeros((1, 2)) for i in range(number)}
        found = Narrowing({}, after, {}, np.zeros((0, 3)), np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
        lines[number] = picture(found, "many").size
    assert lines[1] == lines[3]
    assert (lines[12][0], lines[12][1] - lines[1][1]) == (lines[1][0], 2 * 26)


def test_the_picture_has_dots_where_objects_lie():
    """Without the word on the left, with it on the right, x to the right and y upwards; a disc is at the base."""
    before = np.array([[0.3, 0.4], [-0.6, 0.2]])
    found = Narrowing(
        before={"mug": before},
        after={"mug": before[:1]},
        figures={"mug": {"kept": 0.5, "candidates": 2, "unreachable": 1, "no_ik": 0, "blocked": 0}},
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


def dots(drawn: np.ndarray) -> list[tuple[float, float]]:
    """Return column and row of the middle of each orange dot, from left to right."""
    orange = (drawn[..., 0] > 190) & (drawn[..., 1] < 130) & (drawn[..., 2] < 80)
    labels, count = cast(tuple[np.ndarray, int], ndimage.label(orange))
    middles = ndimage.center_of_mass(orange, labels, range(1, count + 1))
    return sorted((column, row) for row, column in middles)


def test_a_scene_with_starts_is_compared_without_them():
    """A start needs targets that are reachable, and the other scene has none."""
    found = narrowing(starting(), 50, 0)
    assert set(found.figures) == {"cabinet", "block"}
    assert all(0.0 < part["kept"] <= 1.0 for part in found.figures.values())


def test_an_object_on_several_supports_is_compared():
    """Its members have no words of their own that could be changed."""
    compiled = compile_scene(
        starting().config, "cpu", overrides={"start": [], "objects.block.on": ["floor", "cabinet"]}
    )
    assert set(narrowing(compiled, 20, 0).figures) >= {"block/@floor", "block/@cabinet"}
