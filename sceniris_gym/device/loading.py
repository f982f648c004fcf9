"""Compile the kernels of a step or a reset together, before its launches would compile them one by one."""

import os
import threading
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import warp as wp

from sceniris_gym.device.kernel_log import tell_of_compiling
from sceniris_gym.progress import shown, tell

ModuleVariant = tuple[wp.Module, int]
"""A Warp module and its number of threads per block, which is a constant in the compiled code."""


@contextmanager
def on_missing(react: Callable[[ModuleVariant], object]) -> Iterator[None]:
    """Call `react` before a launch of this thread loads a module that Warp's cache lacks.

    If `react` returns a false value, the launch is skipped, and the module is not loaded.
    """
    load, suggest, thread = wp.Module.load, wp.get_suggested_block_size, threading.get_ident()
    kept: set[ModuleVariant] = set()

    def load_unless_missing(module: wp.Module, device: Any, block_dim: int | None = None, **options: Any) -> Any:
        variant = (module, module.options["block_dim"] if block_dim is None else block_dim)
        if threading.get_ident() == thread and variant not in kept:
            if not _is_kept(*variant) and not react(variant):
                return None  # wp.launch then returns without a launch
            kept.add(variant)
        return load(module, device, block_dim, **options)

    def suggest_unless_missing(kernel: wp.Kernel, device: Any = None) -> tuple[int, int]:
        try:
            return suggest(kernel, device)
        except RuntimeError:  # the module was not loaded. MuJoCo-Warp needs the answer only for the number of blocks
            return 1, 1

    wp.Module.load = load_unless_missing
    wp.get_suggested_block_size = suggest_unless_missing
    try:
        yield
    finally:
        wp.Module.load = load
        wp.get_suggested_block_size = suggest


def _is_kept(module: wp.Module, block_dim: int) -> bool:
    """Return whether Warp's cache has a folder of this module, whichever device it was compiled for."""
    return (Path(wp.config.kernel_cache_dir or "") / module.get_module_identifier(block_dim)).is_dir()


def load_modules(variants: Collection[ModuleVariant], device: wp.Device) -> None:
    """Compile and load modules, and report the progress. On a GPU, all cores compile.

    On a CPU, Warp compiles one module at a time.
    """
    tell_of_compiling(str(device))
    pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)) if device.is_cuda else 1)
    try:
        with shown():
            jobs = [pool.submit(wp.force_load, device, [module], block_dim) for module, block_dim in variants]
            for done, job in enumerate(as_completed(jobs), 1):
                job.result()
                tell("compiling kernels", done, len(jobs))
    finally:
        pool.shutdown(cancel_futures=True)  # an interrupt does not wait for the modules in the queue
