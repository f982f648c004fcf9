"""The poses in which an object can rest: a given orientation, or its stable poses with their probabilities."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import Piece, PieceType, convex_hull
from sceniris_gym.geometry.rotations import matrix, quaternion

if TYPE_CHECKING:
    import trimesh

# A stable pose is left out if its probability is below this fraction of the most frequent pose's probability.
_RARE = 1.0e-3
# Greatest number of stable poses. Each of the many narrow faces of a round object is rare, but together they count.
_MOST_POSES = 256
# An object rights itself in a stable pose after tilts up to this angle, in degrees. A placed object falls through its
# gap of half a millimetre, which shakes it. We dropped shipped assets in MuJoCo C 3,688 times, in all poses with the
# centre of mass above the base of support. In every pose that survives 2.5 degrees, they moved by less than a
# centimetre in half a second. This limit is twice as large. It excludes the chamfers of a block (4.1 degrees) and a mug
# that balances with its handle up (4.7).
STABLE_TILT = 5.0
ROCKING = 2.5
"""In a stable pose, an object may rock by up to this tilt, in degrees, for example on an uneven bottom."""
# With the joints in other states, a pose may lean by this angle, in degrees.
_LEANING = 1.0
# Numbers of tilt directions. A first test with few directions rejects most faces of a round object.
_SIDES = (24, 360)
_STEP = 0.1  # degrees, from one tilt to the next
_COARSE = 0.5  # degrees, from one tilt to the next if many joint states are tested
_FINER = ((24, ROCKING), (24, _STEP), (360, _STEP))  # directions and steps for a curved bottom
# The object rolls if its centre of mass rises by less than this [m] per step of the tilt.
_LEAST_RISE = 1.0e-8
# An x axis with a shorter horizontal part than this points straight up or down, up to rounding.
_UPRIGHT = 1.0e-3
# If a hull is not closed, its points are rounded to these fractions of its size. Points that are too close to each
# other would leave holes in the hull, so stable poses would be missing.
_ROUND = (1.0e-7, 1.0e-6, 1.0e-5, 1.0e-4)


class StablePose(NamedTuple):
    """One pose of an object, rotated about the vertical so that its heading is 0.

    Attributes:
        quat: Orientation of the object's root, wxyz.
        pivot: Bottom centre of the object's bounds [m], in the root's frame.
        bounds: Bounds of the object in this pose, relative to the pivot [m]: low x, low y, high x, high y.
        probability: Probability that a layout draws this pose.
    """

    quat: np.ndarray
    pivot: np.ndarray
    bounds: np.ndarray
    probability: float = 1.0

    @property
    def short_edge(self) -> float:
        """The shorter edge of the object's bounds [m]."""
        return float((self.bounds[2:] - self.bounds[:2]).min())


class HomeShape:
    """The shape of an object with its joints in the home state, in the frame of its root.

    Args:
        home: MjData in the home state.
        root: Root body of the object. `gravcomp` only counts if the root is a child of the world.
        pieces: Pieces of the object.
        margins: Contact distance [m] between each piece and the support, shape (npiece,), 0 by default.
    """

    def __init__(self, home: mujoco.MjData, root: int, pieces: list[Piece], margins: np.ndarray | None = None) -> None:
        self._pieces = pieces
        self.margins = np.zeros(len(pieces)) if margins is None else margins
        back = home.xmat[root].reshape(3, 3).T
        self._mats = [back @ home.xmat[p.body].reshape(3, 3) for p in pieces]
        self._at = [back @ (home.xpos[p.body] - home.xpos[root]) for p in pieces]
        self.center_of_mass = back @ (_center_of_weight(home, root) - home.xpos[root])

    def stable_pose(self, quat: np.ndarray, probability: float = 1.0) -> StablePose:
        """Return the pose in which the root has the orientation `quat`, whose heading is 0."""
        rotation = matrix(quat)
        if not self._pieces:
            return StablePose(quat, np.zeros(3), np.zeros(4), probability)
        lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
        for p, mat, at in zip(self._pieces, self._mats, self._at, strict=True):
            low, high = p.extents(rotation @ mat)
            lower, upper = np.minimum(lower, low + rotation @ at), np.maximum(upper, high + rotation @ at)
        bottom = np.array([*0.5 * (lower + upper)[:2], lower[2]])
        half = 0.5 * (upper - lower)[:2]
        return StablePose(quat, rotation.T @ bottom, np.concatenate([-half, half]), probability)

    def inner_radius(self) -> float:
        """Return the radius [m] of a ball inside the convex hull. In any pose, the bounds are at least 2 radii wide."""
        if not self._pieces:
            return 0.0
        hull = convex_hull(np.concatenate(self.points()))
        to_faces = hull.triangles[:, 0] - hull.center_mass
        return max(float((to_faces * hull.face_normals).sum(axis=1).min()), 0.0)

    def hull(self, body: int) -> Piece:
        """Return the convex hull of all pieces as one piece of the root body `body`, to compute footprints from it."""
        vertices = convex_hull(np.concatenate(self.points())).vertices
        middle = vertices.mean(axis=0)
        unit = np.array([1.0, 0.0, 0.0, 0.0])
        return Piece(-1, body, PieceType.HULL, middle, unit, np.zeros(3), vertices - middle, None, 0)

    def points(self) -> list[np.ndarray]:
        """Return the vertices of each piece in the root's frame [m], shape (n, 3) each."""
        placed = zip(self._pieces, self._mats, self._at, strict=True)
        return [at + p.mesh.vertices @ mat.T for p, mat, at in placed if p.mesh is not None]

    def axes(self) -> np.ndarray:
        """Return the z axis of each piece in the root's frame, shape (npiece, 3)."""
        return np.array([mat @ matrix(p.quat)[:, 2] for p, mat in zip(self._pieces, self._mats, strict=True)])

    def _carried_points(self) -> np.ndarray:
        """Return the points [m] on which the object can rest, (n, 3). Pieces grow by their margin minus the least."""
        more = self.margins - self.margins.min()
        if not more.any():
            return np.concatenate(self.points())
        points = []
        for p, mat, at, by in zip(self._pieces, self._mats, self._at, more, strict=True):
            if p.mesh is not None:
                grown = p.mesh.triangles + by * p.mesh.face_normals[:, None]
                points.append(at + grown.reshape(-1, 3) @ mat.T)
        return np.concatenate(points)

    def bottom(self, quat: np.ndarray) -> float:
        """Return the height [m] of the lowest point relative to the root's origin, minus margins. Usually negative."""
        up = matrix(quat)[2:]
        return float((up @ self.center_of_mass - self._height(up))[0])

    def holds(self, quat: np.ndarray) -> bool:
        """Return whether gravity restores a pose after tilts of 1 to `STABLE_TILT` degrees, in 24 directions."""
        return self._comes_back(matrix(quat), _SIDES[0], np.arange(_LEANING, STABLE_TILT + _COARSE, _COARSE))

    def stable(self, where: str) -> list[tuple[np.ndarray, float]]:
        """Return the stable poses on a plane: orientations of the root (wxyz, of heading 0) and their probabilities.

        Poses and probabilities are estimated as in K. Goldberg et al., "Part pose statistics", 1999. A pose is left out
        if the object tips over or rolls after a tilt of at most `STABLE_TILT`. If many small faces form a curved
        bottom, the pose on the lowest face represents the poses on all of them.

        Raises:
            SceneKeyError: No pose is stable, or the centre of mass is outside the hull. The error begins with `where`.
        """
        from trimesh.poses import compute_stable_poses

        hull = _closed_hull(self._carried_points())
        if (((self.center_of_mass - hull.triangles_center) * hull.face_normals).sum(axis=1) >= 0.0).any():
            raise SceneKeyError(
                f"{where}: the centre of mass {np.round(self.center_of_mass, 4).tolist()} m is outside the hull of "
                "the collision geometry, so no pose is stable. Correct the asset's <inertial> or its geoms."
            )
        with np.errstate(divide="ignore", invalid="ignore"):  # faces of the hull without area
            transforms, probability = compute_stable_poses(
                hull, center_mass=self.center_of_mass, sigma=0.0, n_samples=1, threshold=0.0
            )
        kept: list[int] = []
        tilts = np.arange(ROCKING, STABLE_TILT + _STEP, _STEP)
        for i in np.argsort(-probability, kind="stable"):
            if len(kept) == _MOST_POSES or (kept and probability[i] <= _RARE * probability[kept[0]]):
                break
            if all(self._comes_back(transforms[i][:3, :3], sides, tilts) for sides in _SIDES):
                kept.append(int(i))
        regions = self._rocking_regions(transforms[:, :3, :3], probability, kept)
        kept += regions
        probability = probability.copy()
        probability[list(regions)] = list(regions.values())
        if not kept:
            raise SceneKeyError(
                f"{where}: the object is unstable in every pose: a tilt of {STABLE_TILT:g} degrees makes it tip over "
                "or roll, like a ball. Use a yaw or 'any' here, or give it collision geometry with a flat side."
            )
        share = probability[kept] / probability[kept].sum()
        return [(of_heading_zero(transforms[i][:3, :3]), float(p)) for i, p in zip(kept, share, strict=True)]

    def _rocking_regions(self, rotations: np.ndarray, probability: np.ndarray, kept: list[int]) -> dict[int, float]:
        """Group the poses on small faces of a curved bottom into regions. In a region, the object rolls to one pose.

        Args:
            rotations: Orientations in which the object lies on a face, shape (n, 3, 3).
            probability: The probability of each orientation, shape (n,).
            kept: Indices of orientations that are already known to be stable. Regions near them are left out.

        Returns:
            Index of the lowest pose of each region -> the probability of the whole region.
        """
        from scipy.spatial import KDTree

        ups = rotations[:, 2]
        tree, height = KDTree(ups), self._height(ups)
        near = 2.0 * np.sin(0.5 * np.radians(STABLE_TILT))
        around = tree.query_ball_point(ups, near)
        lowest = np.array([min(others, key=lambda i: (height[i], i)) for others in around])
        while (lowest[lowest] != lowest).any():
            lowest = lowest[lowest]
        found = {}
        for i in np.unique(lowest):
            share = float(probability[lowest == i].sum())
            alone = not kept or np.linalg.norm(ups[kept] - ups[i], axis=1).min() > 2.0 * near
            if share > _RARE and alone and all(self._rocks_back(rotations[i], *fine) for fine in _FINER):
                found[int(i)] = share
        return found

    def _rocks_back(self, rotation: np.ndarray, sides: int, step: float) -> bool:
        """Return whether gravity restores a pose on a bottom of many small faces, after tilts of up to `STABLE_TILT`.

        As the object tilts on such a bottom, its centre of mass goes up and down a little. The centre therefore has to
        rise over each interval of `ROCKING` degrees, but not over each step. The tilts end at `STABLE_TILT` plus
        `ROCKING`, so that the centre may also go down a little just below `STABLE_TILT`.

        Args:
            rotation: The pose, shape (3, 3).
            sides: Number of directions of the tilts.
            step: Angle between two tilts [degrees].
        """
        tilts = np.arange(0.0, STABLE_TILT + ROCKING + 0.5 * step, step)
        return self._comes_back(rotation, sides, tilts, round(ROCKING / step))

    def _comes_back(self, rotation: np.ndarray, sides: int, degrees: np.ndarray, span: int = 1) -> bool:
        """Return whether gravity restores a pose after all of the given tilts.

        This is so if, after each tilt, the centre of mass is higher above the lowest point than `span` tilts before.

        Args:
            rotation: The pose, shape (3, 3).
            sides: Number of directions of the tilts.
            degrees: The tilts [degrees], in ascending order. The pose is tilted by each angle in each direction.
            span: Number of steps in `degrees` over which the height should increase.
        """
        if len(degrees) > 2 * span + 2 and not self._comes_back(rotation, sides, degrees[-span - 1 :], span):
            return False  # the largest tilts are tested first, because they reject most faces
        angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
        across = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1) @ rotation
        tilts = np.radians(degrees)[:, None, None]
        up = np.cos(tilts) * rotation[2] + np.sin(tilts) * across
        height = self._height(up.reshape(-1, 3)).reshape(len(tilts), sides)
        return bool((height[span:] - height[:-span] > _LEAST_RISE).all())

    def _height(self, up: np.ndarray) -> np.ndarray:
        """Return the height [m] of the centre of mass above the lowest point, (n,), for each up direction (n, 3)."""
        return up @ self.center_of_mass - self.lowest(up)

    def lowest(self, up: np.ndarray) -> np.ndarray:
        """Return the height [m] of the lowest point minus margins, (n,), for up directions (n, 3) in the root frame."""
        lowest = np.full(len(up), np.inf)
        for p, mat, at, margin in zip(self._pieces, self._mats, self._at, self.margins, strict=True):
            lowest = np.minimum(lowest, p.extents(up @ mat)[0] + up @ at - margin)
        return lowest


def _closed_hull(points: np.ndarray) -> trimesh.Trimesh:
    """Return a closed convex hull of points (n, 3). If the hull has holes, round the points, and compute it again."""
    hull, size = convex_hull(points), float(np.ptp(points, axis=0).max())
    for share in _ROUND:
        if hull.is_watertight:
            break
        hull = convex_hull(np.unique(np.round(points / (share * size)), axis=0) * (share * size))
    return hull


def weights(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the mass [kg] of each body, less the fraction that `gravcomp` compensates, shape (nbody,)."""
    return mjm.body_mass * (1.0 - mjm.body_gravcomp)


def _center_of_weight(home: mujoco.MjData, root: int) -> np.ndarray:
    """Return the centre of mass [m] of a body and its descendants. Each mass is reduced as in `weights`."""
    mjm = home.model
    inside = mjm.body_rootid == root
    weight = weights(mjm)[inside]
    if not mjm.body_gravcomp[inside].any() or weight.sum() <= 0.0:
        return home.subtree_com[root]
    return weight @ home.xipos[inside] / weight.sum()


def heading_of(mat: np.ndarray) -> float:
    """Return the heading [rad] of a body with orientation `mat` (3, 3): the angle of its x axis, seen from above.

    If the x axis points straight up or down, the heading is the direction of the y axis minus a right angle.
    """
    if np.abs(mat[:2, 0]).sum() < _UPRIGHT:
        return float(np.arctan2(-mat[0, 1], mat[1, 1]))
    return float(np.arctan2(mat[1, 0], mat[0, 0]))


def of_heading_zero(mat: np.ndarray) -> np.ndarray:
    """Rotate the orientation `mat`, shape (3, 3), about the vertical to heading 0. Return a quaternion, wxyz."""
    back = -heading_of(mat)
    rotation = np.array([[np.cos(back), -np.sin(back), 0.0], [np.sin(back), np.cos(back), 0.0], [0.0, 0.0, 1.0]])
    return quaternion(rotation @ mat)
