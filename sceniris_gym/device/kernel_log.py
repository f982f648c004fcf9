"""What a user hears of kernels that are compiled: one line, rather than one for each module that Warp loads."""

from __future__ import annotations

import re
import sys
from typing import Any

import warp as wp

# Warp's own line about a module, which comes once it is compiled or loaded.
_LOADED = re.compile(r"\s*Module .* load on device '(?P<device>.*)' took (?P<ms>[\d.]+) ms +\((?P<how>.*)\)")
# From so many seconds on that have gone into compiling, a user is told.
_LONG = 1.0

_told: set[str] = set()


def tell_of_compiling(device: str, own: int | None = None) -> None:
    """Say on stderr that kernels are compiled, once for each device in a process.

    Args:
        device: The device.
        own: How many modules of this package are among them; None if only MuJoCo-Warp's are known to be.
    """
    if device in _told:
        return
    _told.add(device)
    whose = "MuJoCo-Warp's" if own is None else f"{own} modules of this package, then MuJoCo-Warp's as they are needed"
    time = "about a minute" if device == "cpu" else "some minutes"
    print(
        f"sceniris_gym: compiling kernels for '{device}' ({whose}): {time}, once; they are kept in "
        f"{wp.config.kernel_cache_dir}",
        file=sys.stderr,
        flush=True,
    )


class KernelLog:
    """A logger of Warp's that keeps its lines about modules to itself, and passes all others on.

    Where compiling takes longer than a second and nobody has said so yet, it does. With Warp's log level at
    `wp.LOG_DEBUG` everything is passed on.
    """

    def __init__(self, below: wp.Logger) -> None:
        self.debug, self.warning, self.error = below.debug, below.warning, below.error
        self._info = below.info
        self._spent = 0.0

    def info(self, message: str) -> None:
        """Pass a message on, if it is not about a module."""
        loaded = _LOADED.fullmatch(message)
        if loaded is None or wp.config.log_level <= wp.LOG_DEBUG:
            self._info(message)
        elif loaded["how"] == "compiled":
            self._spent += float(loaded["ms"]) / 1000.0
            if self._spent > _LONG:
                tell_of_compiling(loaded["device"])


def use_kernel_log() -> None:
    """Let Warp's default logger speak through a KernelLog. A logger of the user's own stays as it is."""
    logger: Any = wp.get_logger()
    if type(logger).__module__.startswith("warp."):
        wp.set_logger(KernelLog(logger))
