"""`Bounds` finds the lowest corners of boxes around bodies. `ContactSensor` finds the pairs of bodies that touch."""

from collections.abc import Sequence

import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.errors import as_names, refuses_old_names
from sceniris_gym.vector import rotations
from sceniris_gym.vector.names import find_body
from sceniris_gym.vector.parts import PartBody
from sceniris_gym.vector.state import State
from sceniris_gym.vector.variants import Boxes


class Bounds:
    """The smallest box around each of several bodies, along the axes of the body's frame.

    A box contains the colliding geoms of the body, but not the geoms of its child bodies. If the object has variants,
    the geoms are the present variant's. The boxes are computed once, on the host. `lowest` does not synchronise with
    the host.

    Args:
        s: The worlds.
        names: The name of a body, or several names.

    Raises:
        ArgumentTypeError: `names` has another type.
        UnknownNameError: The scene has no such body.
        NotSupportedError: A body has no geom that collides.
    """

    def __init__(self, s: State, names: str | Sequence[str]) -> None:
        self._boxes = Boxes(s.variants, as_names(names, "Bounds: names"), "Bounds")
        self._up = torch.tensor([0.0, 0.0, 1.0], device=s.device)

    def lowest(self, poses: Tensor) -> Tensor:
        """Return the height of the lowest corner of each box [m], shape (num_envs, len(names)).

        The height is z + r . c - |r| . h, with r the third row of the body's rotation matrix, c the centre of the box
        and h its half extents. The corner is never above the lowest point of the geoms. Both have the same height if
        the box is not tilted.

        Args:
            poses: Poses of the same bodies from `State.poses`, shape (num_envs, len(names), 7).
        """
        lower, upper = self._boxes.corners()
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        row = rotations.rotate(rotations.conjugate(poses[..., 3:]), self._up.expand_as(poses[..., :3]))
        return poses[..., 2] + (row * middle - row.abs() * half).sum(dim=-1)


class ContactSensor:
    """Finds which bodies of one list touch which bodies of another, in all worlds and without host synchronisation.

    The last physics step of a control step has already found these contacts, so the sensor adds no collision detection.
    The contacts are one physics step old, unless the task needs "contacts". After a reset, the sensor returns no
    touching pair until the next step.

    Args:
        s: The worlds.
        primary: The name of a body, or several names. 'object/part' names the body of a part, which may be another body
            in each variant of the object. The geoms of a body count, but not the geoms of its child bodies.
        secondary: The name of another body, or several names. Again, the geoms of child bodies do not count.

    Raises:
        UnknownNameError: The scene has no such body, or an argument has an old name.
        ArgumentTypeError: `primary` or `secondary` has another type.
    """

    @refuses_old_names
    def __init__(self, s: State, primary: str | Sequence[str], secondary: str | Sequence[str]) -> None:
        primary = as_names(primary, "ContactSensor: primary")
        secondary = as_names(secondary, "ContactSensor: secondary")
        self._shape = (s.num_envs, len(primary), len(secondary))
        self._first, self._second = _Bodies(s, primary), _Bodies(s, secondary)
        contact = s.data.contact
        self._geom, self._world = wp.to_torch(contact.geom), wp.to_torch(contact.worldid)
        self._number = wp.to_torch(s.data.nacon)
        self._index = torch.arange(len(self._world), device=s.device)

    def __call__(self, s: State) -> Tensor:
        """Return which pairs touch, shape (num_envs, len(primary), len(secondary)), bool."""
        worlds, firsts, seconds = self._shape
        one, other = self._geom.long().clamp(min=0).unbind(dim=1)
        size = worlds * firsts * seconds
        touched = torch.zeros(size + 1, dtype=torch.bool, device=s.device)
        world = self._world.long()
        for a, b in ((one, other), (other, one)):
            first, second = self._first.number(a, world), self._second.number(b, world)
            counts = (self._index < self._number) & (first >= 0) & (second >= 0)
            place = (world * firsts + first) * seconds + second
            # all other contacts set an extra entry at the end: selecting contacts would synchronise with the host
            touched.index_fill_(0, torch.where(counts, place, size), True)
        return touched[:size].view(self._shape) & (s.elapsed > 0)[:, None, None]


class _Bodies:
    """Bodies by name, of which some are parts of objects with variants.

    Args:
        s: The worlds.
        names: Names of bodies, or 'object/part'.
    """

    def __init__(self, s: State, names: Sequence[str]) -> None:
        config, of_body, self._parts = s.variants.scene.config, np.full(s.mjm.nbody, -1), dict[int, PartBody]()
        known = {f"{config.owners.get(one, one)}/{part}" for one, of in config.objects.items() for part in of.parts}
        for i, name in enumerate(names):
            if name in known:
                owner, _, part = name.partition("/")
                self._parts[i] = PartBody(s.variants, owner, part, "ContactSensor")
            else:
                of_body[find_body(s.scene, name, "ContactSensor", known)] = i
        bodies = torch.tensor(s.mjm.geom_bodyid, dtype=torch.int64, device=s.device)
        self._number, self._body = torch.tensor(of_body, device=s.device)[bodies], bodies

    def number(self, geom: Tensor, world: Tensor) -> Tensor:
        """Return the index of the body of each geom among the names, or -1, shape (n,)."""
        found = self._number[geom]
        for i, part in self._parts.items():
            bodies = part.read()
            found = torch.where(bodies[world % len(bodies)] == self._body[geom], i, found)
        return found
