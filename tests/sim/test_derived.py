"""Updates of fields that follow from others, against `mj_setConst` of MuJoCo C in double precision."""

from __future__ import annotations

import copy

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.sim.derived import FOLLOWS, launch_derived
from sceniris_gym.sim.derived_tables import derived_tables

NWORLD = 12
MASK = np.arange(NWORLD) % 3 != 1

CAMERAS = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    <light name="sun" pos="0 0 3" dir="0.1 0 -1"/>
    <camera name="room" pos="0 -1 1" xyaxes="1 0 0 0 0.6 0.8"/>
    <body name="base" pos="0.1 0 0.3" euler="20 10 0"><joint name="turn" axis="0 0 1"/><geom size="0.1" pos="0.1 0 0"/>
      <camera name="hand" pos="0.02 0 0.1" euler="10 30 0" mode="trackcom"/>
      <body name="arm" pos="0.3 0 0" euler="0 0 30"><joint name="lift" axis="0 1 0"/><geom size="0.05" pos="0.1 0.1 0"/>
        <light name="torch" pos="0 0 0.1" dir="1 0 -0.2" mode="targetbodycom" target="base"/></body>
      <body name="hollow" pos="0 0 0.5"/></body>
  </worldbody>
</mujoco>
"""

MACHINE = """
<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" density="800"/><joint armature="0.01" limited="false"/></default>
  <worldbody>
    <body name="base" pos="0.1 0 0.2" euler="0.3 0.2 0">
      <joint name="turn" axis="0 0 1"/><geom size="0.05 0.1" type="capsule" euler="0.3 0 0"/>
      <body name="arm" pos="0.3 0 0.1" euler="0 0.4 0">
        <joint name="out" type="slide" axis="1 0 0"/><geom type="box" size="0.1 0.03 0.02" pos="0.05 0 0"/>
        <body name="wrist" pos="0.2 0.02 0"><joint name="ball" type="ball"/>
          <geom type="ellipsoid" size="0.03 0.05 0.02" pos="0.02 0.05 0"/>
          <body name="fixed" pos="0 0 0.1"><geom size="0.02"/></body></body>
        <body name="left" pos="0 0.1 0"><joint name="left" axis="0 1 0"/><geom size="0.03" pos="0 0 0.1"/></body>
        <body name="right" pos="0 -0.1 0"><joint name="right" axis="0 1 0"/><geom size="0.03" pos="0 0 0.1"/>
          <site name="end" pos="0 0 0.1"/></body>
      </body></body>
    <body name="odd" pos="1 0 0"><freejoint/><geom type="box" size="0.1 0.05 0.02" pos="0.03 0 0" euler="0 0 0.4"/>
      <body name="flap" pos="0.1 0 0"><joint name="flap" axis="0 1 0"/><geom size="0.02" pos="0.05 0 0"/></body></body>
    <body name="ball" pos="0 1 0"><freejoint/><geom size="0.05"/></body>
    <body name="heavy" pos="1 1 0"><joint type="free" armature="0.02"/><geom type="box" size="0.05 0.1 0.2"/></body>
    <body name="sled" pos="1 2 0"><joint type="slide" axis="1 0 0"/><joint name="up" type="slide" axis="0 0 1"/>
      <geom size="0.05"/></body>
    <body name="lift" pos="1 3 0"><joint type="slide" axis="0 0 1"/><geom size="0.05" pos="0.1 0 0"/></body>
    <body name="wheel" pos="1 4 0"><joint axis="0 0 1"/><geom size="0.05"/></body>
    <body name="far" pos="0 2 0"><joint name="far" axis="1 0 0"/><geom size="0.1" pos="0 0.3 0"/></body>
    <body name="mocap" mocap="true" pos="0 0 2"><geom size="0.05"/></body>
    <site name="post" pos="0 0 0.5"/>
  </worldbody>
  <tendon>
    <fixed name="pair"><joint joint="left" coef="2"/><joint joint="right" coef="-0.5"/></fixed>
    <spatial name="rope"><site site="end"/><site site="post"/></spatial>
    <fixed name="belt"><joint joint="far" coef="1"/><joint joint="turn" coef="1.5"/></fixed>
  </tendon>
  <actuator>
    <motor joint="turn" gear="3"/><motor joint="ball" gear="1 2 0.5"/><position tendon="pair" kp="10" gear="0.5"/>
    <motor site="end" gear="0 0 1 0 1 0"/><motor tendon="belt"/><motor joint="up"/>
  </actuator>
</mujoco>
"""


def drawn(mjm: mujoco.MjModel, seed: int) -> mujoco.MjModel:
    """Return a copy with masses, inertias, centres of mass, armatures, gears, cameras and lights of its own."""
    rng, mjm = np.random.default_rng(seed), copy.copy(mjm)
    mjm.body_mass *= rng.uniform(0.2, 5.0, mjm.nbody)
    mjm.body_inertia *= rng.uniform(0.5, 2.0, mjm.nbody)[:, None]
    odd = (mjm.body_simple == 0) & (mjm.body_weldid > 0)
    mjm.body_ipos[odd] += rng.uniform(-0.02, 0.02, (odd.sum(), 3))
    mjm.body_iquat[odd] = rng.normal(size=(odd.sum(), 4))
    mjm.body_iquat[odd] /= np.linalg.norm(mjm.body_iquat[odd], axis=1)[:, None]
    mjm.dof_armature *= rng.uniform(0.2, 3.0, mjm.nv)
    mjm.actuator_gear *= rng.uniform(0.5, 2.0, mjm.actuator_gear.shape)
    for name in ("tendon_armature", "actuator_armature"):
        if hasattr(mjm, name):
            getattr(mjm, name)[:] *= rng.uniform(0.5, 2.0, len(getattr(mjm, name)))
    for name in ("cam_pos", "cam_quat", "light_pos", "light_dir"):
        array = getattr(mjm, name)
        array += rng.uniform(0.1, 0.4, array.shape) * (np.abs(array) + 0.01)
    mjm.cam_quat /= np.linalg.norm(mjm.cam_quat, axis=1, keepdims=True)
    return mjm


def check(mjm: mujoco.MjModel, models: list[mujoco.MjModel]) -> None:
    """Give worlds the fields of these models, and compare what follows in the masked ones; the others keep theirs."""
    with wp.ScopedDevice("cpu"):
        m = mjw.put_model(mjm)
        sources = {name for names in FOLLOWS.values() for name in names}
        outputs = [name for name in FOLLOWS if getattr(m, name).size]
        for name in (*sources, *outputs):
            array = getattr(m, name, None)
            if array is not None and array.size:
                given = models if name in sources else [mjm] * NWORLD
                wide = np.stack([getattr(one, name) for one in given]).reshape(NWORLD, *array.numpy().shape[1:])
                setattr(m, name, wp.array(wide, dtype=array.dtype))
        before = {name: getattr(m, name).numpy().copy() for name in outputs}
        launch_derived(derived_tables(mjm, NWORLD), m, wp.array(MASK, dtype=wp.bool), outputs)
    for world, expected in enumerate(models):
        mujoco.mj_setConst(expected, mujoco.MjData(expected))
        for name in outputs:
            found = getattr(m, name).numpy()[world]
            if MASK[world]:
                wanted = getattr(expected, name).reshape(found.shape)
                atol = 1e-6 if name.startswith(("cam", "light")) else 1e-9
                np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=atol, err_msg=name)
            else:
                np.testing.assert_array_equal(found, before[name][world])


@pytest.mark.parametrize("scene", [MACHINE, CAMERAS], ids=["machine", "cameras"])
def test_outputs_are_those_of_mujoco(scene: str):
    """Of bodies, joints of all types, tendons over two trees, actuators, cameras and lights of several modes."""
    mjm = mujoco.MjModel.from_xml_string(scene)
    check(mjm, [drawn(mjm, seed) for seed in range(NWORLD)])


def test_armatures_of_tendons_and_actuators_count():
    """As they add to M, in the units of what they move."""
    mjm = mujoco.MjModel.from_xml_string(MACHINE)
    for name in ("tendon_armature", "actuator_armature"):
        if hasattr(mjm, name):
            getattr(mjm, name)[:] = 0.03
    mujoco.mj_setConst(mjm, mujoco.MjData(mjm))
    check(mjm, [drawn(mjm, seed) for seed in range(NWORLD)])


def test_weights_in_a_long_chain_are_those_of_mujoco():
    """As near as single precision gets: terms of a body's weight are far greater than their sum."""
    link = '<body pos="0.1 0 0"><joint axis="{} {} 0"/><geom size="0.03" pos="0.05 0 0"/>'
    links = "".join(link.format(i % 2, 1 - i % 2) for i in range(40))
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{links}{'</body>' * 40}</worldbody></mujoco>")
    with wp.ScopedDevice("cpu"):
        m = mjw.put_model(mjm)
        expected = m.body_invweight0.numpy().copy()
        m.body_invweight0.zero_()
        outputs = ["body_invweight0", "dof_invweight0", "tendon_invweight0", "actuator_acc0"]
        launch_derived(derived_tables(mjm, 1), m, wp.ones(1, dtype=wp.bool), outputs)
    np.testing.assert_allclose(m.body_invweight0.numpy(), expected, rtol=0.03)


def test_only_fields_with_a_row_for_each_world_are_written():
    """The others have one row, which stays."""
    mjm = mujoco.MjModel.from_xml_string(CAMERAS)
    with wp.ScopedDevice("cpu"):
        m = mjw.put_model(mjm)
        before = m.body_invweight0.numpy().copy()
        m.body_mass.fill_(2.0)
        m.body_subtreemass = wp.zeros((NWORLD, mjm.nbody), dtype=float)
        launch_derived(derived_tables(mjm, NWORLD), m, wp.ones(NWORLD, dtype=wp.bool), ["body_subtreemass"])
    np.testing.assert_array_equal(m.body_subtreemass.numpy()[:, 0], 2.0 * mjm.nbody)
    np.testing.assert_array_equal(m.body_invweight0.numpy(), before)
