"""Whether there is memory for what is about to be made, where that is known beforehand."""

from __future__ import annotations

from pathlib import Path

import warp as wp

from sceniris_gym.errors import MemoryLimitError

_MEMINFO = Path("/proc/meminfo")
_LIMIT, _USED = (Path("/sys/fs/cgroup") / name for name in ("memory.max", "memory.current"))


def check_memory(what: str, needed: int, device: str, cure: str) -> None:
    """Refuse what does not fit into the memory that is free.

    Args:
        what: What is about to be made, with the place of the user's that asks for it.
        needed: How many bytes it takes, at least.
        device: Where.
        cure: What to do about it.

    Raises:
        MemoryLimitError: It does not fit.
    """
    if needed < 1 << 28:  # not worth asking
        return
    free = free_memory(device)
    if free is not None and needed > free:
        raise MemoryLimitError(what, needed, free, device, cure)


def free_memory(device: str) -> int | None:
    """How many bytes are free on a device; None where nobody says."""
    found = wp.get_device(device)
    if found.is_cuda:
        return int(found.free_memory)
    free = None
    try:
        for line in _MEMINFO.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                free = 1024 * int(line.split()[1])
        limit = _LIMIT.read_text().strip()
        if limit.isdecimal():  # of the container
            room = int(limit) - int(_USED.read_text())
            free = room if free is None else min(free, room)
    except (OSError, ValueError, IndexError):
        pass
    return free
