"""The line that a user reads before kernels are compiled, in place of Warp's own line about each module."""

from __future__ import annotations

import sys

import warp as wp

# The kernels belong to the process, and so does the line about them: generators do not know of each other.
_told: set[str] = set()


def start_warp() -> None:
    """Start Warp, which from now on reports warnings and errors alone; at `wp.LOG_DEBUG` it reports everything."""
    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_WARNING
    wp.init()


def tell_of_compiling(device: str, own: int) -> None:
    """Say on stderr that kernels are compiled, once for each device in a process.

    Args:
        device: The device.
        own: How many modules of this package are among them.
    """
    if device in _told:
        return
    _told.add(device)
    time = "about a minute" if device == "cpu" else "some minutes"
    print(
        f"sceniris_gym: compiling kernels for '{device}' ({own} modules of this package, then MuJoCo-Warp's as they "
        f"are needed): {time}, once; they are kept in {wp.config.kernel_cache_dir}",
        file=sys.stderr,
        flush=True,
    )
