"""Refusals of things that cannot stand, with what would be right."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import SceneKeyError
from tests.oracle.stack_judge import STILL, StackJudge
from tests.program.scenes import checked, scene_of

MODEL = """<mujoco><option gravity="{gravity}">{flag}</option><worldbody>
  <body name="bench"><geom name="bench" type="box" size=".3 .3 .2" pos="0 0 .2"/></body>
  <body name="stand"><geom type="box" size=".02 .1 .1" pos="0 0 .1"/>
    <body name="board" pos="0 0 .22"><joint name="turn" axis="0 1 0" {joint}/>
      <geom type="box" size=".3 .1 .01"/></body></body>
  <body name="stool" pos="2 0 .0505"><freejoint/><geom type="box" size=".05 .05 .05"/>
    <geom type="box" size=".3 .3 .01" pos="0 0 .06" density="100"/></body>
  <body name="crate" {body}><freejoint/><geom name="crate" type="box" size=".05 .05 .05" {geom}/>{more}</body>
</worldbody>{rest}</mujoco>"""
LID = '<worldbody><body name="lid"><freejoint/><geom type="box" size=".04 .04 .01"/></body></worldbody>'
BEAM = '<geom type="box" size=".1 .02 .02" pos=".3 0 .1"/>'


def made(
    on: str = "bench", words: dict[str, Any] | None = None, draws: dict[str, Any] | None = None, **parts: str
) -> None:
    """Check the scene of a crate on a bench or on a board that turns, with draws of things and of the scene."""
    blank = dict.fromkeys(("flag", "joint", "body", "geom", "more", "rest"), "")
    text = MODEL.format(**{**blank, "gravity": "0 0 -9.81", **parts})
    objects = {"stand": {"kind": "static"}, "stool": {}, "crate": {"on": on, **(words or {})}}
    objects |= {"lid": {"on": "crate", **(words or {})}} if "lid" in text else {}
    drawn = draws or {}
    for name in drawn.keys() & objects.keys():
        objects[name]["randomize"] = drawn[name]
    checked(scene_of(objects, model=mujoco.MjSpec.from_string(text), randomize=drawn.get("scene", {})))


RISING = '<body gravcomp="2" pos="0 0 .06"><joint/><geom type="box" size=".02 .02 .01"/></body>'
WIND = '" wind="{} 0 0" density="1.2'
BELT = 'surfacevel=".1 0 0 0 0 0"'
REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "sideways": ({"gravity": "0 -9.81 0"}, r"crate\.on: gravity is \[0\.0, -9\.81, 0\.0\], but should point within"),
    "tilted": ({"gravity": "0 .2 -9.81"}, r"should point within 1 degree of straight down"),
    "upward": ({"gravity": "0 0 9.81"}, r"should point within"),
    "a flag": ({"flag": '<flag contact="disable"/>'}, r"<flag> disables contact or constraint"),
    "bits": ({"geom": 'contype="2" conaffinity="2"'}, r"'crate' falls through 'bench', as none of its geoms collides"),
    "an exclude": (
        {"rest": '<contact><exclude body1="bench" body2="crate"/></contact>'},
        r"'crate' falls through 'bench', .* remove an <exclude>",
    ),
    "gravcomp": ({"body": 'gravcomp="1.2"'}, r"'gravcomp' leaves the object no weight"),
    "an overhang": ({"more": BEAM}, r"'crate' falls over: its centre of mass is [0-9.]+ mm outside of its foot"),
    "a soft contact": ({"geom": 'solref="1.5 1" priority="1"'}, r"'crate' sinks into its support by [0-9.]+ mm"),
    "a soft pair": (
        {"rest": '<contact><pair geom1="bench" geom2="crate" solref=".4 1"/></contact>'},
        r"'crate' sinks into its support by [0-9.]+ mm",
    ),
    "no friction": (
        {"geom": 'friction="0 0 0" priority="1"', "rest": LID},
        r"lid\.on: 'lid' slides off 'crate', because the friction between them is 0, but should be at least 0\.02",
    ),
    "no friction on a tilt": (
        {"gravity": ".1 0 -9.8", "geom": 'condim="1" priority="1"'},
        "'crate' slides off 'bench'",
    ),
    "no friction, whatever the override says": (
        {"gravity": ".1 0 -9.8", "geom": 'condim="1" priority="1"', "flag": '<flag override="enable"/>'},
        "'crate' slides off 'bench'",
    ),
    "a loose stool": (
        {"on": "stool"},
        r"gives way by [0-9.]+ mm under 1 kg, because the scene does not place the free body 'stool'",
    ),
    "a seesaw": ({"on": "stand/board"}, r"gives way by [0-9.]+ mm under 1 kg, because too little holds joint 'turn'"),
    "a contact that may be drawn soft": (
        {"geom": 'priority="1"', "draws": {"crate": {"solref": {"abs": [[0.02, 1], [1.5, 1]]}}}},
        r"'crate' sinks into its support by [0-9.]+ mm",
    ),
    "an impedance that may be drawn soft": (
        {
            "geom": 'priority="1"',
            "draws": {"crate": {"solimp": {"choice": [[0.9, 0.95, 1e-3, 0.5, 2], [0.2, 0.95, 0.1, 0.5, 2]]}}},
        },
        r"'crate' sinks into its support by [0-9.]+ mm",
    ),
    "a mass that may be drawn small": (
        {"rest": LID, "draws": {"crate": {"mass": {"scale": [0.001, 1]}}}},
        r"'crate' sinks into its support by [0-9.]+ mm",
    ),
    "a friction that may be drawn high": (
        {"rest": LID, "draws": {"crate": {"friction": {"scale": [1, 8]}}}},
        r"'crate' sinks into its support by [0-9.]+ mm",
    ),
    "gravcomp of parts that are drawn apart": (
        {"more": RISING, "draws": {"crate": {"mass": {"scale": [0.001, 1], "each": True}}}},
        r"'gravcomp' leaves the object no weight",
    ),
    "wind": (
        {"gravity": f"0 0 -9.81{WIND.format(12)}"},
        r"gravity is .* with a wind that pushes 'crate' by up to 0\.864 N for each kg, but should",
    ),
    "a wind that is drawn": (
        {
            "gravity": f"0 0 -9.81{WIND.format(0.1)}",
            "draws": {"scene": {"wind": {"abs": [[-12, 0, 0], [0, 0, 0]]}}, "crate": {"mass": {"scale": [0.5, 2]}}},
        },
        r"with a wind that pushes 'crate' by up to 1\.73 N for each kg",
    ),
    "a joint that may be drawn weak": (
        {
            "on": "stand/board",
            "joint": 'stiffness="20000"',
            "draws": {"stand": {"stiffness": {"scale": [0.01, 1]}}},
        },
        r"gives way by [0-9.]+ mm under 1 kg, because too little holds joint 'turn'",
    ),
    "a gravity that may be drawn strong": (
        {
            "on": "stand/board",
            "joint": 'stiffness="2000"',
            "draws": {"scene": {"gravity": {"scale": [1, 15]}}},
        },
        r"gives way by [0-9.]+ mm under 1 kg, because too little holds joint 'turn'",
    ),
    "weak friction": ({"on": "stand/board", "joint": 'frictionloss=".5"'}, "gives way"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_stand_is_refused_by_name(case: str):
    """The object, its support or the joint is in the message; `stands: false` lets it fall."""
    parts, message = REFUSED[case]
    with pytest.raises(SceneKeyError, match=message):
        made(**parts)
    made(**parts, words={"stands": False})


BODY = """<mujoco><worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <body name="thing" pos="0 0 {z}"><freejoint/>{inertial}<geom {geom}/></body></worldbody></mujoco>"""
INERTIAL = '<inertial pos="{} {} {}" mass=".1" diaginertia="4e-5 4e-5 4e-5"/>'
BALL = 'type="sphere" size=".04"'
CURVED: dict[str, tuple[str, tuple[float, float, float], float, bool]] = {
    "an egg on its end": ('type="ellipsoid" size=".022 .022 .03"', (3e-4, 0.0, 0.0), 0.03, False),
    "an egg on its side": ('type="ellipsoid" size=".03 .022 .022"', (1e-3, 0.0, 0.0), 0.022, True),
    "a lens": ('type="ellipsoid" size=".05 .05 .015"', (2e-3, 1e-3, 0.0), 0.015, True),
    "a ball": (BALL, (0.0, 1e-4, 0.0), 0.04, True),
    "a ball with a weight in its side": (BALL, (0.0, 1e-3, 0.0), 0.04, False),
    "a ball that rolls by more than it may until it is at rest": (BALL, (6e-3, 0.0, -0.02), 0.04, False),
    "a ball with a weight below": (BALL, (1e-3, 0.0, -0.02), 0.04, True),
    "a ball with a weight above": (BALL, (1e-3, 0.0, 0.02), 0.04, False),
    "a capsule on its end": ('type="capsule" size=".03 .06"', (1e-3, 0.0, 0.0), 0.09, False),
    "a capsule on its side": ('type="capsule" size=".03 .06" euler="90 0 0"', (0.0, 0.03, 0.0), 0.03, True),
    "a capsule with a weight in its side": ('type="capsule" size=".03 .06" euler="90 0 0"', (1e-3, 0, 0), 0.03, False),
    "a cylinder on its side": ('type="cylinder" size=".03 .06" euler="0 90 0"', (0.04, 5e-5, 0.0), 0.03, True),
}


@pytest.mark.parametrize("case", CURVED)
def test_what_balances_on_a_curved_foot_is_refused(case: str):
    """A thing is refused by name if it rolls over in MuJoCo C, which drops it as a layout does, and else taken."""
    geom, center, height, stays = CURVED[case]
    text = BODY.format(geom=geom, inertial=INERTIAL.format(*center), z=height + 0.0005)
    mjm = mujoco.MjModel.from_xml_string(text)
    moved = StackJudge(mjm).moves(mjm.qpos0, np.zeros((0, 3)), np.zeros((0, 4))).max()
    assert (moved <= STILL) == stays
    scene = scene_of({"thing": {"on": "floor"}}, model=mujoco.MjSpec.from_string(text))
    message = r"thing\.on: 'thing' rolls over: its foot is curved, and its centre of mass too high or too far from the"
    with nullcontext() if stays else pytest.raises(SceneKeyError, match=message):
        checked(scene)


def _can(degrees: float) -> str:
    """Return a can of 6.6 x 10 cm, the bottom of which is cut off at an angle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ring = 0.033 * np.column_stack([np.cos(angle), np.sin(angle)])
    low, high = ring[:, 0] * np.tan(np.radians(degrees)), np.full(48, 0.1)
    vertex = " ".join(f"{v:.6f}" for end in (low, high) for v in np.column_stack([ring, end]).ravel())
    asset = f'<mujoco><asset><mesh name="can" vertex="{vertex}"/></asset>'
    return BODY.format(geom='type="mesh" mesh="can"', inertial="", z=0.0).replace("<mujoco>", asset)


@pytest.mark.parametrize(("degrees", "stays"), [(4.0, True), (6.0, True), (12.0, False)])
def test_what_rocks_to_rest_within_a_centimetre_stands(degrees: float, stays: bool):
    """A can with a slanted bottom is taken if it moves by less than 1 cm in MuJoCo C, and else refused."""
    spec = mujoco.MjSpec.from_string(_can(degrees))
    mjm = spec.compile()
    start = mjm.qpos0.copy()
    start[2] += 0.0005 + 0.033 * np.tan(np.radians(degrees))
    assert (StackJudge(mjm).moves(start, np.zeros((0, 3)), np.zeros((0, 4))).max() <= STILL) == stays
    scene = scene_of({"thing": {"on": "floor"}}, model=spec)
    with nullcontext() if stays else pytest.raises(SceneKeyError, match=r"'thing' (rolls|falls) over"):
        checked(scene)
    scene = scene_of({"thing": {"on": "floor"}, "lid": {"asset": "can", "on": "thing"}}, model=spec)
    with pytest.raises(SceneKeyError, match=r"'thing' (rolls|falls) over"):  # it would throw the can off
        checked(scene)


LOOSE = """<mujoco><worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <body name="post" pos="0 0 .1"><geom name="post" type="cylinder" size=".05 .1"/></body>
  <body name="bench" pos="1 0 .1">{joint}<geom name="bench" type="box" size=".2 .2 .1"/></body>
  <body name="thing" pos="0 0 2"><freejoint/><geom {geom}/></body></worldbody></mujoco>"""
ROLLER = 'type="cylinder" size=".03 .06" euler="0 90 0"'


@pytest.mark.parametrize(
    ("geom", "on", "joint", "stays"),
    [(BALL, "floor", "", True), (BALL, "bench", "", True), (BALL, "bench", "<freejoint/>", False)]
    + [(ROLLER, "floor", "", True), (ROLLER, "bench", "", False)],
)
def test_what_rolls_freely_needs_what_cannot_move(geom: str, on: str, joint: str, stays: bool):
    """A ball on a loose bench, and a roller where MuJoCo's contacts are a little off, as they are on a box."""
    objects = {"thing": {"on": on}} | ({"bench": {"on": "floor"}} if joint else {})
    spec = mujoco.MjSpec.from_string(LOOSE.format(geom=geom, joint=joint))
    message = r"thing\.on: 'thing' rolls over: .* from the middle for 'bench', which is not a fixed plane"
    with nullcontext() if stays else pytest.raises(SceneKeyError, match=message):
        checked(scene_of(objects, model=spec))


def test_edges_on_a_cylinder_are_refused():
    """MuJoCo finds depths of centimetres there: a lemon is thrown off. A mesh of the cylinder is taken."""
    banana = {"asset": "banana", "on": "post"}
    with pytest.raises(SceneKeyError, match="'banana' touches the cylinder 'post' with edges of its geoms"):
        checked(scene_of({"banana": banana}, model=mujoco.MjSpec.from_string(LOOSE.format(geom=BALL, joint=""))))


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "geom_surfacevel"), reason="this MuJoCo has no belts")
def test_a_belt_is_no_support():
    """Of the thing or below it, unless that is meant to be carried away."""
    with pytest.raises(SceneKeyError, match=r"'crate' does not stay on 'bench': a geom of one of them has"):
        made(geom=BELT)
    made(geom=BELT, words={"stands": False})


def test_a_breeze_moves_nothing():
    """Neither does a medium without wind."""
    made(gravity=f"0 0 -9.81{WIND.format(2)}")
    made(gravity='0 0 -9.81" density="1000" viscosity=".001')


@pytest.mark.parametrize("joint", ['frictionloss="30"', 'range="0 .1" stiffness="2000"'])
def test_a_joint_that_holds_the_load_is_a_support(joint: str):
    """By its friction, or by its spring."""
    made(on="stand/board", joint=joint, words={"region": {"box": [[-0.1, -0.1], [0.1, 0.1]]}})


def test_a_loose_support_that_holds_the_load_is_one():
    """A stool that is not placed carries things over its foot."""
    made(on="stool", words={"region": {"box": [[-0.02, -0.02], [0.02, 0.02]]}})


def test_nothing_pulls_without_gravity():
    """Things without weight stay where they are put."""
    made(gravity="0 0 0")


def test_more_levels_than_there_is_room_for_are_refused():
    """Thirteen crates on each other."""
    names = [f"c{i}" for i in range(13)]
    bodies = "".join(f'<body name="{n}"><freejoint/><geom type="box" size=".05 .05 .05"/></body>' for n in names)
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    objects = {name: {"on": below} for below, name in zip(["floor", *names], names, strict=False)}
    with pytest.raises(SceneKeyError, match=r"c12\.on: 13 free objects stand on each other, but .* at most 12"):
        checked(scene_of(objects, model=spec))


def test_visible_pieces_carry_nothing():
    """With visual geometry the contacts are those of the geoms that collide, wherever these end."""
    objects = {"pan": {"asset": "pan", "on": "floor"}, "block": {"asset": "block", "in": "pan"}}
    checked(scene_of(objects, geometry="visual"))
    text = """<mujoco><worldbody><body name="bench">
      <geom type="box" size=".3 .3 .2" pos="0 0 .2" contype="0" conaffinity="0"/>
      <geom type="box" size=".3 .3 .199" pos="0 0 .199" group="3" solref="1.5 1" priority="1"/></body>
      <body name="crate"><freejoint/><geom type="box" size=".05 .05 .05"/></body></worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(text)
    with pytest.raises(SceneKeyError, match="'crate' sinks into its support"):
        checked(scene_of({"crate": {"on": "bench"}}, model=spec, geometry="visual"))


SWIVEL = """<mujoco><worldbody><body name="stand"><freejoint/><geom type="box" size=".06 .06 .02"/>
  <body name="arm" pos="0 0 .03"><joint name="tilt" axis="0 1 0" range="-90 90" damping="100" frictionloss="20"/>
    <geom type="capsule" fromto="0 0 .02 .2 0 .02" size=".01" density="100"/></body>
  <body name="skid" pos="0 0 -.019"><joint name="out" type="slide" axis="1 0 0" range="0 .2" frictionloss="20"/>
    <geom type="box" size=".05 .05 {skid}" density="100"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("joints", "skid", "below"),
    [
        ({"tilt": {"fraction": [0, 1]}}, 0.001, "160 mm"),
        ({"tilt": {"choice": [0.0, 0.4]}}, 0.001, "19.5 mm"),
        ({"tilt": {"range": [-1.5, 0.1]}, "out": {"fraction": [0, 1]}}, 0.001, None),
        ({"tilt": {"value": -0.4}}, 0.001, None),
        ({"out": {"fraction": [0, 1]}}, 0.002, "1 mm"),
        ({"out": {"value": 0.0}}, 0.002, None),
    ],
    ids=["any tilt", "one of two tilts", "up or level", "always up", "on its skid", "with its skid still"],
)
def test_parts_that_drawn_joints_move_below_the_foot_are_refused(joints: dict, skid: float, below: str | None):
    """An arm of 20 cm that hangs down, or a skid that is the lowest part; what is still is part of the foot."""
    spec = mujoco.MjSpec.from_string(SWIVEL.format(skid=skid))
    scene = scene_of({"stand": {"on": "floor", "joints": joints}}, model=spec)
    if below is None:
        checked(scene)
        return
    name = next(iter(joints))
    message = rf"stand\.on: 'stand' might not stand on its foot: the drawn joints '{name}' .* up to {below} below"
    with pytest.raises(SceneKeyError, match=message):
        checked(scene)


SEEN = """<mujoco><worldbody><body name="bench">
    <geom type="box" size=".3 .3 .2" pos="0 0 .2" contype="0" conaffinity="0"/>
    <geom type="box" size=".3 .3 .2" pos="0 0 {bench}" group="3"/></body>
  <body name="crate"><freejoint/><geom type="box" size=".05 .05 .05" contype="0" conaffinity="0" mass="0"/>
    <geom type="box" size=".05 .05 .05" pos="0 0 {crate}" group="3"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("bench", "crate", "place"),
    [
        (0.2, 0.03, "30 mm below"),
        (0.2, -0.03, "30 mm above"),
        (0.17, 0.0, "30 mm below"),
        (0.21, -0.01, "20 mm above"),
        (0.2, 0.002, None),
        (0.21, 0.01, None),
    ],
)
def test_visible_geoms_end_where_colliding_ones_do(bench: float, crate: float, place: str | None):
    """Up to 2 mm lower or higher, of an object and its support together."""
    scene = scene_of(
        {"crate": {"on": "bench"}},
        model=mujoco.MjSpec.from_string(SEEN.format(bench=bench, crate=crate)),
        geometry="visual",
    )
    if place is None:
        checked(scene)
        return
    with pytest.raises(SceneKeyError, match=rf"crate\.on: 'crate' would stand {place} the height .* limit is 2 mm"):
        checked(scene)


def test_the_lowest_geom_is_one_that_the_support_carries():
    """A peg that the bench does not collide with would hold the crate 2 cm over it."""
    peg = '<geom type="sphere" size=".02" pos="0 0 -.05" contype="2" conaffinity="2"/>'
    with pytest.raises(SceneKeyError, match=r"'crate' would stand 20 mm below the height"):
        made(more=peg)


LEG = """<body name="thigh_{0}" pos="0 {1} -.05"><joint name="hip_{0}" axis="0 1 0" armature=".1" damping="1"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.18"/><body name="shin_{0}" pos="0 0 -.18">
  <joint name="knee_{0}" axis="0 1 0" armature=".1" damping="1"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.15"/>
  <geom type="box" size=".08 .03 .01" pos="0 0 -.18" euler="0 -34.4 0"/></body></body>"""
SERVOS = "".join(f'<position joint="{joint}_{{0}}" kp="{{1}}"/>' for joint in ("hip", "knee"))
WALKER = """<mujoco>{ground}<worldbody><body name="thing"><freejoint/><geom type="box" size=".1 .1 .05" mass="8"/>{legs}
  </body></worldbody><actuator>{servos}</actuator>
  <keyframe><key name="home" qpos="0 0 .34 1 0 0 0 -.6 1.2 -.6 1.2" ctrl="-.6 1.2 -.6 1.2"/></keyframe></mujoco>"""
OVEN = """<mujoco>{ground}<worldbody><body name="thing"><freejoint/><geom type="box" size=".15 .15 .15" mass="{mass}"/>
  <body name="flap" pos="0 -.16 0"><joint name="flap" axis="1 0 0" range="-90 90" {hold}/>
    <geom type="box" size=".13 .1 .005" pos="0 -.1 0" mass=".3"/></body></body></worldbody>
  <keyframe><key name="home" qpos="0 0 .15 1 0 0 0 -.8"/></keyframe></mujoco>"""
GROUND = '<worldbody><geom type="plane" size="2 2 .1"/></worldbody>'


def walker(strength: float) -> str:
    """Return the text of a walker with bent knees, but for its ground."""
    legs, servos = LEG.format(0, 0.08) + LEG.format(1, -0.08), SERVOS.format(0, strength) + SERVOS.format(1, strength)
    return WALKER.replace("{legs}", legs).replace("{servos}", servos)


def oven(mass: float, hold: str = "") -> str:
    """Return the text of a box with a flap that starts half open, but for its ground."""
    return OVEN.replace("{mass}", str(mass)).replace("{hold}", hold)


JOINTED = {
    "a walker on weak legs": (walker(5.0), r"\['hip_0', 'knee_0', 'hip_1', 'knee_1'\]"),
    "a walker on strong legs": (walker(3000.0), None),
    "a light box with a loose flap": (oven(0.2), r"\['flap'\]"),
    "a heavy box with a loose flap": (oven(1.0), None),
    "a light box with a flap that stays": (oven(0.3, 'frictionloss="2"'), None),
}


@pytest.mark.parametrize("case", JOINTED)
def test_joints_that_give_way_are_refused_where_the_object_moves(case: str):
    """As MuJoCo C moves the object by 1 cm in half a second, or not, on a plane of its own."""
    text, names = JOINTED[case]
    mjm = mujoco.MjModel.from_xml_string(text.format(ground=GROUND))
    data = mujoco.MjData(mjm)
    mujoco.mj_resetDataKeyframe(mjm, data, 0)
    mujoco.mj_forward(mjm, data)
    data.qpos[2] -= np.min(data.contact.dist, initial=0.0)
    start = data.qpos[:3].copy()
    mujoco.mj_step(mjm, data, 250)
    moved = np.linalg.norm(data.qpos[:3] - start)
    assert (moved > 0.01) == (names is not None)
    spec = mujoco.MjSpec.from_string(text.format(ground=""))
    scene = scene_of({"thing": {"on": "floor"}}, model=spec)
    if names is None:
        checked(scene)
        return
    with pytest.raises(
        SceneKeyError, match=rf"thing\.on: 'thing' moves by [0-9.]+ mm: its joints {names} give way.*'in_model'"
    ):
        checked(scene)
