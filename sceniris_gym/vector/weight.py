"""`ArmWeight`: the loads that the weight of an arm puts on its joints."""

from collections.abc import Sequence

import torch
import warp as wp
from torch import Tensor

from sceniris_gym.scene.support import subtree
from sceniris_gym.vector import rotations
from sceniris_gym.vector.names import SLIDE
from sceniris_gym.vector.readings import as_columns
from sceniris_gym.vector.state import State


class ArmWeight:
    """The weight of an arm and its hand in each world, less the part that `gravcomp` bears.

    Drawn masses, centres of mass and gravity count. MuJoCo's `qfrc_bias` would be older than a reset in the first step
    after it.

    Args:
        s: The worlds.
        joints: Ids of the arm's joints, which are hinges or slides.

    Attributes:
        acts: Whether the arm can have any weight. Model fields that are requested later do not count.
    """

    def __init__(self, s: State, joints: Sequence[int]) -> None:
        carried = [subtree(s.mjm, int(s.mjm.jnt_bodyid[j])) for j in joints]
        own = sorted({body for bodies in carried for body in bodies})
        self._below = torch.tensor([[float(b in bodies) for b in own] for bodies in carried], device=s.device)
        self._slide = torch.tensor(s.mjm.jnt_type[list(joints)] == SLIDE, device=s.device)[:, None]
        self._bodies, self._joints = as_columns(own, s.device), as_columns(list(joints), s.device)
        masses, drawn = (s.mjm.body_mass * (1.0 - s.mjm.body_gravcomp))[own], s.model_rows
        heavy = bool(masses.any()) or "body_gravcomp" in drawn
        self.acts, self._state = heavy and (bool(s.mjm.opt.gravity.any()) or "gravity" in drawn), s
        self._xipos, self._xanchor, self._xaxis = (wp.to_torch(a) for a in (s.data.xipos, s.data.xanchor, s.data.xaxis))

    def loads(self) -> Tensor:
        """Return the loads of the weight on the joints [N m or N], shape (num_envs, njoint).

        The load of a hinge is a . (sum of m (p - o)) x g, with axis a, anchor o, and mass m and centre of mass p of
        each body that it carries. The load of a slide is a . (sum of m) g.
        """
        mass, borne, gravity = (self._state._field(name) for name in ("body_mass", "body_gravcomp", "gravity"))
        masses = (mass - mass * borne)[:, self._bodies]
        # the sums over bodies, for each axis of the world
        moments = rotations.transform(self._below, masses[:, None] * self._xipos[:, self._bodies].transpose(1, 2))
        total, gravity = rotations.transform(self._below, masses)[:, :, None], gravity[:, None]
        arms = moments.transpose(1, 2) - total * self._xanchor[:, self._joints]
        load = torch.where(self._slide, total * gravity, torch.linalg.cross(arms, gravity))
        return (self._xaxis[:, self._joints] * load).sum(dim=2)
