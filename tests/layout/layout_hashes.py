"""Hashes of the layouts of all shipped scenes, in a file that `python -m tests.layout.layout_hashes` writes anew."""

from __future__ import annotations

import hashlib
import json
import platform
from pathlib import Path

from sceniris_gym.config.loader import shipped
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene

FILE = Path(__file__).with_suffix(".json")
NWORLD = 1024
ARRAYS = ("qpos", "mocap_pos", "mocap_quat", "status")


def processor() -> str:
    """Name what the bits depend on: kernels are compiled for the processor at hand, fused products and all."""
    info = Path("/proc/cpuinfo")
    flags = set(info.read_text().split()) if info.is_file() else set()
    return " ".join([platform.machine(), *(flag for flag in ("fma", "avx2", "avx512f") if flag in flags)])


def layout_hashes(compiled: CompiledScene) -> dict[str, str]:
    """Return the hash of a scene, and those of the arrays of episode 0 of 1,024 worlds from seed 0, by split."""
    found = {"scene": compiled.hash}
    for split in ("train", "eval"):
        generator = LayoutGenerator(compiled, NWORLD, split=split)
        generator.generate()
        digest = hashlib.sha256()
        for name in ARRAYS:
            digest.update(getattr(generator.layouts, name).cpu().numpy().tobytes())
        found[split] = digest.hexdigest()[:16]
    return found


if __name__ == "__main__":
    scenes = {name: layout_hashes(compile_scene(name, "cpu")) for name in shipped("envs", ".yaml")}
    FILE.write_text(json.dumps({"processor": processor(), "scenes": scenes}, indent=4) + "\n")
