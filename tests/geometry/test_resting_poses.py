"""The poses that orientations are drawn from: stable ones and their probabilities, and what a heading is."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import convex_hull, extract_pieces
from sceniris_gym.geometry.resting_poses import (
    STABLE_TILT,
    HomeShape,
    StablePose,
    _closed_hull,
    heading_of,
    of_heading_zero,
)
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.versions import since_4

FREE = ("apple", "banana", "block", "book", "bottle", "bowl", "brick", "can", "cereal_box")
FREE += ("glass", "lemon", "mug", "orange", "pan", "pear", "plate", "spatula", "tin")
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def model_of(asset: str, geometry: str = "physics") -> SceneModel:
    """A scene of one asset, which may lie in any stable pose."""
    thing = {"asset": asset, "on": "floor", "orientation": "stable"}
    config = SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "geometry": geometry, "objects": {"thing": thing}})
    return build_model(config)


def stable_poses(asset: str, geometry: str = "physics") -> list[StablePose]:
    """The stable poses of an asset."""
    return build_plan(model_of(asset, geometry)).objects[0].stable_poses


def moved(model: SceneModel, pose: StablePose, yaw: float) -> float:
    """Put the thing on the floor in a pose as resets do; return how far [m] it moves in half a second of MuJoCo C."""
    mjm, data = model.mjm, mujoco.MjData(model.mjm)
    quat = np.empty(4)
    mujoco.mju_mulQuat(quat, np.array([np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]), pose.quat)
    start = [0.0, 0.0, model.config.objects["thing"].gap] - matrix(quat) @ pose.pivot
    adr = mjm.joint("thing/free").qposadr[0]
    data.qpos[adr : adr + 7] = *start, *quat
    while data.time < 0.5:
        mujoco.mj_step(mjm, data)
    return float(np.linalg.norm(data.qpos[adr : adr + 3] - start))


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
    """Those that are wide enough to hold it."""
    assert len(stable_poses("orange")) > 60


@pytest.mark.parametrize("asset", FREE)
def test_what_is_put_down_in_a_stable_pose_stays_there(asset: str):
    """In each of its poses, turned any way: nothing tips over, and nothing rolls."""
    model, rng = model_of(asset), np.random.default_rng(0)
    poses = build_plan(model).objects[0].stable_poses
    yaws = rng.uniform(-np.pi, np.pi, (len(poses), max(1, 16 // len(poses))))
    far = [[moved(model, pose, yaw) for yaw in turns] for pose, turns in zip(poses, yaws, strict=True)]
    assert np.max(far) < 0.01


@pytest.mark.parametrize(("asset", "up"), [("book", (1, 0, 0)), ("glass", (0, 0, -1))], ids=["book", "glass"])
def test_what_lands_on_many_corners_stays_whatever_its_heading(asset: str, up: tuple):
    """A book on its spine, and a glass on its rim: the solver finds the forces that carry them."""
    model = model_of(asset)
    (pose,) = (p for p in build_plan(model).objects[0].stable_poses if matrix(p.quat)[2] @ up > 0.999)
    assert max(moved(model, pose, yaw) for yaw in np.linspace(-np.pi, np.pi, 100)) < 0.01


@pytest.mark.parametrize(("asset", "count"), [("block", 6), ("spatula", 2), ("mug", 4)])
def test_poses_on_chamfers_and_facets_are_left_out(asset: str, count: int):
    """A block lies on its six sides; a mug stands either way up, or lies on its handle to either side of it."""
    poses = stable_poses(asset)
    assert len(poses) == count
    assert asset != "mug" or max(matrix(p.quat)[2, 0] for p in poses) < 0.01


@pytest.mark.parametrize(("lean", "stands"), [(STABLE_TILT - 0.1, False), (STABLE_TILT + 0.1, True)])
def test_a_plank_stands_on_end_if_a_small_tilt_does_not_tip_it(lean: float, stands: bool, tmp_path: Path):
    """It tips over once its diagonal is vertical; what is left keeps its proportions."""
    x, y, z = 0.2 * np.tan(np.radians(lean)), 0.3, 0.2  # on its longer edge it tips sooner
    poses = stable_poses(box_mjcf(tmp_path, "plank", x, y, z))
    shares = [rectangle_share(y, z, x / 2)] * 2 + [rectangle_share(x, y, z / 2)] * 2 * stands
    found = sorted((p.probability for p in poses), reverse=True)
    assert found == pytest.approx(np.array(shares) / sum(shares), abs=1e-6)


def test_an_uneven_bottom_still_carries(tmp_path: Path):
    """A keel of one degree to either side: a tilt by more than that comes back."""
    up = 0.03 * np.tan(np.radians(1.0))
    corners = [(x, y, z) for x in (-0.03, 0.03) for y in (-0.05, 0.05) for z in (up, 0.04)]
    keel = [(0.0, -0.05, 0.0), (0.0, 0.05, 0.0)]
    vertices = " ".join(f"{value:.6f}" for corner in (*corners, *keel) for value in corner)
    asset = f'<asset><mesh name="hull" vertex="{vertices}"/></asset>'
    poses = stable_poses(write_mjcf(tmp_path, "boat", '<geom type="mesh" mesh="hull"/>', asset))
    assert sum(matrix(p.quat)[2, 2] > 0.99 for p in poses) == 2


@since_4("a mesh with a curved bottom comes to rest a few degrees off")
@pytest.mark.parametrize(("radius", "fineness"), [(0.06, 4), (0.08, 3), (0.1, 3), (0.12, 3)])
def test_a_duck_of_small_faces_rests_on_its_curved_bottom(radius: float, fineness: int, tmp_path: Path):
    """No face of it comes back from 5 degrees by itself; in MuJoCo C it comes back from 12 directions, and stays."""
    body = trimesh.creation.icosphere(subdivisions=fineness)
    body.apply_scale([0.05, 0.035, 0.03])
    points = np.array(body.vertices)
    points[:, 2] = np.maximum(points[:, 2], -0.024 + (points[:, :2] ** 2).sum(axis=1) / (2.0 * radius))
    head = trimesh.creation.icosphere(subdivisions=2, radius=0.02).vertices + [0.03, 0.0, 0.035]
    vertices = " ".join(f"{v:.7f}" for v in np.concatenate([points, head]).ravel())
    asset = f'<asset><mesh name="duck" vertex="{vertices}"/></asset>'
    path = write_mjcf(tmp_path, "duck", '<geom type="mesh" mesh="duck"/>', asset)
    model, (pose,) = model_of(path), stable_poses(path)
    assert pose.probability == 1.0
    up = matrix(pose.quat)[2]
    assert up[2] > 0.98
    assert max(moved(model, pose, yaw) for yaw in (0.0, 1.0, 2.0)) < 0.01
    for side in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
        turn = Rotation.from_rotvec(np.radians(5.0) * np.array([np.cos(side), np.sin(side), 0.0]))
        start = turn * Rotation.from_quat(pose.quat, scalar_first=True)
        data = mujoco.MjData(model.mjm)
        mjm = model.mjm
        corners = mjm.mesh_vert @ matrix(mjm.geom_quat[-1]).T + mjm.geom_pos[-1]
        adr = mjm.joint("thing/free").qposadr[0]
        data.qpos[adr : adr + 3] = [0.0, 0.0, 5e-4 - start.apply(corners)[:, 2].min()]
        data.qpos[adr + 3 : adr + 7] = start.as_quat(scalar_first=True)
        while data.time < 3.0:
            mujoco.mj_step(mjm, data)
        assert matrix(data.qpos[adr + 3 : adr + 7])[2] @ up > np.cos(np.radians(2.5))


@pytest.mark.parametrize("sides", [48, 72, 100, 144, 360])
def test_a_prism_of_many_sides_lies_on_none_of_them(sides: int, tmp_path: Path):
    """A tilt of less than 5 degrees rolls it on to the next side, or past several: it stands on its ends alone."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    ring = 0.03 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = " ".join(f"{x:.7f} {y:.7f} {z}" for z in (0.0, 0.1) for x, y in ring)
    asset = f'<asset><mesh name="hull" vertex="{vertices}"/></asset>'
    poses = stable_poses(write_mjcf(tmp_path, "prism", '<geom type="mesh" mesh="hull"/>', asset))
    assert sorted(round(matrix(p.quat)[2, 2]) for p in poses) == [-1, 1]


def test_poses_are_those_of_what_collides():
    """The fine round surface of a can is seen, and its sixteen-sided hull is what it lies on."""
    seen, collides = stable_poses("can_16k", "visual"), stable_poses("can_16k")
    assert len(seen) == len(collides) == 18
    for a, b in zip(seen, collides, strict=True):
        assert a.quat == pytest.approx(b.quat) and a.probability == b.probability


def test_poses_are_those_of_the_own_centre_of_mass(tmp_path: Path):
    """A box with all its mass at one end rights itself from its sides."""
    inertial = '<inertial pos="0 0 0.001" mass="0.1" diaginertia="1e-5 1e-5 1e-5"/>'
    box = '<geom type="box" size="0.02 0.02 0.05" pos="0 0 0.05"/>'
    poses = stable_poses(write_mjcf(tmp_path, "tumbler", inertial + box))
    upright = {round(matrix(p.quat)[2, 2]): p.probability for p in poses}
    assert set(upright) == {1, -1}
    assert upright[1] > 0.8


@pytest.mark.parametrize(
    ("geoms", "said"),
    [
        ('<geom type="sphere" size="0.03"/>', "object is unstable in every pose: a tilt of 5 degrees makes it"),
        ('<geom type="capsule" size="0.03 0.05"/>', "Use a yaw or 'any' here, or give it collision"),
        (
            '<inertial pos="0 0 0.2" mass="1" diaginertia="1 1 1"/><geom type="box" size="0.03 0.03 0.03"/>',
            r"centre of mass \[0.0, 0.0, 0.2\] m is outside .* Correct the asset's <inertial>",
        ),
        (
            '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
            '<geom type="box" size="0.03 0.03 0.03" contype="0" conaffinity="0"/>',
            "no collision geometry and no stable pose. Give it geoms that collide",
        ),
    ],
    ids=["ball", "capsule", "outside", "ghost"],
)
def test_what_lies_in_no_pose_is_refused(geoms: str, said: str, tmp_path: Path):
    """The message says why, and what would be right."""
    with pytest.raises(SceneKeyError, match=rf"objects\.thing\.orientation: the .*{said}"):
        stable_poses(write_mjcf(tmp_path, "thing", geoms))


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


def test_the_bounds_of_a_turned_thing_are_those_of_its_vertices(tmp_path: Path):
    """In random turns: the pivot is below their middle, and the ball inside is nowhere wider than they are."""
    geoms = '<geom type="box" size="0.05 0.02 0.03" pos="0.01 0.02 0.03"/>'
    geoms += '<geom type="box" size="0.01 0.06 0.01" pos="0 0.02 0.05" euler="20 10 0"/>'
    model = model_of(write_mjcf(tmp_path, "cross", geoms))
    data, root = mujoco.MjData(model.mjm), model.bodies["thing"]
    mujoco.mj_forward(model.mjm, data)
    shape = HomeShape(data, root, extract_pieces(model.mjm, "physics", {root}))
    corners = np.concatenate(
        [
            (_CORNERS * model.mjm.geom_size[g]) @ matrix(model.mjm.geom_quat[g]).T + model.mjm.geom_pos[g]
            for g in np.flatnonzero(model.mjm.geom_bodyid == root)
        ]
    )
    for turn in Rotation.random(20, rng=np.random.default_rng(0)):
        pose = shape.stable_pose(turn.as_quat(scalar_first=True))
        turned = turn.apply(corners)
        low, high = turned.min(0), turned.max(0)
        np.testing.assert_allclose(turn.apply(pose.pivot), [*0.5 * (low + high)[:2], low[2]], atol=1e-9)
        np.testing.assert_allclose(pose.bounds, 0.5 * np.array([*(low - high)[:2], *(high - low)[:2]]), atol=1e-9)
        assert 0.01 < shape.inner_radius() <= 0.5 * pose.short_edge


def test_the_hull_of_a_thing_is_that_of_all_its_pieces(tmp_path: Path):
    """Its volume by SciPy, and one convex piece of the root's body."""
    geoms = '<geom type="box" size="0.05 0.02 0.03"/><geom type="box" size="0.01 0.06 0.01" pos="0 0.02 0.05"/>'
    model = model_of(write_mjcf(tmp_path, "cross", geoms))
    data, root = mujoco.MjData(model.mjm), model.bodies["thing"]
    mujoco.mj_forward(model.mjm, data)
    hull = HomeShape(data, root, extract_pieces(model.mjm, "physics", {root})).hull(root)
    sizes, at = (a[model.mjm.geom_bodyid == root] for a in (model.mjm.geom_size, model.mjm.geom_pos))
    corners = np.concatenate([_CORNERS * size + pos for size, pos in zip(sizes, at, strict=True)])
    expected, found = ConvexHull(corners), hull.vertices + hull.pos
    assert hull.body == root
    assert len(found) == len(expected.vertices)
    assert ConvexHull(np.concatenate([found, corners])).volume == pytest.approx(expected.volume)


def test_a_hull_with_points_next_to_each_other_is_closed():
    """One that is not has lost faces, and with them the poses on them: a mug did not stand any more."""
    rng, angles = np.random.default_rng(1), 2.0 * np.pi * np.arange(70) / 70
    ring = 0.04 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    points = np.concatenate([ring, ring + [0.0, 0.0, 0.1], ring + 1e-11 * rng.normal(size=ring.shape)])
    assert not convex_hull(points).is_watertight
    hull = _closed_hull(points)
    assert hull.is_watertight
    assert hull.volume == pytest.approx(ConvexHull(points).volume, rel=1e-4)
