"""`ArmWeight`: how far the weight of an arm pulls its joints from their targets."""

from collections.abc import Sequence

import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.scene.support import subtree
from sceniris_gym.vector import rotations
from sceniris_gym.vector.names import SLIDE
from sceniris_gym.vector.readings import as_columns
from sceniris_gym.vector.state import State


class ArmWeight:
    """The weight of an arm and its hand, with the model's masses and gravity, less the part that `gravcomp` bears.

    It depends only on the poses of bodies. MuJoCo's `qfrc_bias` would be older than a reset in the first step after it.

    Args:
        s: The worlds.
        joints: Ids of the arm's joints, which are hinges or slides.
        compliance: Change of each joint's position under a unit load [rad/(N m) or m/N], shape (njoint,).

    Attributes:
        acts: Whether the arm has any weight.
    """

    def __init__(self, s: State, joints: Sequence[int], compliance: np.ndarray) -> None:
        def tensor(values: np.ndarray) -> Tensor:
            return torch.tensor(values, dtype=torch.float32, device=s.device)

        mjm, gravity = s.mjm, s.mjm.opt.gravity
        carried = [subtree(mjm, int(mjm.jnt_bodyid[j])) for j in joints]
        bodies = sorted({body for bodies in carried for body in bodies})
        mass = mjm.body_mass * (1.0 - mjm.body_gravcomp)
        masses = np.array([[mass[body] * (body in below) for body in bodies] for below in carried])
        self.acts = bool(masses.any() and gravity.any())
        total, slide = masses.sum(axis=1)[:, None], (mjm.jnt_type[list(joints)] == SLIDE)[:, None]
        self._masses, self._mass, self._compliance = tensor(masses), tensor(total), tensor(compliance)
        self._hinge_gravity, self._slide_load = tensor(~slide * gravity), tensor(slide * total * gravity)
        self._bodies, self._joints = as_columns(bodies, s.device), as_columns(list(joints), s.device)
        self._xipos, self._xanchor, self._xaxis = (wp.to_torch(a) for a in (s.data.xipos, s.data.xanchor, s.data.xaxis))

    def sag(self) -> Tensor:
        """Return how far the weight pulls joints below their targets at rest [rad or m], shape (num_envs, njoint).

        The load of a hinge is a . (sum of m (p - o)) x g, with axis a, anchor o, and mass m and centre of mass p of
        each body that it carries. The load of a slide is a . (sum of m) g.
        """
        # the sums over bodies, for each axis of the world
        moments = rotations.transform(self._masses, self._xipos[:, self._bodies].transpose(1, 2))
        moments = moments.transpose(1, 2) - self._mass * self._xanchor[:, self._joints]
        load = torch.linalg.cross(moments, self._hinge_gravity.expand_as(moments)) + self._slide_load
        return self._compliance * (self._xaxis[:, self._joints] * load).sum(dim=2)
