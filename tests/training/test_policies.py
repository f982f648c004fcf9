"""Policies by name: a checkpoint of rsl-rl, a model of Stable-Baselines3, a function; and what is none of them."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
import torch

from sceniris_gym.errors import ArgumentError, MissingExtraError
from sceniris_gym.training.policies import policy_of


def zeros(observation: dict[str, torch.Tensor]) -> torch.Tensor:
    """Take no action."""
    return torch.zeros(len(observation["policy"]), 2)


def test_a_checkpoint_of_rsl_rl_acts_as_its_own_model_does(tmp_path: Path):
    """With and without normalisation of observations; for other observations it is refused."""
    models = pytest.importorskip("rsl_rl.models", reason="needs the extra 'rsl-rl'")
    tensordict = pytest.importorskip("tensordict", reason="needs the extra 'rsl-rl'")
    observation = {"policy": torch.randn(3, 6)}
    seen = tensordict.TensorDict(observation, batch_size=[3])
    for normalized in (False, True):
        spread = {"class_name": "GaussianDistribution", "init_std": 1.0}
        model = models.MLPModel(seen, {"actor": ["policy"]}, "actor", 2, (16, 8), "elu", normalized, spread)
        if normalized:
            model.obs_normalizer.update(5.0 + 3.0 * torch.randn(100, 6))
        model.eval()
        path = tmp_path / f"model_{normalized}.pt"
        torch.save({"actor_state_dict": model.state_dict()}, path)
        policy = policy_of(str(path))
        assert policy(observation) == pytest.approx(model(seen).detach(), abs=1e-6)
        with pytest.raises(ArgumentError, match="takes 6 observations, but this task has 5"):
            policy({"policy": torch.zeros(1, 5)})


def test_a_model_of_stable_baselines_acts_as_it_does(tmp_path: Path):
    """Whatever the algorithm, without exploration."""
    library = pytest.importorskip("stable_baselines3", reason="needs the extra 'sb3'")
    model = library.PPO("MlpPolicy", "Pendulum-v1", n_steps=8, batch_size=8, device="cpu")
    model.save(tmp_path / "model.zip")
    observation = torch.randn(4, 3)
    actions = policy_of(str(tmp_path / "model.zip"), trust=True)({"policy": observation})
    assert actions == pytest.approx(model.predict(observation.numpy(), deterministic=True)[0])


def test_a_model_sees_observations_as_in_its_training(tmp_path: Path, capsys: pytest.CaptureFixture):
    """Statistics of VecNormalize that lie beside it, as examples/05 leaves them, are taken, and said."""
    library = pytest.importorskip("stable_baselines3", reason="needs the extra 'sb3'")
    vec_env = importlib.import_module("stable_baselines3.common.vec_env")
    envs = vec_env.VecNormalize(vec_env.DummyVecEnv([lambda: gym.make("Pendulum-v1")]))
    model = library.PPO("MlpPolicy", envs, n_steps=8, batch_size=8, device="cpu")
    envs.obs_rms.update(5.0 + 3.0 * torch.randn(100, 3).numpy())
    model.save(tmp_path / "model.zip")
    envs.save(str(tmp_path / "normalize.pkl"))
    observation = 5.0 + torch.randn(4, 3)
    actions = policy_of(str(tmp_path / "model.zip"), trust=True)({"policy": observation})
    expected = model.predict(envs.normalize_obs(observation.numpy()), deterministic=True)[0]
    assert actions == pytest.approx(expected)
    assert actions != pytest.approx(model.predict(observation.numpy(), deterministic=True)[0])
    assert "normalize.pkl" in capsys.readouterr().err
    (tmp_path / "normalize.pkl").write_bytes(b"nothing")
    with pytest.raises(ArgumentError, match=r"normalize.pkl: should be a saved VecNormalize"):
        policy_of(str(tmp_path / "model.zip"), trust=True)


def test_exported_networks_act_as_they_do(tmp_path: Path):
    """As TorchScript and ONNX; what is neither is refused, and a missing library is named."""
    observation = torch.randn(3, 6)
    network = torch.nn.Sequential(torch.nn.Linear(6, 8), torch.nn.Tanh(), torch.nn.Linear(8, 2))
    script: Any = torch.jit.trace(network, observation)
    script.save(str(tmp_path / "net.pt"))
    expected = network(observation).detach()
    with torch.no_grad():
        assert policy_of(str(tmp_path / "net.pt"))({"policy": observation}) == pytest.approx(expected, abs=1e-6)
    (tmp_path / "net.onnx").touch()
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "onnxruntime", None)
        with pytest.raises(MissingExtraError, match=r"onnxruntime .*\[onnx\]"):
            policy_of(str(tmp_path / "net.onnx"))
    pytest.importorskip("onnxruntime", reason="needs the extra 'onnx'")
    with pytest.raises(ArgumentError, match=r"net\.onnx: should be an ONNX model"):
        policy_of(str(tmp_path / "net.onnx"))
    batch = {"dynamic_shapes": ({0: torch.export.Dim("n")},)}
    torch.onnx.export(network, (observation,), str(tmp_path / "net.onnx"), dynamo=True, verbose=False, **batch)
    assert policy_of(str(tmp_path / "net.onnx"))({"policy": observation}) == pytest.approx(expected.numpy(), abs=1e-5)


def test_a_row_does_not_depend_on_the_number_of_rows(tmp_path: Path):
    """Bit for bit: networks see full blocks."""
    network = torch.nn.Sequential(torch.nn.Linear(47, 256), torch.nn.ELU(), torch.nn.Linear(256, 5))
    script: Any = torch.jit.trace(network, torch.zeros(1, 47))
    script.save(str(tmp_path / "net.pt"))
    policy, seen = policy_of(str(tmp_path / "net.pt")), torch.randn(200, 47)
    with torch.no_grad():
        whole = policy({"policy": seen})
        for n in (1, 7, 64, 100):
            assert torch.equal(policy({"policy": seen[:n]}), whole[:n])


def test_a_run_is_the_folder_of_its_checkpoint(tmp_path: Path):
    """A missing checkpoint is named."""
    with pytest.raises(ArgumentError, match=r"model\.pt: there is no such file"):
        policy_of(str(tmp_path))


def test_a_function_is_a_policy():
    """By the name of its module."""
    policy = policy_of("tests.training.test_policies:zeros")
    assert policy({"policy": torch.ones(3, 4)}).shape == (3, 2)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("none.pt", "there is no such file"),
        ("nothing", "should be the folder of a run"),
        ("tests.training.test_policies:no", "cannot be imported"),
        ("no.such.module:f", "cannot be imported"),
        ("tests.training.test_policies:__name__", "should be a function"),
    ],
)
def test_what_is_no_policy_is_refused(name: str, words: str):
    """And it is said what would be one."""
    with pytest.raises(ArgumentError, match=words):
        policy_of(name)


def test_files_of_something_else_are_refused(tmp_path: Path):
    """Neither checkpoints nor models, though they are called so."""
    pytest.importorskip("rsl_rl", reason="needs the extra 'rsl-rl'")
    pytest.importorskip("stable_baselines3", reason="needs the extra 'sb3'")
    (tmp_path / "a.pt").write_bytes(b"none")
    (tmp_path / "a.zip").write_bytes(b"none")
    os.mkfifo(tmp_path / "pipe.pt")
    torch.save({"actor_state_dict": {"cnn.weight": torch.zeros(1)}}, tmp_path / "cnn.pt")
    for name, words in (
        ("a.pt", "a.pt: is damaged or has no weights"),
        ("a.zip", "Stable-Baselines3"),
        ("cnn.pt", "MLPModel"),
        ("pipe.pt", "a pipe or a device"),
    ):
        with pytest.raises(ArgumentError, match=words):
            policy_of(str(tmp_path / name), trust=True)


def test_a_pickle_is_not_read_unless_it_is_trusted(tmp_path: Path):
    """A model of Stable-Baselines3 is refused before it is opened, with the way out."""
    (tmp_path / "model.zip").touch()
    with pytest.raises(ArgumentError, match=r"model\.zip: .*executes its code.*--trust"):
        policy_of(str(tmp_path / "model.zip"))


def test_a_checkpoint_with_other_parts_is_refused(tmp_path: Path):
    """Lists, weights of other shapes, and keys that are no names."""
    pytest.importorskip("rsl_rl", reason="needs the extra 'rsl-rl'")
    for i, actor in enumerate(([1], {"mlp.0.weight": torch.zeros(3)}, {5: 5}, {"mlp.9.weight": torch.zeros(2, 3)})):
        torch.save({"actor_state_dict": actor}, tmp_path / f"{i}.pt")
        with pytest.raises(ArgumentError, match=rf"{i}\.pt: should be a file of"):
            policy_of(str(tmp_path / f"{i}.pt"))


def test_a_function_of_a_file_beside_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Also where a program was started that does not look there by itself."""
    (tmp_path / "policy_beside.py").write_text("def act(observation):\n    return observation['policy']\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path not in ("", str(tmp_path))])
    observation = {"policy": torch.ones(2, 3)}
    assert policy_of("policy_beside:act")(observation) is observation["policy"]
