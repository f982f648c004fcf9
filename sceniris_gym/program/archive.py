"""A compiled scene as named arrays, and back: all of it that took work and that its model does not have."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from pydantic import TypeAdapter

from sceniris_gym.geometry.colliders import device_mesh
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import WORLD_FIELDS, Program, fill_struct
from sceniris_gym.program.device_bank import Bank
from sceniris_gym.program.device_reach import Reach, Starts
from sceniris_gym.program.device_statics import Statics
from sceniris_gym.program.pack.objects import set_map_and_arm
from sceniris_gym.program.reach import Reaching, ReachingArm, ReachTarget, load_map, robot_arm
from sceniris_gym.scene.model import SceneModel

_HOME = ("home_qpos", "home_xpos", "home_xquat")
_COUNTS = ("sides", "pieces")
_STRUCTS: dict[str, Any] = {"program": Program, "statics": Statics, "starts": Starts, "bank": Bank}
_GRIPPERS, _TARGETS = TypeAdapter(dict[str, Gripper]), TypeAdapter(tuple[ReachTarget, ...])
# The field with ids of device meshes, which are made anew from their triangles.
_MESHES = "collider_mesh"


def to_arrays(compiled: CompiledScene) -> dict[str, np.ndarray]:
    """Return a compiled scene as arrays, without its model and the maps of its arms."""
    arrays = {name: getattr(compiled, name) for name in _HOME}
    for part, declared in _STRUCTS.items():
        if (instance := getattr(compiled, part)) is not None:
            arrays |= {f"{part}.{name}": value for name, value in _fields(declared, instance).items()}
    for i, mesh in enumerate(compiled.meshes):
        arrays[f"mesh.{i}"] = mesh.points.numpy()
    words: dict[str, Any] = {name: getattr(compiled, name) for name in _COUNTS}
    if compiled.reaching is not None:
        for one in compiled.reaching.arms:
            arrays |= {f"reach.{one.robot}.{name}": value for name, value in _fields(Reach, one.view).items()}
        grippers = {one.robot: one.gripper for one in compiled.reaching.arms}
        words["grippers"] = _GRIPPERS.dump_python(grippers, mode="json")
        words["targets"] = _TARGETS.dump_python(compiled.reaching.targets, mode="json")
    return arrays | {"words": np.array(json.dumps(words))}


def from_arrays(scene: SceneModel, device: str, arrays: Mapping[str, np.ndarray]) -> CompiledScene:
    """Return the compiled scene that `to_arrays` was given.

    Args:
        scene: The same model.
        device: A device of the same kind.
        arrays: The result of `to_arrays`.

    Raises:
        KeyError, TypeError, ValueError, RuntimeError: Something is missing, or of another kind.
    """
    words = json.loads(str(arrays["words"]))
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
    kept: dict[str, Any] = {name: arrays[name] for name in _HOME} | {name: words[name] for name in _COUNTS}
    return CompiledScene(
        scene=scene,
        device=device,
        reaching=_reaching(scene, device, arrays, words) if "targets" in words else None,
        **parts,
        meshes=meshes,
        **kept,
    )


def _reaching(scene: SceneModel, device: str, arrays: Mapping[str, np.ndarray], words: dict) -> Reaching:
    """Return the arms and reach targets that `to_arrays` was given."""
    arms = []
    for name, gripper in _GRIPPERS.validate_python(words["grippers"]).items():
        arm = robot_arm(scene, name)
        reach_map = load_map(arm, scene.config.all_robots[name], scene.config.where)
        arms.append(ReachingArm(name, arm, gripper, reach_map))
        set_map_and_arm(arms[-1], device)
        _fill(Reach, arms[-1].view, arrays, f"reach.{name}.", device)
    return Reaching(tuple(arms), _TARGETS.validate_python(words["targets"]))


def _fields(declared: Any, instance: Any) -> dict[str, np.ndarray]:
    """Return the arrays and numbers of a device struct by name, without the structs in it."""
    names = [name for name, variable in declared.vars.items() if not _is_struct(variable.type)]
    values = {name: getattr(instance, name) for name in names}
    found = {name: value.numpy() if isinstance(value, wp.array) else np.array(value) for name, value in values.items()}
    return {name: value[0] if declared is Program and name in WORLD_FIELDS else value for name, value in found.items()}


def _fill(declared: Any, instance: Any, arrays: Mapping[str, np.ndarray], prefix: str, device: str) -> None:
    """Set the fields that `_fields` returned."""
    for name, variable in declared.vars.items():
        if wp.types.is_array(variable.type):
            fill_struct(declared, instance, {name: arrays[prefix + name]}, device)
        elif not _is_struct(variable.type):
            value = arrays[prefix + name]
            setattr(instance, name, variable.type(*value.tolist()) if value.ndim else value.item())


def _is_struct(kind: Any) -> bool:
    """Return whether a field's declared type is a struct."""
    return not (wp.types.is_array(kind) or isinstance(kind, type))
