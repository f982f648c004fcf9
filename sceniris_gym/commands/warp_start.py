"""Warp is started without its greeting, and without a warning on machines that have no GPU."""

from __future__ import annotations

import os
import sys
import tempfile

_NO_GPU = "Could not find or load the NVIDIA CUDA driver"


def start_warp() -> None:
    """Start Warp for a command: from now on it speaks of warnings and errors alone.

    That there is no driver of a GPU is no news to those who have none, and whoever asks for one that is not there gets
    an error. Warp's own code in C writes that line, past Python, so all that is written meanwhile is kept and read.
    """
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
    with tempfile.TemporaryFile() as written:
        sys.stderr.flush()
        kept = os.dup(2)
        os.dup2(written.fileno(), 2)
        try:
            wp.init()
        finally:
            sys.stderr.flush()
            os.dup2(kept, 2)
            os.close(kept)
        written.seek(0)
        os.write(2, without_gpu_warning(written.read()))


def without_gpu_warning(text: bytes) -> bytes:
    """Return lines less the one that says that there is no driver of a GPU."""
    return b"".join(line for line in text.splitlines(keepends=True) if _NO_GPU.encode() not in line)
