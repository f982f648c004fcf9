"""Checks that MuJoCo-Warp supports the model's solver and features, and that there is enough memory."""

import contextlib
from pathlib import Path

import mujoco
import mujoco_warp as mjw
import warp as wp

from sceniris_gym.errors import MemoryLimitError, NotSupportedError
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.plan import Plan

_MEMINFO = Path("/proc/meminfo")
_LIMIT, _USED = (Path("/sys/fs/cgroup") / name for name in ("memory.max", "memory.current"))
# Memory of a pair of colliders during compilation [bytes], measured with 500,000 pairs.
_PAIR_BYTES = 600


def check_solver(plan: Plan) -> None:
    """Check that MuJoCo-Warp supports the solver that the model selects.

    Raises:
        NotSupportedError: MuJoCo-Warp lacks the solver.
    """
    solver = mujoco.mjtSolver(plan.scene.mjm.opt.solver)
    if int(solver) not in set(mjw.SolverType):
        name = solver.name.removeprefix("mjSOL_")
        raise NotSupportedError(f"{plan.scene.config.where}: MuJoCo-Warp has no solver {name}. Use Newton or CG.")


def put_simulated(mjm: mujoco.MjModel, where: str) -> mjw.Model:
    """Return a model as a `mujoco_warp.Model` on Warp's current device.

    Raises:
        NotSupportedError: The model has a feature that MuJoCo-Warp lacks. The message begins with `where`.
    """
    try:
        return mjw.put_model(mjm)
    except NotImplementedError as error:
        raise NotSupportedError(
            f"{where}: MuJoCo-Warp cannot simulate the model: {error} Remove this from the model."
        ) from None


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
