"""Grasps: what an asset says, what is made from geometry, how wide they are, and what a gripper can take."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from sceniris_gym.errors import GraspError, SceneKeyError, UnknownNameError
from sceniris_gym.grasping.grasps import Grasp, GraspSet, section
from sceniris_gym.grasping.gripper import Gripper
from tests.grasping.scenes import Scene, rotation
from tests.layout.scenes import box_mjcf, write_mjcf


@pytest.fixture
def bar(tmp_path: Path) -> Scene:
    """A bar of 10 x 4 cm, 5 cm tall."""
    return Scene(box_mjcf(tmp_path, "bar", 0.10, 0.04, 0.05))


def test_a_bar_is_taken_across_from_above(bar: Scene):
    """Straight down and tilted, the fingers close on the two long sides; along the bar it is too wide."""
    grasps = bar.grasp_set().grasps
    words = ("top", "tilt 15", "tilt 30", "tilt 45")
    assert {g.name for g in grasps} >= {f"{word} {yaw}" for word in words for yaw in (0, 180)}
    assert not {g.name for g in grasps} & {f"{word} {yaw}" for word in words for yaw in (90, 270)}
    for g in grasps:
        turn = rotation(g.quat)
        tilt = 0.0 if g.name.startswith("top") else float(g.name.split()[1])
        assert -turn[2, 2] == pytest.approx(np.cos(np.radians(tilt)))
        assert abs(turn[2, 1]) < 1e-9  # the fingers stay level
        if g.name.split()[-1] in ("0", "180"):
            assert g.opening == pytest.approx(0.04, abs=1e-9)
            assert abs(turn[1, 1]) == pytest.approx(1.0)
        assert g.opening <= bar.gripper.opening
    tops = [g.pos for g in grasps if g.name in ("top 0", "top 180")]
    assert np.allclose(tops, [0.0, 0.0, 0.025], atol=1e-9)


def test_across_a_corner_the_gap_is_that_of_the_part_between_the_fingers(bar: Scene):
    """At 45 degrees a bar of width w is w / cos(45) + 2 b wide between fingers that are 2 b wide."""
    found = {g.name: g.opening for g in bar.grasp_set().grasps}
    assert found["top 45"] == pytest.approx(0.04 * np.sqrt(2.0) + 2.0 * bar.gripper.half_width, abs=1e-6)


def test_only_what_is_taller_than_wide_is_taken_from_the_side(tmp_path: Path):
    """A post of 9 cm has side grasps, level and at half its height; one of 4 cm has none."""
    tall = Scene(box_mjcf(tmp_path, "tall", 0.05, 0.05, 0.09)).grasp_set().grasps
    low = Scene(box_mjcf(tmp_path, "low", 0.05, 0.05, 0.04)).grasp_set().grasps
    sides = [g for g in tall if g.name.startswith("side")]
    assert len(sides) == 8
    assert all(abs(rotation(g.quat)[2, 2]) < 1e-9 and g.pos[2] == pytest.approx(0.045) for g in sides)
    assert not [g for g in low if g.name.startswith("side")]


def test_the_palm_does_not_reach_what_is_grasped(tmp_path: Path):
    """However tall or deep, the TCP is no deeper in an object than the palm allows."""
    s = Scene(box_mjcf(tmp_path, "post", 0.12, 0.05, 0.3))
    for g in s.grasp_set().grasps:
        down = -rotation(g.quat)[2, 2]
        if g.name.startswith("top"):
            assert 0.3 - g.pos[2] < s.gripper.depth * down
        if g.name in ("side 0", "side 180"):
            assert 0.06 - abs(g.pos[0]) < s.gripper.depth


@pytest.mark.parametrize("height", [0.004, 0.01, 0.02])
def test_fingertips_stay_above_the_support(tmp_path: Path, height: float):
    """The lowest corner of the fingers of every grasp of something flat is above the plane it stands on."""
    s = Scene(box_mjcf(tmp_path, "flat", 0.2, 0.03, height))
    found = s.grasp_set().grasps
    assert found
    for g in found:
        corners = [[x, 0.0, s.gripper.tip] for x in (-s.gripper.half_width, s.gripper.half_width)]
        assert (g.pos + corners @ rotation(g.quat).T)[:, 2].min() > 0.001


def intervals(
    solids: list[trimesh.Trimesh], pos: np.ndarray, turn: np.ndarray, g: Gripper
) -> list[tuple[float, float]]:
    """Return the extents of solids between fingers along the closing axis, cut to their width by exact booleans."""
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = turn, pos
    room = trimesh.creation.box([2.0 * g.half_width, 2.0, 1.0 + g.tip])
    room.apply_translation([0.0, 0.0, g.tip - 0.5 * (1.0 + g.tip)])
    room.apply_transform(frame)
    cut = [trimesh.boolean.intersection([solid, room], engine="manifold") for solid in solids]
    along = []
    for c in cut:
        if len(c.vertices):
            y = (c.vertices - pos) @ turn[:, 1]
            along.append((float(y.min()), float(y.max())))
    merged: list[tuple[float, float]] = []
    for low, high in sorted(along):
        if merged and low <= merged[-1][1] + g.thickness:
            merged[-1] = (merged[-1][0], max(high, merged[-1][1]))
        else:
            merged.append((low, high))
    return merged


@pytest.mark.parametrize("asset", ["mug", "banana", "can", "pan"])
def test_the_gap_is_the_width_of_the_part_that_the_fingers_stand_around(asset: str):
    """Random TCPs around an object, against booleans of its convex pieces with the room between the fingers."""
    s = Scene(asset)
    solids = [
        trimesh.convex.convex_hull(p.mesh.vertices)
        for p in s.plan.pieces
        if p.body == s.scene.bodies["thing"] and p.mesh is not None
    ]
    low = np.min([m.bounds[0] for m in solids], axis=0)
    high = np.max([m.bounds[1] for m in solids], axis=0)
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(60):
        pos = rng.uniform(low, high)
        turn = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
        parts = intervals(solids, pos, turn, s.gripper)
        nearest = min(parts, key=lambda part: max(part[0], -part[1], 0.0), default=None)
        found = section(s.thing.triangles, pos, turn, s.gripper)
        if nearest is None or max(nearest[0], -nearest[1]) >= 0.5 * s.gripper.opening:
            assert found is None
        else:
            hits += 1
            assert found == pytest.approx(nearest, abs=2e-5)
    assert hits > 20


def test_sites_of_an_asset_take_the_place_of_made_grasps(tmp_path: Path):
    """Sites `grasp_*`, also those of a child body, in their bodies' frames; the gap is what is around the TCP there."""
    wall = '<geom type="box" size="0.1 0.004 0.03" pos="0 {y} 0.03"/>'
    rim = '<site name="grasp_rim" pos="0 0.06 0.05" quat="0 1 0 0"/><site name="grip" pos="0 0 0.1"/>'
    lid = '<geom type="box" size="0.02 0.01 0.01"/><site name="grasp_lid" quat="0 1 0 0"/>'
    lid = f'<body name="lid" pos="0 0 0.1">{lid}</body>'
    asset = write_mjcf(tmp_path, "tray", wall.format(y=-0.06) + wall.format(y=0.06) + rim + lid)
    s = Scene(asset)
    found = s.grasp_set()
    assert [g.name for g in found.grasps] == ["grasp_rim", "grasp_lid", "grasp_rim rolled", "grasp_lid rolled"]
    assert [g.body for g in found.grasps] == 2 * [s.scene.bodies["thing"], s.scene.mjm.body("thing/lid").id]
    assert [g.opening for g in found.grasps] == pytest.approx(2 * [0.008, 0.02])
    assert np.allclose(found.grasps[1].pos, 0.0)
    assert found.spans == ((0, 4),)
    for own, rolled in zip(found.grasps[:2], found.grasps[2:], strict=True):
        assert np.allclose(rotation(rolled.quat), rotation(own.quat) @ np.diag([-1.0, -1.0, 1.0]))


def test_a_pattern_that_no_site_has_selects_generated_grasps(tmp_path: Path):
    """An arm of five joints reaches them where it reaches no site. An unknown name gets the sites' names."""
    site = '<site name="grasp_rim" pos="0 0.06 0.05" quat="0 1 0 0"/>'
    asset = write_mjcf(tmp_path, "block", '<geom type="box" size="0.02 0.02 0.02" pos="0 0 0.02"/>' + site)
    made = Scene(asset, reachable="ik", grasp="top*").grasp_set()
    assert {g.name for g in made.grasps} == {f"top {yaw}" for yaw in range(0, 360, 45)}
    assert made.spans == ((0, 8),)
    assert {g.name for g in Scene(asset, reachable="ik", grasp="r*").grasp_set().grasps} == {
        "grasp_rim",
        "grasp_rim rolled",
    }
    with pytest.raises(UnknownNameError, match="rim"):
        Scene(asset, reachable="ik", grasp="rims").grasp_set()
    with pytest.raises(SceneKeyError, match=r"thing\.grasp: it lacks the part 'lid'\. Leave out this variant"):
        Scene(asset, reachable="ik", grasp="lid", parts={"lid": {"default": None}}).grasp_set()


def test_what_is_wider_than_the_gripper_opens_is_refused(tmp_path: Path):
    """A cube of 9 cm: the message names the object, its width and the gripper's."""
    s = Scene(box_mjcf(tmp_path, "cube", 0.09, 0.09, 0.09))
    with pytest.raises(
        GraspError, match=r"objects\.thing\.reachable: .*opening of 0\.09 m.* opens to 0\.08 m.*grasp_"
    ) as caught:
        s.grasp_set()
    assert caught.value.needed == pytest.approx(0.09)
    assert caught.value.opening == pytest.approx(0.08)
    wider = Scene(box_mjcf(tmp_path, "cube", 0.09, 0.09, 0.09), "ur5e")
    assert wider.grasp_set().grasps


def test_every_stable_pose_has_grasps_of_its_own(tmp_path: Path):
    """A flat box that may lie or stand: from above in each pose, and none where it is too wide."""
    s = Scene(box_mjcf(tmp_path, "flat", 0.2, 0.15, 0.05), orientation="stable")
    placed = next(o for o in s.plan.objects if o.name == "thing")
    found = s.grasp_set()
    assert len(found.spans) == len(placed.stable_poses)
    nums = []
    for pose, (first, num) in zip(placed.stable_poses, found.spans, strict=True):
        turn = rotation(pose.quat)
        tops = [g for g in found.grasps[first : first + num] if g.name.startswith("top")]
        assert all((turn @ rotation(g.quat))[2, 2] == pytest.approx(-1.0) for g in tops)
        nums.append((num > 0, bool(abs(turn[2, 2]) > 0.9)))
    assert all(has != lies for has, lies in nums)  # lying it is 15 cm wide, standing 5 cm


def test_any_orientation_has_grasps_from_all_sides(tmp_path: Path):
    """With `orientation: any` each axis of the object may be up."""
    s = Scene(box_mjcf(tmp_path, "cube", 0.05, 0.05, 0.05), orientation="any")
    approaches = {tuple(np.round(rotation(g.quat)[:, 2]).astype(int)) for g in s.grasp_set().grasps}
    assert approaches == {(0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0)}


def test_a_point_is_approached_without_a_width():
    """A marker without an asset."""
    grasps = Scene(None, kind="marker").grasp_set().grasps
    assert len(grasps) == 32
    assert all(g.opening == 0.0 and np.allclose(g.pos, 0.0) for g in grasps)


def test_grasps_that_are_kept_keep_their_stable_poses():
    """Spans may be apart, equal or empty."""
    grasps = tuple(Grasp(name, 1, np.zeros(3), np.eye(4)[0], 0.0) for name in "abcdef")
    found = GraspSet(grasps, ((0, 2), (2, 0), (2, 3), (5, 1), (2, 3))).among(np.array([0, 1, 1, 0, 1, 0], bool))
    names = [[grasp.name for grasp in found.grasps[first : first + num]] for first, num in found.spans]
    assert names == [["b"], [], ["c", "e"], [], ["c", "e"]]
    assert len(found.grasps) == 3
