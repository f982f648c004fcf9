"""Cold starts: how long a fresh process takes to its first layouts, with an empty kernel cache and with a kept one."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchmarks.paper.scenes import Scene

_CACHES = ("WARP_CACHE_PATH", "CUDA_CACHE_PATH", "XDG_CACHE_HOME", "SCENIRIS_GYM_CACHE")
_DONE = "the layouts are there\n"


def cold(scene: Scene, worlds: int, device: str, cache: Path) -> dict[str, float]:
    """Start a process that makes layouts of a scene, and wait for them.

    Args:
        scene: The scene.
        worlds: How many layouts it makes at once.
        device: Warp's name of the device.
        cache: Folder for all that is cached between starts; empty at the first one.

    Returns:
        `cold_s`, from the start of the process until the layouts are there [s]; of it `imports_s`, `compile_s` (the
        scene, its bank, and the kernels for them) and `generate_s`; `valid`, the share of the layouts that is fresh and
        valid; `peak_bytes`, the peak memory: of Warp's pool on a GPU, of the process on a CPU.
    """
    environment = {**os.environ, **{name: str(cache / name.lower()) for name in _CACHES}}
    command = [sys.executable, "-m", "benchmarks.paper.cold", json.dumps([scene, worlds, device])]
    start = time.perf_counter()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        done = next((line for line in process.stdout if line == _DONE), None)
        seconds = time.perf_counter() - start
        rest = process.stdout.read()
    if process.returncode or done is None:
        raise RuntimeError(f"a fresh process for {worlds} layouts of '{scene[0]}' ended with {process.returncode}.")
    return {"cold_s": seconds, **json.loads(rest)}


def main(words: str) -> None:
    """Make layouts, say so at once, and then in a line of JSON what took how long."""
    start = time.perf_counter()
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
    from benchmarks.paper.scenes import compiled_scene
    from sceniris_gym.layout.generate import LayoutGenerator
    from sceniris_gym.layout.layouts import LayoutStatus

    scene, worlds, device = json.loads(words)
    imported = time.perf_counter()
    compiled = compiled_scene(scene, device)
    ready = time.perf_counter()
    generator = LayoutGenerator(compiled, worlds)
    generator.generate()
    wp.synchronize_device(device)
    end = time.perf_counter()
    print(_DONE, end="", flush=True)
    from sceniris_gym.commands.bench import peak_bytes

    status = generator.layouts.status.cpu().numpy()  # imports torch, which making layouts does not need

    found: Mapping[str, float] = {
        "imports_s": imported - start,
        "compile_s": ready - imported,
        "generate_s": end - ready,
        "valid": float((status == LayoutStatus.VALID).mean()),
        "peak_bytes": peak_bytes(device),
    }
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
