"""The message printed before kernels are compiled. It replaces the lines that Warp prints for each module."""

import os
import sys
from pathlib import Path

import warp as wp

from sceniris_gym.files import redirected

_GPU = Path("/proc/driver/nvidia")
# Kept for the whole process, like the kernels: each launch sequence would otherwise print the message again.
_told: set[str] = set()


def start_warp() -> None:
    """Start Warp. If its log level is the default `wp.LOG_INFO`, raise the level to `wp.LOG_WARNING`.

    On a computer without an NVIDIA driver, Warp's line about it is left out.
    """
    if wp.config.log_level == wp.LOG_INFO:
        wp.config.log_level = wp.LOG_WARNING
    with open(os.devnull, "w") as nowhere, redirected(2, 2 if _GPU.exists() else nowhere.fileno()):
        wp.init()


def tell_of_compiling(device: str) -> None:
    """Print a message on stderr that kernels are being compiled. For each device, a process prints it only once."""
    if device in _told:
        return
    _told.add(device)
    time = "about a minute" if device == "cpu" else "some minutes"
    print(
        f"sceniris_gym: compiling kernels for '{device}'. This takes {time}. Scenes of the same kind share compiled "
        f"kernels, which are kept in {wp.config.kernel_cache_dir}",
        file=sys.stderr,
        flush=True,
    )
