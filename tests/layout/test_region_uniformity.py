"""Points are uniform over the region of a support that `region` and `ratio_on_support` leave."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy import stats
from shapely.geometry import Polygon, box

from tests.layout.scenes import FLOOR, compile_on_cpu, make, posed, write_mjcf
from tests.oracle.uniformity import grid_p_value
from tests.placement.supports import SHAPE, goal_points, tiles_mjcf

REGIONS = {
    "whole": (None, SHAPE),
    "box": ({"box": [[-0.2, -0.2], [0.35, 0.3]]}, SHAPE & box(-0.2, -0.2, 0.35, 0.3)),
    "fraction": ({"fraction": [[0.25, 0.0], [1.0, 0.5]]}, SHAPE & box(-0.2, -0.4, 0.4, 0.0)),
    "polygon": (
        {"polygon": [[-0.4, -0.4], [0.3, -0.4], [-0.3, 0.1], [-0.1, 0.3], [-0.4, 0.3]]},
        SHAPE & Polygon([[-0.4, -0.4], [0.3, -0.4], [-0.3, 0.1], [-0.1, 0.3], [-0.4, 0.3]]),
    ),
}


@pytest.mark.parametrize("region", [{}, {"region": {"box": [[-0.1, -0.3], [0.9, 0.05]]}}])
def test_points_are_uniform_over_the_floor(region: dict):
    """The whole floor, and a crop that reaches beyond it."""
    goal = {"kind": "marker", "on": "floor", **region}
    points = goal_points({"floor": {"size": [1.2, 0.7]}, "objects": {"goal": goal}})
    floor = box(-0.6, -0.35, 0.6, 0.35)
    assert grid_p_value(points[:, :2], floor & box(-0.1, -0.3, 0.9, 0.05) if region else floor) > 0.001
    np.testing.assert_allclose(points[:, 2], 0.0005, atol=1e-7)


@pytest.mark.parametrize("name", REGIONS)
def test_points_are_uniform_over_an_l_with_a_hole(tmp_path: Path, name: str):
    """All of the support and its crops, in the support's frame; nothing falls through the hole."""
    words, expected = REGIONS[name]
    objects = {
        "slab": {"asset": tiles_mjcf(tmp_path), "kind": "static"},
        "goal": {"kind": "marker", "on": "slab", **({"region": words} if words else {})},
    }
    points = goal_points({"objects": objects})
    assert grid_p_value(points[:, :2], expected) > 0.001
    np.testing.assert_allclose(points[:, 2], 0.0605, atol=1e-6)


def test_points_are_uniform_in_the_frame_of_a_turned_support(tmp_path: Path):
    """A fixture at any yaw, its region given in its own frame."""
    words, expected = REGIONS["polygon"]
    objects = {
        "slab": {"asset": tiles_mjcf(tmp_path), "kind": "fixture", "on": "floor"},
        "goal": {"kind": "marker", "on": "slab", "region": words},
    }
    compiled = compile_on_cpu({"floor": FLOOR, "objects": objects})
    rows = make(compiled, 4000, seed=12)
    slab, goal = (int(compiled.mjm.body(n).mocapid[0]) for n in ("slab", "goal"))
    local = []
    for data in posed(compiled, rows):
        body = compiled.mjm.body("slab").id
        local.append(data.xmat[body].reshape(3, 3).T @ (data.mocap_pos[goal] - data.xpos[body]))
    assert grid_p_value(np.array(local)[:, :2], expected) > 0.001
    assert np.ptp(rows.mocap_quat[:, slab, 0]) > 0.9


def test_two_surfaces_are_chosen_by_their_areas(tmp_path: Path):
    """Two steps of a stair, one three times as large; and within each the points are uniform."""
    geoms = '<geom type="box" size=".1 .1 .05" pos="-.1 0 .05"/><geom type="box" size=".15 .2 .1" pos=".15 0 .1"/>'
    objects = {
        "stair": {"asset": write_mjcf(tmp_path, "stair", geoms), "kind": "static"},
        "goal": {"kind": "marker", "on": "stair"},
    }
    points = goal_points({"objects": objects})
    high = points[:, 2] > 0.15
    assert stats.binomtest(int(high.sum()), len(points), 0.75).pvalue > 0.001
    assert grid_p_value(points[high, :2], box(0.0, -0.2, 0.3, 0.2), 5) > 0.001
    assert grid_p_value(points[~high, :2], box(-0.2, -0.1, 0.0, 0.1), 5) > 0.001


@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_the_support_is_eroded_by_the_ratio_times_half_the_shorter_edge(tmp_path: Path, ratio: float):
    """A brick of 16 x 8 cm: its pivot keeps 2 cm from every edge at a ratio of 0.5, and reaches that far."""
    brick = write_mjcf(tmp_path, "brick", '<geom type="box" size=".08 .04 .02" pos="0 0 .02"/>')
    objects = {
        "slab": {"asset": tiles_mjcf(tmp_path), "kind": "static"},
        "brick": {"asset": brick, "on": "slab", "ratio_on_support": ratio},
    }
    points = make(compile_on_cpu({"objects": objects}), 4000).qpos[:, :2]
    left = SHAPE.buffer(-0.04 * ratio)
    assert grid_p_value(points, left) > 0.001
    reach = shapely.distance(SHAPE.boundary, shapely.points(points)).min()
    assert 0.04 * ratio - 1e-6 <= reach < 0.04 * ratio + 0.001
