"""`Images`: the observation group `images`, which has pictures of all worlds from the scene's cameras."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
import warp as wp
from gymnasium import spaces
from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.pictures.camera import Cameras
from sceniris_gym.pictures.context import Looks, Shot
from sceniris_gym.sim.batch import Batch

GROUP = "images"
"""The observation group."""

Pictures = dict[str, dict[str, Tensor]]
"""Camera -> kind -> tensor of shape (num_envs, height, width, channels)."""


class Images:
    """The latest pictures of all worlds. A world's pictures do not depend on other worlds.

    Args:
        batch: The worlds.
        shots: The pictures to take, by the name of the camera.
        every: Control steps from one picture of a world to the next, counted from the world's reset.
        graph: Capture the launches into a graph and replay it.

    Attributes:
        names: The name for each value of a segmentation image: first "" for the surroundings, then the names of objects
            and robots.

    Raises:
        UnknownNameError: The scene has no such camera.
    """

    def __init__(
        self, batch: Batch, shots: Mapping[str, tuple[Shot, Looks]], every: int, *, graph: bool = True
    ) -> None:
        scene, worlds = batch.scene, (batch.model, batch.data)
        differ = (*batch.fields.rows, *batch.fields.varied)
        more: Any = {"where": f"scene '{scene.config.name}': images", "differ": differ, "graph": graph}
        self._cameras = []
        for looks in dict.fromkeys(looks for _, looks in shots.values()):
            alike = {name: shot for name, (shot, its_looks) in shots.items() if its_looks == looks}
            self._cameras.append(Cameras(scene, *worlds, alike, looks, **more))
        self._masks = [wp.to_torch(cameras.mask) for cameras in self._cameras]
        self._every, self.names = every, self._cameras[0].names
        taken = {name: images for cameras in self._cameras for name, images in cameras.images.items()}
        self._latest: Pictures = {
            name: {kind: wp.to_torch(image) for kind, image in taken[name].items()} for name in shots
        }

    @property
    def space(self) -> spaces.Dict:
        """The space of one world's images."""
        bounds = {"rgb": (0, 255, np.uint8), "depth": (0.0, np.inf, np.float32)}
        bounds["segmentation"] = (0, len(self.names) - 1, np.int32)

        def box(kind: str, image: Tensor) -> spaces.Box:
            low, high, dtype = bounds[kind]
            return spaces.Box(low, high, tuple(image.shape[1:]), dtype)

        return spaces.Dict(
            {
                camera: spaces.Dict({kind: box(kind, image) for kind, image in of_camera.items()})
                for camera, of_camera in self._latest.items()
            }
        )

    def due(self, elapsed: Tensor) -> Tensor:
        """Return which worlds need a new picture, (num_envs,) bool. `elapsed`: their control steps since the reset."""
        return elapsed % self._every == 0

    def take(self, mask: Tensor, copy: bool) -> Pictures:
        """Take pictures of the masked worlds, and return the latest pictures of all worlds.

        Args:
            mask: Which worlds, shape (num_envs,), bool. Other worlds keep their latest pictures.
            copy: Whether to return copies, which later pictures do not overwrite.
        """
        for cameras, its_mask in zip(self._cameras, self._masks, strict=True):
            its_mask.copy_(mask)
            cameras.launch()
        return {
            camera: {kind: image.clone() if copy else image for kind, image in of_camera.items()}
            for camera, of_camera in self._latest.items()
        }


def picture_names(images: Mapping[str, Any]) -> dict[str, Any]:
    """Return the pictures of the group `images`, or their spaces, by names such as 'wrist/rgb'."""
    return {f"{camera}/{kind}": image for camera, of_camera in images.items() for kind, image in of_camera.items()}


def as_channels(pictures: Mapping[str, Tensor]) -> Tensor:
    """Return one camera's pictures as a tensor for a convolution, shape (num_envs, channels, height, width), float32.

    Colours are scaled to [0, 1]. Distances [m] and segmentation values do not change. The channels follow the order of
    `pictures`.

    Raises:
        ArgumentError: There are no pictures.
    """
    if not pictures:
        raise ArgumentError("as_channels: pictures should have at least one kind, such as 'rgb', got none.")
    parts = [image / 255.0 if kind == "rgb" else image.float() for kind, image in pictures.items()]
    return torch.cat(parts, dim=3).permute(0, 3, 1, 2)
