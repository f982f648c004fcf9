"""Checks that MuJoCo-Warp supports the model's solver and features, and that there is enough memory."""

import contextlib
from collections.abc import Collection
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import warp as wp

from sceniris_gym.errors import MemoryLimitError, NotSupportedError
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.plan import Plan

_MEMINFO = Path("/proc/meminfo")
_LIMIT, _USED = (Path("/sys/fs/cgroup") / name for name in ("memory.max", "memory.current"))
# Those of `mujoco_warp.SolverType`, which is not imported here, because layouts alone need no MuJoCo-Warp.
_SOLVERS = (mujoco.mjtSolver.mjSOL_CG, mujoco.mjtSolver.mjSOL_NEWTON)
# Memory of a pair of colliders during compilation [bytes], measured with 500,000 pairs.
_PAIR_BYTES = 600


def check_solver(plan: Plan) -> None:
    """Check that MuJoCo-Warp supports the solver that the model selects.

    Raises:
        NotSupportedError: MuJoCo-Warp lacks the solver.
    """
    solver = mujoco.mjtSolver(plan.scene.mjm.opt.solver)
    if solver not in _SOLVERS:
        name = solver.name.removeprefix("mjSOL_")
        raise NotSupportedError(f"{plan.scene.config.where}: MuJoCo-Warp has no solver {name}. Use Newton or CG.")


def check_pairs_fit(plan: Plan) -> None:
    """Check that the pairs of colliders that compilation lists for the collision tests fit into memory.

    Raises:
        MemoryLimitError: The list of pairs does not fit.
    """
    solid = {(p.body, p.contact_class) for p in plan.pieces if p.type != PieceType.PLANE}
    number = len(solid) + sum(p.type == PieceType.PLANE for p in plan.pieces)
    own = sum(len(o.bodies) for o in plan.objects)
    pairs = own * (number - own) + own * own // 2
    what = f"{plan.scene.config.where}: the pairs of {number} colliders"
    check_memory(what, pairs * _PAIR_BYTES, "cpu", "Use fewer objects, or geoms of one body instead of many bodies.")


def check_memory(what: str, needed: int, device: str, cure: str) -> None:
    """Check that a large allocation fits into free memory.

    Args:
        what: The beginning of the error: the file and the subject that takes memory, e.g. 'a.yaml: the pairs of 12
            colliders'.
        needed: Least number of bytes that the allocation takes.
        device: Warp's name of the device.
        cure: The last sentence of the error: how the user can save memory.

    Raises:
        MemoryLimitError: The allocation does not fit.
    """
    if needed < 1 << 28:  # small enough to skip the query
        return
    free = free_memory(device)
    if free is not None and needed > free:
        free_gib = max(free, 0) / 2**30
        raise MemoryLimitError(
            f"{what}: takes {needed / 2**30:.1f} GiB or more, but only {free_gib:.1f} GiB are free on {device}. {cure}"
        )


class WorldMemory(NamedTuple):
    """Memory that worlds take on a device, estimated from the shapes of their arrays.

    As text, it is such as "4,096 worlds take 1.14 GiB of 78.52 GiB free on cuda:0".

    Attributes:
        nworld: Number of worlds.
        device: Warp's name of the device.
        needed: Bytes that the worlds take.
        free: Free bytes before the worlds are made, or None if the system does not report them.
        most: Greatest number of worlds that fits, or None if `free` is None.
    """

    nworld: int
    device: str
    needed: int
    free: int | None
    most: int | None

    def __str__(self) -> str:
        free = "" if self.free is None else f" of {max(self.free, 0) / 2**30:.2f} GiB free"
        return f"{self.nworld:,} worlds take {self.needed / 2**30:.2f} GiB{free} on {self.device}"


def check_worlds(where: str, nworld: int, device: str, *parts: tuple[int, int]) -> WorldMemory:
    """Check that worlds fit into free memory, and return the memory that they take.

    Args:
        where: The beginning of the error.
        nworld: Number of worlds.
        device: Warp's name of the device.
        parts: The bytes of each part of the worlds: a number for all worlds together, and a number for each world.

    Raises:
        MemoryLimitError: The worlds do not fit. The message has the greatest number of worlds that fits.
    """
    fixed, world = (sum(sizes) for sizes in zip(*parts, strict=True))
    needed, free = fixed + nworld * world, free_memory(device)
    most = None if free is None else max(free - fixed, 0) // world
    cure = f"Use fewer worlds (at most {most or 0:,}), or another device."
    check_memory(f"{where}: {nworld:,} worlds", needed, device, cure)
    return WorldMemory(nworld, device, needed, free, most)


def array_bytes(*holders: Any, rows: Collection[int] = (1,)) -> int:
    """Return the bytes of the Warp arrays in attributes of these objects that have one of these numbers of rows."""
    arrays = [array for holder in holders for array in vars(holder).values() if isinstance(array, wp.array)]
    return sum(array.capacity for array in arrays if array.shape[0] in rows)


def free_memory(device: str) -> int | None:
    """Return the number of free bytes on a device, or None if the system does not report it."""
    found = wp.get_device(device)
    if found.is_cuda:
        return int(found.free_memory)
    free = None
    with contextlib.suppress(OSError, ValueError, KeyError):
        told = dict(line.split(":") for line in _MEMINFO.read_text().splitlines())
        free = 1024 * int(told["MemAvailable"].removesuffix("kB"))
        limit = _LIMIT.read_text().strip()
        if limit.isdecimal():  # of the container
            free = min(free, int(limit) - int(_USED.read_text()))
    return free
