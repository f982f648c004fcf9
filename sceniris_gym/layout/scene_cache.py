"""Compiled scenes on disk, so that a scene is compiled once and not at every start.

A file holds the arrays of one compiled scene in NumPy's format, without pickles, so that nothing in it is executed. Its
name is a hash of all that the arrays depend on: the model, the words of the scene file, this package's own source, the
versions of the libraries that compute them, and the kind of device. It is written beside its place and renamed, so that
no process sees half of one. A file that cannot be read or written is as good as missing, and so is one that belongs to
another user or that others may write: its numbers become indices in kernels, which nothing checks again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import time
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np
import platformdirs
import warp as wp

from sceniris_gym.config import stored_arrays
from sceniris_gym.files import replacing
from sceniris_gym.scene.model import SceneModel

VARIABLE = "SCENIRIS_GYM_CACHE"
"""The environment variable that names another folder, or is OFF."""
OFF = "off"
MOST_BYTES = 256 << 20
"""The files that were not used for longest are removed as soon as all together take more than this."""
UNREADABLE = (*stored_arrays.UNREADABLE, AttributeError)
"""Errors that reading a damaged or foreign file may raise."""

_SUFFIX = ".npz"
# A temporary file of this age [s] was left by a process that ended while it wrote.
_LEFT = 3600.0
_COMPUTE = ("mujoco", "warp-lang", "numpy", "scipy", "shapely", "trimesh")


def cache_folder() -> Path | None:
    """Return the folder of compiled scenes: $SCENIRIS_GYM_CACHE/scenes, else `scenes` in the user's cache folder.

    The latter is $XDG_CACHE_HOME/sceniris_gym or ~/.cache/sceniris_gym. None if the variable is "off", or there is no
    home.
    """
    named = os.environ.get(VARIABLE, "")
    if named.lower() == OFF:
        return None
    if named:
        return Path(named).expanduser() / "scenes"
    try:
        return platformdirs.user_cache_path("sceniris_gym") / "scenes"
    except RuntimeError:
        return None


def scene_key(scene: SceneModel, device: str) -> str:
    """Return the name of a scene in the cache: 32 hexadecimal digits, different for whatever compiles differently."""
    model = np.empty(mujoco.mj_sizeModel(scene.mjm), np.uint8)
    mujoco.mj_saveModel(scene.mjm, None, model)
    config, on = scene.config, wp.get_device(device)
    kind = [_processor(), on.name if on.is_cuda else "cpu", on.arch]
    facts = [
        scene.hash,
        config.where,
        config.model_dump_json(exclude={"model"}),
        repr(scene.couplings),
        scene.bodies,
        _sources(),
        kind,
    ]
    digest = hashlib.sha256(json.dumps(facts).encode())
    for values in (model, scene.home_qpos, scene.home_ctrl):
        digest.update(values.tobytes())
    return digest.hexdigest()[:32]


def load_arrays(key: str) -> dict[str, np.ndarray] | None:
    """Return the arrays that were stored under a key; None if there are none that can be read."""
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / f"{key}{_SUFFIX}"
    with contextlib.suppress(*UNREADABLE):
        os.utime(path)  # for `_remove_oldest`
        return stored_arrays.read_arrays(path, own=True)
    return None


def store_arrays(key: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Store arrays under a key, if the folder can be written to."""
    folder = cache_folder()
    if folder is None:
        return
    with contextlib.suppress(OSError):
        with replacing(folder / f"{key}{_SUFFIX}") as path, path.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
            path.chmod(0o600)  # others may have the user's umask let them write
        _remove_oldest(folder)


def _remove_oldest(folder: Path) -> None:
    """Remove files beyond `MOST_BYTES`, and temporary files that nobody writes to any more."""
    for path in folder.glob(".*.tmp"):
        if time.time() - path.stat().st_mtime > _LEFT:
            path.unlink(missing_ok=True)
    files = sorted(((path.stat(), path) for path in folder.glob(f"*{_SUFFIX}")), key=lambda f: -f[0].st_mtime)
    total = 0
    for stat, path in files:
        total += stat.st_size
        if total > MOST_BYTES:
            path.unlink(missing_ok=True)


@cache
def _processor() -> str:
    """Return the instructions that the processor has: compiled kernels use them, and round accordingly."""
    lines: list[str] = []
    with contextlib.suppress(OSError), Path("/proc/cpuinfo").open() as info:
        lines = [line for line in info.read(1 << 14).splitlines() if line.startswith(("flags", "Features"))]
    return " ".join([platform.machine(), *lines[:1]])


@cache
def _sources() -> str:
    """Return a hash of this package's Python files, as a checkout keeps its version, and of the libraries' versions."""
    digest = hashlib.sha256(repr([metadata.version(name) for name in _COMPUTE]).encode())
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
