"""Depths of contacts under loads, by MuJoCo C with the numbers that are drawn, and the pull of the wind by hand."""

from __future__ import annotations

import copy
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.program.loads import least_upright, tilt_of, wind_push
from sceniris_gym.program.plan import build_plan
from tests.program.scenes import scene_of

SOFT = 'solref=".05 1" solimp=".3 .9 .005 .2 3" priority="2"'
LEGS = "".join(
    f'<geom type="box" size=".01 .01 .02" pos="{x} {y} {-0.02 + z}" mass=".01"/>'
    for x, y, z in ((0.08, 0.08, 0.0), (-0.08, 0.08, 0.0), (0.0, -0.16, 0.0), (0.0, 0.0, 4e-4))
)
# Geoms, how high it stands [m], attributes of the load and what is drawn of the lower object.
CASES: dict[str, tuple[str, float, str, dict[str, Any]]] = {
    "a light plate": ('<geom type="box" size=".1 .1 .01" mass=".025"/>', 0.01, 'mass="2"', {}),
    "a drawn plate": (
        '<geom type="box" size=".1 .1 .01" mass=".05" friction=".7" priority="2"/>',
        *(0.01, 'mass="2"', {"mass": {"abs": [0.025, 0.15]}}),
    ),
    "a drawn plate alone": (
        '<geom type="box" size=".1 .1 .01" mass=".05"/>',
        *(0.01, 'mass=".001"', {"mass": {"abs": [0.025, 0.15]}}),
    ),
    "slippery": (
        '<geom type="box" size=".1 .1 .01" mass=".1" friction=".3" priority="2"/>',
        *(0.01, 'mass="5"', {}),
    ),
    "rough": ('<geom type="box" size=".1 .1 .01" mass=".3" friction="1.5"/>', 0.01, 'mass="2"', {}),
    "of four dimensions": ('<geom type="box" size=".1 .1 .01" mass=".3" condim="4"/>', 0.01, 'mass="2"', {}),
    "without friction": ('<geom type="box" size=".1 .1 .01" mass=".3" condim="1"/>', 0.01, 'mass="1"', {}),
    "soft": (f'<geom type="box" size=".1 .1 .01" mass=".5" {SOFT}/>', 0.01, 'mass=".5"', {}),
    "stiff": (
        '<geom type="box" size=".1 .1 .01" mass=".5" solref="-900 -50"/>',
        *(0.01, 'mass=".2"', {}),
    ),
    "drawn contacts": (
        '<geom type="box" size=".1 .1 .01" mass=".5" priority="2"/>',
        *(0.01, 'mass=".5"', {"solref": {"abs": [[0.02, 1], [0.08, 1]]}, "friction": {"abs": [0.5, 1.2]}}),
    ),
    "drawn impedance": (
        '<geom type="box" size=".1 .1 .01" mass=".5" priority="2"/>',
        *(0.01, 'mass=".5"', {"solimp": {"choice": [[0.5, 0.8, 0.004, 0.5, 2], [0.9, 0.95, 0.001, 0.5, 2]]}}),
    ),
    "a drum": ('<geom type="cylinder" size=".08 .02" mass=".2"/>', 0.02, 'mass="1"', {}),
    "a tripod with a short leg": (
        f'<geom type="box" size=".1 .2 .005" pos="0 0 .005" mass=".02"/>{LEGS}',
        *(0.04, 'mass="2"', {}),
    ),
}


def resting(mjm: mujoco.MjModel, names: list[str]) -> np.ndarray:
    """Return how deep the lower object of each case is in the floor at rest [m], by MuJoCo C."""
    data = mujoco.MjData(mjm)
    for i, (name, (_, height, *_)) in enumerate(CASES.items()):
        top = 2.0 * height if "tripod" not in name else height + 0.01
        data.joint(f"p{i}_free").qpos[:3] = i, 0.0, height + 5e-4
        data.joint(f"w{i}_free").qpos[:3] = i, 0.0, top + 0.02 + 1e-3
    mujoco.mj_step(mjm, data, 600)
    depths = np.zeros(len(names))
    for contact in data.contact[: data.ncon]:
        below, above = (mjm.body(b).name for b in np.sort(mjm.geom_bodyid[contact.geom]))
        if below == "world":
            depths[names.index(above)] = max(depths[names.index(above)], -contact.dist)
    return depths


@pytest.mark.parametrize("option", ['impratio="1.5"', 'cone="elliptic" impratio="3"'], ids=["pyramidal", "elliptic"])
def test_depths_are_within_a_fifth_of_mujoco(option: str):
    """For masses, loads, frictions, `solref`, `solimp`, shapes and feet, with the worst of what is drawn."""
    bodies = "".join(
        f'<body name="p{i}" pos="{i} 0 1"><joint name="p{i}_free" type="free"/>{geoms}</body>'
        f'<body name="w{i}" pos="{i} 0 2"><joint name="w{i}_free" type="free"/>'
        f'<geom type="box" size=".02 .02 .02" {load}/></body>'
        for i, (geoms, _, load, _) in enumerate(CASES.values())
    )
    objects: dict[str, Any] = {}
    for i, (*_, draws) in enumerate(CASES.values()):
        objects |= {f"p{i}": {"on": "floor", "randomize": draws}, f"w{i}": {"on": f"p{i}"}}
    spec = mujoco.MjSpec.from_string(f"<mujoco><option {option}/><worldbody>{bodies}</worldbody></mujoco>")
    scene = scene_of(objects, model=spec, floor={"size": [30, 3]})
    plan = build_plan(scene)
    names, worst = [f"p{i}" for i in range(len(CASES))], np.zeros(len(CASES))
    for light, soft in ((True, True), (False, False)):
        mjm = copy.copy(scene.mjm)
        for i, (*_, draws) in enumerate(CASES.values()):
            geom = mjm.body_geomadr[mjm.body(f"p{i}").id]
            if "mass" in draws:
                mjm.body(f"p{i}").mass = 0.025 if light else 0.15
            if "solref" in draws:
                mjm.geom_solref[geom] = (0.08, 1.0) if soft else (0.02, 1.0)
                mjm.geom_friction[geom, 0] = 1.2
            if "solimp" in draws:
                mjm.geom_solimp[geom] = draws["solimp"]["choice"][0 if soft else 1]
        mujoco.mj_setConst(mjm, mujoco.MjData(mjm))
        worst = np.maximum(worst, resting(mjm, names))
    depth = {o.name: stance.depth for o, stance in zip(plan.objects, plan.stances, strict=True)}
    found = {case: depth[name] / true for case, name, true in zip(CASES, names, worst, strict=True)}
    assert {case: ratio for case, ratio in found.items() if not 1.0 / 1.2 < ratio < 1.2} == {}
    assert worst.max() > 2e-3


WINDY = """<mujoco><option wind="0 3 0" density="1.2" gravity="0 0 -9.81"/><worldbody>
  <body name="slab"><freejoint/><geom type="box" size=".01 .1 .15" mass=".5"/></body></worldbody></mujoco>"""


def test_the_wind_that_counts_is_the_strongest_at_the_broadest_side_of_the_lightest():
    """Half of density times area times the square of the speed, for each kilogram; gravity adds to it."""
    draws = {"wind": {"abs": [[0, -4, 0], [0, 2, 0]]}, "gravity": {"add": [[0.0, -0.1, -1], [0.05, 0.0, 1]]}}
    objects = {"slab": {"on": "floor", "randomize": {"mass": {"scale": [0.5, 2]}}}}
    scene = scene_of(objects, model=mujoco.MjSpec.from_string(WINDY), randomize=draws)
    plan = build_plan(scene)
    push = 0.5 * 1.2 * 0.2 * 0.3 * 4.0**2 / 0.25
    assert wind_push(scene, plan.objects[0]) == pytest.approx(push, rel=1e-6)
    np.testing.assert_allclose(least_upright(scene), [0.05, -0.1, -8.81])
    assert tilt_of(scene, plan.objects) == pytest.approx((np.hypot(0.05, 0.1) + push) / (8.81 - push))
