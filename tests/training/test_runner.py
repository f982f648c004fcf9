"""The runner of rsl-rl: what actor and critic see, and that it prints nothing."""

from __future__ import annotations

import pytest
import torch

pytest.importorskip("rsl_rl")

from sceniris_gym.training.runner import POINTS, Keypoints, SpatialSoftmax, _imitation, _ppo
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


def test_a_point_is_where_a_channel_is_active():
    """A sharp peak is at its pixel, -1 to 1 from the first to the last; an even channel is in the middle."""
    maps = torch.zeros(1, 3, 5, 9)
    maps[0, 0, 4, 2] = maps[0, 1, 0, 8] = 50.0
    y, x = SpatialSoftmax()(maps).reshape(2, 3)
    torch.testing.assert_close(y, torch.tensor([1.0, -1.0, 0.0]))
    torch.testing.assert_close(x, torch.tensor([-0.5, 1.0, 0.0]))


@pytest.mark.parametrize("size", [(64, 64), (84, 60), (9, 7)])
def test_pictures_of_any_size_give_as_many_points(size: tuple[int, int]):
    """As rsl-rl's CNNModel asks of an encoder."""
    net = Keypoints(4)
    assert net(torch.rand(2, 4, *size)).shape == (2, net.output_dim) == (2, 2 * POINTS)
