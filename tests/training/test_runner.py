"""The runner of rsl-rl: what actor and critic see, and that it prints nothing."""

from __future__ import annotations

import pytest

pytest.importorskip("rsl_rl")

from sceniris_gym.training.runner import _config
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
    assert _config(Settings(), 0, groups, [])["obs_groups"] == {"actor": [sees[0]], "critic": [sees[1]]}


def test_images_are_for_the_actor():
    """By convolutions, beside its numbers; the critic sees none."""
    config = _config(Settings(), 0, ["policy", "critic"], ["front", "wrist"])
    assert config["obs_groups"] == {"actor": ["policy", "front", "wrist"], "critic": ["critic"]}
    assert (config["actor"]["class_name"], config["critic"]["class_name"]) == ("CNNModel", "MLPModel")
