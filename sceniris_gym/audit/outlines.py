"""Objects seen from above, as relations need them: pivot, heading and rectangular bounds in every layout."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sceniris_gym.audit.carriers import carrier_of
from sceniris_gym.audit.geometry import Form, Poses, Solid, rotation
from sceniris_gym.audit.pairs import Tree
from sceniris_gym.config.scene import SceneConfig

_UPRIGHT = 1e-3  # an x axis with a shorter horizontal part points straight up or down


@dataclass(frozen=True)
class Outline:
    """One object seen from above in each row.

    Attributes:
        pivot: Bottom centre of the bounds [m], world frame, shape (nrow, 3); for a robot, the origin of its base.
        heading: Direction of the root's x axis [rad], shape (nrow,); if that axis points straight up or down, the
            direction of the y axis minus a right angle.
        low, high: Bounds [m] around the pivot, along the heading and to the left of it, shape (nrow, 2).
    """

    pivot: np.ndarray
    heading: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def corners(self) -> np.ndarray:
        """Return the corners of the bounds [m] from above, in order around them, shape (nrow, 4, 2)."""
        x = np.stack([self.low[:, 0], self.high[:, 0], self.high[:, 0], self.low[:, 0]], 1)
        y = np.stack([self.low[:, 1], self.low[:, 1], self.high[:, 1], self.high[:, 1]], 1)
        c, s = np.cos(self.heading)[:, None], np.sin(self.heading)[:, None]
        return self.pivot[:, None, :2] + np.stack([c * x - s * y, s * x + c * y], 2)

    def span(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and greatest world coordinate [m] of the bounds along unit vectors (nrow, 2)."""
        along = np.einsum("nkj,nj->nk", self.corners(), direction)
        return along.min(1), along.max(1)


@dataclass(frozen=True)
class Seen:
    """The objects of a scene in some rows, seen from above.

    Attributes:
        poses: The poses in the rows.
        outlines: Object name -> its outline.
        present: Object name -> rows in which it is present, shape (nrow,).
        support_heading: Object name -> heading of its support [rad], shape (nrow,).
    """

    poses: Poses
    outlines: Mapping[str, Outline]
    present: Mapping[str, np.ndarray]
    support_heading: Mapping[str, np.ndarray]


class Outlines:
    """The objects of a scene, of which it computes outlines.

    Args:
        tree: Owners of the bodies.
        solids: The solids of the model.
        config: The scene.
        bodies: Object name -> root body id.
        home: The start pose, one row.
    """

    def __init__(
        self, tree: Tree, solids: list[Solid], config: SceneConfig, bodies: Mapping[str, int], home: Poses
    ) -> None:
        self.mjm, self.config, self.bodies, self._home = tree.mjm, config, bodies, home
        self._solids: dict[str, list[Solid]] = {name: [] for name in bodies}
        for solid in solids:
            owner = tree.owner[tree.mjm.geom_bodyid[solid.geom]]
            if owner in bodies and solid.form is not Form.HALFSPACE:
                self._solids[owner].append(solid)

    def see(self, poses: Poses, present: Mapping[str, np.ndarray]) -> Seen:
        """Return the objects as relations, orientations and groups are judged by them.

        Args:
            poses: Poses in the rows.
            present: Object name -> rows in which it is present, shape (nrow,).
        """
        outlines = {name: self.outline(name, poses) for name in self.bodies}
        return Seen(poses, outlines, present, self.support_heading(poses))

    def support_heading(self, poses: Poses) -> dict[str, np.ndarray]:
        """Return object name -> heading [rad] of the x axis of its support, 0 on the floor and in the air."""
        found = {}
        for name, part in self.config.parts.items():
            found[name] = np.zeros(len(poses.xpos))
            if part.support is not None:
                x = poses.xmat[:, carrier_of(self.mjm, self.bodies, self.config, part.support.parent).body, :, 0]
                found[name] = np.arctan2(x[:, 1], x[:, 0])
        return found

    def turn(self, name: str, poses: Poses) -> np.ndarray:
        """Return the rotation of an object from its authored orientation in each row, shape (nrow, 3, 3)."""
        root = self.bodies[name]
        return poses.xmat[:, root] @ rotation(self.mjm.body_quat[root]).T

    def outline(self, name: str, poses: Poses) -> Outline:
        """Return the outline of an object in each row.

        The pivot is the centre of the bounds in the orientation of the row with the joints at home; with `orientation:
        any`, with the joints of the row. The bounds, and the height of the pivot, always have the joints of the row. A
        robot's pivot is the origin of its base.
        """
        heading = _heading(poses.xmat[:, self.bodies[name]])
        at = poses.xpos[:, self.bodies[name]]
        if not self._solids[name]:
            return Outline(at, heading, np.zeros((len(at), 2)), np.zeros((len(at), 2)))
        c, s, zero = np.cos(heading), np.sin(heading), np.zeros_like(heading)
        axes = np.stack([np.stack([c, s, zero], 1), np.stack([-s, c, zero], 1)], 1)
        up = np.broadcast_to([0.0, 0.0, 1.0], at.shape)
        low = np.stack([self._least(name, poses, axes[:, k]) for k in range(2)], 1)
        high = np.stack([-self._least(name, poses, -axes[:, k]) for k in range(2)], 1)
        if name in self.config.all_robots:
            return Outline(at, heading, low, high)
        middle = (low + high) / 2
        part = self.config.parts.get(name)
        if part is None or part.drawn_orientation.kind != "any":
            ends = [[self._least_at_home(name, poses, sign * axes[:, k]) for k in range(2)] for sign in (1, -1)]
            middle = (np.stack(ends[0], 1) - np.stack(ends[1], 1)) / 2
        pivot = at + np.einsum("nk,nkj->nj", middle, axes)
        pivot[:, 2] += self._least(name, poses, up)
        return Outline(pivot, heading, low - middle, high - middle)

    def _least(self, name: str, poses: Poses, direction: np.ndarray) -> np.ndarray:
        """Return the least coordinate [m] of an object along unit vectors (nrow, 3) from its root, shape (nrow,)."""
        at = poses.xpos[:, self.bodies[name]]
        ends = []
        for solid in self._solids[name]:
            local = np.einsum("nij,ni->nj", poses.geom_xmat[:, solid.geom], direction)
            ends.append(((poses.geom_xpos[:, solid.geom] - at) * direction).sum(1) + solid.lowest(local))
        return np.min(ends, axis=0)

    def _least_at_home(self, name: str, poses: Poses, direction: np.ndarray) -> np.ndarray:
        """Return the same with the object's joints at home."""
        root, home = self.bodies[name], self._home
        seen = np.einsum("nij,ni->nj", poses.xmat[:, root], direction)
        ends = []
        for solid in self._solids[name]:
            at = home.xmat[0, root].T @ (home.geom_xpos[0, solid.geom] - home.xpos[0, root])
            ends.append(seen @ at + solid.lowest(seen @ home.xmat[0, root].T @ home.geom_xmat[0, solid.geom]))
        return np.min(ends, axis=0)


def _heading(mat: np.ndarray) -> np.ndarray:
    """Return the headings [rad] of rotations (nrow, 3, 3), shape (nrow,)."""
    x, y = mat[:, :2, 0], mat[:, :2, 1]
    upright = np.linalg.norm(x, axis=1) < _UPRIGHT
    return np.where(upright, np.arctan2(y[:, 1], y[:, 0]) - np.pi / 2, np.arctan2(x[:, 1], x[:, 0]))
