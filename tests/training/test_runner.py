"""The runner of rsl-rl: what actor and critic see, and that it prints nothing."""

from __future__ import annotations

import pytest

pytest.importorskip("rsl_rl")

from sceniris_gym.training.keypoints import Keypoints
from sceniris_gym.training.runner import _imitation, _ppo
from sceniris_gym.training.settings import Settings


@pytest.mark.parametrize(
    ("groups", "sees"),
    [
        (["policy", "critic"], ("policy", "critic")),
        (["critic", "policy"], ("policy", "critic")),
        (["policy"], ("policy", "policy")),
        (["critic"], ("critic", "critic")),
        (["state"], ("state", "state")),
    ],
)
def test_a_group_alone_is_for_actor_and_critic(groups: list[str], sees: tuple[str, str]):
    """Otherwise each sees its own."""
    assert _ppo(Settings(), groups, {})["obs_groups"] == {"actor": [sees[0]], "critic": [sees[1]]}


def test_images_are_for_the_actor():
    """By an encoder for each camera, beside its numbers; the critic, or the teacher that it imitates, sees none."""
    sight = {"front": Keypoints(4), "wrist": Keypoints(3)}
    made = _ppo(Settings(), ["policy", "critic"], sight)
    assert made["obs_groups"] == {"actor": ["policy", "front", "wrist"], "critic": ["critic"]}
    assert made["actor"]["cnns"] is sight
    assert (made["actor"]["class_name"], made["critic"]["class_name"]) == ("CNNModel", "MLPModel")
    made = _imitation(Settings(), ["policy", "critic"], sight)
    assert made["obs_groups"] == {"student": ["policy", "front", "wrist"], "teacher": ["critic"]}
    assert (made["student"]["class_name"], made["teacher"]["class_name"]) == ("CNNModel", "MLPModel")
