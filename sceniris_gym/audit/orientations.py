"""Check of orientations: yaw, facing, and stable rest."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np
import shapely

from sceniris_gym.audit.geometry import Poses, rotation
from sceniris_gym.audit.language import Excess
from sceniris_gym.audit.outlines import Outline, Seen
from sceniris_gym.audit.relations import ROUNDING, wrapped
from sceniris_gym.audit.scene import JudgedScene
from sceniris_gym.config.orientation import DrawnOrientation

_LOWEST = 1e-4  # m; points up to this height above the lowest one carry the object
_ONE_POINT = 1e-5  # m; pivots that are no further apart coincide, up to rounding


class OrientationAudit:
    """Measures the violation of orientations.

    Args:
        scene: The scene.
        hulls: Object name -> corners of its convex hull in its root's frame at home [m], shape (n, 3).
    """

    def __init__(self, scene: JudgedScene, hulls: Mapping[str, np.ndarray]) -> None:
        self.scene, self.hulls, home = scene, hulls, scene.home
        self._mass_at = {
            name: home.xmat[root].reshape(3, 3).T @ (_center_of_weight(home, root) - home.xpos[root])
            for name, root in scene.bodies.items()
        }

    def excess(self, seen: Seen) -> Excess:
        """Measure the orientation of every placed object.

        Returns:
            (object, word, unit) -> violation in each row [m or rad], at most 0 where the orientation is right, NaN
            where the object is absent. Shape (nrow,).
        """
        found, outlines = {}, seen.outlines
        for name, part in self.scene.placed.items():
            if part.drawn_orientation.kind == "any":
                continue
            turn, root = part.drawn_orientation, self.scene.bodies[name]
            missed = {("yaw", "rad"): _off_interval(outlines[name].heading - seen.support_heading[name], 0.0, turn)}
            if turn.kind == "stable":
                missed["stable", "m"] = self._off_balance(name, seen.poses)
            else:
                up = seen.poses.xmat[:, root] @ rotation(self.scene.mjm.body_quat[root])[2]
                missed["upright", "rad"] = np.arctan2(np.linalg.norm(up[:, :2], axis=1), up[:, 2])
            if turn.target is not None:
                facing = _off_interval(*_from_target(outlines[name], outlines[turn.target]), turn)
                yaw = missed.pop(("yaw", "rad"))
                missed["face_to", "rad"] = np.where(seen.present[turn.target], facing, yaw)
            found |= {(name, *key): np.where(seen.present[name], amount, np.nan) for key, amount in missed.items()}
        return found

    def _off_balance(self, name: str, poses: Poses) -> np.ndarray:
        """Return the distance [m] of the centre of mass from the hull of the lowest points, seen from above."""
        mat = poses.xmat[:, self.scene.bodies[name]]
        points = np.einsum("nij,kj->nki", mat, self.hulls[name])
        row, corner = np.nonzero(points[:, :, 2] <= points[:, :, 2].min(1)[:, None] + _LOWEST)
        carried = shapely.convex_hull(shapely.multipoints(points[row, corner, :2], indices=row))
        return shapely.distance(shapely.points((mat @ self._mass_at[name])[:, :2]), carried)


def _center_of_weight(home: mujoco.MjData, root: int) -> np.ndarray:
    """Return the centre [m] of the weight of a root and all bodies below it, without the share of `gravcomp`."""
    mjm = home.model
    weight = np.where(mjm.body_rootid == root, mjm.body_mass * (1.0 - mjm.body_gravcomp), 0.0)
    if not mjm.body_gravcomp.any() or weight.sum() <= 0.0:
        return home.subtree_com[root].copy()
    return weight @ home.xipos / weight.sum()


def _off_interval(angle: np.ndarray, rounding: np.ndarray | float, turn: DrawnOrientation) -> np.ndarray:
    """Return the distance [rad] of angles, known up to `rounding`, from the yaw interval of `turn`."""
    low, high = turn.yaw
    return np.abs(wrapped(angle - (low + high) / 2)) - (high - low) / 2 - rounding


def _from_target(own: Outline, target: Outline) -> tuple[np.ndarray, np.ndarray]:
    """Return the angle [rad] from the direction of the target to an object's front (-y), and its rounding error.

    If both are at one point, as `points` allow, there is no direction and any angle is right.
    """
    to = target.pivot[:, :2] - own.pivot[:, :2]
    apart = np.linalg.norm(to, axis=1)
    rounding = np.where(apart > _ONE_POINT, ROUNDING / np.maximum(apart, ROUNDING), np.pi)
    return own.heading - np.pi / 2 - np.arctan2(to[:, 1], to[:, 0]), rounding
