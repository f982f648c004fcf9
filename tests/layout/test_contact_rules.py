"""MuJoCo's rules about contacts in models of users' own: explicit pairs, margins, flags, many bodies, home poses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import Rows, bank_rows, compile_on_cpu, make, posed, read

N = 300


def own_scene(folder: Path, bodies: str, objects: dict[str, Any], rest: str = "", **words: Any) -> CompiledScene:
    """Compile a model of one's own on a floor of 1 m."""
    path = folder / "own.xml"
    floor = '<geom name="floor" type="plane" size="2 2 .1"/>'
    path.write_text(f"<mujoco>{rest}<worldbody>{floor}{bodies}</worldbody></mujoco>")
    return compile_on_cpu({"model": str(path), "floor": {"size": [1.0, 1.0]}, "objects": objects, **words})


def contacts(compiled: CompiledScene, rows: Rows) -> list[tuple[str, str, float]]:
    """Return the contacts that act, in all rows: names of the geoms and the distance [m]."""
    found = []
    for data in posed(compiled, rows):
        mujoco.mj_comPos(compiled.mjm, data)
        mujoco.mj_collision(compiled.mjm, data)
        for contact in data.contact:
            if contact.dist < contact.includemargin:
                names = sorted(compiled.mjm.geom(int(g)).name for g in contact.geom)
                found.append((*names, float(contact.dist)))
    return found


def crates(**geom: str) -> str:
    """Return two free boxes of 20 cm and 10 cm."""
    words = " ".join(f'{key}="{value}"' for key, value in geom.items())
    return "".join(
        f'<body name="{name}" pos="{x} 0 1"><freejoint/>'
        f'<geom name="{name}" type="box" size="{half} {half} .05" {words}/></body>'
        for name, x, half in (("big", 3, 0.1), ("small", 5, 0.05))
    )


ON_FLOOR = {"big": {"on": "floor"}, "small": {"on": "floor"}}


@pytest.mark.parametrize("exclude", ["", '<exclude body1="big" body2="small"/>'], ids=["bits", "bits and exclude"])
def test_explicit_pairs_come_before_bits_and_excludes(tmp_path: Path, exclude: str):
    """Boxes whose bits never match, and whose bodies are excluded, are kept apart where a pair names them."""
    pair = f'<contact>{exclude}<pair geom1="big" geom2="small" margin="0.03"/></contact>'
    compiled = own_scene(tmp_path, crates(contype="2", conaffinity="1"), ON_FLOOR, pair)
    rows = make(compiled, N)
    assert (rows.status == LayoutStatus.VALID).all()
    assert contacts(compiled, rows) == []


def test_margins_count_as_touching(tmp_path: Path):
    """Margins of 2 cm: no contact acts, among the boxes or with the floor, over which they stand that much higher."""
    compiled = own_scene(tmp_path, crates(margin="0.02"), ON_FLOOR)
    rows = make(compiled, N)
    assert (rows.status == LayoutStatus.VALID).all()
    assert contacts(compiled, rows) == []
    heights = rows.qpos[:, compiled.mjm.jnt_qposadr[0] + 2] - 0.05
    assert heights == pytest.approx(0.02, abs=1e-4)


def scissors(option: str = "") -> str:
    """Return a blade, and a second one that it carries and that lies on it at angles near 0."""
    return f"""{option}<worldbody><geom name="floor" type="plane" size="2 2 .1"/>
      <body name="scissors" mocap="true"><geom type="box" size=".02 .02 .02" pos="-.2 0 .05"/>
        <body name="blade" pos="0 0 .1"><joint name="first" axis="0 0 1" range="-180 180"/>
          <geom name="blade" type="box" size=".1 .01 .01" pos=".15 0 0"/>
          <body name="other"><joint name="second" axis="0 0 1" range="-180 180"/>
            <geom name="other" type="box" size=".1 .01 .01" pos=".15 0 0"/></body></body></body></worldbody>
      <keyframe><key name="home" qpos="0 0.8"/></keyframe>"""


def test_parents_collide_where_their_filter_is_off(tmp_path: Path):
    """A blade is kept off the one that carries it; with the filter on MuJoCo lets them pass, and so do layouts."""
    joints = {"second": {"range": [-1.5, 1.5]}, "first": {"range": [-1.0, 1.0]}}
    words = {"scissors": {"kind": "fixture", "on": "floor", "joints": joints}}
    for flag, is_apart in (("enable", False), ("disable", True)):
        option = f'<option><flag filterparent="{flag}"/></option>'
        path = tmp_path / f"{flag}.xml"
        path.write_text(f"<mujoco>{scissors(option)}</mujoco>")
        scene = {"model": str(path), "floor": {"size": [1.0, 1.0]}, "attempts": 100, "objects": words}
        compiled = compile_on_cpu(scene)
        rows = make(compiled, N)
        angles = np.abs(rows.qpos[:, compiled.mjm.joint("second").qposadr[0]])
        assert (angles.min() > 0.1) == is_apart
        assert contacts(compiled, rows) == []


def test_a_crate_keeps_off_hundreds_of_bodies(tmp_path: Path):
    """600 posts, of a body each or all of one: the same layouts, and MuJoCo C finds no contact."""
    at = [(0.04 * (i % 30) - 0.6, 0.04 * (i // 30) - 0.4) for i in range(600)]
    crate = '<body name="crate" pos="5 0 1"><freejoint/><geom name="crate" type="box" size=".005 .005 .005"/></body>'
    posts = [f'<geom name="p{i}" type="cylinder" size=".005 .1" pos="{x} {y} .1"/>' for i, (x, y) in enumerate(at)]
    each = "".join(f'<body name="post{i}">{post}</body>' for i, post in enumerate(posts))
    made = []
    for bodies in (each, f'<body name="posts">{"".join(posts)}</body>'):
        generator = LayoutGenerator(own_scene(tmp_path, bodies + crate, {"crate": {"on": "floor"}}), 1000)
        generator.generate()
        rows = read(generator.layouts)
        assert (rows.status == LayoutStatus.VALID).all()
        assert contacts(generator.compiled, rows) == []
        assert generator.rejection_counts()["crate"]["collision"] > 100
        made.append(rows.bits())
    assert made[0] == made[1]


def test_a_home_full_of_meshes_is_no_overflow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """All plates are at the origin before they are placed; pairs are judged one by one, and no log file appears."""
    monkeypatch.chdir(tmp_path)
    joint = '<joint name="hinge" axis="0 0 1" range="0 1"/>'
    objects = {
        f"plate_{i}": {"asset": "plate", "on": "floor", "region": {"box": [[-3, -3], [3, 3]]}} for i in range(60)
    }
    (tmp_path / "toy.xml").write_text(
        '<mujoco><worldbody><body name="toy"><geom size=".01"/><body pos=".1 0 0">'
        f'{joint}<geom size=".01"/><body pos=".1 0 0"><geom size=".01"/></body></body></body></worldbody></mujoco>'
    )
    toy = {"asset": str(tmp_path / "toy.xml"), "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0, 1]}}}
    compiled = compile_on_cpu({"floor": {"size": [6.0, 6.0]}, "objects": {"toy": toy, **objects}})
    assert bank_rows(compiled, "train") == slice(0, 64)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_links_that_just_touch_at_home_do_not_keep_an_arm_from_its_place(tmp_path: Path):
    """Two links with a gap of 0.0 at home, as some arms have: its joints are drawn around that pose."""
    arm = """<mujoco><worldbody><body name="arm"><geom name="base" type="box" size=".1 .1 .1"/>
      <body name="turn" pos="0 0 .15"><joint name="pan" axis="0 0 1" range="-1 1"/><geom size=".04"/>
        <body name="link" pos="0 0 .05"><joint name="lift" axis="0 1 0" range="-1 1"/>
          <geom name="elbow" type="box" size=".05 .05 .05" pos=".15 0 -.05"/></body></body></body></worldbody>
      <keyframe><key name="home" qpos="0 0"/></keyframe></mujoco>"""
    (tmp_path / "arm.xml").write_text(arm)
    data = mujoco.MjData(mjm := mujoco.MjModel.from_xml_string(arm))
    mujoco.mj_kinematics(mjm, data)
    base, elbow = mjm.geom("base").id, mjm.geom("elbow").id
    assert abs(mujoco.mj_geomDistance(mjm, data, base, elbow, 1.0, None)) < 1e-9
    robot = {"asset": str(tmp_path / "arm.xml"), "joints": {"pan": {"noise": 0.02}}}
    compiled = compile_on_cpu({"floor": {"size": [2.0, 2.0]}, "robot": robot})
    assert (make(compiled, 20).status == LayoutStatus.VALID).all()


def test_a_refusal_names_the_geoms_that_collide(tmp_path: Path):
    """With their bodies and their distance."""
    bodies = '<body name="wall"><geom name="slab" type="box" size="1 1 .2"/></body>' + crates()
    with pytest.raises(InfeasibleSceneError) as told:
        own_scene(tmp_path, bodies, {"big": {"on": "floor"}}, attempts=2)
    text = str(told.value)
    assert "geom 'big' of body 'big' and geom 'slab' of body 'wall'" in text
    assert "mm deep on average" in text
