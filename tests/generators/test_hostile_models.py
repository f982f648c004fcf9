"""Hostile models are a function of their seed, have what they claim, and compile; their judge finds what is wrong."""

from __future__ import annotations

from collections import Counter
from functools import cache
from xml.etree.ElementTree import fromstring

import mujoco
import numpy as np
import pytest

from tests.generators.hostile_features import FEATURES, wanted_features
from tests.generators.hostile_models import HostileModel, make
from tests.generators.hostile_words import Home, Served, Thing
from tests.oracle.hostile_judge import Judge

# Elements by which a feature can be told from the model alone.
TAGS = {
    "pair": "pair",
    "exclude": "exclude",
    "weld": "weld",
    "connect": "connect",
    "spatial_tendon": "spatial",
    "flex": "flexcomp",
    "hfield": "hfield",
    "muscle": "muscle",
    "damper": "damper",
    "intvelocity": "intvelocity",
    "adhesion": "adhesion",
    "fixed_tendon": "fixed",
}


@cache
def models() -> list[HostileModel]:
    """Enough of them for every feature to come up."""
    return [make(seed) for seed in range(300)]


def test_a_model_is_a_function_of_its_seed():
    """Twice the same files, scene and description; another one for another seed."""
    for model in models()[:10]:
        again = make(model.seed)
        assert (again.files, again.scene, again.features) == (model.files, model.scene, model.features)
        assert again.things == model.things
    assert len({model.files["model.xml"] for model in models()}) == len(models())


def test_a_model_of_one_body_has_no_exclude():
    """There is nothing to exclude its contacts with."""
    assert "exclude" in wanted_features(916)
    assert fromstring(make(916).files["model.xml"]).find(".//exclude") is None


def test_every_feature_occurs_about_as_often_as_it_says():
    """All of them, none much more often than drawn, and at most one model in twenty beyond 512 start pairs."""
    count = Counter(feature for model in models() for feature in model.features)
    assert set(FEATURES) - set(count) == set()
    assert set(count) <= set(FEATURES)
    wanted = Counter(feature for model in models() for feature in wanted_features(model.seed))
    assert [f for f in FEATURES if count[f] > wanted[f]] in ([], ["nested"])  # jointed obstacles are nested, too
    assert count["many"] <= 0.05 * len(models())


def test_features_are_seen_in_the_models():
    """Features that a model claims stand in its files."""
    for model in models():
        tags = {e.tag for text in model.files.values() for e in fromstring(text).iter()}
        assert {TAGS[f] for f in model.features & set(TAGS)} <= tags


def test_all_models_compile_with_1_to_700_bodies_of_1_mm_to_50_m(tmp_path):
    """MuJoCo C takes every file; sizes and numbers span what they should."""
    bodies, sizes = [], []
    for model in models():
        model.write(tmp_path)
        compiled = [mujoco.MjModel.from_xml_path(str(tmp_path / name)) for name in model.files]
        bodies.append(compiled[0].nbody - 1)
        kind = compiled[0].geom_type
        solid = (kind > int(mujoco.mjtGeom.mjGEOM_HFIELD)) & (kind < int(mujoco.mjtGeom.mjGEOM_MESH))
        sizes += list(2.0 * compiled[0].geom_size[solid].max(axis=1))
    assert min(bodies) <= 2 and 600 < max(bodies) <= 700
    assert 0.0009 < min(sizes) < 0.002 and 40.0 < max(sizes) <= 50.0


WORLD = """<mujoco><compiler angle="radian"/><option timestep=".002"/><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body name="post" pos="0 0 .5"><geom name="post" type="box" size=".05 .05 .5"/>
    <body name="door" pos=".2 0 0"><joint name="hinge" axis="0 0 1" range="-1 1"/>
      <geom name="leaf" type="box" size=".0501 .01 .1" pos="-.1 0 0"/></body></body>
  <body name="a" pos=".5 0 .1005"><freejoint/><geom name="a" type="box" size=".1 .1 .1" {geom}/></body>
  <body name="b" pos=".5 .5 .1005"><freejoint/><geom name="b" type="box" size=".1 .1 .1"/></body>
  <body name="guide" mocap="true" pos="0 0 3"/></worldbody>
  <actuator><position joint="hinge" kp="100"/></actuator>{rest}</mujoco>"""
THINGS = [
    Thing("a", "a", "free", placed=True, support="world", stable=True),
    Thing("b", "b", "free", placed=True, support="world"),
    Thing("post", "post", "static", drawn=("hinge",)),
]


def verdict(
    at: dict[int, float] | None = None, geom: str = "", rest: str = "", ctrl: float = 0.0, guide: float = 3.0
) -> set[str]:
    """Kinds of conflicts of the start pose with some coordinates changed: 0 is the hinge, a's from 1, b's from 8."""
    mjm = mujoco.MjModel.from_xml_string(WORLD.format(geom=geom, rest=rest))
    qpos = mjm.qpos0[None].copy()
    for adr, value in (at or {}).items():
        qpos[0, adr] = value
    mocap = np.array([[[0.0, 0.0, guide]]]), np.array([[[1.0, 0.0, 0.0, 0.0]]])
    served = Served(qpos, *mocap, np.array([[ctrl]]), np.zeros((1, 0)))
    return {c.kind for c in Judge(mjm, THINGS, Home.of(mjm)).judge(served)}


WELD = '<equality><weld body1="a" body2="b"/></equality>'
HINGE = '<equality><joint joint1="hinge" polycoef=".2 0 0 0 0"/></equality>'
STRING = """<tendon><fixed name="t" limited="true" range="-.1 .1"><joint joint="hinge" coef="1"/></fixed></tendon>"""
NOTCH = '<contact><pair geom1="a" geom2="b" margin=".05" gap=".02"/></contact>'
EDGES = (0.76, -0.26, 0.2105, *np.array([-1.5, 1.0, 1.25, -1.25]) / np.linalg.norm([-1.5, 1.0, 1.25, -1.25]))
"""Where b is 62.7 mm from a, by edges that MuJoCo's test of boxes sees at 45 mm."""
FAULTS = {
    "none": ({}, set()),
    "door drawn": ({"at": {0: 0.3}, "ctrl": 0.3}, set()),
    "overlap": ({"at": {9: 0.19}}, {"contact", "moved"}),
    "touch by a hair": ({"at": {9: 0.199999}}, {"contact"}),
    "beside each other": ({"at": {9: 0.2001}}, set()),
    "missed margin": ({"at": {9: 0.21}, "geom": 'margin=".03"'}, {"margin", "moved"}),
    "missed margin of a pair": ({"at": {9: 0.22}, "rest": NOTCH}, {"margin", "moved"}),
    "violated weld": ({"at": {9: 0.501}, "rest": WELD}, {"equality"}),
    "as far off as at home": ({"rest": HINGE}, set()),
    "joint equality": ({"at": {0: -0.4}, "rest": HINGE, "ctrl": -0.4}, {"equality", "acceleration"}),
    "limit of a tendon": ({"at": {0: 0.4}, "rest": STRING, "ctrl": 0.4}, {"limit of tendon", "acceleration"}),
    "limit of a joint": ({"at": {0: 1.1}, "ctrl": 1.1}, {"limit of joint"}),
    "sunk into the floor": ({"at": {3: 0.0999}}, {"in its support"}),
    "deeper than at home": ({"at": {0: 0.1}, "ctrl": 0.1}, {"deeper than at home"}),
    "servo not at rest": ({"at": {0: 0.5}, "ctrl": 0.0}, {"acceleration"}),
    "falls": ({"at": {3: 0.15}}, {"moved"}),
    "mocap not at home": ({"guide": 2.0}, {"not at home"}),
    "box seen too near": ({"at": dict(zip(range(8, 15), EDGES, strict=True)), "geom": 'margin=".05"'}, {"moved"}),
    "not finite": ({"at": {8: np.nan}}, {"not finite"}),
}


@pytest.mark.parametrize(("state", "kinds"), FAULTS.values(), ids=FAULTS.keys())
def test_the_judge_finds_planted_faults(state: dict, kinds: set[str]):
    """Each fault by its kind, and no other; what is right is let pass."""
    assert verdict(**state) == kinds


def test_what_overlaps_at_home_is_no_kick():
    """A door in its post as the model has it, and loose things in each other beside a stable one."""
    text = WORLD.replace('size=".0501 .01 .1" pos="-.1 0 0"', 'size=".09 .01 .1" pos="-.1 .03 0"')
    loose = "".join(
        f'<body name="loose{i}" pos="{0.635 + 0.04 * i} 0 .031"><freejoint/><geom size=".03"/></body>' for i in range(2)
    )
    text = text.format(geom="", rest="").replace('<body name="guide"', f'{loose}<body name="guide"')
    mjm = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, data)
    assert abs(data.qacc[0]) > 600.0 and abs(data.qacc[-6:]).max() > 20.0
    served = Served(mjm.qpos0[None], data.mocap_pos[None], data.mocap_quat[None], np.zeros((1, 1)), np.zeros((1, 0)))
    assert Judge(mjm, THINGS, Home.of(mjm)).judge(served) == []
