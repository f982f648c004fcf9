"""Models of single layouts: stock MuJoCo simulates them as it simulates the model with all variants."""

from __future__ import annotations

import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.dataset.manifest import DatasetPlan
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.dataset.writer import DatasetWriter
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import compile_on_cpu
from tests.layout.starting import HELD, LIFTED, starting

UNITS = {"cabinet": "upper", "cupboard": "door", "chest": "lid", "shelf": None}
"""Unit -> the joint that its part `opening` is."""
# An asset whose parts other elements name, in each way that an MJCF file has.
MACHINE = """
<mujoco model="machine"><compiler angle="radian"/>
  <default><default class="soft"><geom friction="0.7"/></default></default>
  <asset><texture name="t" type="2d" builtin="flat" width="2" height="2"/><material name="m" texture="t"/></asset>
  <worldbody><body name="machine"><geom class="soft" size="0.05 0.05 0.05" type="box" material="m"/><site name="top"/>
    <camera name="eye" mode="targetbody" target="arm"/>
    <body name="arm" pos="0 0 0.1"><joint name="turn" axis="0 1 0" range="-1 1"/><geom name="rod" size="0.01 0.04"
      type="cylinder"/><site name="tip" pos="0.03 0 0.05"/>
      <body name="hand" pos="0 0 0.05"><joint name="slide" type="slide"/><geom size="0.01"/></body></body></body>
  </worldbody>
  <contact><exclude body1="machine" body2="arm"/></contact>
  <tendon><spatial name="rope"><site site="top"/><geom geom="rod" sidesite="tip"/><site site="tip"/></spatial></tendon>
  <equality><joint joint1="turn" joint2="slide" polycoef="0 0.1 0 0 0"/></equality>
  <actuator><position name="servo" joint="turn" kp="5"/><motor tendon="rope"/>
    <general site="tip" refsite="top"/></actuator>
  <sensor><framepos objtype="site" objname="tip" reftype="body" refname="machine"/><actuatorpos actuator="servo"/>
    <tendonpos tendon="rope"/><subtreecom body="machine"/></sensor>
</mujoco>"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """Units with drawn joints and a can on them, a machine that half of the layouts lack, and an arm."""
    path = tmp_path_factory.mktemp("machine") / "machine.xml"
    path.write_text(MACHINE)
    unit = {"asset": [*UNITS], "kind": "fixture", "on": "floor", "region": {"box": [[0.5, 0.5], [0.8, 0.8]]}}
    unit |= {"parts": {"opening": UNITS}, "joints": {"opening": {"fraction": [0.2, 0.9]}}}
    objects = {"unit": unit, "can": {"asset": "can", "on": {"any": "unit"}}, "lemon": {"asset": "lemon", "on": "floor"}}
    objects["machine"] = {"asset": str(path), "kind": "fixture", "on": "floor", "joints": {"turn": {"range": [0, 0.5]}}}
    joints = {"joint1": {"range": [-0.5, 0.5]}}
    words = {"floor": {"size": [4, 4]}, "robot": {"asset": "panda", "base": [-1, -1, 0], "joints": joints}}
    groups = {"sometimes": {"of": ["machine", "lemon"], "count": [0, 2]}}
    return compile_on_cpu({"objects": objects, "groups": groups, "bank": 8, **words})


def written(compiled: CompiledScene, n: int, folder: Path) -> tuple[mujoco.MjModel, list[mujoco.MjModel], np.ndarray]:
    """Write a data set, and return the model with all objects, the models of the rows, and the rows."""
    plan = DatasetPlan.of(compiled, n, 0, "train", ("mjcf",))
    DatasetWriter(compiled, plan, folder, Shard()).write(chunk=n)
    with zipfile.ZipFile(folder / "layouts-00000.zip") as archive:
        archive.extractall(folder / "models")
    own = [mujoco.MjModel.from_xml_path(str(folder / "models" / f"layout_{i}.xml")) for i in range(n)]
    with (folder / "scene.zip").open("rb") as file:
        return mujoco.MjSpec.from_zip(file).compile(), own, np.load(folder / "layouts-00000.npy")


def names(mjm: mujoco.MjModel, kind: str) -> list[str]:
    """Return the names of the elements of a kind, by id."""
    return [getattr(mjm, kind)(i).name for i in range(getattr(mjm, f"n{ {'joint': 'jnt'}.get(kind, kind) }"))]


def contacts(mjm: mujoco.MjModel, data: mujoco.MjData, body_names: list[str], own: np.ndarray) -> list[tuple]:
    """Return the bodies, the distance and the place of each contact of some bodies, sorted."""
    found = []
    for contact in data.contact:
        bodies = mjm.geom_bodyid[contact.geom]
        if own[bodies].all() and all(mjm.geom(i).name != "parking_ground" for i in contact.geom):
            place = (round(1e5 * float(value)) for value in (contact.dist, *contact.pos))
            found.append((*sorted(body_names[body] for body in bodies), *place))
    return sorted(found)


@pytest.mark.parametrize("scene", ["small", "kitchen_any"])
def test_each_layout_is_a_model_of_its_own_objects(scene: str, request: pytest.FixtureRequest, tmp_path: Path):
    """The same names in all rows, the poses, contacts and motion of the whole model, and no absent object."""
    compiled = request.getfixturevalue("small") if scene == "small" else compile_on_cpu(scene)
    big, models, rows = written(compiled, 24 if scene == "small" else 3, tmp_path)
    owners, opened, machines = compiled.config.owners, set(), set()
    for i, (own, row) in enumerate(zip(models, rows, strict=True)):
        text = (tmp_path / "models" / f"layout_{i}.xml").read_text()
        there = dict(zip(compiled.slots, row["present"].tolist(), strict=True))
        renamed, left = names(big, "body"), np.ones(big.nbody, bool)
        for name in compiled.config.objects:
            inside = [b for b, body in enumerate(renamed) if body == name or body.startswith(f"{name}/")]
            left[inside] = there[name]
            if not there[name] or name in owners:
                assert f'"{name}"' not in text
                assert f'"{name}/' not in text
            for body in inside if name in owners else ():
                renamed[body] = owners[name] + renamed[body].removeprefix(name)
        assert names(own, "body") == [name for name, stays in zip(renamed, left, strict=True) if stays]
        assert own.ngeom == (left[big.geom_bodyid] & ~np.isin(names(big, "geom"), ["parking_ground"])).sum()
        assert (own.nkey, own.key(0).name) == (1, "home")
        datas = mujoco.MjData(big), mujoco.MjData(own)
        for column in ("qpos", "mocap_pos", "mocap_quat"):
            getattr(datas[0], column)[:] = row[column]
        mujoco.mj_resetDataKeyframe(own, datas[1], 0)
        for actuator, name in enumerate(names(own, "actuator")):
            if name:
                datas[0].ctrl[names(big, "actuator").index(name)] = datas[1].ctrl[actuator]
        for steps, tolerance in ((0, 1e-9), (int(0.2 / big.opt.timestep), 2e-5)):
            for mjm, data in zip((big, own), datas, strict=True):
                mujoco.mj_step(mjm, data, steps)
                mujoco.mj_forward(mjm, data)
            np.testing.assert_allclose(datas[1].xpos, datas[0].xpos[left], atol=tolerance)
            if steps == 0:
                assert contacts(own, datas[1], names(own, "body"), np.ones(own.nbody, bool)) == contacts(
                    big, datas[0], renamed, left
                )
                servos = [a for a, name in enumerate(names(own, "actuator")) if name]
                assert np.abs(datas[1].actuator_force[servos]).max() < 1e-3
        if scene == "small":
            (unit,) = (name.removeprefix("unit/") for name in owners if name.startswith("unit/") and there[name])
            joints = [name for name in names(own, "joint") if name.startswith("unit/")]
            assert ("unit/opening" in joints) == (UNITS[unit] is not None)
            assert f"unit/{UNITS[unit]}" not in joints
            if UNITS[unit] is not None:
                joint = compiled.mjm.joint(f"unit/{unit}/{UNITS[unit]}")
                assert datas[1].joint("unit/opening").qpos == pytest.approx(datas[0].joint(joint.id).qpos, abs=1e-5)
            assert (own.ntendon, own.neq, own.nsensor) == ((2, 2, 4) if there["machine"] else (1, 1, 0))
            opened.add(unit)
            machines.add(there["machine"])
    assert scene != "small" or (opened == {*UNITS} and machines == {True, False})


def test_an_object_in_the_hand_stays_there(tmp_path: Path):
    """The controls of the keyframe close the gripper, as a reset does: it bears twice the object's weight."""
    compiled = starting()
    _, models, rows = written(compiled, 48, tmp_path)
    seen = set()
    for i, (own, row) in enumerate(zip(models, rows, strict=True)):
        assert (tmp_path / "models" / f"layout_{i}.xml").read_text().count("<keyframe") == 1
        if row["start"] not in (LIFTED, HELD) or not row["valid"]:
            continue
        data = mujoco.MjData(own)
        mujoco.mj_resetDataKeyframe(own, data, 0)
        mujoco.mj_forward(own, data)
        before, hand = data.body("block").xpos.copy(), data.body("panda/hand").xpos.copy()
        data.xfrc_applied[own.body("block").id, 2] = -9.81 * own.body("block").mass[0]
        mujoco.mj_step(own, data, int(0.5 / own.opt.timestep))
        moved = data.body("panda/hand").xpos - hand
        np.testing.assert_allclose(data.body("block").xpos - moved, before, atol=0.004)
        seen.add(int(row["start"]))
    assert seen == {LIFTED, HELD}
