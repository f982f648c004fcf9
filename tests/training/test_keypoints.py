"""Points in pictures: where a spatial softmax puts them, and sizes of pictures."""

from __future__ import annotations

import pytest
import torch

from sceniris_gym.training.keypoints import POINTS, Keypoints, SpatialSoftmax


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
