"""State of actuators after a write, judged by the forces that plain MuJoCo finds."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.layout.masks import mask_of_rows
from sceniris_gym.sim.rest import rest_map
from sceniris_gym.sim.write import Poses, StateWriter, poses_of

ACTUATORS = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <worldbody>
    <body name="base" mocap="true">
      <geom size="0.01" contype="0" conaffinity="0"/>
      <body name="link">
        <joint name="hinge" axis="0 0 1"/>
        <geom size="0.1" pos="0.3 0 0" contype="0" conaffinity="0"/>
        <site name="tip" pos="0.3 0 0"/>
        <body name="carriage" pos="0.5 0 0">
          <joint name="slide" type="slide" axis="1 0 0"/>
          <geom size="0.1" contype="0" conaffinity="0"/>
        </body>
      </body>
    </body>
    <site name="post" pos="1 1 0"/>
  </worldbody>
  <tendon>
    <fixed name="sum"><joint joint="hinge" coef="2"/><joint joint="slide" coef="-0.5"/></fixed>
    <spatial name="rope"><site site="tip"/><site site="post"/></spatial>
  </tendon>
  <actuator>
    <position name="geared" joint="hinge" kp="10" gear="3"/>
    <position name="over a tendon" tendon="sum" kp="20" gear="0.5"/>
    <position name="filtered" joint="slide" kp="5" timeconst="0.1"/>
    <intvelocity name="integrated" joint="hinge" kp="7" actrange="-9 9"/>
    <general name="offset" joint="slide" gainprm="4" biastype="affine" biasprm="1 -2 0"/>
    <position name="limited" joint="hinge" kp="10" ctrlrange="-0.1 0.1"/>
    <position name="over a rope" tendon="rope" kp="1"/>
    <velocity name="velocity" joint="hinge" kv="3"/>
    <motor name="motor" joint="slide"/>
  </actuator>
</mujoco>
"""
HOLDING = ("geared", "over a tendon", "filtered", "integrated", "offset")
HOME_CTRL = np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.0, 0.6, 0.7, 0.8])
HOME_ACT = np.array([0.3, 0.3])


def written(
    qpos: np.ndarray, rows: list[int] | None = None, mask: list[bool] | None = None
) -> tuple[mujoco.MjModel, mjw.Data]:
    """Write layouts with joint positions `qpos` (nrow, 2) into worlds whose numbers are all -7.

    World i gets row rows[i]; without `rows` the masked worlds get rows of their own numbers.
    """
    model, nrow = mujoco.MjModel.from_xml_string(ACTUATORS), len(qpos)
    with wp.ScopedDevice("cpu"):
        d = mjw.make_data(model, nrow if rows is None else len(rows))
        for array in (d.qpos, d.ctrl, d.act):
            array.fill_(-7.0)
        poses = Poses()  # pyrefly: ignore[missing-argument]
        poses.qpos = wp.array(qpos, dtype=float)
        poses.mocap_pos = wp.full((nrow, 1), wp.vec3(1.0, 2.0, 3.0), dtype=wp.vec3)
        poses.mocap_quat = wp.full((nrow, 1), wp.quat(0.5, -0.5, 0.5, -0.5), dtype=wp.quat)
        which = wp.array([True] * d.nworld if mask is None else mask, dtype=wp.bool)
        given = None if rows is None else wp.array(rows, dtype=int)
        if given is not None:
            mask_of_rows(given, nrow, which)
        writer = StateWriter(model, d, which, rest_map(model, HOME_CTRL, HOME_ACT, "cpu"))
        writer.launch(poses, given)
    return model, d


def test_position_actuators_exert_nothing_at_the_written_pose():
    """Over a gear, a tendon, a filter, an integrator and an offset: the force at the sampled pose is zero."""
    poses = np.array([[0.3, 0.1], [-1.2, 0.4], [2.0, -0.3]])
    model, d = written(poses, [0, 1, 2])
    data = mujoco.MjData(model)
    for world, pose in enumerate(poses):
        data.qpos[:], data.ctrl[:], data.act[:] = pose, d.ctrl.numpy()[world], d.act.numpy()[world]
        mujoco.mj_forward(model, data)
        for name in HOLDING:
            assert abs(data.actuator(name).force[0]) < 2e-6, name


def test_controls_stay_in_range_and_others_are_at_home():
    """A limited actuator goes as far as it may; ropes, velocities and motors take their home controls."""
    model, d = written(np.array([[0.5, 0.0]]), [0])
    ctrl = dict(zip((model.actuator(i).name for i in range(model.nu)), d.ctrl.numpy()[0], strict=True))
    np.testing.assert_allclose(ctrl["limited"], 0.1)
    for name, home in (("over a rope", 0.6), ("velocity", 0.7), ("motor", 0.8), ("integrated", 0.4)):
        np.testing.assert_allclose(ctrl[name], home)


def test_worlds_without_a_row_keep_everything():
    """Row -1, and a row that does not exist, leave a world as it is; the others get pose and mocap pose."""
    poses = np.array([[0.3, 0.1], [-1.2, 0.4]])
    _, d = written(poses, [-1, 1, 2, 0])
    qpos = d.qpos.numpy()
    np.testing.assert_allclose(qpos[[1, 3]], poses[[1, 0]].astype(np.float32))
    np.testing.assert_array_equal(qpos[[0, 2]], -7.0)
    for array in (d.ctrl, d.act):
        np.testing.assert_array_equal(array.numpy()[[0, 2]], -7.0)
        assert (array.numpy()[[1, 3]] != -7.0).all()
    np.testing.assert_array_equal(d.mocap_pos.numpy()[[1, 3], 0], [[1.0, 2.0, 3.0]] * 2)
    np.testing.assert_array_equal(d.mocap_quat.numpy()[[1, 3], 0], [[0.5, -0.5, 0.5, -0.5]] * 2)
    np.testing.assert_array_equal(d.mocap_pos.numpy()[[0, 2], 0], 0.0)


def test_masked_worlds_take_their_own_rows():
    """Without a list of rows; the others keep everything."""
    poses = np.array([[0.3, 0.1], [-1.2, 0.4], [0.7, -0.2]])
    _, d = written(poses, mask=[True, False, True])
    np.testing.assert_allclose(d.qpos.numpy(), np.array([poses[0], [-7.0, -7.0], poses[2]], np.float32))
    for array in (d.ctrl, d.act):
        np.testing.assert_array_equal(array.numpy()[1], -7.0)
        assert (array.numpy()[[0, 2]] != -7.0).all()


def test_springs_of_masked_worlds_are_at_home():
    """The same plastic references in each; the others keep theirs."""
    model = mujoco.MjModel.from_xml_string(ACTUATORS)
    with wp.ScopedDevice("cpu"):
        d = mjw.make_data(model, 3)
        d.plastic = wp.full((3, 2), 9.0, dtype=float)
        mask = wp.array([True, False, True], dtype=wp.bool)
        rest = rest_map(model, HOME_CTRL, HOME_ACT, "cpu")
        StateWriter(model, d, mask, rest, plastic=np.array([1.0, 2.0])).launch(poses_of(d))
    assert d.plastic.numpy().tolist() == [[1.0, 2.0], [9.0, 9.0], [1.0, 2.0]]
