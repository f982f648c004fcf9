"""The task of a problem file: instruction, observations, reward and end of an episode."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.vector.libero_task import LiberoGoalTask
from sceniris_gym.vector.single_env import SceneEnv
from sceniris_gym.vector.state import State
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.importers.libero.problems import STACK, write

pytestmark = pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")


class InBasket(LiberoGoalTask):
    """The bowl starts in the basket in the first world, and beside it in the others."""

    action_size = 1

    def apply(self, s: State, action: Tensor) -> None:
        """Do nothing."""

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Put the bowl into its place."""
        pose = torch.tensor([0.4, 0.0, 0.05, 1.0, 0.0, 0.0, 0.0]).repeat(s.num_envs, 1)
        pose[0, 0] = 0.21
        s.put_pose("akita_black_bowl_1", pose, mask)


@pytest.mark.parametrize("output", ["torch", "numpy"])
def test_the_file_gives_instruction_reward_success_and_end(output: str, tmp_path: Path):
    """In each world, and as the file says; what the goal names is observed."""
    libero = read_bddl(write(tmp_path, STACK.replace("lift", "Lift")))
    env = SceneVectorEnv(InBasket(libero.problem), 2, scene=libero.scene, device="cpu", output=output)
    obs, info = env.reset(seed=0)
    assert info["language"] == ["lift the bowl"] * 2
    assert len(obs["policy"][0]) == 14 and "basket_1" in str(env.observation_names)
    _, reward, terminated, _, info = env.step(torch.zeros(2, 1))
    env.close()
    assert info["language"] == ["lift the bowl"] * 2
    assert info["success"].tolist() == terminated.tolist() == [True, False]
    assert reward.tolist() == [1.0, 0.0]


def test_one_world_has_one_instruction(tmp_path: Path):
    """As text, not as a list."""
    libero = read_bddl(write(tmp_path, STACK))
    env = SceneEnv(InBasket(libero.problem), scene=libero.scene, device="cpu")
    assert env.reset(seed=0)[1]["language"] == "lift the bowl"
    env.close()
