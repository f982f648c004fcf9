"""Builds reachability maps: finds which TCP poses on a grid are reached, and the surface around the reached region.

First, inverse kinematics labels each corner of the grid with the base and wrist rotations that reach it. Then the
solutions of each corner are tried at its neighbours. Finally, bisection finds where the surface crosses grid edges.
This is done for the grid over (z, u, tilt, v), and for a table over (z, radius) for each pole. A pole is an approach
axis straight up or down. Inverse kinematics runs on the device in large batches. All other work is NumPy on the host.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from sceniris_gym.errors import ArmError, MapError
from sceniris_gym.progress import tell
from sceniris_gym.reach.arm import SerialArm, rotate
from sceniris_gym.reach.checkpoint import Checkpoint
from sceniris_gym.reach.labels import ALL_TURNS, Labeller
from sceniris_gym.reach.map import ReachMap, pack
from sceniris_gym.reach.measures import gather_witnesses, measure_false_accepts, tcp_axes
from sceniris_gym.reach.solve import random_joints

STEP = 0.025
"""Smallest default step of the grid [m]. For a large arm, the step is its reach divided by 44, so that the map stays
below 16 MB."""
TILT_STEP = math.radians(2.5)
STARTS = 64
"""Random starts per corner. For a Panda, 200 starts reach the same corners as 64, and 16 starts miss one in 700."""

_STEPS_OF_REACH = 44
_POLE_STEPS = 5  # steps of the poles' tables per step of the grid
_NEAR_STARTS = 32  # additional random starts for corners with a neighbour that is reached in more rotations
_EDGE_STARTS = 16  # random starts for points on an edge, in addition to the solution at its reached end
_PASSES = 10
_FEWEST_STEPS, _MOST_STEPS = 2, 10_000  # steps of the grid within the arm's reach
_LEAST_TILT, _MOST_TILT = math.radians(0.01), math.radians(90.0)
_HALVINGS = 4  # bisections of an edge that the surface crosses: they find the distance to 1/32 of a step
_MOST_CORNERS = 2**29  # keeps addresses within 32 bits, and joints within 16 GB during a build
_FULL = 255  # label of a corner that is reached in every rotation
_HALF = 128
_FAR = 255  # distance of a corner if the surface does not cross any of its edges


@dataclass(frozen=True)
class Lattice:
    """Corners of a map's grid, or of one of its two tables for the poles (approach axis straight up or straight down).

    All TCP positions of the arm are in a ball around a point of its first axis. Corners outside the ball are never
    reached.

    Attributes:
        shape: Number of corners along each axis: (z, u, tilt, v) for the grid, (z, radius) for a pole's table.
        low, step: Coordinates of the first corner, and steps, both as (z, tilt, u, v) [m, rad], shape (4,).
        order: For each axis, the index of its coordinate in (z, tilt, u, v). A radius counts as u.
        height, radius: z of the ball's centre, and radius of the ball [m].
    """

    shape: tuple[int, ...]
    low: np.ndarray
    step: np.ndarray
    order: tuple[int, ...]
    height: float
    radius: float

    @property
    def strides(self) -> np.ndarray:
        """Change of a corner's index per step along each axis."""
        return np.cumprod([1, *self.shape[:0:-1]])[::-1]

    def coords(self, corner: np.ndarray) -> np.ndarray:
        """Return (z, tilt, u, v) [m, rad] of corners, shape (N, 4)."""
        coords = np.tile(self.low, (len(corner), 1))
        for axis, index in zip(self.order, np.unravel_index(corner, self.shape), strict=True):
            coords[:, axis] += self.step[axis] * index
        return coords

    @cached_property
    def inside(self) -> np.ndarray:
        """Indices of the corners inside the ball."""
        middle, squares = np.array([self.height, 0.0, 0.0, 0.0]), np.zeros(self.shape)
        for c, index in zip(self.order, np.indices(self.shape, sparse=True), strict=True):
            if c != 1:  # a tilt is no distance
                squares += (self.low[c] + self.step[c] * index - middle[c]) ** 2
        return np.flatnonzero(squares <= self.radius**2)

    def neighbours(self, corner: np.ndarray) -> np.ndarray:
        """Return the indices of the two neighbours along each axis, -1 beyond the border, shape (N, 2 * naxis)."""
        found = []
        for index, n, stride in zip(np.unravel_index(corner, self.shape), self.shape, self.strides, strict=True):
            found += [np.where(index > 0, corner - stride, -1), np.where(index < n - 1, corner + stride, -1)]
        return np.stack(found, axis=1)


class LabelledGrid:
    """The label of each corner of a lattice, and the corner's distance from the surface around the reached region.

    Attributes:
        level: The labels. A label is the fraction of base and wrist rotations at which the arm reaches a corner, from 0
            (none) to 255 (all), shape (N,), uint8.
        distance: Distance from a corner to the surface along the nearest edge that the surface crosses, in 1/32 of a
            step. 255 if the surface crosses no edge of the corner. Shape (N,), uint8.
        joints: Joint positions that reach a corner, 0 for corners that are not reached, shape (N, njoint), float16.
    """

    def __init__(self, name: str, lattice: Lattice, labeller: Labeller, njoint: int, batch: int) -> None:
        self.name, self.lattice, self._labeller, self._batch = name, lattice, labeller, batch
        n = math.prod(lattice.shape)
        self.level = np.zeros(n, np.uint8)
        self.distance = np.full(n, _FAR, np.uint8)
        self.joints = np.zeros((n, njoint), np.float16)

    def solve(self, checkpoint: Checkpoint) -> None:
        """Run all stages that are not finished in the checkpoint."""
        arrays = {f"{self.name}_{key}": getattr(self, key) for key in ("level", "distance", "joints")}
        batches = -(-len(self.lattice.inside) // self._batch)
        for stage in (self._label, self._spread, self._bisect):
            task = f"{self.name}{stage.__name__}"
            if checkpoint.enter(task, arrays, batches * self._batch):
                stage(checkpoint)
                checkpoint.leave(task)

    def _label(self, checkpoint: Checkpoint) -> None:
        """Label every corner inside the ball by inverse kinematics from random starts."""
        for corner in self._batches(self.lattice.inside, "corners", checkpoint.done):
            self._raise(corner, *self._labeller.label(self.lattice.coords(corner), count=STARTS))
            checkpoint.reached(checkpoint.done + self._batch)

    def _spread(self, checkpoint: Checkpoint) -> None:
        """Label corners again, from solutions of neighbours with a higher label, until no label changes.

        At most `_PASSES` passes are made.
        """
        shape = self.lattice.shape
        changed = self.level > 0
        for number in range(_PASSES):
            beside = np.zeros(shape, bool)
            for axis in range(len(shape)):
                level, risen, marked = (np.moveaxis(a.reshape(shape), axis, 0) for a in (self.level, changed, beside))
                marked[1:] |= risen[:-1] & (level[:-1] > level[1:])
                marked[:-1] |= risen[1:] & (level[1:] > level[:-1])
            front = np.flatnonzero(beside)
            changed = np.zeros(len(self.level), bool)
            for corner in self._batches(front, f"neighbours, pass {number + 1}"):
                warm = self._joints_of(self.lattice.neighbours(corner))
                found = self._labeller.label(self.lattice.coords(corner), warm, first=STARTS, count=_NEAR_STARTS)
                changed[self._raise(corner, *found)] = True
            if not changed.any():
                break

    def _bisect(self, checkpoint: Checkpoint) -> None:
        """Find by bisection where the surface crosses the edges between corners, and set `distance`."""
        half = (self.level >= _HALF).reshape(self.lattice.shape)
        for axis, stride in enumerate(self.lattice.strides):
            along = np.moveaxis(half, axis, 0)
            crossed = np.zeros(half.shape, bool)
            np.moveaxis(crossed, axis, 0)[:-1] = along[1:] != along[:-1]
            what = f"surface along {('z', 'tilt', 'u', 'v')[self.lattice.order[axis]]}"
            for corner in self._batches(np.flatnonzero(crossed), what):
                at_share = self._crossing(corner, corner + stride, self.lattice.order[axis])
                for end, share in ((corner, at_share), (corner + stride, 1.0 - at_share)):
                    self.distance[end] = np.minimum(self.distance[end], np.round(32.0 * share).astype(np.uint8))

    def _batches(self, corner: np.ndarray, what: str, first: int = 0) -> Iterator[np.ndarray]:
        """Yield corners in batches, starting at position `first`, and report progress after each batch."""
        for at in range(first, len(corner), self._batch):
            yield corner[at : at + self._batch]
            tell(f"{self.name}: {what}", min(at + self._batch, len(corner)), len(corner))

    def _crossing(self, low: np.ndarray, high: np.ndarray, coordinate: int) -> np.ndarray:
        """Return where the surface crosses each edge from corner `low` to corner `high`, from 0 to 1, shape (N,)."""
        reached = self.level[low] >= _HALF
        warm = np.where(reached[:, None], self.joints[low], self.joints[high]).astype(np.float32)
        start = self.lattice.coords(low)
        lower, upper = np.zeros(len(low)), np.ones(len(low))
        for _ in range(_HALVINGS):
            middle = 0.5 * (lower + upper)
            point = start.copy()
            point[:, coordinate] += middle * self.lattice.step[coordinate]
            count, joints = self._labeller.label(point, warm[:, None], count=_EDGE_STARTS)
            here = 2 * count >= ALL_TURNS
            warm = np.where(here[:, None], joints[:, : warm.shape[1]], warm)
            lower, upper = np.where(here == reached, middle, lower), np.where(here == reached, upper, middle)
        return 0.5 * (lower + upper)

    def _raise(self, corner: np.ndarray, count: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Store labels and joints of corners whose new label is higher than the stored label. Return these corners.

        `count` has the number of rotations at which the arm reaches each corner.
        """
        level = np.where(count == 0, 0, np.maximum(1, count * _FULL // ALL_TURNS)).astype(np.uint8)
        better = level > self.level[corner]
        risen = corner[better]
        self.level[risen] = level[better]
        self.joints[risen] = joints[better, : self.joints.shape[1]]
        return risen

    def _joints_of(self, corner: np.ndarray) -> np.ndarray:
        """Return stored joint positions that reach corners, by index. NaN for index -1 and for corners out of reach."""
        there = (corner >= 0) & (self.level[corner] > 0)
        return np.where(there[..., None], self.joints[corner], np.float16(np.nan)).astype(np.float32)

    def codes(self) -> np.ndarray:
        """Return the code of each corner, as in `map.CODE_VALUES`, in the shape of the lattice, uint8."""
        level, distance = np.ogrid[:256, :256]  # a table of all pairs, because a lattice has millions of corners
        fifth = np.minimum(distance * 5 // 32, 5)  # 5 without a crossing
        near = distance < 16
        some = np.where(level < _HALF, np.where(near, 7, 6), np.where(near, 8, 9))
        table = np.where(level == 0, 5 - fifth, np.where(level == _FULL, 10 + fifth, some)).astype(np.uint8)
        return table[self.level, self.distance].reshape(self.lattice.shape)


def build_map(
    arm: SerialArm,
    device: str,
    *,
    step: float | None = None,
    tilt_step: float = TILT_STEP,
    seed: int = 0,
    state: Path | None = None,
) -> ReachMap:
    """Build the reachability map of an arm, and report progress.

    Args:
        arm: The arm, with a vertical first axis and the TCP on its last axis.
        device: Warp's name of the device. A full map takes 5 to 13 s on an NVIDIA H200, and hours on a CPU core.
        step: Step of the grid along z, u and v [m]. By default STEP, or more for an arm with a reach above 1.1 m.
        tilt_step: Step of the grid along tilt [rad], rounded so that it divides 180 degrees.
        seed: Seed of the random joint positions from which inverse kinematics starts.
        state: File for the build's progress, or None. If the file exists, the build resumes from it.

    Raises:
        ArmError: The arm cannot have a map. The message gives the reason.
        MapError: `state` belongs to a different build, or a step is out of range.
    """
    if arm.no_map is not None:
        raise ArmError(f"{arm.name} cannot have a reachability map: {arm.no_map}. Use `reachable: ik` with this arm.")
    height, radius = reach_ball(arm, device, seed)
    step = max(STEP, radius / _STEPS_OF_REACH) if step is None else step
    if not (step > 0.0 and tilt_step > 0.0):
        raise MapError(f"map of {arm.name}: steps should be positive, got {step:g} m and {tilt_step:g} rad.")
    least, most = radius / _MOST_STEPS, radius / _FEWEST_STEPS
    if not (least <= step <= most and _LEAST_TILT <= tilt_step <= _MOST_TILT):
        raise MapError(
            f"map of {arm.name}: the step should be from {least:.2g} to {most:.2g} m for a reach of {radius:.2f} m, "
            f"got {step:g} m. The tilt step should be from {math.degrees(_LEAST_TILT):g} to "
            f"{math.degrees(_MOST_TILT):g} degrees, got {math.degrees(tilt_step):g}."
        )
    grid, poles = lattices(height, radius, step, tilt_step)
    if math.prod(grid.shape) > _MOST_CORNERS:
        raise MapError(
            f"map of {arm.name}: the grid should have at most {_MOST_CORNERS:g} corners, got "
            f"{' x '.join(map(str, grid.shape))}. Use larger steps than {step:g} m and {math.degrees(tilt_step):g} "
            "degrees."
        )
    labeller = Labeller(arm, device, starts=STARTS + _NEAR_STARTS, seed=seed)
    batch = 1 << (18 if device.startswith("cuda") else 12)
    checkpoint = Checkpoint(state, f"{arm.hash} {grid.shape} {grid.step.tolist()} {seed}")
    named = {"grid": grid, "pole0": poles[0], "pole1": poles[1]}
    surfaces = [LabelledGrid(name, lattice, labeller, len(arm.joints), batch) for name, lattice in named.items()]
    for surface in surfaces:
        surface.solve(checkpoint)
    first = surfaces[0]
    rows, codes = pack_rows(first.codes())
    cells, joints = gather_witnesses(grid.shape, first.level, first.joints)
    built = ReachMap(
        arm=arm,
        step=step,
        tilt_step=float(grid.step[1]),
        z_low=float(grid.low[0]),
        u_low=float(grid.low[2]),
        nz=grid.shape[0],
        ntilt=grid.shape[2],
        nu=grid.shape[1],
        rows=rows,
        codes=codes,
        pole_step=float(poles[0].step[0]),
        pole_z_low=float(poles[0].low[0]),
        poles=np.stack([surface.codes() for surface in surfaces[1:]]),
        wit_cells=cells,
        wit_joints=joints,
        turn_error=max(map(turn_error, surfaces)),
        seed=seed,
    )
    return replace(built, false_accepts=measure_false_accepts(built, device))


def lattices(height: float, radius: float, step: float, tilt_step: float) -> tuple[Lattice, tuple[Lattice, Lattice]]:
    """Return the grid and the tables of both poles, around the ball of `reach_ball`."""
    half = math.ceil(radius / step) + 1
    ntilt = max(2, round(math.pi / tilt_step) + 1)
    tilt = math.pi / (ntilt - 1)
    n = 2 * half + 1
    low = np.array([height - half * step, 0.0, -half * step, -half * step])
    grid = Lattice((n, n, ntilt, n), low, np.array([step, tilt, step, step]), (0, 2, 1, 3), height, radius)
    fine = step / _POLE_STEPS
    half = math.ceil(radius / fine) + 1
    steps = np.array([fine, 0.0, fine, 0.0])
    up, down = (
        Lattice((2 * half + 1, half + 1), np.array([height - half * fine, t, 0.0, 0.0]), steps, (0, 2), height, radius)
        for t in (0.0, math.pi)
    )
    return grid, (up, down)


def reach_ball(arm: SerialArm, device: str, seed: int = 0) -> tuple[float, float]:
    """Return the centre and the radius of a ball that contains all TCP positions of the arm.

    The centre is on the first axis, at the height of the second joint. A random search finds the radius: it starts
    from many joint positions, and repeatedly changes the best 256 (with the farthest TCP) at random. The radius
    includes a margin of 1 cm.

    Returns:
        Height of the centre [m], and radius [m].
    """
    height = float(arm.link_pos[0, 2] + rotate(arm.link_pos[1], arm.link_quat[0])[2])
    centre = np.array([*arm.axis_xy, height])
    draws = np.random.default_rng(seed)
    joints, scale = random_joints(arm, 65_536, seed), 1.0

    def reaches() -> np.ndarray:
        return np.linalg.norm(tcp_axes(arm, joints, device)[0] - centre, axis=1)

    for _ in range(40):
        kept = joints[np.argsort(-reaches())[:256]]
        moved = np.repeat(kept, 15, axis=0) + scale * draws.standard_normal((15 * len(kept), len(arm.joints)))
        joints = np.concatenate([kept, np.clip(moved, arm.lower, arm.upper)])
        scale *= 0.8
    return height, float(reaches().max()) + 0.01


def pack_rows(codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Trim codes, shape (nz, nu, ntilt, nv), along v.

    For each (z, u), the corners from one before the first to one after the last nonzero code of any tilt remain.

    Returns:
        Rows and packed codes, as in ReachMap.
    """
    nz, nu, ntilt, nv = codes.shape
    flat = codes.reshape(nz * nu, ntilt, nv)
    used = np.max(flat, axis=1) > 0
    low = np.maximum(used.argmax(axis=1) - 1, 0)
    high = np.minimum(nv - used[:, ::-1].argmax(axis=1), nv - 1)
    length = np.where(np.max(used, axis=1), high - low + 1, 0)
    address = np.concatenate([[0], np.cumsum(ntilt * length)[:-1]])
    kept = [flat[i, :, low[i] : low[i] + length[i]].ravel() for i in np.flatnonzero(length)]
    rows = np.stack([address, low, length], axis=1).astype(np.int32)
    return rows, pack(np.concatenate([np.zeros(0, np.uint8), *kept]))


def turn_error(surface: LabelledGrid) -> float:
    """Estimate the fraction of reachable poses that a map gets wrong because of base and wrist limits.

    A map gives the same verdict for all base and wrist rotations of a pose. If the arm reaches only some of these
    rotations, the verdict is right for the majority and wrong for the others. In a pole's table, a corner
    represents a ring of poses, so the radius of the ring is the corner's weight.
    """
    share = surface.level.reshape(surface.lattice.shape) / _FULL
    weight = np.arange(share.shape[1]) if share.ndim == 2 else 1.0
    return float((weight * np.minimum(share, 1.0 - share)).sum() / max((weight * share).sum(), 1.0))
