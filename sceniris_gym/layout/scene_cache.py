"""Compiled scenes on disk, so that a scene is compiled once, and not in every process.

A file holds the arrays of one compiled scene in NumPy's format, without pickles, so that reading it cannot execute
code. Its name is a hash of all inputs: the model, the settings in the scene file, the source of this package, the
versions of the numerical libraries, and the kind of device. A file is written under a temporary name and then renamed,
so that other processes never see a partial file. Unreadable and unwritable files are ignored. A file is also ignored if
it belongs to another user or if other users may write to it, because its numbers become indices in kernels without
further checks.
"""

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
from typing import Any

import mujoco
import numpy as np
import platformdirs
import warp as wp
from pydantic import TypeAdapter

from sceniris_gym.files import UNREADABLE as UNREADABLE_FILE
from sceniris_gym.files import read_arrays, replacing
from sceniris_gym.geometry.colliders import device_mesh
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import WORLD_FIELDS, Program, fill_struct
from sceniris_gym.program.device_bank import Bank
from sceniris_gym.program.device_conditions import Conditions
from sceniris_gym.program.device_reach import Reach, Starts
from sceniris_gym.program.device_statics import Statics
from sceniris_gym.program.pack.objects import set_map_and_arm
from sceniris_gym.program.reach import Reaching, ReachingArm, ReachTarget, load_map, robot_arm
from sceniris_gym.scene.model import SceneModel

_HOME = ("home_qpos", "home_xpos", "home_xquat")
_COUNTS = ("sides", "pieces")
_STRUCTS: dict[str, Any] = {
    "program": Program,
    "statics": Statics,
    "conditions": Conditions,
    "starts": Starts,
    "bank": Bank,
}
_GRIPPERS, _TARGETS = TypeAdapter(dict[str, Gripper]), TypeAdapter(tuple[ReachTarget, ...])
# The field with ids of device meshes. Ids are not stored: meshes are built again from their triangles.
_MESHES = "collider_mesh"


def to_arrays(compiled: CompiledScene) -> dict[str, np.ndarray]:
    """Return a compiled scene as arrays, without its model and the maps of its arms."""
    arrays = {name: getattr(compiled, name) for name in _HOME}
    for part, declared in _STRUCTS.items():
        if (instance := getattr(compiled, part)) is not None:
            arrays |= {f"{part}.{name}": value for name, value in _fields(declared, instance).items()}
    for i, mesh in enumerate(compiled.meshes):
        arrays[f"mesh.{i}"] = mesh.points.numpy()
    values: dict[str, Any] = {name: getattr(compiled, name) for name in _COUNTS}
    if compiled.reaching is not None:
        for one in compiled.reaching.arms:
            arrays |= {f"reach.{one.robot}.{name}": value for name, value in _fields(Reach, one.view).items()}
        grippers = {one.robot: one.gripper for one in compiled.reaching.arms}
        values["grippers"] = _GRIPPERS.dump_python(grippers, mode="json")
        values["targets"] = _TARGETS.dump_python(compiled.reaching.targets, mode="json")
    return arrays | {"values": np.array(json.dumps(values))}


def from_arrays(scene: SceneModel, device: str, arrays: Mapping[str, np.ndarray]) -> CompiledScene:
    """Rebuild a compiled scene from the result of `to_arrays`.

    Args:
        scene: The model of the same scene.
        device: A device of the same kind.
        arrays: The result of `to_arrays`.

    Raises:
        KeyError, TypeError, ValueError, RuntimeError: An array is missing or has another type.
    """
    values = json.loads(str(arrays["values"]))
    parts: dict[str, Any] = dict.fromkeys(_STRUCTS)
    for part, declared in _STRUCTS.items():
        if any(name.startswith(f"{part}.") for name in arrays):
            parts[part] = declared()
            _fill(declared, parts[part], arrays, f"{part}.", device)
    with_mesh = np.flatnonzero(arrays[f"program.{_MESHES}"])
    meshes = tuple(device_mesh(arrays[f"mesh.{i}"], device) for i in range(len(with_mesh)))
    ids = np.zeros(len(arrays[f"program.{_MESHES}"]), np.uint64)
    ids[with_mesh] = [mesh.id for mesh in meshes]
    fill_struct(Program, parts["program"], {_MESHES: ids}, device)
    parts |= {name: arrays[name] for name in _HOME} | {name: values[name] for name in _COUNTS}
    reaching = _reaching(scene, device, arrays, values) if "targets" in values else None
    return CompiledScene(scene=scene, device=device, reaching=reaching, meshes=meshes, **parts)


def _reaching(scene: SceneModel, device: str, arrays: Mapping[str, np.ndarray], values: dict) -> Reaching:
    """Rebuild the arms and reach targets."""
    arms = []
    for name, gripper in _GRIPPERS.validate_python(values["grippers"]).items():
        arm = robot_arm(scene, name)
        reach_map = load_map(arm, scene.config.all_robots[name], scene.config.where)
        arms.append(ReachingArm(name, arm, gripper, reach_map))
        set_map_and_arm(arms[-1], device)
        _fill(Reach, arms[-1].view, arrays, f"reach.{name}.", device)
    return Reaching(tuple(arms), _TARGETS.validate_python(values["targets"]))


def _fields(declared: Any, instance: Any) -> dict[str, np.ndarray]:
    """Return the arrays and numbers of a device struct by name, without nested structs."""
    names = [name for name, variable in declared.vars.items() if not _is_struct(variable.type)]
    values = {name: getattr(instance, name) for name in names}
    found = {name: value.numpy() if isinstance(value, wp.array) else np.array(value) for name, value in values.items()}
    return {name: value[0] if declared is Program and name in WORLD_FIELDS else value for name, value in found.items()}


def _fill(declared: Any, instance: Any, arrays: Mapping[str, np.ndarray], prefix: str, device: str) -> None:
    """Set the fields of a device struct from arrays that `_fields` returned."""
    for name, variable in declared.vars.items():
        if wp.types.is_array(variable.type):
            fill_struct(declared, instance, {name: arrays[prefix + name]}, device)
        elif not _is_struct(variable.type):
            value = arrays[prefix + name]
            setattr(instance, name, variable.type(*value.tolist()) if value.ndim else value.item())


def _is_struct(kind: Any) -> bool:
    """Return whether a field's declared type is a struct."""
    return not (wp.types.is_array(kind) or isinstance(kind, type))


VARIABLE = "SCENIRIS_GYM_CACHE"
"""The environment variable that sets another cache folder, or OFF for no cache."""
OFF = "off"
MOST_BYTES = 256 << 20
"""Maximum size of the cache. Beyond it, the least recently used files are removed."""
UNREADABLE = (*UNREADABLE_FILE, AttributeError)
"""Errors that reading a damaged or foreign file may raise."""

_SUFFIX = ".npz"
# A temporary file of this age [s] belongs to a process that ended while writing.
_LEFT = 3600.0
_COMPUTE = ("mujoco", "warp-lang", "numpy", "scipy", "shapely", "trimesh")


def cache_folder() -> Path | None:
    """Return the folder of compiled scenes: $SCENIRIS_GYM_CACHE/scenes, or by default in the user's cache folder.

    The default is `scenes` in $XDG_CACHE_HOME/sceniris_gym or ~/.cache/sceniris_gym. The result is None if
    $SCENIRIS_GYM_CACHE is "off", or if the user has no home.
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
    """Return the cache key of a scene, 32 hexadecimal digits. Scenes that compile differently have different keys."""
    model = np.empty(mujoco.mj_sizeModel(scene.mjm), np.uint8)
    mujoco.mj_saveModel(scene.mjm, None, model)
    config, on = scene.config, wp.get_device(device)
    kind = [_processor(), on.name if on.is_cuda else "cpu", on.arch]
    words = config.model_dump_json(exclude={"model"})
    facts = [scene.hash, config.where, words, repr(scene.couplings), scene.bodies, _sources(), kind]
    digest = hashlib.sha256(json.dumps(facts).encode())
    for values in (model, scene.home_qpos, scene.home_ctrl):
        digest.update(values.tobytes())
    return digest.hexdigest()[:32]


def load_arrays(key: str) -> dict[str, np.ndarray] | None:
    """Return the arrays stored under a key, or None if they are missing or unreadable."""
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / f"{key}{_SUFFIX}"
    with contextlib.suppress(*UNREADABLE):
        os.utime(path)  # marks the file as used, for `_remove_oldest`
        return read_arrays(path, own=True)
    return None


def store_arrays(key: str, arrays: Mapping[str, np.ndarray]) -> None:
    """Store arrays under a key, if the folder can be written to."""
    folder = cache_folder()
    if folder is None:
        return
    with contextlib.suppress(OSError):
        with replacing(folder / f"{key}{_SUFFIX}") as path, path.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
            path.chmod(0o600)  # the umask may let other users write, and such files are ignored
        _remove_oldest(folder)


def _remove_oldest(folder: Path) -> None:
    """Remove the least recently used files beyond `MOST_BYTES`, and abandoned temporary files."""
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
    """Return the instruction sets of the processor, because the rounding of compiled kernels depends on them."""
    lines: list[str] = []
    with contextlib.suppress(OSError), Path("/proc/cpuinfo").open() as info:
        lines = [line for line in info.read(1 << 14).splitlines() if line.startswith(("flags", "Features"))]
    return " ".join([platform.machine(), *lines[:1]])


@cache
def _sources() -> str:
    """Return a hash of the libraries' versions and this package's sources, which can change without a new version."""
    digest = hashlib.sha256(repr([metadata.version(name) for name in _COMPUTE]).encode())
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
