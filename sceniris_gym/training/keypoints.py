"""`Keypoints`: a convolutional network whose features are points in a picture, so that it finds things."""

from __future__ import annotations

import torch
from torch import Tensor, nn

POINTS = 64
"""Points that are found in a picture."""


class Keypoints(nn.Sequential):
    """Convolutions that end in a spatial softmax (Levine et al. 2016), as an encoder of rsl-rl's CNNModel.

    Args:
        channels: Channels of the pictures, which have shape (n, channels, height, width), float32.
    """

    output_channels = None  # the output is flat, as CNNModel asks
    output_dim = 2 * POINTS

    def __init__(self, channels: int) -> None:
        super().__init__(
            nn.Conv2d(channels, 32, 5, stride=2, padding=2),
            nn.ELU(),
            nn.Conv2d(32, 64, 3, stride=2, padding=1),
            nn.ELU(),
            nn.Conv2d(64, POINTS, 3, padding=1),
            SpatialSoftmax(),
        )


class SpatialSoftmax(nn.Module):
    """The expected position of each channel's activation in its picture, (n, 2 * channels): first y, then x.

    A softmax over the pixels of a channel is a distribution of positions. The first row and column are at -1, the last
    ones at 1.
    """

    def forward(self, maps: Tensor) -> Tensor:
        """Return the positions for activations of shape (n, channels, height, width)."""
        shares = maps.flatten(2).softmax(dim=2).view_as(maps)
        return torch.cat([_mean(shares.sum(dim=3)), _mean(shares.sum(dim=2))], dim=1)


def _mean(shares: Tensor) -> Tensor:
    return (shares * torch.linspace(-1.0, 1.0, shares.shape[2], device=shares.device)).sum(dim=2)
