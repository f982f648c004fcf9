"""Parts of one object that touch at home: no deeper than there, judged by the contacts that MuJoCo C finds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import Rows, compile_on_cpu, make, posed
from tests.versions import OLD

N = 512
DEEPER = 1e-5  # m


def own_scene(folder: Path, bodies: str, *, drawn: dict[str, Any], rest: str = "", **words: Any) -> CompiledScene:
    """Compile a model with a static object `thing`, of which joints are drawn."""
    path = folder / "own.xml"
    path.write_text(f'<mujoco>{rest}<worldbody><body name="thing">{bodies}</body></worldbody></mujoco>')
    objects = {"thing": {"kind": "static", "joints": drawn}}
    return compile_on_cpu({"model": str(path), "objects": objects, "attempts": 200, **words})


def nearest(mjm: mujoco.MjModel, data: mujoco.MjData) -> dict[tuple[int, int], float]:
    """The least distance [m] of every two geoms in a contact that acts."""
    mujoco.mj_kinematics(mjm, data)
    mujoco.mj_comPos(mjm, data)
    mujoco.mj_collision(mjm, data)
    found: dict[tuple[int, int], float] = {}
    for contact in data.contact:
        if contact.dist < contact.includemargin:
            geoms = int(contact.geom.min()), int(contact.geom.max())
            found[geoms] = min(float(contact.dist), found.get(geoms, np.inf))
    return found


def too_near(compiled: CompiledScene, rows: Rows) -> list[tuple[str, str, float]]:
    """Names of geoms that are nearer than at home by more than 10 um, or in contact without being so at home."""
    mjm = compiled.mjm
    data = mujoco.MjData(mjm)
    data.qpos[:] = compiled.home_qpos
    home = nearest(mjm, data)
    return [
        (mjm.geom(a).name, mjm.geom(b).name, distance)
        for state in posed(compiled, rows)
        for (a, b), distance in nearest(mjm, state).items()
        if distance < home.get((a, b), np.inf) - DEEPER
    ]


DOORS = """<geom type="box" size=".3 .02 .3" pos="0 .3 .3"/>
  <body name="left" pos="-.2 0 .3"><joint name="left" axis="0 0 1" range="-120 120"/>
    <geom name="left" type="box" size=".1001 .01 .3" pos=".1 0 0"/></body>
  <body name="right" pos=".2 0 .3"><joint name="right" axis="0 0 1" range="-120 120"/>
    <geom name="right" type="box" size=".1001 .01 .3" pos="-.1 0 0"/></body>"""


def test_doors_that_overlap_at_home_get_no_deeper_into_each_other(tmp_path: Path):
    """Two leaves with an overlap of 0.2 mm, each drawn on both sides of home."""
    compiled = own_scene(tmp_path, DOORS, drawn={"*": {"range": [-0.3, 0.3]}})
    rows = make(compiled, N)
    assert (rows.status == LayoutStatus.VALID).all()
    assert too_near(compiled, rows) == []
    assert np.abs(rows.qpos).max() > 0.25


def two_links(first: str, second: str, at: str) -> str:
    """Return two links with geoms of their own that turn about the vertical, the second one placed as `at` says."""
    joint = 'axis="0 0 1" range="-180 180"'
    return f"""<geom size=".01" pos="0 0 -1"/><body><joint name="a" {joint}/>{first}</body>
      <body {at}><joint name="b" {joint}/>{second}</body>"""


def test_an_arm_gets_no_deeper_into_itself_than_at_home(tmp_path: Path):
    """A forearm that is 3 mm in the base at home, and lifted or lowered."""
    arm = """<mujoco><worldbody><body name="arm"><geom name="base" type="box" size=".1 .1 .1"/>
      <body pos="0 0 .15"><joint name="pan" axis="0 0 1" range="-60 60"/><geom size=".04"/>
        <body pos="0 0 .05"><joint name="lift" axis="0 1 0" range="-60 60"/>
          <geom name="fore" type="capsule" size=".04" fromto=".05 0 -.063 .3 0 -.063"/></body></body></body></worldbody>
      <keyframe><key name="home" qpos="0 0"/></keyframe></mujoco>"""
    (tmp_path / "arm.xml").write_text(arm)
    robot = {"asset": str(tmp_path / "arm.xml"), "joints": {"*": {"noise": 0.05}}}
    compiled = compile_on_cpu({"floor": {"size": [2.0, 2.0]}, "robot": robot})
    rows = make(compiled, N)
    assert (rows.status == LayoutStatus.VALID).all()
    assert too_near(compiled, rows) == []
    lifted = rows.qpos[:, compiled.mjm.joint("arm/lift").qposadr[0]]
    assert lifted.max() < 1e-3
    assert lifted.min() < -0.045
    assert np.abs(rows.qpos[:, compiled.mjm.joint("arm/pan").qposadr[0]]).max() > 0.045


def test_what_is_within_its_margin_at_home_comes_no_nearer(tmp_path: Path):
    """Two slides with a margin of 2 cm, 1 cm apart at home."""
    slide = (
        '<joint name="{0}" type="slide" axis="1 0 0" range="-1 1"/><geom name="{0}" type="box" size=".1 .1 .1" {1}/>'
    )
    bodies = f"""<geom size=".01" pos="0 0 1"/><body name="a">{slide.format("a", 'margin=".02"')}</body>
      <body name="b" pos=".21 0 0">{slide.format("b", "")}</body>"""
    compiled = own_scene(tmp_path, bodies, drawn={"*": {"range": [-0.02, 0.02]}})
    rows = make(compiled, N)
    assert (rows.status == LayoutStatus.VALID).all()
    assert too_near(compiled, rows) == []
    apart = 0.01 + rows.qpos[:, 1] - rows.qpos[:, 0]
    assert 0.01 - DEEPER <= apart.min() < 0.0102
    assert (apart < 0.02).mean() > 0.2


COAXIAL = {
    "end to end": ('pos="0 0 .0995"', 'type="cylinder" size=".05 .05"'),
    "one in the other": ('pos="0 0 .01"', 'type="cylinder" size=".02 .3"'),
    "a ball in its socket": ('pos="0 0 .02"', 'size=".03"'),
    "a capsule in it": ('pos="0 0 0"', 'type="capsule" size=".02 .2"'),
}


@pytest.mark.parametrize("case", COAXIAL)
def test_what_stays_as_deep_as_it_is_is_free_to_turn(tmp_path: Path, case: str):
    """A cylinder and what is coaxial with it: hardly a candidate is turned away."""
    at, second = COAXIAL[case]
    cylinder = '<geom type="cylinder" size=".05 .05"/>'
    bodies = two_links(cylinder, f"<geom {second}/>", at=at)
    compiled = own_scene(tmp_path, bodies, drawn={"*": {"range": [-3.0, 3.0]}}, attempts=1, restarts=0)
    assert (make(compiled, 2000).status == LayoutStatus.VALID).mean() > 0.999


def test_other_geoms_of_bodies_that_touch_at_home_are_kept_apart(tmp_path: Path):
    """Two arms of a hinge overlap at its pin; their tips must not meet, whatever is left out there."""
    tip = '<geom name="{0}" type="box" size=".03 .03 .03" pos=".3 0 0"/>'
    pin = '<geom name="{0}" type="cylinder" size=".03 .03"/>'
    first, second = (pin.format(a) + tip.format(b) for a, b in ("pt", "qu"))
    bodies = two_links(first, second, 'pos="0 0 .059" euler="0 0 60"')
    compiled = own_scene(tmp_path, bodies, drawn={"*": {"range": [-1.0, 1.0]}})
    rows = make(compiled, N)
    assert (rows.status == LayoutStatus.VALID).all()
    assert too_near(compiled, rows) == []
    between = np.radians(60.0) + rows.qpos[:, 1] - rows.qpos[:, 0]
    assert 0.15 < np.abs(between).min() < 0.25


SHAPES = {
    "box": 'type="box" size=".05 .03 .02"',
    "ball": 'type="sphere" size=".04"',
    "capsule": 'type="capsule" size=".02 .05"',
    "cylinder": 'type="cylinder" size=".04 .03"',
    "egg": 'type="ellipsoid" size=".05 .03 .02"',
    "hull": 'type="mesh" mesh="hull"',
}


@pytest.mark.parametrize("nearness", [1.0, 0.0], ids=["deep", "touching"])
def test_home_itself_is_always_valid(tmp_path: Path, nearness: float):
    """All kinds of shapes in each other in random poses, or pulled out until they touch: with nothing drawn away."""
    if OLD and nearness == 0.0:
        pytest.skip("MuJoCo before 4.0: mj_geomDistance says 0 of some shapes that do not touch yet")
    rng, bodies = np.random.default_rng(7), []
    kinds = [(a, b) for i, a in enumerate(SHAPES) for b in list(SHAPES)[i:] for _ in range(3)]
    hull = '<asset><mesh name="hull" vertex="0 0 .04 .05 0 0 -.03 .04 0 -.03 -.04 0 0 .02 -.05 .03 .03 .02"/></asset>'
    for i, (a, b) in enumerate(kinds):
        station = f"{0.4 * (i % 8) - 1.4} {0.4 * (i // 8) - 1.4} 0"
        pos, quat = _out_of(SHAPES[a], SHAPES[b], hull, 0.02 * rng.normal(size=3), rng.normal(size=4), nearness)
        joint = f'<joint name="j{i}" axis="{_words(rng.normal(size=3))}" range="-90 90"/>'
        bodies.append(
            f'<body name="thing{i}" pos="{station}"><geom {SHAPES[a]}/><body><body pos="{_words(pos)}" '
            f'quat="{_words(quat)}">{joint}<geom {SHAPES[b]}/></body></body></body>'
        )
    path = tmp_path / "many.xml"
    path.write_text(f"<mujoco>{hull}<worldbody>{''.join(bodies)}</worldbody></mujoco>")
    thing = {"kind": "static", "joints": {"*": {"range": [-1e-7, 1e-7]}}}
    objects = {f"thing{i}": thing for i in range(len(kinds))}
    compiled = compile_on_cpu({"model": str(path), "objects": objects, "attempts": 1, "restarts": 0})
    assert (compiled.program.pair_margin.numpy() < 0.0).sum() == len(kinds)
    assert (make(compiled, 8).status == LayoutStatus.VALID).all()


def _words(numbers: np.ndarray) -> str:
    return " ".join(f"{x:.12g}" for x in numbers)


def _out_of(
    first: str, second: str, asset: str, pos: np.ndarray, quat: np.ndarray, nearness: float
) -> tuple[np.ndarray, np.ndarray]:
    """A pose of the second geom beside the first one, pulled along its direction by a share of what parts them."""
    text = f"<mujoco>{asset}<worldbody><geom {first}/><body><freejoint/><geom {second}/></body></worldbody></mujoco>"
    mjm = mujoco.MjModel.from_xml_string(text)
    data, quat, way = mujoco.MjData(mjm), quat / np.linalg.norm(quat), pos / np.linalg.norm(pos)
    low, high = 0.0, 0.3
    for _ in range(60):
        middle = 0.5 * (low + high)
        data.qpos[:] = np.r_[pos + middle * way, quat]
        mujoco.mj_kinematics(mjm, data)
        is_apart = mujoco.mj_geomDistance(mjm, data, 0, 1, 1.0, None) > 0.0
        low, high = (low, middle) if is_apart else (middle, high)
    return pos + (1.0 - nearness) * high * way, quat


def test_a_refusal_says_that_two_geoms_may_be_as_deep_as_at_home(tmp_path: Path):
    """Doors that are turned into each other."""
    drawn = {"left": {"value": 0.05}, "right": {"value": -0.05}}
    with pytest.raises(InfeasibleSceneError) as told:
        own_scene(tmp_path, DOORS, drawn=drawn)
    text = str(told.value)
    assert "geom 'left' of body 'left' and geom 'right' of body 'right'" in text
    assert "0.21 mm deep is allowed, as at home" in text
