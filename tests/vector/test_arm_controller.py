"""An arm as tasks drive it: how the tool moves with joints, against plain MuJoCo, and whether it does as it is told."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.chain import Chain
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ArmError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from sceniris_gym.vector import arm_controller
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.state import State
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.driving import Drive
from tests.vector.workshop import HANDS, JOINTS, joints_of, mjcf, mujocos, state_of, step, tensor

SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "panda", "base": [0.1, -0.2, 0.3], "yaw": 35, "joints": {"joint*": {"noise": 0.3}}},
    "objects": {"block": {"asset": "block", "on": "floor", "region": {"box": [[-0.9, -0.9], [-0.7, -0.7]]}}},
}


@pytest.fixture(scope="module")
def arm_scene() -> CompiledScene:
    """Return a CompiledScene with a Panda whose base is turned."""
    return compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cpu")


@pytest.fixture
def driven(arm_scene: CompiledScene) -> tuple[SceneVectorEnv, Any]:
    """Return an environment of four arms, and its task."""
    envs = SceneVectorEnv(Drive, 4, scene=arm_scene, autoreset_mode="Disabled")
    envs.reset(seed=1)
    return envs, envs.task


def panda(mjm: mujoco.MjModel) -> Chain:
    """Return the Panda's kinematics in float64, which share no code with the controller."""
    return Chain(mjm, mjm.body("panda").id, mjm.site("panda/tcp").id)


def drive(envs: SceneVectorEnv, action: torch.Tensor) -> None:
    """Step with actions of fewer numbers than there are controls, shape (4, n)."""
    envs.step(torch.nn.functional.pad(action, (0, 8 - action.shape[1])))


def test_the_jacobian_is_mujocos_in_the_base_frame(driven):
    """Column by column, against mj_jacSite and the Jacobian of a SerialChain, where also the tool is."""
    envs, task = driven
    mjm = envs.compiled.mjm
    found = envs.state.jacobian("panda/tcp", "panda")
    assert found.shape == (4, 6, 9)
    dofs = [int(mjm.joint(f"panda/joint{i}").dofadr[0]) for i in range(1, 8)]
    for i in range(4):
        data = mujoco.MjData(mjm)
        data.qpos[:] = envs.batch.data.qpos.numpy()[i]
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        jacobian = np.zeros((6, mjm.nv))
        mujoco.mj_jacSite(mjm, data, jacobian[:3], jacobian[3:], mjm.site("panda/tcp").id)
        base = data.body("panda").xmat.reshape(3, 3)
        expected = np.concatenate([base.T @ jacobian[:3], base.T @ jacobian[3:]])[:, dofs]
        np.testing.assert_allclose(found[i, :, :7].numpy(), expected, atol=1e-5)
    poses, jacobians = panda(mjm).jacobian(task.arm.qpos(envs.state).double().numpy())
    np.testing.assert_allclose(found[:, :, :7].numpy(), jacobians, atol=1e-5)
    np.testing.assert_allclose(task.arm.tool(envs.state)[:, :3], poses[:, :3, 3], atol=1e-5)


def test_joint_targets_lead_by_what_full_speed_takes_and_no_more(driven):
    """The joint then moves at its published speed, and stops within a few steps of an action of zero."""
    envs, task = driven
    s, arm = envs.state, task.arm
    task.move = lambda s, action: arm.move_joints(s, action[:, :7])
    action = torch.zeros(4, 7)
    action[:, 0] = 1.0
    for _ in range(25):
        drive(envs, action)
        assert ((arm.targets(s) - arm.qpos(s)).abs() <= arm.lead + 1e-6).all()
    assert (arm.qvel(s)[:, 0] > 1.6).all()
    for _ in range(15):
        drive(envs, torch.zeros(4, 7))
    assert (arm.qvel(s).abs() < 0.05).all()
    torch.testing.assert_close(arm.qpos(s), arm.targets(s), rtol=0, atol=2e-3)


def test_targets_stay_within_the_joints_limits(driven):
    """However long a joint is driven against its end."""
    envs, task = driven
    s, arm = envs.state, task.arm
    task.move = lambda s, action: arm.move_joints(s, action[:, :7])
    for _ in range(120):
        drive(envs, torch.ones(4, 7))
    high = torch.tensor(envs.compiled.mjm.actuator_ctrlrange[:7, 1], dtype=torch.float32)
    assert (arm.targets(s) <= high + 1e-6).all()
    assert (arm.targets(s) > high - 0.3).all()


def test_a_tool_goes_along_the_axes_of_the_base_and_looks_down(driven):
    """To a point 10 cm aside, turned by half a radian, and there it stays."""
    envs, task = driven
    s, arm = envs.state, task.arm
    task.move = lambda s, action: arm.move_tool(s, action[:, :4])
    for _ in range(40):  # stand up straight first: the start has noise
        drive(envs, torch.zeros(4, 4))
    goal = arm.tool_target.clone()
    goal[:, :3] = torch.tensor([0.45, 0.1, 0.3])
    goal[:, 3] = torch.tensor([0.5, -0.5, 0.0, 0.25])
    step = torch.tensor([arm_controller.TOOL_STEP] * 3 + [arm_controller.YAW_STEP])
    for _ in range(120):
        drive(envs, ((goal - arm.tool_target) / step).clamp(-1.0, 1.0))
    tool = arm.tool(s)
    torch.testing.assert_close(tool[:, :3], goal[:, :3], rtol=0, atol=2e-3)
    half = 0.5 * goal[:, 3]
    down = torch.stack([0 * half, half.cos(), half.sin(), 0 * half], dim=1)
    assert ((tool[:, 3:] * down).sum(dim=1).abs() > 0.9999).all()
    # the joints, as a SerialChain has them, bring the tool to the same pose
    reached, yaw = panda(envs.compiled.mjm).fk(arm.qpos(s).double().numpy()), goal[:, 3].numpy()
    np.testing.assert_allclose(reached[:, :3, 3], goal[:, :3], atol=2e-3)
    np.testing.assert_allclose(reached[:, :2, 0], np.stack([np.cos(yaw), np.sin(yaw)], axis=1), atol=2e-2)
    np.testing.assert_allclose(reached[:, :3, 2], [[0.0, 0.0, -1.0]] * 4, atol=2e-2)


def test_a_tool_does_not_go_below_what_it_is_told(driven):
    """The target stops there, and rises at once when it is told to."""
    envs, task = driven
    arm = task.arm
    task.move = lambda s, action: arm.move_tool(s, action[:, :4], lowest=0.25)
    action = torch.zeros(4, 4)
    action[:, 2] = -1.0
    for _ in range(80):
        drive(envs, action)
    assert (arm.tool_target[:, 2] >= 0.25).all()
    assert (arm.tool(envs.state)[:, 2] < 0.27).all()


def test_the_way_to_a_pose_is_the_difference_of_positions_and_the_shorter_rotation(driven):
    """Against SciPy's rotations, up to half a turn: the axis times twice the sine of half the angle."""
    s, arm, rng = driven[0].state, driven[1].arm, np.random.default_rng(0)
    now = arm.tool(s)
    vectors = rng.normal(size=(len(now), 3)) * 0.8
    goal, shift = Rotation.from_rotvec(vectors) * turned(now), rng.uniform(-0.5, 0.5, (len(now), 3))
    pose = np.hstack([now[:, :3].numpy() + shift, -goal.as_quat(scalar_first=True)])
    way = arm.way_to(s, torch.as_tensor(pose, dtype=torch.float32)).numpy()
    short = (goal * turned(now).inv()).as_rotvec()
    angle = np.linalg.norm(short, axis=1, keepdims=True)
    np.testing.assert_allclose(way, np.hstack([shift, 2.0 * np.sin(0.5 * angle) * short / angle]), atol=1e-5)


def test_the_gripper_closes_and_opens(driven):
    """From -1 to 1; the width is the distance between the fingers."""
    envs, task = driven
    arm = task.arm
    task.move = lambda s, action: arm.grip(s, action[:, 0])
    for command, width in ((-1.0, 0.0), (0.0, 0.04), (1.0, 0.08)):
        for _ in range(40):
            drive(envs, torch.full((4, 1), command))
        torch.testing.assert_close(arm.width(envs.state), torch.full((4,), width), rtol=0, atol=2e-3)


def test_a_start_concerns_the_masked_worlds_alone(driven):
    """Tool targets of the others stay what they were."""
    envs, task = driven
    task.arm.tool_target.fill_(9.0)
    task.arm.start(envs.state, torch.tensor([True, False, False, True]))
    torch.testing.assert_close(task.arm.tool_target[[0, 3], :3], task.arm.tool(envs.state)[[0, 3], :3])
    assert (task.arm.tool_target[1:3] == 9.0).all()


@pytest.mark.parametrize(("asset", "joints", "open_"), [("panda", 7, 0.04), ("ur5e", 6, 0.0475), ("heron", 6, 0.044)])
def test_shipped_arms_have_their_joints_actuators_and_gripper(asset, joints, open_):
    """By their names in the asset, which the controller does not look at; the only robot needs no name."""
    s = state_of({"robot": {"asset": asset, "base": [0.1, 0.2, 0.3], "yaw": 40}})
    for arm in (ArmController(s), ArmController(s, asset), ArmController(s, "robot")):
        assert (arm.name, arm.joints, arm.has_gripper) == (asset, joints, True)
        names = [f"{asset}/joint{i + 1}" for i in range(joints)]
        qpos = np.random.default_rng(0).uniform(-1.0, 1.0, (2, s.mjm.nq))
        s.data.qpos.assign(qpos)
        adr = [int(s.mjm.joint(name).qposadr[0]) for name in names]
        np.testing.assert_array_equal(arm.qpos(s), qpos[:, adr].astype(np.float32))
        columns = [s.mjm.actuator(name).id for name in names]
        targets = tensor(s.mjm.actuator_ctrlrange[columns]).mean(dim=1).repeat(2, 1) + 0.01
        s.ctrl.fill_(9.0)
        arm.set_targets(s, targets)
        torch.testing.assert_close(s.ctrl[:, columns], targets, rtol=0, atol=0)
        for action, target in ((-1.0, 0.0), (0.5, 0.75 * open_), (1.0, open_)):
            arm.grip(s, torch.full((2,), action))
            torch.testing.assert_close(s.ctrl[:, s.actuator(f"{asset}/gripper")], torch.full((2,), target))
        assert (s.ctrl == 9.0).sum() == 2 * (s.mjm.nu - joints - 1)
        fingers = [int(s.mjm.joint(f"{asset}/finger_joint{i}").qposadr[0]) for i in (1, 2)]
        np.testing.assert_allclose(arm.width(s), qpos[:, fingers].sum(axis=1), rtol=1e-6)


def test_leads_of_shipped_arms_are_what_they_have_always_been():
    """F / kp (1 + kv / d), from the numbers in the Panda's asset; policies were trained with these."""
    arm = ArmController(state_of({"robot": {"asset": "panda"}}))
    numbers = [(87, 2000, 100, 40)] * 2 + [(87, 1500, 60, 40), (87, 1500, 40, 40)]
    numbers += [(12, 500, 15.402, 4.598)] * 2 + [(12, 400, 9.402, 4.598)]
    assert arm.lead.tolist() == [np.float32(f / kp * (1.0 + kv / d)) for f, kp, kv, d in numbers]


@pytest.fixture(scope="module")
def pair_file(tmp_path_factory) -> Path:
    """Return a model of two arms that face each other, with odd names and hands of their own."""
    path = tmp_path_factory.mktemp("pair") / "two arms.xml"
    arms = {"plinth": ("two actuators", "0 0 0", 10.0), "left": ("tendon", "1 0.2 0", 180.0)}
    path.write_text(mjcf(arms))
    return path


def pair(path: Path) -> State:
    """Return worlds with both arms; the name of the one is the root body of the other."""
    left, right = {"in_model": "plinth", "tcp": "plinth:point"}, {"in_model": "left", "tcp": "left:point"}
    return state_of({"model": str(path), "robots": {"left": left, "right": right}})


def test_each_of_several_robots_has_a_controller_by_its_name_in_the_scene(pair_file):
    """With joints, tool and gripper of its own, in a model of the user's; a root body's name is second to it."""
    s = pair(pair_file)
    for name, plinth in (("left", "plinth"), ("right", "left"), ("plinth", "plinth")):
        arm = ArmController(s, name)
        assert (arm.name, arm.joints, arm.has_gripper) == ("right" if plinth == "left" else "left", 4, True)
        qpos = np.random.default_rng(1).uniform(-0.2, 0.2, (2, s.mjm.nq))
        qvel = np.random.default_rng(2).uniform(-0.2, 0.2, (2, s.mjm.nv))
        s.data.qpos.assign(qpos)
        s.data.qvel.assign(qvel)
        s._batch.update()
        np.testing.assert_array_equal(arm.qpos(s), qpos[:, joints_of(s.mjm, plinth)].astype(np.float32))
        dofs = [int(s.mjm.joint(f"{plinth}:{joint}").dofadr[0]) for joint in JOINTS]
        np.testing.assert_array_equal(arm.qvel(s), qvel[:, dofs].astype(np.float32))
        np.testing.assert_allclose(arm.tool(s)[0, :3], mujocos(s).site(f"{plinth}:point").xpos, atol=1e-6)


def test_arms_of_any_make_are_driven_by_their_joints(pair_file):
    """Gears, tendons and slides: each joint goes where it is told, the other arm stays where it is."""
    s = pair(pair_file)
    arm, other, datas = ArmController(s, "right"), ArmController(s, "left"), [mujocos(s, world) for world in range(2)]
    other.set_targets(s, other.qpos(s))
    before, wanted = other.qpos(s).clone(), tensor([[0.4, -0.5, 0.1, 0.6], [-0.3, 0.2, -0.1, -0.4]])
    for _ in range(120):
        arm.move_joints(s, ((wanted - arm.targets(s)) / tensor([0.04, 0.04, 0.02, 0.04])).clamp(-1.0, 1.0))
        step(s, datas)
    torch.testing.assert_close(arm.targets(s), wanted, rtol=0, atol=1e-5)
    torch.testing.assert_close(arm.qpos(s), wanted, rtol=0, atol=1e-2)
    torch.testing.assert_close(other.qpos(s), before, rtol=0, atol=1e-4)
    with pytest.raises(ArgumentError, match=r"move_joints: action should have shape \(num_envs, 4\), got \(2, 7\)"):
        arm.move_joints(s, torch.zeros(2, 7))


def test_tools_of_arms_that_face_each_other_go_along_the_axes_of_the_world(pair_file):
    """Each keeps its heading, whichever way its base is turned, and arrives where MuJoCo has it."""
    s = pair(pair_file)
    arms = {"plinth": ArmController(s, "left"), "left": ArmController(s, "right")}
    starts, datas = {plinth: mujocos(s).site(f"{plinth}:point") for plinth in arms}, [mujocos(s) for _ in range(2)]
    for arm in arms.values():
        arm.start(s, torch.ones(2, dtype=torch.bool))
    goals = {plinth: starts[plinth].xpos + [-0.06, 0.03, -0.08] for plinth in arms}
    for _ in range(150):
        for plinth, arm in arms.items():
            way = tensor(goals[plinth]) - arm.tool_target[:, :3]
            action = torch.cat([way / arm_controller.TOOL_STEP, torch.zeros(2, 1)], dim=1)
            arm.move_tool(s, action.clamp(-1.0, 1.0))
        step(s, datas)
    for plinth, arm in arms.items():
        found = mujocos(s).site(f"{plinth}:point")
        np.testing.assert_allclose(found.xpos, goals[plinth], atol=5e-3)
        np.testing.assert_allclose(found.xmat, starts[plinth].xmat, atol=0.05)
        torch.testing.assert_close(arm.tool_lead(s)[:, 3], torch.zeros(2), rtol=0, atol=0.02)


def test_any_gripper_closes_and_opens(tmp_path):
    """From -1 to 1, each by itself; the width is that of the geoms."""
    path, hands = tmp_path / "arms.xml", [name for name, hand in HANDS.items() if hand.actuators]
    path.write_text(mjcf({hand: (hand, f"0 {i} 0", 0.0) for i, hand in enumerate(hands)}))
    robots = {f"r{i}": {"in_model": hand, "tcp": f"{hand}:point"} for i, hand in enumerate(hands)}
    s = state_of({"model": str(path), "robots": robots}, 1)
    arms, data = [ArmController(s, hand) for hand in hands], mujocos(s)
    for command in (-1.0, 1.0):
        for _ in range(100):
            for arm in arms:
                arm.grip(s, torch.full((1,), command))
            step(s, [data])
        for arm, hand in zip(arms, hands, strict=True):
            closed, opened = HANDS[hand].gaps
            found = np.linalg.norm(data.geom(f"{hand}:thumb").xpos - data.geom(f"{hand}:index").xpos)
            assert found == pytest.approx(opened if command > 0.0 else closed, abs=2e-3)
            assert arm.width(s).item() == pytest.approx(found - closed, abs=1e-3)


def test_an_arm_without_a_gripper_is_driven_and_says_so_when_it_should_grip(tmp_path):
    """A robot from a file, under the prefix that the scene gives it, with a joint in its root body."""
    path = tmp_path / "crane.xml"
    body = mjcf({"base": ("none", "0 0 0", 0.0)}).replace('pos="0 0 .4">', ">")
    path.write_text(
        body.replace('<body name="base" pos="0 0 0" euler="0 0 0.0">', "<body name='base'><joint name='0'/>")
    )
    path.write_text(path.read_text().replace("<actuator>", '<actuator><position joint="0" kp="900" kv="90"/>'))
    s = state_of({"robot": {"asset": str(path), "tcp": "base:point", "base": [0.2, 0.0, 0.1], "yaw": 70}})
    arm = ArmController(s, "crane")
    assert (arm.name, arm.joints, arm.has_gripper) == ("crane", 5, False)
    for use in (arm.width, lambda s: arm.grip(s, torch.zeros(2))):
        with pytest.raises(
            ArmError, match=r"scene 'scene': ArmController: robot: the robot has no gripper: .*'ctrlrange'"
        ):
            use(s)
    datas = [mujocos(s), mujocos(s)]
    arm.start(s, torch.ones(2, dtype=torch.bool))
    goal = arm.tool_target.clone() + tensor([0.0, -0.05, 0.05, 0.3])
    for _ in range(120):
        action = ((goal - arm.tool_target) / tensor([0.02] * 3 + [0.1])).clamp(-1.0, 1.0)
        arm.move_tool(s, action, lowest=-1.0)
        step(s, datas)
    torch.testing.assert_close(arm.tool(s)[:, :3], goal[:, :3], rtol=0, atol=5e-3)
    torch.testing.assert_close(arm.tool_target, goal, rtol=0, atol=1e-4)


def turned(pose: torch.Tensor) -> Rotation:
    """Return the orientations of poses."""
    return Rotation.from_quat(pose[:, 3:].double().numpy(), scalar_first=True)


def reach_poses(s: State, datas: list[mujoco.MjData]) -> None:
    """Move the tools to poses by six numbers, from either frame, and check their errors after 2 s in MuJoCo C."""
    arm, n = ArmController(s), len(datas)
    homes, rng = arm.qpos(s).double().numpy(), np.random.default_rng(0)
    chain = Chain(s.mjm, s.mjm.body(arm.name).id, s.mjm.site(f"{arm.name}/tcp").id)
    goals = chain.fk(homes + rng.uniform(-0.5, 0.5, homes.shape))
    places, rotations = goals[:, :3, 3], Rotation.from_matrix(goals[:, :3, :3])
    arm.start(s, torch.ones(n, dtype=torch.bool))
    torch.testing.assert_close(arm.pose_target, arm.tool(s), rtol=0, atol=0)
    for i in range(100):
        way, target = places - arm.pose_target[:, :3].numpy(), turned(arm.pose_target)
        turn = (rotations * target.inv()).as_rotvec()
        frame = "tool" if i % 2 else "base"
        if frame == "tool":
            way, turn = target.inv().apply(way), target.inv().apply(turn)
        action = np.hstack([way / arm_controller.TOOL_STEP, turn / arm_controller.YAW_STEP])
        action /= np.maximum(np.abs(action).max(axis=1, keepdims=True), 1.0)
        arm.move_tool(s, tensor(action), lowest=-1.0, frame=frame)
        step(s, datas)
    np.testing.assert_allclose(arm.tool(s)[:, :3], places, atol=5e-3)
    assert (np.degrees((turned(arm.tool(s)) * rotations.inv()).magnitude()) < 2.0).all()
    reached = chain.fk(arm.qpos(s).double().numpy())
    np.testing.assert_allclose(reached, goals, atol=2e-2)


def bearing_arms(asset: str) -> State:
    """Return eight worlds with an arm that has to bear its weight."""
    model = build_model(SceneConfig.load({"robot": {"asset": asset, "yaw": 40}}))
    model.mjm.body_gravcomp[:] = 0.0
    return state_of(model, 8)


@pytest.mark.parametrize("asset", ["panda", "ur5e"])
def test_a_tool_goes_to_any_pose_by_six_numbers(asset):
    """Within 5 mm and 2 degrees, also if the arm has to bear its weight."""
    s = bearing_arms(asset)
    reach_poses(s, [mujocos(s, world) for world in range(8)])


def test_a_tool_goes_to_any_pose_with_drawn_masses_gravity_and_gains():
    """Each world's own weight is borne by its own gains; by the model's, tools hung 10 to 50 mm too low."""
    s = bearing_arms("panda")
    fields = {name: s.model_field(name) for name in ("body_mass", "body_inertia", "gravity")}
    gains = {name: s.model_field(name)[..., :3] for name in ("actuator_gainprm", "actuator_biasprm")}
    fields["body_mass"][::2] *= 2.0
    fields["body_inertia"][::2] *= 2.0
    fields["gravity"][2:6] *= tensor([1.0, 1.0, 0.5])
    fields["gravity"][2:6, 0] = 2.0
    for gain in gains.values():
        gain[4:] *= 0.7
    datas = []
    for world in range(8):
        mjm = copy.copy(s.mjm)
        mjm.body_mass[:], mjm.body_inertia[:] = fields["body_mass"][world], fields["body_inertia"][world]
        mjm.opt.gravity[:] = fields["gravity"][world]
        mjm.actuator_gainprm[:, :3] = gains["actuator_gainprm"][world]
        mjm.actuator_biasprm[:, :3] = gains["actuator_biasprm"][world]
        datas.append(mujocos(s, world, mjm))
    reach_poses(s, datas)


def test_a_tool_goes_to_any_pose_with_damped_joints_of_little_inertia():
    """Like an xArm7's last joint. A force at its limit has no derivative, and swung such joints by 6 rad/s."""
    model = build_model(SceneConfig.load({"robot": {"asset": "heron"}}))
    model.mjm.dof_armature[:] = 0.0
    model.mjm.actuator_biasprm[:, 2] *= 5.0
    mujoco.mj_setConst(model.mjm, mujoco.MjData(model.mjm))
    s = state_of(model, 8)
    reach_poses(s, [mujocos(s, world) for world in range(8)])


def test_an_action_of_osc_pose_has_the_scale_rate_and_gripper_of_robosuite():
    """0.05 m and 0.5 rad from the present pose; 26% of it in a step of 0.05 s; 1 closes the hand in 0.4 s."""
    s = state_of({"robot": {"asset": "panda", "yaw": 40}})
    arm, datas = ArmController(s), [mujocos(s), mujocos(s)]
    action = tensor([[0.3, -0.4, 0.2, 0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.2, 0.1, -0.3, -1.0]])
    poses, grips = [arm.tool(s)], []
    for _ in range(25):
        before = arm.tool(s)
        arm.move_osc_pose(s, action)
        shift, turn = 0.05 * action[:, :3], Rotation.from_rotvec(0.5 * action[:, 3:6].double().numpy())
        torch.testing.assert_close(arm.pose_target[:, :3], before[:, :3] + shift, rtol=0, atol=1e-6)
        expected = (turn * turned(before)).as_matrix()
        np.testing.assert_allclose(turned(arm.pose_target).as_matrix(), expected, atol=1e-6)
        step(s, datas)
        poses.append(arm.tool(s))
        grips.append(s.ctrl[:, s.actuator("panda/gripper")].clone())
    # 6.1 per second of the way, at a constant speed
    speed = 6.1 * 0.02 * torch.cat([0.05 * action[:, :3], 0.5 * action[:, 3:6]], dim=1)
    moved = np.hstack([poses[25][:, :3] - poses[15][:, :3], (turned(poses[25]) * turned(poses[15]).inv()).as_rotvec()])
    np.testing.assert_allclose(moved, 10.0 * speed, atol=0.1 * float(10.0 * speed.norm(dim=1).max()))
    closing = torch.stack(grips)[:, 0]
    torch.testing.assert_close(closing, (0.04 - 0.002 * torch.arange(1, 26)).clamp(min=0.0))
    assert (torch.stack(grips)[:, 1] == grips[0][1]).all()
    arm.move_osc_pose(s, torch.zeros(2, 7))
    torch.testing.assert_close(s.ctrl[:, s.actuator("panda/gripper")], grips[-1])
    with pytest.raises(
        ArgumentError, match=r"robot: move_osc_pose: action should have shape \(num_envs, 6\) or .*, 7\)"
    ):
        arm.move_osc_pose(s, torch.zeros(2, 4))
    with pytest.raises(ArgumentError, match="robot: move_tool: frame should be 'base', or 'tool'"):
        arm.move_tool(s, torch.zeros(2, 6), frame=cast(Any, "world"))


SMALL = {"model": str(Path(__file__).parents[1] / "data" / "small_arm.xml")}


def test_an_arm_whose_actuators_are_not_called_joint_is_found():
    """It was refused with "unknown arm 'panda'. Valid: arm.", and so was the name that this offered."""
    s = state_of(SMALL | {"robot": {"in_model": "arm", "tcp": "arm/tcp"}})
    assert ArmController(s).name == ArmController(s, "arm").name == "arm"
    with pytest.raises(UnknownNameError, match=r"^scene 'scene': ArmController: unknown robot 'panda'. Valid: arm.$"):
        ArmController(s, "panda")


def test_a_root_body_of_another_name_than_the_actuators_begin_with_is_no_matter(tmp_path):
    """Joints were looked for in a body `arm`, and missed: "unknown joint 'arm'. Valid: base, ..."."""
    path = tmp_path / "arm.xml"
    text = mjcf({"base": ("mimic", "0 0 0", 0.0)}).replace("base:", "arm/")
    for i, name in enumerate(("alpha", "beta", "gamma", "delta")):
        text = text.replace(f"arm/{name}", f"arm/joint{i + 1}")
    path.write_text(text.replace("arm/only", "arm/gripper").replace("arm/point", "arm/tcp"))
    s = state_of({"model": str(path), "robot": {"in_model": "base", "tcp": "arm/tcp"}})
    arm = ArmController(s, "base")
    assert (arm.qpos(s).shape, arm.qvel(s).shape, arm.width(s).shape) == ((2, 4), (2, 4), (2,))
