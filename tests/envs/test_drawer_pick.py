"""DrawerPick-v0: made by name, reachable, observed in the robot's frame, and solved by a script."""

from __future__ import annotations

import importlib
import itertools
import pickle
import re
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

import sceniris_gym
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArmError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.arm_controller import TOOL_STEP, YAW_STEP
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.reaching import ScriptedArm, descent
from tests.envs.stated import values

ENV_ID = "sceniris_gym/DrawerPick-v0"
drawer_pick = importlib.import_module("sceniris_gym.envs.drawer_pick")
DrawerPick = drawer_pick.DrawerPick


@pytest.fixture(scope="session")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("drawer_pick", {"bank": 8}), "cpu")


def host_data(envs: SceneVectorEnv, world: int) -> mujoco.MjData:
    """Return plain MuJoCo's data for the state of one world."""
    d, data = envs.batch.data, mujoco.MjData(envs.compiled.mjm)
    data.qpos[:] = d.qpos.numpy()[world]
    data.mocap_pos[:], data.mocap_quat[:] = d.mocap_pos.numpy()[world], d.mocap_quat.numpy()[world]
    mujoco.mj_kinematics(envs.compiled.mjm, data)
    return data


def test_a_scene_without_the_arm_is_refused():
    """The error names the scene and what is missing in it, and is one of this package."""
    with pytest.raises(ArmError, match=r"scene 'mid': ArmController: the scene has no robot"):
        SceneVectorEnv(DrawerPick, 1, scene="mid", device="cpu")
    with pytest.raises(UnknownNameError, match=r"ArmController: unknown robot 'panda'. Valid: ur5e."):
        SceneVectorEnv(DrawerPick, 1, scene={"robot": {"asset": "ur5e"}, "bank": 1}, device="cpu")


def test_it_is_made_by_id_by_module_and_by_spec(compiled):
    """make_vec takes the id, the id with its module, and the spec of what was made, pickled in between."""
    assert sceniris_gym.__version__
    first = gymnasium.make_vec(ENV_ID, num_envs=2, scene=compiled)
    again = gymnasium.make_vec(
        f"sceniris_gym:{ENV_ID}", num_envs=2, scene=compiled, max_episode_steps=7, output="numpy"
    )
    assert isinstance(first, SceneVectorEnv)
    assert isinstance(again, SceneVectorEnv)
    assert (first.max_episode_steps, again.max_episode_steps) == (200, 7)
    plain = gymnasium.make_vec(ENV_ID, num_envs=2, device="cpu", autoreset_mode="NextStep")
    assert plain.spec is not None
    spec = pickle.loads(pickle.dumps(plain.spec))
    third = gymnasium.make_vec(spec)
    assert (third.num_envs, third.metadata["autoreset_mode"]) == (2, gymnasium.vector.AutoresetMode.NEXT_STEP)
    observations = [envs.reset(seed=1)[0] for envs in (first, again, third)]
    for group in ("policy", "critic"):
        np.testing.assert_array_equal(observations[0][group].numpy(), observations[1][group])
        np.testing.assert_array_equal(observations[0][group].numpy(), observations[2][group].numpy())


@pytest.mark.filterwarnings("ignore:.*A Box observation space")
def test_one_world_of_it_passes_gymnasiums_checker(compiled):
    """gymnasium.make gives a plain environment whose observations are those of world 0 of the batch."""
    env = gymnasium.make(ENV_ID, device="cpu", render_mode="rgb_array", render_config={"size": (32, 24)})
    check_env(env.unwrapped, skip_render_check=True)
    observation, info = env.reset(seed=5)
    batch, _ = SceneVectorEnv(DrawerPick, 3, scene=compiled).reset(seed=5)
    np.testing.assert_array_equal(observation["policy"], batch["policy"][0].numpy())
    assert (info["layout"]["seed"], info["layout"]["episode"]) == (5, 0)
    _, reward, terminated, truncated, _ = env.step(np.zeros(5, np.float32))
    assert isinstance(reward, float)
    assert (terminated, truncated) == (False, False)
    frame = env.render()
    assert isinstance(frame, np.ndarray)
    assert frame.shape == (24, 32, 3)
    env.close()
    env.close()


def test_the_scene_can_be_changed_by_overrides():
    """`overrides` replaces parts of the task's scene, here the drawer's opening."""
    envs = SceneVectorEnv(
        DrawerPick, 4, device="cpu", overrides={"objects.cabinet.joints": {"upper": {"value": 0.246}}}
    )
    envs.reset(seed=0)
    np.testing.assert_allclose(envs.state.qpos("cabinet/upper").numpy(), 0.246, atol=1e-6)


def test_the_docstring_lists_what_is_observed(compiled):
    """Names and sizes in the table of the class are those of the observation."""
    assert DrawerPick.__doc__ is not None
    table = re.findall(r"^\s+\| (\w+) \| (\d+) \|", DrawerPick.__doc__, flags=re.MULTILINE)
    envs = SceneVectorEnv(DrawerPick, 1, scene=compiled)
    names = envs.observation_names
    assert [(name, (int(size),)) for name, size in table] == names["policy"]
    assert names["critic"] == [
        *names["policy"],
        ("banana_velocity", (6,)),
        ("apple_pose", (7,)),
        ("touching", (2,)),
        ("held", (1,)),
        ("tcp_to_grasp", (3,)),
        ("turn_to_grasp", (2,)),
    ]
    sizes = {group: sum(shape[0] for _, shape in named) for group, named in names.items()}
    for group, size in sizes.items():
        assert re.search(rf"[Gg]roup `{group}`, {size} numbers", DrawerPick.__doc__)


def test_poses_are_in_the_robots_base_frame(compiled):
    """Tool and drawer as seen from the base, and the way to the banana, against plain MuJoCo."""
    envs = SceneVectorEnv(DrawerPick, 3, scene=compiled)
    observation, _ = envs.reset(seed=2)
    first = 0
    for name, shape in envs.observation_names["policy"]:
        told = observation["policy"][:, first : first + shape[0]].numpy()
        first += shape[0]
        for i in range(3):
            data = host_data(envs, i)
            base = data.body("panda").xmat.reshape(3, 3)
            where = {
                "tcp_pose": (data.site("panda/tcp").xpos, data.site("panda/tcp").xmat),
                "drawer_pose": (data.body("cabinet/upper_drawer").xpos, data.body("cabinet/upper_drawer").xmat),
            }
            if name in where:
                pos, matrix = where[name]
                seen = np.zeros(9)
                mujoco.mju_quat2Mat(seen, told[i, 3:].astype(float))
                np.testing.assert_allclose(told[i, :3], base.T @ (pos - data.body("panda").xpos), atol=1e-5)
                np.testing.assert_allclose(seen.reshape(3, 3), base.T @ matrix.reshape(3, 3), atol=1e-5)
            banana, tool = data.body("banana"), data.site("panda/tcp").xpos
            if name == "tcp_to_banana":
                np.testing.assert_allclose(told[i], base.T @ (banana.xpos - tool), atol=1e-5)
            if name == "banana_axes":
                axes = (base.T @ banana.xmat.reshape(3, 3))[:, [0, 2]]
                np.testing.assert_allclose(told[i], axes.T.ravel(), atol=1e-5)


def test_nothing_moves_until_the_agent_does(compiled):
    """With zero actions the tool stays where it is, and the banana only settles in the drawer."""
    envs = SceneVectorEnv(DrawerPick, 4, scene=compiled)
    envs.reset(seed=0)
    s = envs.state
    arm, tool, banana = s.qpos("panda")[:, :7].clone(), s.site("panda/tcp")[:, :3].clone(), s.pose("banana").clone()
    assert len(torch.unique(arm[:, 0])) == 4, "the start pose has noise"
    hold = torch.zeros(4, 5)
    hold[:, 4] = 1.0
    for _ in range(25):
        _, _, terminated, _, info = envs.step(hold)
    assert not terminated.any()
    assert not info["success"].any()
    torch.testing.assert_close(s.site("panda/tcp")[:, :3], tool, rtol=0, atol=5e-3)
    torch.testing.assert_close(s.pose("banana")[:, :3], banana[:, :3], rtol=0, atol=5e-3)


def test_the_banana_is_within_reach_from_above(compiled):
    """In nearly all layouts the open hand goes straight down to the banana and touches nothing else."""
    envs = SceneVectorEnv(DrawerPick, 30, scene=compiled)
    envs.reset(seed=300)
    arm = ScriptedArm.of(compiled.mjm)
    ways = [descent(arm, host_data(envs, i), "banana", "banana/grasp") for i in range(30)]
    assert sum(way is not None for way in ways) >= 28


def test_the_camera_sees_the_banana_over_the_face_of_the_drawer(compiled):
    """From `overview`, at least half of the rays to the banana's surface meet the banana first, whatever the layout."""
    envs = SceneVectorEnv(DrawerPick, 30, scene=compiled)
    envs.reset(seed=300)
    mjm = compiled.mjm
    (geom,) = [g for g in range(mjm.ngeom) if mjm.geom_bodyid[g] == mjm.body("banana").id and mjm.geom_group[g] == 2]
    start, count = mjm.mesh_vertadr[mjm.geom_dataid[geom]], mjm.mesh_vertnum[mjm.geom_dataid[geom]]
    corners = 0.95 * mjm.mesh_vert[start : start + count : 12].astype(float)  # within the surface
    seen, hit = [], np.zeros(1, dtype=np.int32)
    for i in range(30):
        data = host_data(envs, i)
        mujoco.mj_camlight(mjm, data)
        eye = data.camera("overview").xpos
        first = []
        for corner in data.geom(geom).xpos + corners @ data.geom(geom).xmat.reshape(3, 3).T:
            mujoco.mj_ray(mjm, data, eye, corner - eye, np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8), 1, -1, hit, None)
            first.append(hit[0] == geom)
        seen.append(np.mean(first))
    assert min(seen) > 0.5, np.round(seen, 2)


def scripted(envs: SceneVectorEnv, observation: dict, down: torch.Tensor, closed: torch.Tensor) -> torch.Tensor:
    """Return actions that go over the grasp, down to it, close (counted in `closed`) and go up; from observations."""
    grasp, lead = values(envs, observation, "tcp_to_grasp", "critic"), values(envs, observation, "tool_lead")
    cos, sin = values(envs, observation, "turn_to_grasp", "critic").unbind(dim=1)
    turn = 0.5 * torch.atan2(sin, cos)
    down |= (grasp[:, :2].norm(dim=1) < 0.01) & (turn.abs() < 0.08)
    closed += (closed > 0) | (down & (grasp.norm(dim=1) < 0.01))
    height = torch.where(down, grasp[:, 2].clamp(-0.03, 0.03), grasp[:, 2] + 0.15)
    task: Any = envs.task
    up = (0.62 - task.height(envs.state)).clamp(-0.01, 0.012)
    height = torch.where(closed > 0, torch.where(closed > 12, up, 0.0), height)
    held = closed[:, None] > 0
    way = torch.cat(
        [torch.where(held, 0.0, grasp[:, :2]), height[:, None], torch.where(held, 0.0, turn[:, None])], dim=1
    )
    limit, step = torch.tensor([0.04, 0.04, 0.04, 0.3]), torch.tensor([TOOL_STEP] * 3 + [YAW_STEP])
    moved = ((way.clamp(-limit, limit) - lead) / step).clamp(-1, 1)
    return torch.cat([moved, torch.where(held, -1.0, 1.0)], dim=1)


def test_a_script_lifts_the_banana_out(compiled):
    """Over it, down, close, up: success to the last step; the terms of the reward come one after the other."""
    envs = SceneVectorEnv(DrawerPick, 6, scene=compiled, autoreset_mode="Disabled")
    observation, _ = envs.reset(seed=0)
    task: Any = envs.task
    down, closed = torch.zeros(6, dtype=torch.bool), torch.zeros(6, dtype=torch.long)
    terms: dict[str, list[torch.Tensor]] = {"reaching": [], "grasping": [], "lifting": [], "out": []}
    rewards, successes, info = [], [], {}
    for _ in range(200):
        observation, reward, _, _, info = envs.step(scripted(envs, observation, down, closed))
        rewards.append(reward)
        successes.append(info["success"])
        for name, seen in terms.items():
            seen.append(info["reward_terms"][name] > 0.01)
    assert info["success"].sum() >= 5
    done = info["success"]
    assert (task.height(envs.state)[done] > drawer_pick.CLEAR_HEIGHT).all()
    assert (task.touching(envs.state)[done] == 1.0).all()
    first = {name: torch.stack(seen).int().argmax(dim=0)[done] for name, seen in terms.items()}
    order = [first[name] for name in ("reaching", "grasping", "lifting", "out")]
    assert all((a < b).all() for a, b in itertools.pairwise(order))
    fifths = torch.stack(rewards).reshape(5, 40, 6).sum(dim=1)[:, done]
    assert (fifths[1:] > fifths[:-1]).all()
    assert (torch.stack(successes).sum(dim=0)[done] < 100).all()


def test_a_banana_that_is_thrown_out_is_no_success(compiled):
    """It must be held by both fingers, and for half a second."""
    envs = SceneVectorEnv(DrawerPick, 2, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=1)
    qpos, address = envs.batch.data.qpos.numpy(), compiled.mjm.joint("banana/free").qposadr[0]
    qpos[:, address + 2] = 0.8
    envs.batch.data.qpos.assign(qpos)
    task: Any = envs.task
    task.held.copy_(torch.tensor([0.0, 25.0]))
    _, _, _, _, info = envs.step(torch.zeros(2, 5))
    assert (task.height(envs.state) > drawer_pick.CLEAR_HEIGHT).all()
    assert not info["success"].any()
    assert (info["reward_terms"]["out"] == 0.0).all()
    assert (task.held == 0.0).all()


def put_banana(envs: SceneVectorEnv, monkeypatch: pytest.MonkeyPatch, height: float, quat: list[float]) -> Any:
    """Put the banana's origin at a height [m], turned by `quat` (wxyz), and say that both fingers touch it."""
    task: Any = envs.task
    monkeypatch.setattr(task, "touching", lambda s: torch.ones(s.num_envs, 2))
    qpos, address = envs.batch.data.qpos.numpy(), envs.compiled.mjm.joint("banana/free").qposadr[0]
    qpos[:, address + 2 : address + 7] = [height, *quat]
    envs.batch.data.qpos.assign(qpos)
    envs.batch.update()
    return task


def test_a_banana_is_out_when_its_lowest_point_is(compiled, monkeypatch):
    """On end, its lowest point is more than 7 cm below its origin; lying, it is the origin."""
    envs = SceneVectorEnv(DrawerPick, 2, scene=compiled)
    envs.reset(seed=1)
    half = 0.5**0.5
    lying, on_end, upside_down = [1.0, 0.0, 0.0, 0.0], [half, 0.0, half, 0.0], [0.0, 1.0, 0.0, 0.0]
    for height, quat, out in ((0.56, lying, True), (0.6, on_end, False), (0.6, upside_down, True)):
        task = put_banana(envs, monkeypatch, height, quat)
        terms = task.reward(envs.state, torch.zeros(2, 5))
        assert (terms["out"] > 0).tolist() == [out, out]
        assert (task.held > 0).tolist() == [out, out]
        assert (terms["lifting"] > 0.0799).tolist() == [out, out]


def test_success_takes_half_a_second(compiled, monkeypatch):
    """From the first moment that it is out to the last are 0.5 s: 25 steps, 26 moments, in which `held` goes to 1."""
    envs = SceneVectorEnv(DrawerPick, 2, scene=compiled)
    envs.reset(seed=1)
    task = put_banana(envs, monkeypatch, 0.6, [1.0, 0.0, 0.0, 0.0])
    for steps in range(26):
        assert not task.success(envs.state).any()
        task.reward(envs.state, torch.zeros(2, 5))
        held = task.observe(envs.state)["critic"]["held"]
        torch.testing.assert_close(held, torch.full((2, 1), steps * envs.state.dt / 0.5))
    assert task.success(envs.state).all()
    assert (task.observe(envs.state)["critic"]["held"] == 1.0).all()
