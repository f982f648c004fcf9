"""`Observer`: turns a task's observations into flat groups, and adds spaces, sensor noise and pictures.

`Images` takes these pictures, of all worlds, from the scene's cameras.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
import warp as wp
from gymnasium import spaces
from torch import Tensor

from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.pictures.camera import Cameras
from sceniris_gym.pictures.context import Looks, Shot
from sceniris_gym.sim.batch import Batch
from sceniris_gym.vector.sensing import Sensing, Sensors
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task, check_observation

GROUP = "images"
"""The observation group of the pictures."""

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
        self._latest: Pictures = _of_each(lambda _, image: wp.to_torch(image), {name: taken[name] for name in shots})

    @property
    def space(self) -> spaces.Dict:
        """The space of one world's images."""
        names = (0, len(self.names) - 1, np.int32)
        bounds = {"rgb": (0, 255, np.uint8), "depth": (0.0, np.inf, np.float32), "segmentation": names}

        def box(kind: str, image: Tensor) -> spaces.Box:
            low, high, dtype = bounds[kind]
            return spaces.Box(low, high, tuple(image.shape[1:]), dtype)

        return spaces.Dict({camera: spaces.Dict(kinds) for camera, kinds in _of_each(box, self._latest).items()})

    def due(self, elapsed: Tensor) -> Tensor:
        """Return which worlds need a new picture, (num_envs,) bool. `elapsed`: control steps since each reset."""
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
        return _of_each(lambda _, image: image.clone() if copy else image, self._latest)


def _of_each(function: Callable[[str, Any], Any], images: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the results of a function of the kind and the picture, for each picture of each camera."""
    return {
        camera: {kind: function(kind, image) for kind, image in of_camera.items()}
        for camera, of_camera in images.items()
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


RANDOMIZED = "randomized"
"""Name under which the group `critic` has the drawn numbers of the physics and the appearance."""
Groups = tuple[str, ...] | None
"""Names of observation groups. None stands for all groups."""
Names = dict[str, list[tuple[str, tuple[int, ...]]]]
"""For each group, the name and the shape in one world of each tensor, in the order of concatenation."""


def chosen(observation: Observation, groups: Groups) -> Observation:
    """Return the groups named in `groups`, in this order, or all groups if `groups` is None.

    Raises:
        UnknownNameError: The observation has no such group.
    """
    if groups is None:
        return observation
    check_names("observation group", groups, "observation_groups", observation)
    return {group: observation[group] for group in groups}


def flatten(observation: Observation, out: dict[str, Tensor] | None = None) -> dict[str, Tensor]:
    """Concatenate the tensors of each group to one tensor of shape (num_envs, size), float32.

    Args:
        observation: An observation of a task.
        out: Tensors to write to, or None to allocate new tensors.
    """
    return {
        group: torch.cat(
            [t.reshape(len(t), -1).float() for t in tensors.values()], dim=1, out=None if out is None else out[group]
        )
        for group, tensors in observation.items()
    }


def names_of(observation: Observation) -> Names:
    """Return the names and shapes of the parts of each flat group, in order."""
    return {group: [(name, tuple(t.shape[1:])) for name, t in named.items()] for group, named in observation.items()}


def observation_space(observation: dict[str, Tensor]) -> spaces.Dict:
    """Return the space of one world's observation, for flat groups of shape (num_envs, size)."""
    return spaces.Dict({g: spaces.Box(-np.inf, np.inf, t.shape[1:], np.float32) for g, t in observation.items()})


def action_space(size: int) -> spaces.Box:
    """Return the space of one world's actions: `size` numbers in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (size,), np.float32)


class Observer:
    """Observes the worlds of a task.

    Args:
        task: The task, after `bind`.
        state: The worlds.
        images: Pictures of the worlds, or None.
        groups: The groups to observe, or None for all groups.
        sensing: Noise, delay and dropout, or None.
        copy: Return new tensors in every call. If false, `flat` returns one of two buffers, and `pictures` returns the
            latest pictures. Later calls overwrite both.

    Attributes:
        sensors: The Sensors that apply `sensing` to observations and actions, or None.
        names: Names and shapes of the parts of each flat group, in order.
        space: Space of one world's observations.
        action_space: Space of one world's actions.

    Raises:
        TaskError: The task's observation has a wrong type or shape.
        UnknownNameError: The task's observation lacks a group of `groups`.
    """

    def __init__(
        self, task: Task, state: State, images: Images | None, *, groups: Groups, sensing: Sensing | None, copy: bool
    ) -> None:
        self._task, self._state, self._images, self._groups, self._copy = task, state, images, groups, copy
        observation = self._of_task()
        check_observation(task, observation, state.num_envs)
        size = task.action_size or state.mjm.nu
        self.sensors = None if sensing is None else Sensors(state, sensing, observation, size)
        self.action_space = action_space(size)
        observation = chosen(observation, groups)
        flat = flatten(observation)
        self.names, self.space = names_of(observation), observation_space(flat)
        if images is not None:
            self.space[GROUP] = images.space
        self._kept = None if copy else (flat, {group: torch.empty_like(t) for group, t in flat.items()})

    def flat(self, buffer: int) -> dict[str, Tensor]:
        """Return the flat groups: new tensors if the Observer copies, otherwise the tensors of buffer `buffer`."""
        observation = self._of_task()
        if self.sensors is not None:
            observation = self.sensors(self._state, observation)
        observation = chosen(observation, self._groups)
        return flatten(observation, None if self._kept is None else self._kept[buffer])

    def pictures(self, mask: Tensor | None = None, *, copy: bool = False) -> dict[str, Any]:
        """Take pictures of the masked worlds or, without a mask, all pictures that are due. Return group `images`."""
        if self._images is None:
            return {}
        due = self._images.due(self._state.elapsed) if mask is None else mask
        return {GROUP: self._images.take(due, copy or self._copy)}

    def _of_task(self) -> Observation:
        """Return the task's observation. The group `critic` also gets the numbers that the scene's `randomize` drew."""
        observation, draws = self._task.observe(self._state), self._state.scene.draws
        if not draws or "critic" not in observation:
            return observation
        numbers = torch.cat([self._state.randomized(draw.name) for draw in draws], dim=1)
        return {**observation, "critic": {**observation["critic"], RANDOMIZED: numbers}}
