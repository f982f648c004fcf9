"""Stable-Baselines3 on our environments: the same as its own vector environment of single worlds, and training."""

from __future__ import annotations

import importlib
import math
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, MissingExtraError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.single_env import SceneEnv
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach, make_env, reach_scene

__all__ = ["make_env", "reach_scene"]

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize, VecVideoRecorder

from sceniris_gym.adapters.sb3 import Sb3VecEnvWrapper

MAX_STEPS = 5


class PolicyGroup(gymnasium.ObservationWrapper):
    """One world that shows the policy's group alone."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        self.observation_space = env.observation_space["policy"]  # pyrefly: ignore[bad-index]

    def observation(self, observation: Any) -> np.ndarray:
        """Return the policy's group."""
        return observation["policy"]


@pytest.fixture
def make(make_env: Callable) -> Callable[..., Sb3VecEnvWrapper]:
    """Return a function that makes adapted environments of the small reaching task."""

    def made(num_envs: int = 3, **kwargs: Any) -> Sb3VecEnvWrapper:
        return Sb3VecEnvWrapper(make_env(num_envs, **{"max_episode_steps": MAX_STEPS, **kwargs}))

    return made


def test_it_steps_as_stable_baselines_own_vector_environment(make, reach_scene: CompiledScene):
    """Observations, rewards, dones and the infos of finished worlds are those of DummyVecEnv around single worlds."""
    ours = make()
    one = [lambda: Monitor(PolicyGroup(SceneEnv(Reach, scene=reach_scene, max_episode_steps=MAX_STEPS)))] * 3
    own = DummyVecEnv(one)  # pyrefly: ignore[bad-argument-type]
    assert ours.observation_space == own.observation_space
    assert ours.action_space == own.action_space
    for envs in (ours, own):
        assert envs.seed(20) == [20, 21, 22]
    np.testing.assert_allclose(ours.reset(), np.asarray(own.reset()), atol=1e-6)
    rng = np.random.default_rng(0)
    ends = []
    for _ in range(14):
        action = rng.uniform(-1.0, 1.0, (3, 5)).astype(np.float32)
        observation, reward, done, infos = ours.step(action)
        other, other_reward, other_done, other_infos = own.step(action)
        assert (observation.dtype, reward.dtype, done.dtype) == (np.float32, np.float32, np.bool_)
        np.testing.assert_allclose(np.asarray(observation), np.asarray(other), atol=1e-6)
        np.testing.assert_allclose(reward, other_reward, atol=1e-6)
        np.testing.assert_array_equal(done, other_done)
        for i, (info, expected) in enumerate(zip(infos, other_infos, strict=True)):
            if not done[i]:
                assert info == {}
                continue
            np.testing.assert_allclose(info["terminal_observation"], expected["terminal_observation"], atol=1e-6)
            assert info["TimeLimit.truncated"] is bool(expected["TimeLimit.truncated"])
            assert info["is_success"] is bool(expected["success"])
            assert info["episode"]["r"] == pytest.approx(expected["episode"]["r"], abs=1e-5)
            assert info["episode"]["l"] == expected["episode"]["l"]
            assert info["episode"]["t"] > 0.0
            named = {name: value for name, value in expected.items() if name.startswith("layout_")}
            assert {name: info.get(name) for name in named} == named
            for name, value in ours.reset_infos[i].items():
                assert value == own.reset_infos[i][name]
            ends.append(info["TimeLimit.truncated"])
    assert set(ends) == {True, False}


def test_an_environment_with_a_plain_observation_is_taken_too(make):
    """Steps and last observations are those of an environment with a dict of groups."""
    plain, other = make(observation_groups="policy"), make()
    assert plain.observation_space == other.observation_space
    plain.seed(0)
    other.seed(0)
    np.testing.assert_array_equal(plain.reset(), other.reset())
    for _ in range(MAX_STEPS):
        (seen, _, _, infos), (wanted, _, _, others) = (envs.step(np.ones((3, 5))) for envs in (plain, other))
        np.testing.assert_array_equal(seen, wanted)
    # pyrefly: ignore[unbound-name]
    np.testing.assert_array_equal(*(each[0]["terminal_observation"] for each in (infos, others)))


def test_infos_of_unfinished_worlds_are_dicts_of_their_own(make):
    """An entry that a wrapper writes into the info of one world does not appear in another."""
    envs = make()
    envs.reset()
    infos = envs.step(np.zeros((3, 5), np.float32))[3]
    infos[0]["mine"] = 1
    assert infos[1:] == [{}, {}]


def test_what_is_returned_is_never_overwritten(make):
    """Stable-Baselines3 keeps observations until after the next step."""
    envs = make()
    kept = [envs.reset(), envs.step(np.zeros((3, 5)))[0]]
    copies = [array.copy() for array in kept]
    for _ in range(MAX_STEPS + 1):
        envs.step(np.full((3, 5), 0.5))
    for array, copied in zip(kept, copies, strict=True):
        np.testing.assert_array_equal(array, copied)


def test_seeds_hold_for_one_reset_and_without_them_episodes_go_on(make):
    """The worlds say which layout they are in."""
    envs = make()
    envs.seed(7)
    first = envs.reset()
    assert envs.reset_infos[2] == {"layout": {"seed": 9, "episode": 0, "fallback": False}}
    assert (envs.reset() != first).any()
    assert [info["layout"]["episode"] for info in envs.reset_infos] == [1, 1, 1]
    envs.seed(7)
    np.testing.assert_array_equal(envs.reset(), first)
    assert len(set(envs.seed())) == 3


def test_options_are_those_of_the_environment(make):
    """A mask resets some worlds and their returns, once; single worlds have no options of their own."""
    envs = make()
    envs.seed(0)
    envs.reset()
    for _ in range(2):
        before, *_ = envs.step(np.full((3, 5), 0.2))
    envs.set_options({"reset_mask": np.array([False, True, False])})
    after = envs.reset()
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    assert (after[1] != before[1]).any()
    assert [info["layout"]["episode"] for info in envs.reset_infos] == [0, 1, 0]
    for _ in range(3):
        done, infos = envs.step(np.full((3, 5), 0.2))[2:]
    assert done.tolist() == [True, False, True]
    assert infos[0]["episode"]["l"] == MAX_STEPS
    for _ in range(2):
        done, infos = envs.step(np.full((3, 5), 0.2))[2:]
    assert done.tolist() == [False, True, False]
    assert infos[1]["episode"]["l"] == MAX_STEPS
    envs.reset()
    assert [info["layout"]["episode"] for info in envs.reset_infos] == [2, 3, 2]
    envs.set_options([{}, {}, {}])
    with pytest.raises(ValueError, match="'set_param' has an argument `worlds`"):
        envs.env_method("set_param", "objects.apple.region", 0, indices=[2])
    with pytest.raises(ValueError, match="all worlds together"):
        envs.set_options([{"reset_mask": np.array([True, False, False])}, {}, {}])
    envs.set_options({"mask": 1})
    with pytest.raises(UnknownNameError, match="reset_mask"):
        envs.reset()


def test_attributes_and_methods_are_those_of_the_environment_and_its_task(make):
    """One answer for each index; a task's are found too, unknown ones are not."""
    envs = make()
    assert envs.get_attr("max_episode_steps") == [MAX_STEPS] * 3
    assert envs.get_attr("substeps", indices=1) == [2]
    assert envs.has_attr("drawn")
    assert not envs.has_attr("nothing")
    envs.set_attr("max_episode_steps", 2)
    envs.reset()
    envs.step(np.zeros((3, 5)))
    assert envs.step(np.zeros((3, 5)))[2].all()
    (found,) = envs.env_method("success", envs.env.state, indices=[2])
    assert found.shape == (3,)
    with pytest.raises(ValueError, match="one value for all worlds"):
        envs.set_attr("max_episode_steps", 9, indices=[0])
    with pytest.raises(AttributeError, match="SceneVectorEnv and Reach have no attribute 'nothing'"):
        envs.set_attr("nothing", 1)
    with pytest.raises(UnknownNameError, match="unknown attribute 'reset'"):
        envs.set_attr("reset", None)
    assert envs.env_is_wrapped(Monitor) == [True] * 3
    assert envs.env_is_wrapped(gymnasium.wrappers.TimeLimit, indices=0) == [False]


@pytest.mark.parametrize("indices", [3, -4, [0, 3], [-4]], ids=str)
def test_indices_are_those_of_a_list_as_in_stable_baselines_own(make, reach_scene: CompiledScene, indices: Any):
    """Negative ones count from the end, and those beyond either end are refused before anything is done."""
    ours = make()
    own = DummyVecEnv([lambda: PolicyGroup(SceneEnv(Reach, scene=reach_scene))] * 3)
    for envs in (ours, own):
        assert len(envs.get_attr("num_envs" if envs is ours else "spec", indices=[-1, -3, 2])) == 3
        for call in (
            lambda envs=envs: envs.get_attr("render_mode", indices=indices),
            lambda envs=envs: envs.set_attr("render_mode", None, indices=indices),
            lambda envs=envs: envs.env_method("close", indices=indices),
            lambda envs=envs: envs.env_is_wrapped(Monitor, indices=indices),
        ):
            with pytest.raises(IndexError):
                call()
    ours.reset()


def test_an_attribute_is_set_for_every_world_or_for_none(make):
    """One world named three times is not all of them; all of them in any order are."""
    envs = make()
    with pytest.raises(ValueError, match="one value for all worlds"):
        envs.set_attr("max_episode_steps", 9, indices=[0, 0, 0])
    envs.set_attr("max_episode_steps", 9, indices=[2, 0, -2])
    assert envs.get_attr("max_episode_steps") == [9] * 3


def test_a_param_is_set_in_single_worlds(make):
    """Their next layouts follow, and infos of finished episodes come as before."""
    name = "objects.cabinet.joints.slide"
    envs = make(params=[name])
    envs.reset()
    envs.set_attr(name, [0.05, 0.06], indices=[0, 2])
    for _ in range(MAX_STEPS):
        *_, dones, _ = envs.step(np.zeros((3, 5)))
    assert dones.all()  # pyrefly: ignore[unbound-name]
    assert envs.reset_infos[2]["layout"]["params"][name] == pytest.approx([0.05, 0.06])
    low, high = envs.env.randomizer.layouts.param.cpu().numpy().T
    assert high.tolist() == pytest.approx([0.06, 0.16, 0.06])
    slide = envs.env.randomizer.layouts.joint("slide").numpy()
    assert ((slide >= low) & (slide <= high)).all()


def test_pictures_are_tiled_and_recorded(make, tmp_path: Path):
    """One of each world; none, with a warning, without a render mode."""
    envs = make(4, render_mode="rgb_array", render_config={"size": (32, 24)})
    envs.reset()
    images = envs.get_images()
    assert [image.shape for image in images] == [(24, 32, 3)] * 4
    picture = envs.render()
    assert picture is not None
    assert picture.shape == (48, 64, 3)
    pytest.importorskip("moviepy")
    recorder = VecVideoRecorder(envs, str(tmp_path), record_video_trigger=lambda step: step == 0, video_length=3)
    recorder.reset()
    for _ in range(4):
        recorder.step(np.zeros((4, 5)))
    recorder.close()
    assert len(list(tmp_path.glob("*.mp4"))) == 1
    with pytest.warns(UserWarning, match="rgb_array"):
        assert make(2).get_images() == [None, None]


def test_wrong_environments_are_refused(make_env, reach_scene: CompiledScene):
    """Other autoreset, output, buffers and groups say what would be right."""
    for wrong in ({"autoreset_mode": "NextStep"}, {"output": "numpy"}, {"sim_config": {"copy": False}}):
        with pytest.raises(ValueError, match="autoreset_mode='SameStep', output='torch' and SimConfig"):
            Sb3VecEnvWrapper(make_env(1, **wrong))
    with pytest.raises(UnknownNameError, match=r"unknown observation group 'actor'.*critic, policy"):
        Sb3VecEnvWrapper(make_env(1), group="actor")
    with pytest.raises(TypeError, match="of make_vec"):
        Sb3VecEnvWrapper(SceneEnv(Reach, scene=reach_scene))  # pyrefly: ignore[bad-argument-type]


def test_the_library_that_is_missing_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch):
    """Importing the adapter says what to install; the rest of the package does without."""
    for name in [name for name in sys.modules if name.split(".")[0] == "stable_baselines3"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "sceniris_gym.adapters.sb3")
    with pytest.raises(MissingExtraError, match=r"in the clone, pip install -e '\.\[sb3\]'") as caught:
        importlib.import_module("sceniris_gym.adapters.sb3")
    assert isinstance(caught.value, ImportError)


def test_the_last_observation_of_a_broken_world_is_of_numbers(make):
    """It is terminated, and its zeros cannot spoil a replay buffer."""
    envs = make(2)
    envs.reset()
    qvel = envs.env.batch.data.qvel.numpy()
    qvel[0] = math.nan
    envs.env.batch.data.qvel.assign(qvel)
    observation, reward, done, infos = envs.step(np.zeros((2, 5)))
    assert done.tolist() == [True, False]
    assert not infos[0]["TimeLimit.truncated"]
    assert np.isfinite(infos[0]["terminal_observation"]).all()
    assert np.isfinite(observation).all()
    assert np.isfinite(reward).all()


@pytest.mark.parametrize("steps", [1, 100], ids=["all finish", "none finishes"])
def test_the_bytes_that_are_copied_grow_with_the_number_of_worlds_alone(make, monkeypatch, steps: int):
    """Twice the worlds is twice the bytes, whether all of them finish in the step or none does."""
    copied = []
    cpu = torch.Tensor.cpu

    def counted(tensor: torch.Tensor, *args: Any, **kwargs: Any) -> torch.Tensor:
        copied.append(tensor.numel() * tensor.element_size())
        return cpu(tensor, *args, **kwargs)

    per_world = []
    for num_envs in (4, 8, 16):
        envs = make(num_envs, max_episode_steps=steps)
        envs.reset()
        monkeypatch.setattr(torch.Tensor, "cpu", counted)
        copied.clear()
        done = envs.step(np.zeros((num_envs, 5)))[2]
        monkeypatch.setattr(torch.Tensor, "cpu", cpu)
        assert done.all() == done.any() == (steps == 1)
        per_world.append(sum(copied) / num_envs)
    observation = 4 * envs.observation_space.shape[0]
    layout = 8 + 4 + 1  # of the episode that ended, and of the one that begins
    finished = observation + 2 + 2 * layout if steps == 1 else 0
    assert per_world == [observation + 4 + 2 + finished] * 3


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", [PPO, SAC])
def test_algorithms_train_save_and_are_evaluated(make, tmp_path: Path, algorithm: type):
    """Normalised and monitored, without a warning; statistics of episodes arrive in the logger's buffers."""
    sizes = {PPO: {"n_steps": 8, "batch_size": 32}, SAC: {"learning_starts": 16, "batch_size": 32}}[algorithm]
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        envs = VecNormalize(make(4), norm_obs=True, norm_reward=True)
        model = algorithm("MlpPolicy", envs, seed=3, device="cpu", **sizes)
        model.learn(96)
        assert len(model.ep_info_buffer) > 8
        assert {info["l"] for info in model.ep_info_buffer} <= set(range(1, MAX_STEPS + 1))
        assert len(model.ep_success_buffer) == len(model.ep_info_buffer)
        envs.training = envs.norm_reward = False
        found = np.array(evaluate_policy(model, envs, n_eval_episodes=6, return_episode_rewards=True))
        assert found.shape == (2, 6)
        assert (found[0] < 0.0).all()
        assert (found[1] <= MAX_STEPS).all()
    model.save(tmp_path / "model.zip")
    again = algorithm.load(tmp_path / "model.zip", env=envs, device="cpu")
    observation = envs.reset()
    expected, _ = model.predict(observation, deterministic=True)
    np.testing.assert_array_equal(again.predict(observation, deterministic=True)[0], expected)
    for one, other in zip(model.policy.parameters(), again.policy.parameters(), strict=True):
        assert torch.equal(one, other)
        assert torch.isfinite(one).all()


def test_a_monitor_around_it_counts_the_same(make):
    """VecMonitor says that the worlds have their own episodes already, and agrees with them."""
    inner = make()
    with pytest.warns(UserWarning, match="already wrapped"):
        outer = VecMonitor(inner)
    outer.reset()
    for _ in range(2 * MAX_STEPS):
        done, infos = outer.step(np.zeros((3, 5)))[2:]
        mine = inner.env.statistics.read()
        if done.any():
            assert mine["return"] == pytest.approx(np.mean([i["episode"]["r"] for i in infos if i]), rel=1e-5)


@pytest.fixture
def one_thread() -> Iterator[None]:
    """Keep torch to one thread: small networks gain nothing from more, and wait for each other on a busy machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.slow
def test_ppo_gets_better_at_reaching_on_a_cpu(one_thread):
    """Half a minute of PPO on 64 worlds of TabletopReachEasy-v0: the return rises on layouts of the other split."""

    def made(split: str) -> Sb3VecEnvWrapper:
        arguments = {"num_envs": 64, "device": "cpu", "max_episode_steps": 50, "split": split}
        return Sb3VecEnvWrapper(gymnasium.make_vec("sceniris_gym:sceniris_gym/TabletopReachEasy-v0", **arguments))

    envs, judged = VecNormalize(made("train"), gamma=0.9), made("eval")
    # noise that depends on the state and stays for ten steps gets an arm somewhere, fresh noise in each step does not
    exploring = {"use_sde": True, "sde_sample_freq": 10, "policy_kwargs": {"log_std_init": -1.0}}
    sizes = {"n_steps": 10, "batch_size": 320, "gamma": 0.9, "learning_rate": 2e-3}
    model = PPO("MlpPolicy", envs, seed=0, device="cpu", **sizes, **exploring)

    def returns() -> np.ndarray:
        normalized = VecNormalize(judged, training=False, norm_reward=False)
        normalized.obs_rms = envs.obs_rms
        judged.seed(0)
        return np.array(evaluate_policy(model, normalized, n_eval_episodes=64, return_episode_rewards=True)[0])

    before = returns()
    model.learn(64 * 300)
    gained = returns() - before
    assert gained.mean() > 0.2 * before.mean()
    assert gained.mean() > 3.0 * gained.std() / 8.0, "not by chance: three standard errors over 64 layouts"
    envs.close()
    judged.close()


@pytest.mark.cuda
def test_worlds_on_a_gpu_are_seen_in_numpy():
    """The border is crossed for observations, rewards, dones and infos; PPO steps on it."""
    compiled = compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cuda:0")
    envs = Sb3VecEnvWrapper(SceneVectorEnv(Reach, 4, scene=compiled, max_episode_steps=MAX_STEPS))
    envs.reset()
    envs.set_options({"reset_mask": torch.tensor([True, False, True, False], device="cuda")})
    assert isinstance(envs.reset(), np.ndarray)
    for _ in range(MAX_STEPS):
        observation, reward, done, infos = envs.step(np.zeros((4, 5)))
    assert all(isinstance(array, np.ndarray) for array in (observation, reward, done))  # pyrefly: ignore[unbound-name]
    assert done.tolist() == [True] * 4
    assert all(np.isfinite(info["terminal_observation"]).all() for info in infos)  # pyrefly: ignore[unbound-name]
    assert [info["layout"]["episode"] for info in envs.reset_infos] == [2, 1, 2, 1]
    PPO("MlpPolicy", envs, n_steps=8, batch_size=32, device="cpu").learn(64)


IMAGES = {"overview": {"size": (40, 36), "data": ("rgb", "depth")}}


def until_an_end(envs: Sb3VecEnvWrapper) -> tuple[Any, list[dict]]:
    """Return observations and infos of the step that ends the first episodes."""
    envs.reset()
    for _ in range(MAX_STEPS - 1):
        envs.step(np.zeros((2, 5), np.float32))
    observation, _, _, infos = envs.step(np.zeros((2, 5), np.float32))
    return observation, infos


def test_images_train_a_cnn_policy(make):
    """A picture alone: bytes with the channels last, which SB3 puts first; terminal observations have it as well."""
    envs = Sb3VecEnvWrapper(make(2, images={"cameras": IMAGES, "final": True}).env, "overview/rgb")
    assert envs.observation_space == gymnasium.spaces.Box(0, 255, (36, 40, 3), np.uint8)
    observation, infos = until_an_end(envs)
    assert (observation.shape, observation.dtype) == ((2, 36, 40, 3), np.uint8)
    assert infos[0]["terminal_observation"].shape == (36, 40, 3)
    model = PPO("CnnPolicy", envs, n_steps=6, batch_size=6, n_epochs=1, seed=0, device="cpu")
    assert model.observation_space.shape == (3, 36, 40)
    model.learn(12)


def test_images_and_numbers_train_a_policy_of_several_inputs(make):
    """As a dict, also in terminal observations; SB3 takes floats such as depths as they are."""
    envs = Sb3VecEnvWrapper(
        make(2, images={"cameras": IMAGES, "final": True}).env, ("policy", "overview/rgb", "overview/depth")
    )
    observation, infos = until_an_end(envs)
    assert {name: part.shape[1:] for name, part in observation.items()} == {
        name: part.shape for name, part in infos[1]["terminal_observation"].items()
    }
    assert envs.observation_space.contains(infos[1]["terminal_observation"])
    PPO("MultiInputPolicy", envs, n_steps=6, batch_size=6, n_epochs=1, seed=0, device="cpu").learn(12)


def test_pictures_need_those_of_the_last_state_too(make):
    """The error names the argument; a picture that is not taken is none of the names."""
    with pytest.raises(ArgumentError, match="final=True"):
        Sb3VecEnvWrapper(make(1, images=IMAGES).env, "overview/rgb")
    with pytest.raises(UnknownNameError, match=r"'overview/rbg'.*Did you mean 'overview/rgb'"):
        Sb3VecEnvWrapper(make(1, images={"cameras": IMAGES, "final": True}).env, "overview/rbg")
