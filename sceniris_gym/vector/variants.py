"""`VariantView`: the variants of objects that worlds have; `Boxes`: the boxes around bodies, of whichever variant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.scene.model import SceneModel


class VariantView:
    """The variants of objects that worlds have.

    Args:
        scene: The scene, with all variants.
        variant: The present variant of each object with variants, shape (num_envs, number of these objects), int32; not
            used in a scene without variants.
        device: Torch device.

    Attributes:
        names: The objects with variants.
    """

    def __init__(self, scene: SceneModel, variant: Tensor | None, device: torch.device) -> None:
        self.scene, self.names, self.device = scene, tuple(scene.config.variants), device
        self._variant = torch.zeros(1, 0, dtype=torch.int32, device=device) if variant is None else variant

    def index(self, name: str | None) -> Tensor:
        """Return the number of the variant of an object that is present, 0 without a name, shape (num_envs,), int64."""
        if name is None:
            return torch.zeros(len(self._variant), dtype=torch.int64, device=self.device)
        return self._variant[:, self.names.index(name)].long()


class Boxes:
    """The smallest box around each of several bodies, along the axes of the body's frame.

    A box contains the colliding geoms of the body itself, not those of its children. Boxes are computed once, on the
    host.

    Args:
        view: The variants that worlds have.
        bodies: Bodies of the simulated scene.
        where: The beginning of errors.

    Raises:
        NotSupportedError: A body has no geom that collides.
    """

    def __init__(self, view: VariantView, bodies: Sequence[int], where: str) -> None:
        self._view, names = view, {view.scene.sim.bodies[name]: name for name in view.names}
        self._names = [names.get(body) for body in bodies]
        members = [np.flatnonzero(view.scene.sim_bodies == body).tolist() for body in bodies]
        found = [[_corners(view.scene, member, where) for member in of] for of in members]
        most = max((len(corners) for corners in found), default=1)
        table = np.array([[corners[min(i, len(corners) - 1)] for i in range(most)] for corners in found])
        self._table = torch.tensor(np.reshape(table, (-1, most, 2, 3)), dtype=torch.float32, device=view.device)

    def corners(self) -> tuple[Tensor, Tensor]:
        """Return the lower and the upper corners [m], shape (num_envs, number of bodies, 3) each.

        They have no dimension of worlds if no body has variants.
        """
        boxes = self._table[:, 0]
        if any(self._names):
            chosen = torch.stack([self._view.index(name) for name in self._names], dim=1)
            boxes = self._table[torch.arange(len(self._names), device=boxes.device), chosen]
        lower, upper = boxes.unbind(dim=-2)
        return lower, upper


def _corners(scene: SceneModel, body: int, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper corner of a body's box in its own frame [m], each of shape (3,)."""
    boxes = [piece.bounds() for piece in extract_pieces(scene.mjm, "physics", {body})]
    if not boxes:
        name = scene.mjm.body(body).name
        raise NotSupportedError(f"{where}: body '{name}' has no geom that collides. Name a body that has one.")
    lower, upper = zip(*boxes, strict=True)
    return np.min(lower, axis=0), np.max(upper, axis=0)
