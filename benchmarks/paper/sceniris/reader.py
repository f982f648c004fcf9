"""Configurations written for the original Sceniris package, read as scenes of this one: `read_sceniris`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper.sceniris.keys import (
    CONFIGURATION,
    KeyReader,
    KeysLeftOutWarning,
    Notes,
    in_its_keys,
    origin,
)
from benchmarks.paper.sceniris.names import names_in
from benchmarks.paper.sceniris.placement import fixed_place, fixed_points, needed_floor, place
from benchmarks.paper.sceniris.relations import Views
from benchmarks.paper.sceniris.robot import robot_words
from sceniris_gym.config.loader import SHIPPED_NAME
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import TIERS
from sceniris_gym.errors import ScenirisError, UnknownNameError

_MODELS = (".xml", ".urdf")
_ROBOT_VIEWS = ("robot_centric_axis_transforms", "robot_centric_frame_transforms")


def read_sceniris(
    cfg: Mapping[str, Any],
    assets: Mapping[str, str] | None = None,
    *,
    robot: str | Mapping[str, Any] | None = None,
    tier: str = "map",
) -> SceneConfig:
    """Read a configuration of the original package, the dict that its `Scene.gen_from_cfg` takes.

    These keys are read, with the original's defaults:

    - `env`: `env_size` (1.0) or `workspace_limits`, which define the floor; `robot_centric_axis_transforms`, rotated
      views of the world that relations may name; `robot_position`, where the `robot` stands: several are bounds,
      within which its base is drawn on the floor, or in the middle of which it is above it.
    - `objects`, a list or a mapping by id: `id`, `asset_path`, `parent_id` (the ground), `relation_to_parent` ('top'
      is `on`, 'inside' and 'in' are `inside`), `ratio_on_support` (0), `position.xy_limit` (fractions of the
      support's bounds, clipped to them), `constraints`, and `fixed_world_positions`, which override those five: the
      object is put at one of them, all equally likely, on the floor where z = 0 and else in the air. If one on the
      floor is outside the workspace, the floor is enlarged, and objects without such positions keep to the workspace.
    - `reachable`, if there is a `robot`.
    - `rotation`, in degrees: 'uniform_z' with `lower` and `upper`, 'constant' with an `orientation` about z, 'stable'
      with `z_rotation`, 'face_to' with `face_to_object_id`.
    - `joint_states`: `joint_ids`, and `min` (0) and `max` (1) as fractions of the joint's limits, one pair for a joint.
    - `constraints`, all of which hold: `anchor_object_ids`; `direction` (a side, an axis or [x, y]) within
      `direction_tolerance_angle` (90), in the frame `relation_axis_transform`: the *support's* by default, or 'world',
      an object (only an anchor in the original), a robot's view, or a rotation matrix on top of the support's;
      `distance` with `distance_type` ('equal') and `distance_relax` (0.01); `distance_start_bbox`, which measures
      between the bounds of both objects here, and from the anchor's hull to the other's origin in the original.
      'middle' as a direction or type of distance, and several anchors without a direction, are `between`, which for two
      of them is a strip here and a rectangle in the original.

    Objects that have joint states or a fixed position, or that others stand on, become fixtures; the others are free.
    Joints and parts ('drawer/upper') should have the same names in the assets, MJCF or URDF files, which is checked for
    all of them that exist. A key that has no effect in the original has none here.

    Args:
        cfg: The configuration; it is not changed.
        assets: Assets by object id, as shipped names or MJCF or URDF files, in place of its `asset_path`.
        robot: The scene's robot, which a configuration does not name: an asset, or a mapping as in a scene file.
        tier: How thoroughly `reachable` objects are proven to be so: 'map', 'map_strict', 'ik' or 'clear'.

    Returns:
        The scene.

    Raises:
        ScenirisError: A key is missing, or a value or a name is wrong.

    Warns:
        KeysLeftOutWarning: Some keys are left out, or have a different meaning or value here: a `ratio_on_support`
            outside 0 to 1 is clipped, and so is an `xy_limit`, whose corners may also change order. It names them all;
            an `asset_path` among them is kept, but is no MJCF or URDF file.
    """
    notes = Notes()
    keys = KeyReader(cfg, "", notes)
    env, objects = keys.section("env"), _objects_by_id(keys)
    views = Views(
        objects, {robot: turn for key in _ROBOT_VIEWS for robot, turn in env.section(key).everything().items()}
    )
    arm, under = robot_words(robot, env)
    _check_names(tier, assets := assets or {}, objects)
    size, limits = _workspace(env, objects, under)
    parents = {str(part.value("parent_id")).split("/")[0] for part in objects.values()}
    reach = None if arm is None else tier
    scene = {
        "floor": {"size": size},
        "robot": arm,
        "objects": {
            name: _object(part, replace(views, own=name), limits, assets.get(name), name in parents, reach)
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
        warnings.warn(KeysLeftOutWarning(notes.left_out, notes.changed, notes.advice), stacklevel=2)
    return config


def _workspace(
    env: KeyReader, objects: Mapping[str, KeyReader], under: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the size of the floor, shape (2,), and the part of it to keep to, shape (2, 2) or None for all of it.

    The floor has at least the size `under`, which a robot may need whose base is drawn.
    """
    limits = env.array("workspace_limits", None, (2, 2)) if env.value("workspace_limits") is not None else None
    edge = env.number("env_size", 1.0)
    size = np.full(2, edge) if limits is None else 2.0 * np.abs(limits).max(axis=0)
    env.made("floor.size", "env_size" if limits is None else "workspace_limits")
    env.finish()
    needed = np.maximum(needed_floor(objects), under)
    if (size > 0.0).all() and (size < needed).any():
        limits = 0.5 * np.array([-size, size]) if limits is None else limits
        size = np.maximum(size, needed)
    return size, limits


def _check_names(tier: str, assets: Mapping[str, str], objects: Mapping[str, KeyReader]) -> None:
    if tier not in TIERS:
        raise UnknownNameError("tier", str(tier), "read_sceniris: tier", TIERS)
    for name in assets:
        if name not in objects:
            raise UnknownNameError("object", name, "read_sceniris: assets", objects)


def _check_parts(config: SceneConfig, origins: Mapping[str, str]) -> None:
    """Check the names of joints and parts of objects, wherever there is an asset to look them up in."""
    inside = {}
    for name, part in config.objects.items():
        asset = part.asset or ""
        if SHIPPED_NAME.fullmatch(asset) or (asset.endswith(_MODELS) and Path(asset).is_file()):
            inside[name] = names_in(asset, f"{CONFIGURATION}: {origin(f'objects.{name}.asset', origins)}")
    for name, part in config.objects.items():
        for joint in part.joints if name in inside else ():
            if joint not in (joints := inside[name].joints):
                where = origin(f"objects.{name}.joints.{joint}", origins)
                raise UnknownNameError("joint", joint, f"{CONFIGURATION}: {where}", joints)
        owner, _, body = part.support.parent.partition("/") if part.support is not None else ("", "", "")
        if body and owner in inside and body not in (bodies := inside[owner].bodies):
            where = f"{CONFIGURATION}: objects.{name}.parent_id"
            raise UnknownNameError("body", f"{owner}/{body}", where, [f"{owner}/{b}" for b in bodies])


def _objects_by_id(keys: KeyReader) -> dict[str, KeyReader]:
    """Return the objects by id; messages name them by id, whether the configuration has a list or a mapping."""
    data = keys.value("objects")
    if data is None:
        raise keys.wrong("objects", "is missing. It should be a list of mappings, each with an 'id'")
    if isinstance(data, Mapping):
        listed = keys.section("objects")
        return {str(name): listed.section(str(name)) for name in data}
    objects = {}
    for part in keys.sections("objects"):
        name = part.value("id")
        if not isinstance(name, str):
            raise part.wrong("id", f"{name!r} should be the name of the object")
        if name in objects:
            raise part.wrong("id", f"'{name}' should be a different name: an earlier object already has it")
        part.path = f"objects.{name}"
        objects[name] = part
    return objects


def _object(
    keys: KeyReader, views: Views, limits: np.ndarray | None, asset: str | None, is_parent: bool, tier: str | None
) -> dict:
    keys.ignore("id")
    joints, fixed = _joints(keys), fixed_points(keys)
    words = {
        "asset": _asset(keys, asset),
        "kind": "fixture" if joints or is_parent or fixed is not None else "free",
        "joints": joints,
        **(place(keys, views, limits) if fixed is None else fixed_place(keys, fixed)),
        **_rotation(keys, views),
        **_reachable(keys, tier),
    }
    keys.finish()
    return words


def _reachable(keys: KeyReader, tier: str | None) -> dict:
    """Return the word for an object that the robot should reach; `tier` is None without a robot."""
    wanted = keys.value("reachable")
    if wanted is True and tier is None:
        keys.leave_out("reachable")
        keys.notes.advise("'reachable' is carried over if read_sceniris gets a 'robot'.")
    elif isinstance(wanted, bool):
        keys.ignore("reachable")
    return {"reachable": tier} if wanted is True and tier is not None else {}


def _asset(keys: KeyReader, asset: str | None) -> str:
    keys.made(f"{keys.path}.asset", "asset_path")
    path = keys.take("asset_path")
    if asset is not None:
        return asset
    if path is None:
        raise keys.wrong("asset_path", "is missing. Name an MJCF or URDF file, a shipped asset, or give it in 'assets'")
    if not SHIPPED_NAME.fullmatch(str(path)) and not str(path).endswith(_MODELS):
        keys.leave_out("asset_path")
        keys.notes.advise("`sceniris-gym import` makes assets of meshes and USD.")
    return str(path)


def _joints(keys: KeyReader) -> dict:
    joints: dict[str, dict] = {}
    for state in keys.sections("joint_states"):
        fraction = (state.number("min", 0.0), state.number("max", 1.0))
        for joint in map(str, state.values("joint_ids")):
            if joints.get(joint, {}).get("fraction", fraction) != fraction:
                raise state.wrong("joint_ids", f"'{joint}' has different limits in an earlier entry. Name it only once")
            joints[joint] = {"fraction": fraction}
            state.made(f"{keys.path}.joints.{joint}", "joint_ids")
            state.made(f"{keys.path}.joints.{joint}.fraction", "")
        if state.value("distribution") == "uniform":
            state.ignore("distribution")
        state.finish()
    return joints


def _rotation(keys: KeyReader, views: Views) -> dict:
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
        orientation = {"face_to": rotation.known("face_to_object_id", "object", target, views.objects, views.own)}
    elif kind == "constant":
        orientation = _constant(rotation)
    else:
        if kind is not None:
            rotation.leave_out("type")
        orientation = None
    rotation.finish()
    return {"orientation": orientation}


def _constant(rotation: KeyReader) -> Any:
    """Return the orientation of a constant rotation; one that is not about z is left as the asset has it."""
    value = rotation.value("orientation")
    if np.ndim(value) < 2:
        angle = rotation.number("orientation", 0.0)
        return {"yaw": (angle, angle)}
    matrix = rotation.rotation("orientation", value)
    if matrix[2, 2] < 1.0 - 1e-6:
        return "fixed"  # the key is left out
    rotation.ignore("orientation")
    angle = math.degrees(math.atan2(matrix[1, 0], matrix[0, 0]))
    return {"yaw": (angle, angle)}
