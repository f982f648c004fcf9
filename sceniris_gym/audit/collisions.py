"""Checks the distances between solids: missed collisions of layouts, and false alarms among rejected candidates."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement, product

import mujoco
import numpy as np

from sceniris_gym.audit.distance import Narrow
from sceniris_gym.audit.geometry import Form, Poses, Rows, Solid

WORLD = "world"


@dataclass(frozen=True)
class Judged:
    """A pair of solids that must be apart.

    Attributes:
        first, second: Indices into the list of solids.
        clearance: Least allowed distance between the solids [m]. It does not apply if one supports the other.
        owners: Names of the objects that own the solids. For two parts of one object, the same name twice.
        margin: Distance [m] at which MuJoCo's contact of the pair starts to act.
    """

    first: int
    second: int
    clearance: float
    owners: tuple[str, str]
    margin: float = 0.0


class Tree:
    """Owners of the bodies of a model, and the bodies that a layout can move.

    Args:
        mjm: The model.
        bodies: Object name -> root body id. A body outside all objects belongs to the top-level body above it.
        keyframe: The keyframe of the start pose, None for 'home'.
    """

    def __init__(self, mjm: mujoco.MjModel, bodies: Mapping[str, int], keyframe: str | None = None) -> None:
        roots = {body: name for name, body in bodies.items()}
        self.mjm, self.keyframe = mjm, keyframe
        self.owner: list[str] = [WORLD]
        self.fixture = mjm.body_mocapid[mjm.body_rootid] >= 0
        self.movable = self.fixture | (mjm.body_weldid != 0)
        for body in range(1, mjm.nbody):
            parent = mjm.body_parentid[body]
            inherited = self.owner[parent] if parent else mjm.body(body).name or f"body {body}"
            self.owner.append(roots.get(body, inherited))


class JudgedPairs:
    """The pairs of solids that a layout must keep apart, by the two objects that own them.

    MuJoCo's `<pair>` and `<exclude>` apply. With "physics", contact bits also apply. Two bodies that no layout moves
    are not judged. Fixtures must be apart from each other and from the static scene, although MuJoCo reports no
    contacts between them. Parts of one object are only judged if layouts draw the object's joints.

    Args:
        tree: Owners of the bodies.
        solids: The solids of the model.
        geometry: "physics" or "visual".
        clearances: Clearance [m] of each placed object. A pair keeps the larger clearance.
        jointed: Names of the objects whose joints are drawn.
        at_home: Pairs of geoms that touch in the start pose, the lower id first. These pairs are left out, because
            `ContactAudit` judges them. With "visual", all geoms of two bodies are left out if any two of them touch.
        placed: Names of the objects that layouts place, None for all. Two objects that are not placed keep no
            clearance. If their joints are not drawn either, the objects never leave the start pose. They are left out,
            because `ContactAudit` judges them.

    Attributes:
        of: Owner -> indices of its solids.
        clearances: As above.
    """

    def __init__(
        self,
        tree: Tree,
        solids: list[Solid],
        geometry: str,
        clearances: Mapping[str, float],
        jointed: Collection[str] = (),
        at_home: Collection[tuple[int, int]] = (),
        placed: Collection[str] | None = None,
    ) -> None:
        mjm = tree.mjm
        self.tree, self.solids, self.geometry, self.clearances = tree, solids, geometry, clearances
        self._jointed, self._at_home, self._placed = jointed, at_home, placed
        self._moved = None if placed is None else {*placed, *jointed}
        self._bits, self._body = (mjm.geom_contype.tolist(), mjm.geom_conaffinity.tolist()), mjm.geom_bodyid.tolist()
        self._margins, self._excludes = mjm.geom_margin.tolist(), {*mjm.exclude_signature.tolist()}
        pairs = zip(mjm.pair_geom1, mjm.pair_geom2, mjm.pair_margin, strict=True)
        self._explicit = {frozenset(pair): float(margin) for *pair, margin in pairs}
        visual = at_home if geometry == "visual" else ()
        self._touching = {frozenset(mjm.geom_bodyid[list(geoms)].tolist()) for geoms in visual}
        self._found: dict[tuple[str, str], list[Judged]] = {}
        self.of: dict[str, list[int]] = {}
        for i, solid in enumerate(solids):
            self.of.setdefault(tree.owner[self._body[solid.geom]], []).append(i)

    def __iter__(self) -> Iterator[Judged]:
        """Yield all pairs."""
        for owners in combinations_with_replacement(self.of, 2):
            yield from self.between(*owners)

    def between(self, one: str, other: str) -> list[Judged]:
        """Return the pairs of two objects, or of the parts of one object."""
        if (one, other) not in self._found:
            still = one == other and one not in self._jointed
            still |= self._moved is not None and not self._moved.intersection((one, other))
            pairs = {tuple(sorted(pair)) for pair in product(self.of[one], self.of[other]) if pair[0] != pair[1]}
            judged = [self._judged(*pair) for pair in sorted(pairs)] if not still else []
            self._found[one, other] = [pair for pair in judged if pair is not None]
        return self._found[one, other]

    def _judged(self, first: int, second: int) -> Judged | None:
        """Return a pair of solids if a layout must keep it apart."""
        tree, (g, h) = self.tree, (self.solids[i].geom for i in (first, second))
        body1, body2 = self._body[g], self._body[h]
        owners = tree.owner[body1], tree.owner[body2]
        own = owners[0] == owners[1]
        if not (tree.movable[body1] or tree.movable[body2]):
            return None
        if (g, h) in self._at_home or frozenset((body1, body2)) in self._touching:
            return None
        margin = self._explicit.get(frozenset((g, h)))
        if margin is None:
            excluded = (min(body1, body2) << 16) + max(body1, body2) in self._excludes
            contype, conaffinity = self._bits
            bits = contype[g] & conaffinity[h] | contype[h] & conaffinity[g]
            if excluded or (self.geometry == "physics" and not bits):
                return None
            if (own or not (tree.fixture[body1] or tree.fixture[body2])) and _filtered(tree.mjm, body1, body2):
                return None
            margin = self._margins[g] + self._margins[h]
        keeps = not own and (self._placed is None or bool({*owners} & {*self._placed}))
        clearance = max(self.clearances.get(owner, 0.0) for owner in owners) if keeps else 0.0
        return Judged(first, second, clearance, owners, margin if self.geometry == "physics" else 0.0)


def _filtered(mjm: mujoco.MjModel, body1: int, body2: int) -> bool:
    """Return whether MuJoCo skips contacts of two bodies, because they are welded together, or are parent and child."""
    weld1, weld2 = mjm.body_weldid[body1], mjm.body_weldid[body2]
    if weld1 == weld2:
        return True
    if mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT:
        return False
    parent1, parent2 = (mjm.body_weldid[mjm.body_parentid[w]] for w in (weld1, weld2))
    return bool(weld1 != 0 and weld2 != 0 and (weld1 == parent2 or weld2 == parent1))


MISSED_TOLERANCE = 1e-5  # m, a layout may be this much nearer than its clearance
POLYHEDRON_TOLERANCE = 1e-5  # m, a rejected candidate may be this much farther than its clearance
CURVED_TOLERANCE = 1e-4  # m, the same for pairs with a sphere, capsule, cylinder or ellipsoid


@dataclass(frozen=True)
class Conflict:
    """Two solids that are nearer than their clearance.

    Attributes:
        row: The layout.
        geoms: Ids of the two geoms.
        owners: Names of the two objects.
        distance: Distance [m], at most 0 if the surfaces cross, minus infinity if one solid is inside the other.
        clearance: Required distance [m]. Negative if the geoms may penetrate, because they do in the start pose.
    """

    row: int
    geoms: tuple[int, int]
    owners: tuple[str, str]
    distance: float
    clearance: float


@dataclass(frozen=True)
class FalseAlarm:
    """A candidate that was rejected for collision although it keeps all clearances.

    Attributes:
        row: Index of the candidate.
        owners: Owners of the nearest pair of solids. None if the candidate is in no pair.
        surplus: Distance of this pair beyond its clearance [m]. Infinite if there is no pair.
    """

    row: int
    owners: tuple[str, str] | None
    surplus: float


class CollisionAudit:
    """Exact pairwise collision checks of layouts.

    Args:
        tree: Owners of the bodies.
        solids: The solids of the model.
        pairs: The pairs of solids that must be apart.
    """

    def __init__(self, tree: Tree, solids: list[Solid], pairs: JudgedPairs) -> None:
        self.tree, self.solids, self.pairs = tree, solids, pairs
        self._narrow = Narrow(solids)
        self._body = [int(tree.mjm.geom_bodyid[s.geom]) for s in solids]
        self._reach = [float(np.linalg.norm(s.center) + np.linalg.norm(s.half)) for s in solids]

    def missed(self, poses: Poses, supporting: Rows, there: Rows) -> list[Conflict]:
        """Return all pairs of solids that are nearer than their clearance.

        An object may touch the body that supports it, but not intersect it. FCL returns no penetration depth for
        meshes. This test therefore raises the object by the tolerance: if both still touch, they intersect.

        Args:
            poses: World poses of the rows.
            supporting: Object name -> id of the supporting body in each row, shape (nrow,), -1 without support.
            there: Object name -> mask of the rows with the object, shape (nrow,).
        """
        conflicts = []
        spheres = {owner: self._spheres(solids, poses) for owner, solids in self.pairs.of.items()}
        wholes = {owner: around(*found) for owner, found in spheres.items()}
        for owners, rows in self._together(there, len(poses.xpos)):
            near = MISSED_TOLERANCE + max(self.pairs.clearances.get(owner, 0.0) for owner in owners)
            (one, radius), (other, size) = (wholes[owner] for owner in owners)
            apart = np.linalg.norm(one[rows] - other[rows], axis=1) - radius[rows] - size[rows]
            rows = rows[apart < near]
            if not len(rows):
                continue
            (ones, radii), (others, sizes) = (spheres[owner] for owner in owners)
            apart = np.linalg.norm(ones[rows, :, None] - others[rows, None], axis=3).min(axis=0)
            first, second = (np.array(self.pairs.of[owner]) for owner in owners)
            i, j = np.nonzero(apart - radii[:, None] - sizes < near)
            close = {frozenset(pair) for pair in zip(first[i].tolist(), second[j].tolist(), strict=True)}
            for pair in self.pairs.between(*owners):
                if frozenset((pair.first, pair.second)) in close:
                    conflicts += self._missed(pair, poses, supporting, rows)
        return sorted(conflicts, key=lambda c: (c.row, c.geoms))

    def _missed(self, pair: Judged, poses: Poses, supporting: Rows, rows: np.ndarray) -> list[Conflict]:
        """Return the conflicts of one pair in some rows."""
        bound, lifted = self._lower_bound(pair, poses, rows), self._lifted(pair, supporting, rows)
        clearance = np.where(lifted != 0, 0.0, pair.clearance)
        allowed = clearance - MISSED_TOLERANCE
        if self._over_halfspace(pair) is not None:
            found = [(i, bound[i]) for i in np.flatnonzero(bound < allowed)]
        else:
            near = np.flatnonzero(bound < np.where(lifted != 0, MISSED_TOLERANCE, allowed))
            exact = [(i, self._exact(pair, poses, int(rows[i]), lifted[i])) for i in near]
            found = [(i, d) for i, d in exact if (d <= 0 if lifted[i] else d < allowed[i])]
        return [Conflict(int(rows[i]), self._geoms(pair), pair.owners, float(d), float(clearance[i])) for i, d in found]

    def _together(self, there: Rows, nrow: int) -> Iterator[tuple[tuple[str, str], np.ndarray]]:
        """Yield two owners of solids, or one owner twice, and the rows that have both, unless there are none."""
        names = [*self.pairs.of]
        masks = np.array([there.get(name, np.ones(nrow, bool)) for name in names])
        for i, j in zip(*np.triu(masks.astype(int) @ masks.T.astype(int)).nonzero(), strict=True):
            yield (names[i], names[j]), np.flatnonzero(masks[i] & masks[j])

    def _spheres(self, solids: list[int], poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Return spheres around n solids in each row: centres [m], shape (nrow, n, 3), and radii, shape (n,)."""
        geoms = [self.solids[i].geom for i in solids]
        offsets = np.array([self.solids[i].center for i in solids])
        centers = poses.geom_xpos[:, geoms] + np.einsum("ngij,gj->ngi", poses.geom_xmat[:, geoms], offsets)
        return centers, np.array([np.linalg.norm(self.solids[i].half) for i in solids])

    def false_alarms(
        self, poses: Poses, supporting: Rows, candidate: np.ndarray, rank: Mapping[str, int], there: Rows
    ) -> list[FalseAlarm]:
        """Return the rejected candidates whose distances all exceed the clearance by more than the tolerance.

        Args:
            poses: World poses of the rows, with each candidate at its rejected pose.
            supporting: Object name -> id of the supporting body in each row, shape (nrow,), -1 without support.
            candidate: Name of the rejected object in each row, shape (nrow,).
            rank: Placed object -> its number in placement order. Objects after the candidate are ignored.
            there: Object name -> mask of the rows with the object, shape (nrow,).
        """
        free = np.ones(len(candidate), bool)
        nearest = [FalseAlarm(row, None, np.inf) for row in range(len(candidate))]
        for owners, both in self._together(there, len(candidate)):
            taking = both[takes_part(owners, candidate[both], rank)]
            for pair in self.pairs.between(*owners) if len(taking) else ():
                taking = taking[free[taking]]
                if not len(taking):
                    break
                self._raise_alarms(pair, poses, supporting, taking, free, nearest)
        return [nearest[row] for row in np.flatnonzero(free)]

    def _raise_alarms(
        self,
        pair: Judged,
        poses: Poses,
        supporting: Rows,
        rows: np.ndarray,
        free: np.ndarray,
        nearest: list[FalseAlarm],
    ) -> None:
        """Update for one pair the rows that are `free` of collisions, and the `nearest` pair of each row."""
        kept = max(pair.clearance, pair.margin)
        required = np.where(self._lifted(pair, supporting, rows) != 0, 0.0, kept)
        surplus = self._lower_bound(pair, poses, rows) - required
        forms = {self.solids[i].form for i in (pair.first, pair.second)}
        tolerance = POLYHEDRON_TOLERANCE if forms <= {Form.POLYHEDRON, Form.HALFSPACE} else CURVED_TOLERANCE
        for i, row in enumerate(rows.tolist()):
            if surplus[i] <= max(nearest[row].surplus, tolerance) and self._over_halfspace(pair) is None:
                surplus[i] = self._exact(pair, poses, row, 0) - required[i]
            if surplus[i] < nearest[row].surplus:
                nearest[row] = FalseAlarm(row, pair.owners, float(surplus[i]))
        free[rows] = surplus > tolerance

    def _lifted(self, pair: Judged, supporting: Rows, rows: np.ndarray) -> np.ndarray:
        """Return for each row: 1 if the first solid stands on the second solid's body, 2 for the reverse, else 0."""
        lifted = np.zeros(len(rows), int)
        for side, (solid, other) in enumerate(((pair.first, pair.second), (pair.second, pair.first)), start=1):
            owner = self.tree.owner[self._body[solid]]
            if owner in supporting:
                lifted[supporting[owner][rows] == self._body[other]] = side
        return lifted

    def _over_halfspace(self, pair: Judged) -> int | None:
        """If one solid of a pair is a half-space, return the index of the other solid. Otherwise return None."""
        if self.solids[pair.first].form is Form.HALFSPACE:
            return pair.second
        return pair.first if self.solids[pair.second].form is Form.HALFSPACE else None

    def _geoms(self, pair: Judged) -> tuple[int, int]:
        return self.solids[pair.first].geom, self.solids[pair.second].geom

    def _lower_bound(self, pair: Judged, poses: Poses, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Return a lower bound of the distance [m] in each row: exact for half-spaces, else from spheres or boxes."""
        geoms = self._geoms(pair)
        pos = [poses.geom_xpos[rows, g] for g in geoms]
        mat = [poses.geom_xmat[rows, g] for g in geoms]
        above = self._over_halfspace(pair)
        if above is not None:
            over, plane = (0, 1) if above == pair.first else (1, 0)
            normal = mat[plane][:, :, 2]
            height = np.einsum("ni,ni->n", pos[over] - pos[plane], normal)
            return height + self.solids[above].lowest(np.einsum("nij,ni->nj", mat[over], normal))
        # spheres around the frames settle most pairs of a large scene, at a tenth of the boxes' time
        apart = np.linalg.norm(pos[1] - pos[0], axis=1) - self._reach[pair.first] - self._reach[pair.second]
        if apart.min(initial=1.0) > 0.0:
            return apart
        return _box_gap(self.solids[pair.first], self.solids[pair.second], pos, mat)

    def _exact(self, pair: Judged, poses: Poses, row: int, lifted: int) -> float:
        """Return the distance [m] of a pair in a row, with the first or second solid raised if `lifted` is 1 or 2."""
        first, second = (
            (poses.geom_xpos[row, geom] + [0.0, 0.0, MISSED_TOLERANCE * (side == lifted)], poses.geom_xmat[row, geom])
            for side, geom in enumerate(self._geoms(pair), start=1)
        )
        return self._narrow.distance(pair.first, pair.second, first, second)


def around(centers: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a sphere around n spheres in each row: centres [m], shape (nrow, 3), and radii, shape (nrow,)."""
    middle = centers.mean(axis=1)
    return middle, (np.linalg.norm(centers - middle[:, None], axis=2) + radii).max(axis=1)


def takes_part(owners: tuple[str, str], candidate: np.ndarray, rank: Mapping[str, int]) -> np.ndarray:
    """Return a mask of the rows where one owner is the candidate, and the other was placed before it, shape (nrow,).

    A pair of two parts of the candidate also counts.

    Args:
        owners: Names of the two objects.
        candidate: Name of the candidate in each row, shape (nrow,).
        rank: Placed object -> its number in placement order. All other objects count as placed before the candidate.
    """
    mine = [candidate == owner for owner in owners]
    if owners[0] == owners[1]:
        return mine[0]
    ranks = np.array([rank[name] for name in candidate])
    there = [rank.get(owner, -1) < ranks for owner in owners]
    return (mine[0] & there[1]) | (mine[1] & there[0])


def _box_gap(first: Solid, second: Solid, pos: list[np.ndarray], mat: list[np.ndarray]) -> np.ndarray:
    """Return the largest separation [m] of two oriented boxes along their six face normals, shape (nrow,)."""
    centers = [p + m @ s.center for p, m, s in zip(pos, mat, (first, second), strict=True)]
    relative = np.abs(np.einsum("nij,nik->njk", mat[0], mat[1]))
    offset = centers[1] - centers[0]
    along1 = np.abs(np.einsum("ni,nij->nj", offset, mat[0])) - first.half - relative @ second.half
    along2 = np.abs(np.einsum("ni,nij->nj", offset, mat[1])) - second.half - np.swapaxes(relative, 1, 2) @ first.half
    return np.maximum(along1.max(1), along2.max(1))
