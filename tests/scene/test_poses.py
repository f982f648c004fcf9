"""The poses that orientations are drawn from: stable ones and their probabilities, and what a heading is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.scene.config import SceneConfig
from sceniris_gym.scene.model import build_model
from sceniris_gym.scene.poses import Variant, heading_of, matrix, of_heading_zero
from sceniris_gym.scene.program import build_plan
from tests.layout.scenes import box_mjcf, write_mjcf


def stable_poses(asset: str, geometry: str = "physics") -> list[Variant]:
    """The stable poses of an asset."""
    thing = {"asset": asset, "on": "floor", "orientation": "stable"}
    config = SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "geometry": geometry, "objects": {"thing": thing}})
    return build_plan(build_model(config)).objects[0].variants


def rectangle_share(a: float, b: float, distance: float) -> float:
    """Share of the sphere that a rectangle a x b [m] takes up, seen from `distance` in front of its middle."""
    return np.arctan2(a * b, 2.0 * distance * np.sqrt(4.0 * distance**2 + a**2 + b**2)) / np.pi


def test_a_box_lies_on_each_face_by_its_solid_angle(tmp_path: Path):
    """It topples from no face, since its centre of mass is over all of them."""
    x, y, z = 0.1, 0.06, 0.04
    poses = stable_poses(box_mjcf(tmp_path, "box", x, y, z))
    assert len(poses) == 6
    found = dict.fromkeys(range(3), 0.0)
    for pose in poses:
        found[int(np.abs(matrix(pose.quat)[2]).argmax())] += pose.probability
    expected = [2 * rectangle_share(*sides) for sides in ((y, z, x / 2), (x, z, y / 2), (x, y, z / 2))]
    assert list(found.values()) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("asset", "geometry"), [("can", "physics"), ("can_16k", "visual")])
def test_a_can_lies_on_its_side_as_often_as_it_should(asset: str, geometry: str):
    """Its round side is many narrow faces, each of them rare, which together are most of it."""
    poses = stable_poses(asset, geometry)
    ups = np.array([np.abs(matrix(p.quat)[2, 2]) for p in poses])
    standing = sum(p.probability for p, up in zip(poses, ups, strict=True) if up > 0.99)
    assert sum(p.probability for p in poses) == pytest.approx(1.0)
    assert 0.05 < standing < 0.4
    assert (ups < 0.01).sum() >= 12


def test_a_round_thing_lies_on_most_of_its_faces():
    """Next to nothing of what its faces have in probability is left out."""
    assert len(stable_poses("orange")) > 60


def test_headings_tell_turns_about_the_vertical_apart_whatever_is_up():
    """A turn by some angle changes the heading by it, also where the x axis points straight up or down."""
    c, s = np.cos(0.7), np.sin(0.7)
    yaw = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for up in ([1, 0, 0, 0], [0.5, 0.5, 0.5, 0.5], [1, 0, 1, 0], [1, 0, -1, 0], [1, 2, 3, 4]):
        mat = matrix(np.array(up) / np.linalg.norm(up))
        turned = heading_of(yaw @ mat) - heading_of(mat)
        assert np.sin(turned - 0.7) == pytest.approx(0.0, abs=1e-9), up
        assert heading_of(matrix(of_heading_zero(mat))) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("x", "y", "heading"),
    [
        ((1, 0, 0), (0, 1, 0), 0.0),
        ((0, 1, 0), (-1, 0, 0), 90.0),
        ((0, -1, 0), (1, 0, 0), -90.0),
        ((0.6, 0, -0.8), (0, 1, 0), 0.0),  # its x axis leans
        ((0.6, 0.8, 0), (0, 0, 1), 53.13010235),  # it lies on its front
        ((0, 0, 1), (0, 1, 0), 0.0),  # its x axis points up, so its y axis counts
        ((0, 0, -1), (1, 0, 0), -90.0),
    ],
    ids=str,
)
def test_a_heading_is_that_of_the_x_axis_seen_from_above(x: tuple, y: tuple, heading: float):
    """In degrees, of bodies with these axes."""
    assert np.degrees(heading_of(np.stack([x, y, np.cross(x, y)], axis=1))) == pytest.approx(heading)


def test_stable_poses_have_heading_zero(tmp_path: Path):
    """Those that stand on an end, so that the x axis points up, as well."""
    geoms = '<geom type="box" size="0.05 0.02 0.03" pos="0.01 0.02 0.03"/>'
    poses = stable_poses(write_mjcf(tmp_path, "box", geoms))
    assert [heading_of(matrix(p.quat)) for p in poses] == pytest.approx([0.0] * 6, abs=1e-9)
    on_end = [p for p in poses if abs(matrix(p.quat)[2, 0]) > 0.999]
    assert len(on_end) == 2
    for pose in on_end:  # its edges run along and across its heading
        assert pose.bounds[2:] - pose.bounds[:2] == pytest.approx([0.06, 0.04], abs=1e-9)
