"""Configurations written for the original Sceniris package, read as scenes of this one: `read_sceniris`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sceniris_gym.errors import KeysLeftOutWarning, ScenirisError, UnknownNameError
from sceniris_gym.scene.compose import names_in
from sceniris_gym.scene.config import SceneConfig
from sceniris_gym.scene.files import SHIPPED_NAME
from sceniris_gym.scene.original_errors import in_its_keys, origin
from sceniris_gym.scene.original_keys import CONFIGURATION, Notes, Section
from sceniris_gym.scene.original_relations import Views, note_origins, read_relation
from sceniris_gym.scene.values import FLOOR

_PLANE = "_plane"  # the original's name of its ground
_SUPPORT_WORDS = {"top": "on", "inside": "inside", "in": "inside"}
_ROBOT_VIEWS = ("robot_centric_axis_transforms", "robot_centric_frame_transforms")
_HALF_EDGE = 1e-4  # m, of the square on the floor that stands for a fixed position


def read_sceniris(cfg: Mapping[str, Any], assets: Mapping[str, str] | None = None) -> SceneConfig:
    """Read a configuration of the original package, the dict that its `Scene.gen_from_cfg` takes.

    These keys are read, with the original's defaults:

    - `env`: `env_size` (1.0) or `workspace_limits`, which make the floor, and `robot_centric_axis_transforms`, turned
      views of the world that relations may name.
    - `objects`, a list or a mapping by id: `id`, `asset_path`, `parent_id` (the ground), `relation_to_parent` ('top'
      is `on`, 'inside' and 'in' are `inside`), `ratio_on_support` (0), `position.xy_limit` (fractions of the
      support's bounds), `constraints`, and `fixed_world_positions` if there is only one, which overrules those five.
    - `rotation`, in degrees: 'uniform_z' with `lower` and `upper`, 'constant' with an `orientation` about z, 'stable'
      with `z_rotation`, 'face_to' with `face_to_object_id`.
    - `joint_states`: `joint_ids`, and `min` (0) and `max` (1) as fractions of the joint's limits.
    - `constraints`, all of which hold: `anchor_object_ids`; `direction` (a side, an axis or [x, y]) within
      `direction_tolerance_angle` (90), in the frame `relation_axis_transform`: the *support's* by default, or 'world',
      an object (where the original knows anchors only), a robot's view, or a rotation matrix on top of the support's;
      `distance` with `distance_type` ('equal') and `distance_relax` (0.01); `distance_start_bbox`, which measures
      between the bounds of both objects here, and from the anchor's hull to the other's origin in the original.
      'middle' as a direction or type of distance, and several anchors without a direction, are `between`, which for two
      of them is a strip here and a rectangle in the original.

    Objects that have joint states or a fixed position, or that others stand on, become fixtures; the others are free.
    Joints and parts ('drawer/upper') must have these names in the assets, which are looked into where there are such
    MJCF files. A key that has no effect in the original has none here.

    Args:
        cfg: The configuration; it is not changed.
        assets: Assets by the id of the object, shipped names or MJCF files, in place of its `asset_path`.

    Returns:
        The scene.

    Raises:
        ScenirisError: A key is missing, or a value or a name is wrong.

    Warns:
        KeysLeftOutWarning: Some keys cannot be carried over, or not with their meaning. It names them all; an
            `asset_path` among them is one that is kept, but is no MJCF file.
    """
    notes = Notes()
    keys = Section(cfg, "", notes)
    env, objects = keys.section("env"), _objects_by_id(keys)
    views = Views(
        objects, {robot: turn for key in _ROBOT_VIEWS for robot, turn in env.section(key).everything().items()}
    )
    limits = env.array("workspace_limits", None, (2, 2)) if env.value("workspace_limits") is not None else None
    edge = env.number("env_size", 1.0)
    size = np.array([edge, edge]) if limits is None else 2.0 * np.abs(limits).max(axis=0)
    env.made("floor.size", "env_size" if limits is None else "workspace_limits")
    env.finish()
    for name in assets or {}:
        if name not in objects:
            raise UnknownNameError("object", name, "read_sceniris: assets", objects)
    parents = {str(part.value("parent_id")).split("/")[0] for part in objects.values()}
    scene = {
        "floor": {"size": size},
        "objects": {
            name: _object(part, views, limits, (assets or {}).get(name), name in parents)
            for name, part in objects.items()
        },
    }
    keys.finish()
    try:
        config = SceneConfig.load(scene)
    except ScenirisError as error:
        raise in_its_keys(error, notes.origins) from None
    _check_parts(config, notes.origins)
    if notes.left_out or notes.changed:
        warnings.warn(KeysLeftOutWarning(notes.left_out, notes.changed), stacklevel=2)
    return config


def _check_parts(config: SceneConfig, origins: Mapping[str, str]) -> None:
    """Check the names of joints and of parts of objects, where there is an asset that has them."""
    inside = {
        name: names_in(part.asset, f"{CONFIGURATION}: {origin(f'objects.{name}.asset', origins)}")
        for name, part in config.objects.items()
        if part.asset is not None and (SHIPPED_NAME.fullmatch(part.asset) or _is_mjcf(part.asset))
    }
    for name, part in config.objects.items():
        for joint in part.joints if name in inside else ():
            if joint not in (joints := inside[name].joints):
                where = origin(f"objects.{name}.joints.{joint}", origins)
                raise UnknownNameError("joint", joint, f"{CONFIGURATION}: {where}", joints)
        owner, _, body = part.support.parent.partition("/") if part.support is not None else ("", "", "")
        if body and owner in inside and body not in (bodies := inside[owner].bodies):
            where = f"{CONFIGURATION}: objects.{name}.parent_id"
            raise UnknownNameError("body", f"{owner}/{body}", where, [f"{owner}/{b}" for b in bodies])


def _is_mjcf(asset: str) -> bool:
    return asset.endswith(".xml") and Path(asset).is_file()


def _objects_by_id(keys: Section) -> dict[str, Section]:
    """Return the objects by their ids; in messages they are named by these, whatever form the configuration has."""
    data = keys.value("objects")
    if data is None:
        raise keys.wrong("objects", "is missing. It is a list of mappings, each with an 'id'")
    if isinstance(data, Mapping):
        listed = keys.section("objects")
        return {str(name): listed.section(str(name)) for name in data}
    objects = {}
    for part in keys.sections("objects"):
        name = part.value("id")
        if not isinstance(name, str):
            raise part.wrong("id", f"{name!r} should be the name of the object")
        if name in objects:
            raise part.wrong("id", f"'{name}' should be another name than that of an object before it")
        part.path = f"objects.{name}"
        objects[name] = part
    return objects


def _object(keys: Section, views: Views, limits: np.ndarray | None, asset: str | None, is_parent: bool) -> dict:
    keys.ignore("id")
    joints = _joints(keys)
    fixed = keys.value("fixed_world_positions")
    is_fixed = isinstance(fixed, Sequence | np.ndarray) and len(fixed) == 1
    words = {
        "asset": _asset(keys, asset),
        "kind": "fixture" if joints or is_parent or is_fixed else "free",
        "joints": joints,
        **(_fixed_place(keys) if is_fixed else _place(keys, views, limits)),
        **_rotation(keys, views),
    }
    if keys.value("reachable") is False:
        keys.ignore("reachable")
    keys.finish()
    return words


def _asset(keys: Section, asset: str | None) -> str:
    keys.made(f"{keys.path}.asset", "asset_path")
    path = keys.take("asset_path")
    if asset is not None:
        return asset
    if path is None:
        raise keys.wrong("asset_path", "is missing. Name an MJCF file or a shipped asset, or give it in 'assets'")
    if not SHIPPED_NAME.fullmatch(str(path)) and not str(path).endswith(".xml"):
        keys.leave_out("asset_path")
    return str(path)


def _joints(keys: Section) -> dict:
    joints: dict[str, dict] = {}
    for state in keys.sections("joint_states"):
        fraction = (state.number("min", 0.0), state.number("max", 1.0))
        for joint in map(str, state.values("joint_ids")):
            joints[joint] = {"fraction": fraction}
            state.made(f"{keys.path}.joints.{joint}", "joint_ids")
            state.made(f"{keys.path}.joints.{joint}.fraction", "")
        if state.value("distribution") == "uniform":
            state.ignore("distribution")
        state.finish()
    return joints


def _rotation(keys: Section, views: Views) -> dict:
    keys.made(f"{keys.path}.orientation", "rotation")
    keys.made(f"{keys.path}.orientation.face_to", "rotation.face_to_object_id")
    rotation = keys.section("rotation")
    kind = rotation.take("type")
    if kind == "uniform_z":
        orientation: Any = {"yaw": (rotation.number("lower", -180.0), rotation.number("upper", 180.0))}
    elif kind == "stable":
        orientation = {"stable": {} if rotation.take("z_rotation", True) else {"yaw": (0.0, 0.0)}}
    elif kind == "face_to":
        target = rotation.take("face_to_object_id")
        orientation = {"face_to": rotation.known("face_to_object_id", "object", target, views.objects)}
    elif kind == "constant":
        orientation = _constant(rotation)
    else:
        if kind is not None:
            rotation.leave_out("type")
        orientation = None
    rotation.finish()
    return {"orientation": orientation}


def _constant(rotation: Section) -> Any:
    """Return the orientation of a constant rotation; one that is not about z stays as the asset has it."""
    value = rotation.value("orientation")
    if np.ndim(value) < 2:
        angle = rotation.number("orientation", 0.0)
        return {"yaw": (angle, angle)}
    matrix = rotation.rotation("orientation", value)
    if matrix[2, 2] < 1.0 - 1e-6:
        return "fixed"  # and the key is left out
    rotation.ignore("orientation")
    angle = math.degrees(math.atan2(matrix[1, 0], matrix[0, 0]))
    return {"yaw": (angle, angle)}


def _fixed_place(keys: Section) -> dict:
    keys.ignore("parent_id", "relation_to_parent", "ratio_on_support", "position", "constraints")
    keys.made(f"{keys.path}.region", "fixed_world_positions")
    point = keys.checked("fixed_world_positions", keys.values("fixed_world_positions")[0], (3,))
    if point[2] != 0.0:
        return {"region": {"box": (point, point)}}
    return {"on": FLOOR, "region": {"box": (point[:2] - _HALF_EDGE, point[:2] + _HALF_EDGE)}}


def _place(keys: Section, views: Views, limits: np.ndarray | None) -> dict:
    parent = str(keys.take("parent_id", _PLANE))
    keys.known("parent_id", "object", parent.split("/")[0], [_PLANE, *views.objects])
    parent = FLOOR if parent == _PLANE else parent
    relation = keys.take("relation_to_parent", "top")
    keys.known("relation_to_parent", "relation to a parent", relation, _SUPPORT_WORDS)
    position = keys.section("position")
    is_cropped = position.value("xy_limit") is not None
    crop = np.sort(position.array("xy_limit", [[0.0, 0.0], [1.0, 1.0]], (2, 2)).clip(0.0, 1.0), axis=0)
    position.finish()
    region: dict | None = {"fraction": crop} if is_cropped else None
    if parent == FLOOR and limits is not None:
        region = {"box": limits[0] + crop * (limits[1] - limits[0])}
    relations: list[dict] = []
    for constraint in keys.sections("constraints"):
        if (found := read_relation(constraint, views)) is not None:
            note_origins(constraint, f"{keys.path}.relations.{len(relations)}", found)
            relations.append(found)
    keys.made(f"{keys.path}.{_SUPPORT_WORDS[relation]}", "parent_id")
    keys.made(f"{keys.path}.region", "position.xy_limit")
    keys.made(f"{keys.path}.relations", "constraints")
    return {
        _SUPPORT_WORDS[relation]: parent,
        "ratio_on_support": min(max(keys.number("ratio_on_support", 0.0), 0.0), 1.0),
        "region": region,
        "relations": relations,
    }
