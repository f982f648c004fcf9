"""Stances of objects: springs by MuJoCo C, what carries them, and what needs no test."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from sceniris_gym.program.plan import build_plan
from sceniris_gym.program.standing import FLAT, ROUND, carriers_of
from tests.layout.scenes import box_mjcf
from tests.program.scenes import checked, scene_of

PAIR = """<mujoco><option jacobian="dense"/><worldbody>
  <geom name="below" type="{below}" size="1 1 .1" {a}/>
  <body name="thing" pos="0 0 {z}"><freejoint/><geom name="thing" type="box" size=".05 .05 .05" mass="{m}" {b}/></body>
</worldbody>{rest}</mujoco>"""
MIXED = [
    ("", "", 0.3),
    ('solref=".05 1"', "", 0.3),
    ('solref=".05 .7" priority="1"', "", 2.0),
    ('solmix="3" solimp=".5 .8 .01"', 'solref=".01 1"', 1.0),
    ("", 'solref="-900 -50"', 0.5),
    ('solref=".05 1" solimp=".3 .9 .005 .2 3" priority="1"', "", 0.5),
    ('solref=".05 1" solimp=".3 .9 .003 .5 1" priority="1"', "", 0.5),
]


@pytest.mark.parametrize("rest", ["", '<contact><pair geom1="thing" geom2="below" solref=".06 1"/></contact>'])
@pytest.mark.parametrize(("a", "b", "mass"), MIXED)
@pytest.mark.parametrize("below", ["box", "plane"])
def test_contacts_sink_as_in_mujoco(below: str, a: str, b: str, mass: float, rest: str):
    """A box that has come to rest is as deep as its stance says, to 1%, also by an explicit pair."""
    z = 0.15 if below == "box" else 0.05
    text = PAIR.format(below=below, a=a, b=b, m=mass, z=z + 0.0005, rest=rest)
    objects = {"thing": {"on": "below", "region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}}}
    plan = build_plan(scene_of(objects, model=mujoco.MjSpec.from_string(text)))
    (stance,) = plan.stances
    mjm = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(mjm)
    mujoco.mj_step(mjm, data, 2500)
    assert data.ncon == 4
    assert stance.sinks[None] == pytest.approx(-data.contact.dist.mean(), rel=0.01)


def test_the_chain_goes_down_to_what_cannot_move(tmp_path: Path):
    """Of a free object on a free one on a fixture; a thing that is dropped or meant to fall has no stance."""
    crate = box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05)
    objects = {
        "desk": {"asset": box_mjcf(tmp_path, "desk", 0.4, 0.4, 0.1), "kind": "fixture", "on": "floor"},
        "low": {"asset": crate, "on": "desk"},
        "high": {"asset": crate, "on": "low"},
        "dropped": {"asset": crate, "on": "high", "gap": 0.006},
        "thrown": {"asset": crate, "on": "high", "orientation": "any"},
        "falling": {"asset": crate, "on": "high", "stands": False},
        "in_space": {"asset": crate, "region": {"box": [[0, 0, 1], [1, 1, 2]]}},
    }
    plan = build_plan(scene_of(objects))
    stances = dict(zip(objects, plan.stances, strict=True))
    assert [name for name, stance in stances.items() if stance.feet] == ["low", "high"]
    assert stances["high"].levels == [2, 1]
    assert carriers_of(plan.objects) == [None, None, 1, 2, 2, 2, None]


def test_what_cannot_hang_over_is_certain(tmp_path: Path):
    """On the floor, at ratio 1, and where the region keeps far enough from the edge."""
    crate, desk = box_mjcf(tmp_path, "crate", 0.1, 0.06, 0.1), box_mjcf(tmp_path, "desk", 0.8, 0.8, 0.1)
    inner, outer = ({"box": [[-x, -x], [x, x]]} for x in (0.34, 0.35))
    objects = {
        "desk": {"asset": desk, "kind": "fixture", "on": "floor"},
        "on_floor": {"asset": crate, "on": "floor"},
        "whole": {"asset": crate, "on": "desk", "ratio_on_support": 1.0},
        "inside": {"asset": crate, "on": "desk", "region": inner},
        "near_edge": {"asset": crate, "on": "desk", "region": outer},
        "anywhere": {"asset": crate, "on": "desk", "ratio_on_support": 0.9},
    }
    stances = dict(zip(objects, build_plan(scene_of(objects)).stances, strict=True))
    certain = {name for name, stance in stances.items() if stance.feet and stance.is_certain}
    assert certain == {"on_floor", "whole", "inside"}


def test_flat_and_round_feet_have_laws_of_their_own(tmp_path: Path):
    """A box on the floor or on a box, and a hull with four corners below; a can is round."""
    objects = {
        "crate": {"asset": box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05), "on": "floor"},
        "book": {"asset": "book", "on": "crate"},
        "can": {"asset": "can", "on": "crate"},
        "block": {"asset": "block", "on": "crate"},
    }
    stances = build_plan(scene_of(objects)).stances
    assert [s.feet[0].law for s in stances] == [FLAT, FLAT, ROUND, FLAT]
    assert stances[2].feet[0].margin > 0.02


def test_each_pose_has_the_law_of_its_foot(tmp_path: Path):
    """A can is round where it stands upright, and not where it lies."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.3, 0.3, 0.05), "on": "floor"}
    plan = build_plan(scene_of({"crate": crate, "can": {"asset": "can", "on": "crate", "orientation": "stable"}}))
    stance = plan.stances[1]
    is_round = [len(foot.parts[0]) > 8 for foot in stance.feet]
    assert [foot.law == ROUND for foot in stance.feet] == is_round
    assert any(is_round)
    assert not all(is_round)


WALLED = """<mujoco><worldbody><body name="tray" pos="0 0 1">
  <geom type="box" size=".2 .2 .01"/><geom type="box" size=".01 .22 {z}" pos=".21 0 .03"/>
  <geom type="box" size=".01 .22 .03" pos="-.21 0 .03"/><geom type="box" size=".2 .01 .03" pos="0 .21 .03"/>
  <geom type="box" size=".2 .01 .03" pos="0 -.21 .03"/></body>
  <body name="thing"><freejoint/><geom type="box" size=".05 .02 .04"/>{far}</body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("z", "far", "certain"),
    [(0.03, "", True), (0.012, "", False), (0.03, '<geom type="box" size=".02 .02 .04" pos=".3 0 0"/>', False)],
    ids=["high", "low", "beyond"],
)
def test_walls_keep_a_foot_on_its_support(z: float, far: str, certain: bool):
    """Unless one of them is too low, or the foot has a part that may be on its other side."""
    spec = mujoco.MjSpec.from_string(WALLED.format(z=z, far=far))
    stance = build_plan(scene_of({"thing": {"on": "tray"}}, model=spec)).stances[0]
    assert stance.is_certain == certain


@pytest.mark.parametrize(("size", "certain"), [(0.2, True), (0.199, False)])
def test_walls_keep_a_foot_on_the_floor_that_collides(size: float, certain: bool):
    """The visible floor ends 1 mm before the walls, and what is below it carries the foot if it reaches them."""
    seen = '<geom type="box" size=".199 .199 .01" contype="0" conaffinity="0" group="2"/>'
    below = f'<geom type="box" size="{size} {size} .01" group="3"/>'
    text = WALLED.format(z=0.03, far="").replace('<geom type="box" size=".2 .2 .01"/>', seen + below)
    spec = mujoco.MjSpec.from_string(text)
    stance = build_plan(scene_of({"thing": {"on": "tray"}}, model=spec, geometry="visual")).stances[0]
    assert stance.is_certain == certain


@pytest.mark.parametrize(("density", "levels"), [(1000, [1]), (100000, [1, 0])], ids=["light", "heavy"])
def test_what_is_heavy_does_not_feel_a_light_load(density: int, levels: list[int]):
    """A cube of 2 cm on one of 10 cm is tested as if it stood on something that cannot move."""
    bodies = "".join(
        f'<body name="{n}"><freejoint/><geom type="box" size="{s} {s} {s}" density="{d}"/></body>'
        for n, s, d in (("base", 0.05, 1000), ("cube", 0.01, density))
    )
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    plan = build_plan(scene_of({"base": {"on": "floor"}, "cube": {"on": "base"}}, model=spec))
    assert plan.stances[1].levels == levels


def test_a_carrier_is_loaded_by_those_that_are_there_at_a_time(tmp_path: Path):
    """The heaviest variant, and as many members of a group as there may be, whatever on it they stand on."""
    names = ("light", "middle", "heavy")
    files = {n: box_mjcf(tmp_path, n, 0.05, 0.05, s) for n, s in zip(names, (0.04, 0.08, 0.16), strict=True)}
    base = {"asset": box_mjcf(tmp_path, "base", 0.2, 0.2, 0.05), "on": "floor"}
    book = {"asset": box_mjcf(tmp_path, "book", 0.1, 0.1, 0.03), "on": "base"}
    variants = {"thing": {"variants": {n: {"asset": file} for n, file in files.items()}, "on": "book"}}
    members = {n: {"asset": file, "on": "book" if n == "heavy" else "base"} for n, file in files.items()}
    group = {"some": {"of": list(names), "count": [0, 2]}}
    for words, groups, loads in ((variants, {}, (2.7, 0.7)), (members, group, (2.9, 0.7))):
        scene = scene_of({"base": base, "book": book, **words}, groups=groups)
        stances = build_plan(scene).stances
        assert [s.load for s in stances[:2]] == pytest.approx(loads)
        assert [s.load for s in stances[2:]] == pytest.approx([0.1, 0.2, 0.4])


def test_a_support_of_variants_sinks_no_deeper_than_under_one(tmp_path: Path):
    """A plank sinks as deep under an object with twelve equal variants as under one of them."""
    crate, plank = box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.12), box_mjcf(tmp_path, "plank", 0.1, 0.1, 0.01)
    many = {f"v{i}": {"asset": crate} for i in range(12)}
    scenes = [{"variants": many}, {"asset": crate}]
    found = [
        checked(scene_of({"plank": {"asset": plank, "on": "floor"}, "thing": {**words, "on": "plank"}}))
        for words in scenes
    ]
    several, alone = (plan.stances[0] for plan in found)
    assert several.depth == alone.depth < 0.005


CABINET = """<mujoco><worldbody><body name="cabinet"><freejoint/><geom type="box" size=".1 .1 .1" mass="{mass}"/>
  <body name="drawer" pos="0 0 .12"><joint name="out" type="slide" axis="1 0 0" range="0 .3"/>
    <geom type="box" size=".09 .09 .01" mass="1"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("mass", "certain"), [(0.2, False), (9.0, True)])
def test_drawn_joints_shift_the_centre_of_mass(mass: float, certain: bool):
    """A cabinet whose drawer may tip it needs a test, one that is heavy does not."""
    spec = mujoco.MjSpec.from_string(CABINET.format(mass=mass))
    objects = {"cabinet": {"on": "floor", "joints": {"out": {"fraction": [0, 1]}}}}
    (stance,) = build_plan(scene_of(objects, model=spec)).stances
    (foot,) = stance.feet
    assert stance.is_certain == certain
    assert foot.margin == pytest.approx(0.1 - 0.3 / (1.0 + mass), abs=1e-6)
    assert foot.most == pytest.approx(0.1, abs=1e-6)
