"""`VariantView`: the present variants in all worlds. `Boxes` and `TargetGrasps`: boxes and grasps of these variants."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector import rotations
from sceniris_gym.vector.base_frame import BaseFrame
from sceniris_gym.vector.names import find_body, unknown


class VariantView:
    """The present variants of objects in all worlds.

    Args:
        scene: The scene with all variants.
        variant: The present variant of each object with variants, shape (num_envs, number of these objects), int32.
            None in a scene without variants.
        device: Torch device.

    Attributes:
        names: The objects with variants.
    """

    def __init__(self, scene: SceneModel, variant: Tensor | None, device: torch.device) -> None:
        self.scene, self.names, self.device = scene, tuple(scene.config.variants), device
        self._variant = torch.zeros(1, 0, dtype=torch.int32, device=device) if variant is None else variant

    def index(self, name: str | None) -> Tensor:
        """Return the number of an object's present variant, shape (num_envs,), int64.

        It is 0 in worlds without the object, and in all worlds if `name` is None.
        """
        if name is None:
            return torch.zeros(len(self._variant), dtype=torch.int64, device=self.device)
        return self.number(name).clamp(min=0)

    def number(self, name: str) -> Tensor:
        """Return the number of an object's present variant, -1 in worlds without it, shape (num_envs,), int64."""
        return self._variant[:, self.names.index(name)].long()

    @property
    def present(self) -> Tensor:
        """The presence of the objects `names` in each world, shape (num_envs, len(names)), bool."""
        return self._variant >= 0


class Boxes:
    """The smallest box around each of several bodies, along the axes of the body's frame.

    A box contains the colliding geoms of the body, but not the geoms of its child bodies. The boxes are computed once,
    on the host.

    Args:
        view: The present variants.
        names: Names of the bodies, as `find_body` takes them.
        where: The caller, for error messages.

    Raises:
        UnknownNameError: The scene has no such body.
        NotSupportedError: A body has no geom that collides.
    """

    def __init__(self, view: VariantView, names: Sequence[str], where: str) -> None:
        bodies = [find_body(view.scene.sim, name, where) for name in names]
        self._view, owners = view, {view.scene.sim.bodies[name]: name for name in view.names}
        self._names = [owners.get(body) for body in bodies]
        members = [np.flatnonzero(view.scene.sim_bodies == body).tolist() for body in bodies]
        found = [[_corners(view.scene, member, where) for member in of] for of in members]
        most = max((len(corners) for corners in found), default=1)
        table = np.array([[corners[min(i, len(corners) - 1)] for i in range(most)] for corners in found])
        self._table = torch.tensor(np.reshape(table, (-1, most, 2, 3)), dtype=torch.float32, device=view.device)

    def corners(self) -> tuple[Tensor, Tensor]:
        """Return the lower and the upper corners of the boxes [m], shape (num_envs, number of bodies, 3) each.

        If no body has variants, all worlds have the same boxes, so the shapes are (number of bodies, 3).
        """
        boxes = self._table[:, 0]
        if any(self._names):
            chosen = torch.stack([self._view.index(name) for name in self._names], dim=1)
            boxes = self._table[torch.arange(len(self._names), device=boxes.device), chosen]
        lower, upper = boxes.unbind(dim=-2)
        return lower, upper


def _corners(scene: SceneModel, body: int, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper corner of a body's box in the body's frame [m], each of shape (3,)."""
    boxes = [piece.bounds for piece in extract_pieces(scene.mjm, "physics", {body})]
    if not boxes:
        name = scene.mjm.body(body).name
        where = f"scene '{scene.config.name}': {where}"
        raise NotSupportedError(f"{where}: body '{name}' has no geom that collides. Name a body that has one.")
    lower, upper = zip(*boxes, strict=True)
    return np.min(lower, axis=0), np.max(upper, axis=0)


class TargetGrasps:
    """The grasp of a reachable object, or of its present variant, in each world's layout.

    Args:
        layouts: The layouts of the worlds.
        view: The present variants.
        name: The object.
        where: Name of the caller, for error messages.

    Raises:
        UnknownNameError: The scene has no such object, or the object does not have to be reachable.
    """

    def __init__(self, layouts: Layouts, view: VariantView, name: str, where: str) -> None:
        scene, device, reaching = view.scene, view.device, layouts.reaching
        targets = () if reaching is None else reaching.targets
        members = scene.config.variants.get(name, (name,))
        found = [i for i, target in enumerate(targets) if target.name in members]
        if reaching is None or not found:
            valid = {scene.config.owners.get(target.name, target.name) for target in targets}
            raise unknown(scene, "reachable object", name, where, valid)
        self._grasp, self._columns = layouts.grasp, torch.tensor(found, device=device)
        self._qpos = {array: getattr(layouts, array) for array in ("grasp_qpos", "pregrasp_qpos", "path")}
        self._joints = len(reaching.arm_of(targets[found[0]]).arm.joints)
        self.has_path = all(targets[i].on_path for i in found)
        self._rows = torch.arange(len(layouts.grasp), device=device)
        sets = [targets[i].grasp_set.grasps for i in found]
        grasps = [grasp for one in sets for grasp in one]
        # at most one variant is present, so all variants share one list of grasps, in which each has an offset
        self._first = torch.tensor(np.cumsum([0, *map(len, sets[:-1])]), device=device)
        self._body = torch.tensor(scene.sim_bodies[[grasp.body for grasp in grasps]], device=device)
        self._pos, self._quat = (
            torch.tensor(np.array(values), dtype=torch.float32, device=device)
            for values in zip(*((grasp.pos, grasp.quat) for grasp in grasps), strict=True)
        )

    def pose(self, base: BaseFrame, xpos: Tensor, xquat: Tensor) -> Tensor:
        """Return the TCP pose of the grasp, shape (num_envs, 7). It is NaN in worlds without a grasp.

        Args:
            base: The frame in which to return the pose.
            xpos: Positions of all bodies in the world frame [m], shape (num_envs, nbody, 3).
            xquat: Orientations of all bodies in the world frame (wxyz), shape (num_envs, nbody, 4).
        """
        own = self._grasp[:, self._columns]  # index in the grasp set of each variant, or -1 if there is no grasp
        chosen = torch.where(own >= 0, own + self._first, -1).amax(dim=1)
        i = chosen.clamp(min=0).long()
        xpos, xquat = xpos[self._rows, self._body[i]], xquat[self._rows, self._body[i]]
        pos, quat = rotations.rotate(xquat, self._pos[i]), rotations.multiply(xquat, self._quat[i])
        return torch.where(chosen[:, None] >= 0, base.pose(xpos + pos, quat), torch.nan)

    def joints(self, array: str) -> Tensor:
        """Return the named array, 'grasp_qpos' or 'pregrasp_qpos', of the present variant, shape (num_envs, joints)."""
        return self._present(array)[:, : self._joints]

    def path(self) -> tuple[Tensor, Tensor]:
        """Return the corners of the path to the grasp and their number, see `Readings.path`."""
        corners = self._present("path").unflatten(1, (3, -1))[..., : self._joints]
        ends = torch.stack([self.joints("pregrasp_qpos"), self.joints("grasp_qpos")], dim=1)
        vias, none = (corners[:, 1:] != ends[:, :1]).any(dim=2).sum(dim=1, dtype=torch.int32), corners[:, 0, 0].isnan()
        joints = torch.cat([corners, ends], dim=1).masked_fill(none[:, None, None], torch.nan)
        return joints, torch.where(none, 0, 3 + vias)

    def _present(self, array: str) -> Tensor:
        there = self._grasp[:, self._columns].argmax(dim=1)  # absent variants have -1
        return self._qpos[array][self._rows, self._columns[there]]
