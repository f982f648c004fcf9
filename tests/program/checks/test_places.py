"""Scenes far from the origin are refused where single precision would decide, and what gets to where things park."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.program.checks.places import check_parking, check_rough_shapes
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.parking import PARKING_FROM, PARKING_SPACING
from tests.layout.scenes import box_mjcf, write_mjcf

CRATE = '<body name="crate"><freejoint/><geom type="box" size=".05 .05 .05"/></body>'
GROUPS = {"some": {"of": ["small"], "count": [0, 1]}}


def _upload(folder: Path, bodies: str, objects: dict[str, Any], **words: Any) -> None:
    path = folder / "own.xml"
    path.write_text(f"<mujoco><worldbody>{bodies}{CRATE}</worldbody></mujoco>")
    scene = {"model": str(path), "floor": {"size": [1, 1]}, "objects": objects, **words}
    upload_scene(build_model(SceneConfig.load(scene)), "cpu")


def _slab(half: float, at: str = "0 0 -1") -> str:
    return f'<body name="slab" pos="{at}"><geom name="top" type="box" size="{half} {half} 1"/></body>'


def test_a_support_of_five_kilometres_needs_a_region(tmp_path: Path):
    """An object on it could get as far as it reaches; a region near the origin does not cure its corners."""
    objects = {"slab": {"kind": "static"}, "crate": {"on": "slab"}}
    with pytest.raises(SceneKeyError, match=r"objects\.crate\.on: 'slab' reaches 400 m .* within 100 m .* 'region'"):
        _upload(tmp_path, _slab(400), objects)
    near = {"region": {"box": [[-1, -1], [1, 1]]}}
    _upload(tmp_path, _slab(400), {**objects, "crate": {"on": "slab", **near}})
    with pytest.raises(SceneKeyError, match=r"geom 'top': reaches 2500 m .* Use a plane"):
        _upload(tmp_path, _slab(2500), {**objects, "crate": {"on": "slab", **near}})


@pytest.mark.parametrize(("half", "fits"), [(100, True), (101, False)])
def test_a_support_may_reach_as_far_as_a_floor(tmp_path: Path, half: float, fits: bool):
    """To 100 m along each axis."""
    objects = {"slab": {"kind": "static"}, "crate": {"on": "slab"}}
    if fits:
        _upload(tmp_path, _slab(half), objects)
    else:
        with pytest.raises(SceneKeyError, match="should be placed within 100 m"):
            _upload(tmp_path, _slab(half), objects)


def test_a_scene_built_far_away_is_refused(tmp_path: Path):
    """A support, an anchor or a robot at 5 km, each by its name; the sides of the origin are all the same."""
    with pytest.raises(SceneKeyError, match=r"objects\.slab: stands at \(5000, 0, -1\) m"):
        _upload(tmp_path, _slab(1, "5000 0 -1"), {"slab": {"kind": "static"}, "crate": {"on": "slab"}})
    with pytest.raises(SceneKeyError, match=r"objects\.slab: stands at \(0, -5000, -1\) m"):
        _upload(tmp_path, _slab(1, "0 -5000 -1"), {"slab": {"kind": "static"}, "crate": {"on": "floor"}})
    with pytest.raises(SceneKeyError, match=r"robot\.base\.2: 5000 should be from -100 to 100 m"):
        _upload(tmp_path, "", {}, robot={"asset": "panda", "base": [0, 0, 5000]})


def test_what_is_placed_near_may_come_from_far_away(tmp_path: Path):
    """A free body that the model keeps far away stands wherever it is placed."""
    far = CRATE.replace('"crate"', '"other" pos="5000 0 0"')
    _upload(tmp_path, far, {"other": {"on": "floor"}})
    with pytest.raises(SceneKeyError, match=r"objects\.other: stands at"):
        _upload(tmp_path, far, {"other": {}})


def test_what_nothing_can_meet_is_left_alone(tmp_path: Path):
    """A house at 5 km that is no object; the same house with a wing that comes near is refused."""
    _upload(tmp_path, _slab(1, "5000 0 0"), {"crate": {"on": "floor"}})
    with pytest.raises(SceneKeyError, match="geom 'top': reaches"):
        _upload(tmp_path, _slab(4990, "5000 0 -1"), {"crate": {"on": "floor"}})


def test_what_is_placed_ends_near_its_own_origin(tmp_path: Path):
    """A geom at 1e8 m cancels against the object's place, and leaves a rest of metres."""
    far = CRATE.replace('"crate"', '"other"').replace("/></body>", '/><geom size=".01" pos="0 90000 0"/></body>')
    with pytest.raises(SceneKeyError, match=r"objects\.other: geom .* reaches 9e\+04 m .* within 100 m"):
        _upload(tmp_path, far, {"other": {"on": "floor"}})


def test_limits_that_are_no_limits_are_not_drawn_from(tmp_path: Path):
    """A fraction of [-1e30, 1e30] is a number of no meaning."""
    arm = '<body name="arm"><joint name="turn" limited="true" range="-1e30 1e30"/><geom size=".01"/></body>'
    turned = {"joints": {"turn": {"fraction": [0, 1]}}, "kind": "static"}
    with pytest.raises(SceneKeyError, match=r"objects\.arm\.joints: 'arm/turn' is drawn between -1.* from -100 to 100"):
        _upload(tmp_path, arm.replace('name="turn"', 'name="arm/turn"'), {"arm": turned})


def test_a_plane_has_no_end(tmp_path: Path):
    """Wherever its middle is: only its height and slope are used."""
    _upload(tmp_path, '<geom type="plane" size="1 1 .1" pos="5000 0 -1"/>', {"crate": {"on": "floor"}})


def _scene(folder: Path, objects: dict[str, Any], groups: dict[str, Any] | None = None, **others: Any) -> SceneModel:
    """A scene of a small box that may be absent, and these objects."""
    small = {"asset": box_mjcf(folder, "small", 0.1, 0.1, 0.1), "region": {"box": [[0, 0, 1], [1, 1, 2]]}}
    config = {"objects": {"small": small, **objects}, "groups": GROUPS if groups is None else groups, **others}
    return build_model(SceneConfig.load(config))


def _check(scene: SceneModel) -> None:
    check_parking(build_plan(scene))


def _crane(folder: Path, reach: float) -> str:
    """Write a post with a boom that swings all around and slides out as far as this; return the file's path."""
    slide = f'<joint name="out" type="slide" axis="1 0 0" range="0 {reach}"/>'
    tip = f'<body pos="0 0 .1">{slide}<geom type="box" size=".5 .05 .05"/></body>'
    boom = f'<body name="boom" pos="0 0 2"><joint name="swing" axis="0 0 1" range="-180 180"/>{tip}</body>'
    inertia = '<geom type="box" size=".1 .1 1" pos="0 0 1"/>'
    return write_mjcf(folder, f"crane_{reach}", inertia + boom.replace("<joint", '<geom size=".05"/><joint', 1))


def _farthest(scene: SceneModel, name: str, half: np.ndarray) -> float:
    """The larger of the least coordinates [m] at which MuJoCo finds a corner of an object that stands anywhere."""
    mjm, data, draws = scene.mjm, mujoco.MjData(scene.mjm), np.random.default_rng(0)
    bodies, mocap = scene.subtree(name), int(scene.mjm.body_mocapid[scene.bodies[name]])
    geoms = [g for g in range(mjm.ngeom) if mjm.geom_bodyid[g] in bodies]
    joints = [j for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in bodies]
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    best = -np.inf
    for _ in range(300):
        low, high = mjm.jnt_range[joints].T
        data.qpos[mjm.jnt_qposadr[joints]] = np.where(draws.random(len(joints)) < 0.3, high, draws.uniform(low, high))
        data.mocap_pos[mocap, :2] = half * draws.choice([1.0, 0.9], 2)
        mujoco.mj_kinematics(mjm, data)
        for g in geoms:
            points = (corners * mjm.geom_size[g]) @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g]
            best = max(best, float(points[:, :2].min(axis=1).max()))
    return best


@pytest.mark.parametrize("reach", [0.5, 5.0, 20.0, 60.0])
@pytest.mark.parametrize("size", [2.0, 50.0, 70.0, 76.5])
def test_what_can_reach_the_places_is_refused(tmp_path: Path, size: float, reach: float):
    """A crane anywhere on a floor: whenever MuJoCo finds a state in which it gets there, and never far from it."""
    joints = {"*": {"fraction": [0, 1]}}
    crane = {"asset": _crane(tmp_path, reach), "kind": "fixture", "on": "floor", "joints": joints}
    scene = _scene(tmp_path, {"crane": crane}, floor={"size": [size, size]})
    reached = _farthest(scene, "crane", np.full(2, 0.5 * size))
    if reached > PARKING_FROM - PARKING_SPACING:
        with pytest.raises(SceneKeyError, match=r"objects\.crane: reaches as far as .* are parked from \(40, 40\) m"):
            _check(scene)
    elif reached < 0.3 * PARKING_FROM:
        _check(scene)


@pytest.mark.parametrize("far", [10.0, 39.0])
def test_the_points_of_a_region_are_where_an_object_can_get(tmp_path: Path, far: float):
    """In space, where the farthest of them counts, along each axis by itself."""
    stone = {"asset": box_mjcf(tmp_path, "stone", 0.1, 0.1, 0.1), "kind": "fixture"}
    scene = _scene(tmp_path, {"stone": {**stone, "region": {"points": [[far, 0.0, 1.0], [0.0, far, 1.0]]}}})
    if far < PARKING_FROM - PARKING_SPACING:
        _check(scene)
    else:
        with pytest.raises(SceneKeyError, match=r"objects\.stone: reaches as far as"):
            _check(scene)


def test_what_swings_about_a_far_off_point_is_refused(tmp_path: Path):
    """A small thing whose hinge is 15 m beside it; MuJoCo sees it go ten metres farther than it stands."""
    swing = '<joint name="swing" axis="0 0 1" pos="15 0 0" range="-180 180"/><geom type="box" size=".1 .1 .1"/>'
    rock = write_mjcf(tmp_path, "rock", f'<geom type="box" size=".1 .1 .1"/><body name="swing">{swing}</body>')
    thing = {"asset": rock, "kind": "fixture", "on": "floor", "joints": {"swing": {"fraction": [0, 1]}}}
    scene = _scene(tmp_path, {"rock": thing}, floor={"size": [60, 60]})
    assert _farthest(scene, "rock", np.full(2, 30.0)) > PARKING_FROM
    with pytest.raises(SceneKeyError, match=r"objects\.rock: "):
        _check(scene)


def test_what_stays_at_the_places_is_refused_by_its_name(tmp_path: Path):
    """A tower that nobody places, and one of the user's own model; beside one of the two axes they may stand."""
    body = '<geom type="box" size="1 1 1" pos="{0} {1} 1"/>'
    for at, fits in (((41, 41), False), ((41, 10), True), ((10, 60), True), ((-45, -45), True)):
        tower = {"asset": write_mjcf(tmp_path, f"tower_{at[0]}_{at[1]}", body.format(*at)), "kind": "static"}
        scene = _scene(tmp_path, {"tower": tower})
        if fits:
            _check(scene)
        else:
            with pytest.raises(SceneKeyError, match=r"objects\.tower: reaches as far as \(42, 42\) m"):
                _check(scene)
    own = tmp_path / "own.xml"
    own.write_text(f'<mujoco><worldbody><body name="mast">{body.format(41, 41)}</body></worldbody></mujoco>')
    with pytest.raises(SceneKeyError, match="body 'mast': reaches as far as"):
        _check(_scene(tmp_path, {}, model=str(own)))


def test_what_lies_flat_on_the_ground_is_in_nobody_s_way(tmp_path: Path):
    """A sheet that ends at the height of the ground, under the places."""
    sheet = write_mjcf(tmp_path, "sheet", '<geom type="box" size="60 60 .01" pos="0 0 -.01"/>')
    _check(_scene(tmp_path, {"sheet": {"asset": sheet, "kind": "static"}}))


@pytest.mark.parametrize(("width", "fits"), [(PARKING_SPACING - 0.01, True), (PARKING_SPACING + 0.01, False)])
def test_what_may_be_absent_is_narrower_than_the_places_are_apart(tmp_path: Path, width: float, fits: bool):
    """Else neighbours would touch; a group that is always whole asks nothing of its members."""
    slab = {"asset": box_mjcf(tmp_path, "slab", width, 0.5, 0.1), "region": {"box": [[0, 0, 1], [1, 1, 2]]}}
    groups = {"some": {"of": ["slab"], "count": [0, 1]}}
    if fits:
        _check(_scene(tmp_path, {"slab": slab}, groups))
    else:
        with pytest.raises(SceneKeyError, match=rf"objects\.slab: is {width:.3g} m wide and may be absent"):
            _check(_scene(tmp_path, {"slab": slab}, groups))
    _check(_scene(tmp_path, {"slab": slab}, {"all": {"of": ["slab"], "count": 1}}))


def test_a_variant_that_is_too_large_is_to_be_left_out(tmp_path: Path):
    """It is in no group that the user wrote."""
    slab = {"variants": {"one": {"asset": box_mjcf(tmp_path, "slab", 3.0, 0.5, 0.1)}, "two": {"asset": "can"}}}
    with pytest.raises(SceneKeyError, match=r"objects\.slab/one: is 3 m wide .* or leave this variant out\."):
        _check(_scene(tmp_path, {"slab": {**slab, "region": {"box": [[0, 0, 1], [1, 1, 2]]}}}))


def test_what_a_condition_leaves_out_is_to_be_placed_in_every_layout(tmp_path: Path):
    """It is in no group; on several supports it has the name of the scene file."""
    slab = {"asset": box_mjcf(tmp_path, "slab", 3.0, 0.5, 0.1), "on": "floor"}
    for words in ({"if": "small"}, {"on": ["floor", "table"]}):
        objects = {"table": {"asset": "table", "kind": "static"}, "slab": {**slab, **words}}
        with pytest.raises(SceneKeyError, match=r"objects\.slab: is 3 m wide .* or place it in every layout\."):
            _check(_scene(tmp_path, objects, floor={"size": [4, 4]}))


def test_without_groups_anything_may_stand_there(tmp_path: Path):
    """Nothing is parked, so nothing is in the way."""
    tower = {"asset": write_mjcf(tmp_path, "tower", '<geom type="box" size="1 1 1" pos="41 41 1"/>'), "kind": "static"}
    _check(_scene(tmp_path, {"tower": tower}, {}))


HILLS = '<asset><hfield name="hills" nrow="2" ncol="2" size=".5 .5 .1 .1" elevation="0 1 0 1"/></asset>'
HILL = '<geom name="hill" type="hfield" hfield="hills" pos="{} 0 0"/>'
FLAG = """<body name="pole" pos="{} 0 0.1"><flexcomp name="flag" type="grid" count="3 3 1" spacing=".05 .05 .05" dim="2"
  rigid="true" radius=".005" mass=".1"><contact selfcollide="none"/></flexcomp></body>"""


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize(
    ("shape", "at", "says"),
    [(HILL, 0.3, "geom 'hill': a hfield"), (HILL, 0.95, "geom 'hill': a hfield"), (HILL, 1.6, None)]
    + [(FLAG, 0.3, "flex 'flag': a soft body"), (FLAG, 1.0, None)],
)
def test_what_is_no_obstacle_is_refused_near_placed_objects(
    tmp_path: Path, geometry: str, shape: str, at: float, says: str | None
):
    """The crate stays on the floor, and MuJoCo finds no contact in the place where it is nearest."""
    body = shape.format(at) + "</worldbody>" + HILLS + "<worldbody>"
    if says is not None:
        with pytest.raises(NotSupportedError, match=rf"{says} cannot be an obstacle\. Use .*, or keep objects\.crate"):
            _upload(tmp_path, body, {"crate": {"on": "floor"}}, geometry=geometry)
        return
    _upload(tmp_path, body, {"crate": {"on": "floor"}}, geometry=geometry)
    mjm = mujoco.MjModel.from_xml_path(str(tmp_path / "own.xml"))
    data = mujoco.MjData(mjm)
    data.qpos[:3] = 0.5, 0.0, 0.05
    mujoco.mj_forward(mjm, data)
    assert data.ncon == 0


def test_a_height_field_that_layouts_move_is_refused_with_the_key_of_its_asset(tmp_path: Path):
    """However far away the other objects are."""
    land = write_mjcf(tmp_path, "land", '<geom name="hill" type="hfield" hfield="hills"/>', HILLS)
    objects = {"land": {"asset": land, "region": {"box": [[9, 9, 9], [10, 10, 10]]}}}
    with pytest.raises(NotSupportedError, match=r"objects\.land\.asset: geom '.*hill': a hfield cannot be an obstacle"):
        check_rough_shapes(build_plan(_scene(tmp_path, objects, {})))
