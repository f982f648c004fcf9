"""Constraints that layouts would break are refused by name, limits of tendons by MuJoCo's own lengths and rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.couplings import follow
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import write_mjcf
from tests.program.scenes import checked, scene_of

OWN = """<mujoco><worldbody>
  <body name="post" pos="1 0 0"><geom type="box" size=".1 .1 .1"/><site name="hook" pos="0 0 .1"/></body>
  <body name="cup"><freejoint/><geom size=".05"/><site name="ear"/></body>
  <body name="jar" pos="0 1 0"><freejoint/><geom size=".05"/></body>
  {extra}
</worldbody>{rest}</mujoco>"""
PLACED = {"region": {"box": [[-0.2, -0.2, 0.2], [0.2, 0.2, 0.6]]}}
# A parallelogram: two cranks on a root, and a rod on the first one that meets the second one at its end.
LOOP = """<geom type="box" size=".02 .02 .02"/>
<body name="a" pos="0 0 .1"><joint name="a" axis="0 1 0"/><geom type="box" size=".01 .01 .04" pos="0 0 .05"/>
  <body name="rod" pos="0 0 .1"><joint name="rod" axis="0 1 0"/><geom type="box" size=".05 .01 .01" pos=".05 0 0"/>
  </body></body>
<body name="b" pos=".1 0 .1"><joint name="b" axis="0 1 0"/><geom type="box" size=".01 .01 .04" pos="0 0 .05"/></body>
<body name="lid" pos="0 .1 0"><joint name="lid" axis="0 1 0" range="-1 1"/><geom type="box" size=".01 .01 .01"/></body>
"""
PIN = '<equality><connect name="pin" body1="rod" body2="b" anchor=".1 0 0"/></equality>'
SLIDES = '<geom type="box" size=".02 .02 .02"/>' + "".join(
    f'<body name="{n}" pos="0 {x} 0"><joint name="{n}" type="slide" range="-.1 .2"/><geom size=".01"/></body>'
    for n, x in (("p", 0.1), ("q", 0.2), ("r", 0.3))
)
BENT = '<equality><joint joint1="r" joint2="p" polycoef=".01 .5 -3"/></equality>'
TENDON = """<tendon><fixed name="cable" limited="{limited}" range="{low} {high}">
  <joint joint="p" coef="1"/><joint joint="q" coef="-2"/><joint joint="r" coef="-1.5"/></fixed></tendon>"""
HOME = '<keyframe><key name="home" qpos="{} 0 0"/></keyframe>'


def own(folder: Path, rest: str, objects: dict, extra: str = ""):
    """The model of a scene of the user's own MJCF."""
    (folder / "own.xml").write_text(OWN.format(rest=rest, extra=extra))
    return scene_of(objects, model=str(folder / "own.xml"))


TIED = {
    "weld of two objects": (
        '<weld name="glue" body1="cup" body2="jar"/>',
        {"cup": PLACED, "jar": PLACED},
        ["equality 'glue' (weld)", "'cup'", "'jar'", "one asset"],
    ),
    "connect with a static": (
        '<connect name="pin" body1="cup" body2="post" anchor="0 0 0"/>',
        {"cup": PLACED, "post": {"kind": "static"}},
        ["equality 'pin' (connect)", "'cup' and 'post'", "Remove the equality"],
    ),
    "connect with the world": (
        '<connect body1="cup" anchor="0 0 0"/>',
        {"cup": PLACED},
        ["equality 0 (connect)", "'cup'", "'world'"],
    ),
    "weld of sites": (
        '<weld name="glue" site1="ear" site2="hook"/>',
        {"cup": PLACED},
        ["equality 'glue' (weld)", "'cup'", "'post'"],
    ),
}


@pytest.mark.parametrize(("tie", "objects", "says"), TIED.values(), ids=TIED)
def test_a_weld_or_connect_between_things_that_are_drawn_apart_is_refused(
    tmp_path: Path, tie: str, objects: dict, says: list[str]
):
    """By its name and both bodies, with what would be right; a disabled or inactive one is nobody's business."""
    with pytest.raises(NotSupportedError) as caught:
        checked(own(tmp_path, f"<equality>{tie}</equality>", objects))
    for text in says:
        assert text in str(caught.value)
    inactive = tie.replace("/>", ' active="false"/>')
    checked(own(tmp_path, f"<equality>{inactive}</equality>", objects))
    checked(own(tmp_path, f'<option><flag equality="disable"/></option><equality>{tie}</equality>', objects))


def test_a_weld_between_things_that_stay_is_allowed_where_the_start_pose_keeps_it(tmp_path: Path):
    """Neither has a region; one that the start pose misses is refused with by how much."""
    rest = '<equality><weld name="glue" body1="cup" body2="jar"/></equality>'
    checked(own(tmp_path, rest, {"cup": {}, "jar": {}}))
    key = '<keyframe><key name="home" qpos="0 0 0 1 0 0 0 0 1.5 0 1 0 0 0"/></keyframe>'
    with pytest.raises(NotSupportedError, match=r"'glue' \(weld\) is violated by 0.5 m.*keyframe 'home'"):
        checked(own(tmp_path, rest + key, {"cup": {}, "jar": {}}))


@pytest.mark.parametrize("kind", ["free", "fixture"])
def test_a_loop_within_an_object_is_allowed_unless_its_joints_are_drawn(tmp_path: Path, kind: str):
    """Wherever the object is placed; other joints of it may be drawn."""
    linkage = {"asset": write_mjcf(tmp_path, "linkage", LOOP, PIN), "kind": kind, **PLACED}
    checked(scene_of({"linkage": linkage}))
    checked(scene_of({"linkage": {**linkage, "joints": {"lid": {"fraction": [0, 1]}}}}))
    with pytest.raises(NotSupportedError, match=r"'linkage/pin' \(connect\).*'linkage/rod'.*drawing 'linkage/b' would"):
        checked(scene_of({"linkage": {**linkage, "joints": {"b": {"noise": 0.1}}}}))


TENDONS = """<tendon><fixed name="pull"><joint joint="a" coef="1"/><joint joint="lid" coef="-2"/></fixed>
  <fixed name="other"><joint joint="b" coef="1"/></fixed></tendon>"""


@pytest.mark.parametrize("second", ["", 'tendon2="other"'])
def test_an_equality_of_tendons_is_refused_where_their_joints_are_drawn(tmp_path: Path, second: str):
    """With what would be right: an equality of joints."""
    rest = TENDONS + f'<equality><tendon name="even" tendon1="pull" {second}/></equality>'
    linkage = {"asset": write_mjcf(tmp_path, "linkage", LOOP, rest), "kind": "fixture", **PLACED}
    checked(scene_of({"linkage": linkage}))
    with pytest.raises(
        NotSupportedError, match=r"even' \(tendon\).*'linkage/pull'.*drawing joints 'linkage/lid'"
    ) as caught:
        checked(scene_of({"linkage": {**linkage, "joints": {"lid": {"noise": 0.1}}}}))
    assert "<equality><joint>" in str(caught.value)
    checked(scene_of({"linkage": {**linkage, "joints": {"rod": {"noise": 0.1}}}}))


def test_a_spatial_tendon_that_pulls_is_refused_between_objects_and_allowed_within_one(tmp_path: Path):
    """Limits or stiffness; a slack one does nothing."""
    strap = '<tendon><spatial name="strap" {}><site site="ear"/><site site="hook"/></spatial></tendon>'
    for words, flag in (('limited="true" range="0 .3"', "limit"), ('stiffness="5"', "spring")):
        off = f'<option><flag {flag}="disable"/></option>'
        checked(own(tmp_path, off + strap.format(words), {"cup": PLACED}))
        with pytest.raises(NotSupportedError, match=r"tendon 'strap' has limits or stiffness.*'cup', 'world'"):
            checked(own(tmp_path, strap.format(words), {"cup": PLACED}))
        checked(own(tmp_path, strap.format(words), {"cup": {}}))
    checked(own(tmp_path, strap.format(""), {"cup": PLACED}))
    within = """<geom type="box" size=".02 .02 .02"/><site name="s"/><body name="arm" pos="0 0 .1"><site name="t"/>
      <joint name="j" axis="0 1 0" range="-1 1"/><geom type="box" size=".01 .01 .01" pos=".05 0 0"/></body>"""
    rest = '<tendon><spatial name="strap" stiffness="5"><site site="s"/><site site="t"/></spatial></tendon>'
    hook = {"asset": write_mjcf(tmp_path, "hook", within, rest), "joints": {"j": {"noise": 0.1}}, **PLACED}
    checked(scene_of({"hook": hook}))
    write_mjcf(tmp_path, "hook", within, rest.replace('stiffness="5"', 'limited="false" range="0 1"'))
    checked(scene_of({"hook": hook}))
    write_mjcf(tmp_path, "hook", within, rest.replace('stiffness="5"', 'limited="true" range="0 1"'))
    checked(scene_of({"hook": {**hook, "joints": {}}}))
    with pytest.raises(NotSupportedError, match=r"tendon 'hook/strap' is spatial and has limits.*'hook/j' changes"):
        checked(scene_of({"hook": hook}))


def test_a_fixed_tendon_may_run_between_objects(tmp_path: Path):
    """As a spring it is none of the layouts' business; what its limits allow is judged by what is drawn."""
    doors = "".join(
        f'<body name="{n}" pos="{x} 2 0"><joint name="{n}" range="-60 60"/><geom size=".1"/></body>'
        for x, n in enumerate("de")
    )
    band = '<tendon><fixed name="band" {}><joint joint="d" coef="1"/><joint joint="e" coef="1"/></fixed></tendon>'
    objects = {"d": {"kind": "static", "joints": {"d": {"value": 0.5}}}, "e": {"kind": "static"}}
    checked(own(tmp_path, band.format('stiffness="5"'), objects, doors))
    checked(own(tmp_path, band.format('limited="true" range="0 1"'), objects, doors))
    with pytest.raises(SceneKeyError, match="drawing 'd' would make tendon 'band'"):
        checked(own(tmp_path, band.format('limited="true" range="0 .2"'), objects, doors))


def test_an_equality_of_a_flex_is_refused_by_its_name(tmp_path: Path):
    """Also where the flex itself collides with nothing."""
    cloth = """<geom size=".01"/><flexcomp name="cloth" type="grid" count="3 3 1" spacing=".05 .05 .05" dim="2"
      radius=".005" mass=".1"><contact selfcollide="none" contype="0" conaffinity="0"/><edge equality="true"/>
      </flexcomp>"""
    rag = {"asset": write_mjcf(tmp_path, "rag", cloth), "kind": "static"}
    with pytest.raises(NotSupportedError, match="flex 'rag/cloth' cannot be placed"):
        checked(scene_of({"rag": rag}))


def rack(
    folder: Path, joints: dict[str, Any], limits: tuple[float, float], rest: str = "", limited: str = "true"
) -> SceneModel:
    """Three slides and a cable over them."""
    tendon = TENDON.format(limited=limited, low=limits[0], high=limits[1])
    asset = write_mjcf(folder, "rack", SLIDES, tendon + rest)
    return scene_of({"rack": {"asset": asset, "kind": "fixture", "on": "floor", "joints": joints}})


def draws(scene: SceneModel, count: int = 20_000) -> np.ndarray:
    """Positions from the intervals of the plan, their ends among them, with what follows."""
    rng = np.random.default_rng(0)
    qpos = np.tile(scene.home_qpos, (count, 1))
    for o in build_plan(scene).objects:
        for d in o.joint_ranges:
            parts = np.array(d.intervals)[rng.integers(len(d.intervals), size=count)]
            qpos[:, d.qposadr] = parts[:, 0] + np.clip(rng.uniform(-0.5, 1.5, size=count), 0, 1) * np.ptp(parts, axis=1)
    follow(scene.couplings, qpos)
    return qpos


def lengths(scene: SceneModel, qpos: np.ndarray) -> np.ndarray:
    """MuJoCo's own."""
    data, found = mujoco.MjData(scene.mjm), []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(scene.mjm, data)
        mujoco.mj_comPos(scene.mjm, data)
        mujoco.mj_tendon(scene.mjm, data)
        found.append(data.ten_length[0])
    return np.array(found)


@pytest.mark.parametrize(
    ("joints", "rest"),
    [
        ({"p": {"range": [-0.05, 0.1]}, "q": {"fraction": [0.2, 0.6]}}, ""),
        ({"p": {"choice": [-0.1, 0.0, 0.2]}, "q": {"value": 0.05}, "r": {"noise": 0.5}}, ""),
        ({"p": {"range": [-0.1, 0.2]}}, BENT),  # cable and finger turn back in between
        ({"p": {"noise": 0.05}, "q": {"noise": 0.05}}, BENT),
    ],
)
def test_limits_are_judged_by_what_mujoco_measures_over_all_draws(tmp_path: Path, joints: dict[str, Any], rest: str):
    """A cable with room for its lengths is fine, with 1 mm less it is refused, at both ends; joints that follow too."""
    free = rack(tmp_path, joints, (-9, 9), rest)
    found = lengths(free, draws(free))
    low, high = float(found.min()), float(found.max())
    checked(rack(tmp_path, joints, (low - 1e-3, high + 1e-3), rest))
    for limits in ((low + 1e-3, high + 1e-3), (low - 1e-3, high - 1e-3)):
        with pytest.raises(SceneKeyError) as caught:
            checked(rack(tmp_path, joints, limits, rest))
        for text in ("tendon 'rack/cable'", "'rack/p'", f"[{limits[0]:g}, {limits[1]:g}]", "smaller ranges"):
            assert text in str(caught.value)


def test_no_row_of_a_limit_is_beyond_it_in_what_is_accepted(tmp_path: Path):
    """MuJoCo's own constraint rows."""
    scene = rack(tmp_path, {"p": {"fraction": [0.2, 0.6]}, "r": {"noise": 0.05}}, (-0.13, 0.16))
    data, kinds = mujoco.MjData(scene.mjm), mujoco.mjtConstraint
    for row in draws(scene, 500):
        data.qpos[:] = row
        mujoco.mj_forward(scene.mjm, data)
        limits = np.isin(data.efc_type, [kinds.mjCNSTR_LIMIT_JOINT, kinds.mjCNSTR_LIMIT_TENDON])
        assert data.efc_pos[limits].min(initial=0.0) > -1e-6


def test_limits_that_act_on_nothing_drawn_or_on_nothing_at_all_are_left_alone(tmp_path: Path):
    """A cable over joints that keep their start pose, one without limits, and limits that the model switches off."""
    joints = {"p": {"fraction": [0, 1]}}
    off = '<option><flag limit="disable"/></option>'
    with pytest.raises(SceneKeyError, match="tendon 'rack/cable'"):
        checked(rack(tmp_path, joints, (-0.01, 0.01)))
    checked(rack(tmp_path, {}, (-0.01, 0.01)))
    checked(rack(tmp_path, joints, (-0.01, 0.01), limited="false"))
    model = tmp_path / "own.xml"
    tendon = TENDON.format(limited="true", low=-0.01, high=0.01)
    body = f'<worldbody><body name="rack">{SLIDES}</body></worldbody>'
    objects = {"rack": {"kind": "static", "joints": joints}}
    for option, fits in ((off, True), ("", False)):
        model.write_text(f"<mujoco>{option}{body}{tendon}</mujoco>")
        scene = scene_of(objects, model=str(model))
        if fits:
            checked(scene)
        else:
            with pytest.raises(SceneKeyError, match="tendon 'cable'"):
                checked(scene)


def test_a_start_pose_beyond_a_limit_may_be_kept_but_not_left_further(tmp_path: Path):
    """No layout makes the excess of home worse."""
    key = HOME.format(0.15)
    checked(rack(tmp_path, {"p": {"value": 0.15}, "q": {"range": [0, 0.05]}}, (-0.2, 0.1), key))
    with pytest.raises(SceneKeyError, match=r"tendon 'rack/cable' 0\.15 to 0\.16 long"):
        checked(rack(tmp_path, {"p": {"range": [0.15, 0.16]}}, (-0.2, 0.1), key))
