"""MuJoCo's rules about geoms, judged by the contacts that MuJoCo C finds."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.geometry.contacts import ContactRules

BITS = [(0, 0), (1, 1), (1, 0), (0, 1), (2, 4), (4, 2)]
FLAGS = '<option o_margin=".03"><flag override="enable"/></option>'


def model(rng: np.random.Generator, option: str = "") -> mujoco.MjModel:
    """Return eight spheres with random bits, margins and gaps, two explicit pairs among them."""
    bodies = ""
    for i in range(8):
        contype, conaffinity = BITS[rng.integers(len(BITS))]
        margin, gap = rng.choice([0.0, 0.01, 0.02]), rng.choice([0.0, 0.003])
        bodies += (
            f'<body name="b{i}"><freejoint/><geom name="g{i}" size=".1" contype="{contype}" '
            f'conaffinity="{conaffinity}" margin="{margin}" gap="{gap}"/></body>'
        )
    pairs = '<contact><pair geom1="g0" geom2="g1" margin=".015"/><pair geom1="g2" geom2="g5" gap=".002"/></contact>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{bodies}</worldbody>{pairs}</mujoco>")


@pytest.mark.oldest
@pytest.mark.parametrize("option", ["", FLAGS], ids=["as it is", "override"])
@pytest.mark.parametrize("seed", range(6))
def test_geoms_meet_and_act_as_in_mujoco(seed: int, option: str):
    """Two by two, all others far away: there is a contact where they meet, and it acts below their distance."""
    mjm = model(np.random.default_rng(seed), option)
    rules, data = ContactRules(mjm, "physics"), mujoco.MjData(mjm)
    for a in range(8):
        for b in range(a + 1, 8):
            data.qpos.reshape(8, 7)[:] = np.array([[100.0 * i, 0, 0, 1, 0, 0, 0] for i in range(8)])
            data.qpos[7 * b : 7 * b + 3] = data.qpos[7 * a : 7 * a + 3] + [0.19, 0, 0]
            mujoco.mj_forward(mjm, data)
            one, other = int(rules.classes[a]), int(rules.classes[b])
            assert rules.meet(one, other) == (data.ncon > 0)
            if data.ncon:
                assert rules.distance(one, other) == pytest.approx(data.contact.includemargin[0])


def test_geoms_that_collide_with_nothing_are_told():
    """Neither bits nor pairs; a geom without bits collides where a pair names it."""
    mjm = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom name="a" size=".1" contype="0" conaffinity="0"/><body><freejoint/>'
        '<geom name="b" size=".1" contype="0" conaffinity="0"/><geom size=".1" contype="0" conaffinity="0"/></body>'
        '</worldbody><contact><pair geom1="a" geom2="b"/></contact></mujoco>'
    )
    assert [ContactRules(mjm, "physics").collides(geom) for geom in range(3)] == [True, True, False]


def test_what_is_seen_knows_no_rules():
    """With visual geometry all geoms are of one class and meet at distance 0."""
    rules = ContactRules(model(np.random.default_rng(0)), "visual")
    assert set(rules.classes) == {0}
    assert rules.meet(0, 0)
    assert rules.distance(0, 0) == 0.0
