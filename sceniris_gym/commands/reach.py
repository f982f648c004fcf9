"""The `reach` command: builds an arm's reachability map, judges poses, and draws the arm's reach."""

import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from sceniris_gym.audit.contacts import deepest_contacts
from sceniris_gym.config.loader import SHIPPED_NAME, shipped
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import ArgumentError, MapError, NotSupportedError, ReachWarning, check_names
from sceniris_gym.files import UNREADABLE, check_picture, no_file, read_array, replacing
from sceniris_gym.geometry.rotations import quaternion
from sceniris_gym.layout.compile import device_name
from sceniris_gym.pictures.layout_picture import save
from sceniris_gym.pictures.reach_picture import draw
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.reach.arm import TCP, SerialArm
from sceniris_gym.reach.build import build_map
from sceniris_gym.reach.map import SUFFIX, ReachMap, build_command, default_tier, map_file, map_path, why_not_map
from sceniris_gym.reach.solve import solve
from sceniris_gym.scene.build import build_model

_ROUNDING = 1e-5  # m, parts of an arm may overlap by this much more than at home
_ROUNDS = 32  # attempts to solve a pose, as long as the arm touches itself with the joints found


class GivenArm(NamedTuple):
    """An arm as a user gives it.

    Attributes:
        name: A shipped asset, or the path of an MJCF or URDF file.
        mjm: The model.
        arm: The arm in the model.
    """

    name: str
    mjm: mujoco.MjModel
    arm: SerialArm


def read_arm(name: str, changes: Mapping[str, Any] | None = None) -> GivenArm:
    """Read an arm: a shipped asset, or the path of an MJCF or URDF file.

    Args:
        name: The asset or the path.
        changes: Values for keys of a scene file, such as `robot.tcp` for an arm without a site 'tcp'.

    Raises:
        UnknownNameError: The asset is unknown, or has no such TCP.
        SceneFileError: The file is missing, or cannot be read.
        ArmError: The model is not a serial arm.
    """
    if SHIPPED_NAME.fullmatch(name) and name not in (assets := shipped("assets", ".xml")):
        arms = [asset for asset, path in assets.items() if f'<site name="{TCP}"' in path.read_text()]
        check_names("arm", [name], "reach", arms)
    scene = build_model({"robot": {"asset": name}}, changes)
    return GivenArm(name, scene.mjm, robot_arm(scene))


def build(given: GivenArm, out: Path, device: str | None = None, **options: Any) -> dict[str, Any]:
    """Build the map of an arm into a file, report the progress, and describe the map.

    The `options` are the steps and the seed, as `build_map` takes them. Until the map is complete, a file next to `out`
    stores the state of the build. A later build resumes from this file.
    """
    state = out.with_name(f".{out.name}.state")
    start = time.perf_counter()
    built = build_map(given.arm, device_name(device, "reach"), state=state, **options)
    with replacing(out) as temporary:
        built.save(temporary)
    state.unlink(missing_ok=True)
    figures = {"seconds": round(time.perf_counter() - start, 1), "file": str(out), "file_bytes": out.stat().st_size}
    if out.resolve() != map_path(given.name).resolve():
        figures["used_with"] = f"--map {out}"
    return describe(given, built) | figures


def default_map(name: str) -> Path:
    """Return the default path of a new map: next to the arm's model file, in the working folder for a shipped arm."""
    return Path(f"{name}{SUFFIX}") if SHIPPED_NAME.fullmatch(name) else map_path(name)


def judge(
    given: GivenArm, path: Path | None, poses: Path, out: Path, tier: Tier | None = None, device: str | None = None
) -> dict[str, Any]:
    """Judge the TCP poses of a file (N, 4, 4), write the verdicts (N,) bool, and count the reached poses.

    Args:
        given: The arm.
        path: A map, or None for the arm's default map.
        poses: The .npy file of poses.
        out: The .npy file of verdicts.
        tier: The tier of the test, or None for the arm's default.
        device: Warp's name of the device. None takes "cuda:0" if available, otherwise "cpu".
    """
    name, mjm, arm = given
    asked = read_poses(poses)
    by_map = tier is not None and tier.needs_map
    reach_map = find_map(given, path) if path is not None or by_map or _has_map(given) else None
    used = default_tier(arm, reach_map) if tier is None else tier
    why = why_not_map(arm, reach_map, name)
    if tier is not None and by_map and why is not None:
        warnings.warn(f"reach {name} --tier {tier.word}: {why}.", ReachWarning, stacklevel=2)
    verdicts = judge_poses(mjm, arm, reach_map, asked, used, device_name(device, "reach"))
    with replacing(out) as temporary, temporary.open("wb") as file:
        np.save(file, verdicts)
    found = {"arm": arm.name, "tier": used.word, "poses": len(asked), "reached": int(verdicts.sum()), "file": str(out)}
    return found if why is None or tier is not None else found | {"why_ik": why}


def show(given: GivenArm, path: Path | None, out: Path, height: float, device: str | None = None) -> dict[str, Any]:
    """Describe an arm and its map, and draw the map. For an arm without a map, there is no picture.

    Raises:
        MapError: `path` is not a map of the arm, or `height` is above or below the map.
    """
    if path is None and not _has_map(given):
        return describe(given, None)
    check_picture(out)
    reach_map = find_map(given, path)
    low, high = reach_map.z_low, reach_map.z_low + reach_map.step * (reach_map.nz - 1)
    if not low <= height <= high:  # NaN, too
        inside = f"from {low:.2f} to {high:.2f} m, inside the map"
        raise MapError(f"reach {given.name} --height {height:g}: should be {inside}.")
    save(draw(reach_map, height, device_name(device, "reach")), out)
    return describe(given, reach_map) | {"picture": str(out)}


def _has_map(given: GivenArm) -> bool:
    return given.arm.no_map is None and map_file(given.name) is not None


def find_map(given: GivenArm, path: Path | None) -> ReachMap:
    """Load the map at `path`, or the arm's default map if None.

    Raises:
        MapError: The map is missing, or does not fit the arm.
    """
    name, _, arm = given
    if arm.no_map is not None:
        raise MapError(f"reach: '{name}' cannot have a map: {arm.no_map}. Use --tier ik.")
    own = map_file(name)
    if path is not None:
        another = f"Build one: {build_command(name)}." if own is None else "Leave out --map: this arm has its own."
        return ReachMap.load(path, arm, another)
    if own is None:
        raise MapError(f"reach: '{name}': {why_not_map(arm, None, name)}.")
    return ReachMap.load(own, arm, f"Build it again: {build_command(name)}.")


def describe(given: GivenArm, reach_map: ReachMap | None) -> dict[str, Any]:
    """Return the properties of an arm and its map, by name."""
    name, _, arm = given
    found: dict[str, Any] = {
        "arm": arm.name,
        "hash": arm.hash,
        "joints": len(arm.joints),
        "full_turn_of_base": arm.turns_freely(0),
        "full_turn_of_wrist": arm.turns_freely(-1),
    }
    if reach_map is None:
        found["map"] = None
    else:
        memory, witnesses = reach_map.nbytes
        found |= {
            "step_m": reach_map.step,
            "tilt_step_degrees": float(np.degrees(reach_map.tilt_step)),
            "map_bytes": memory,
            "witness_bytes": witnesses,
            "turn_error": reach_map.turn_error,
            "false_accepts": reach_map.false_accepts,
        }
    found["default_tier"] = default_tier(arm, reach_map).word
    why = why_not_map(arm, reach_map, name)
    return found if why is None else found | {"why_ik": why}


def read_poses(path: Path) -> np.ndarray:
    """Read TCP poses in the arm's base frame from a .npy file, shape (N, 4, 4).

    Raises:
        ArgumentError: The file is missing, or its content is not such an array.
    """
    form = "should be a .npy file with an array of shape (N, 4, 4): rigid TCP poses in the arm's base frame"
    if not path.is_file():
        raise ArgumentError(f"--poses {path}: {no_file(path)}. The input {form}.")
    try:
        poses = read_array(path)
    except UNREADABLE as error:
        raise ArgumentError(f"--poses {path}: NumPy cannot read it ({error}). The input {form}.") from error
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or poses.dtype.kind not in "fiu":
        raise ArgumentError(f"--poses {path}: holds {poses.dtype} of shape {poses.shape}. The input {form}.")
    poses = poses.astype(np.float64)
    rotations = poses[:, :3, :3]
    with np.errstate(invalid="ignore"):  # NaN compares as false
        rigid = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) < 1e-3
        rigid &= (np.linalg.det(rotations) > 0.0) & (np.abs(poses[:, 3] - [0, 0, 0, 1]).max(axis=1) < 1e-6)
    rigid &= np.isfinite(poses[:, :3, 3]).all(axis=1)
    if not rigid.all():
        raise ArgumentError(f"--poses {path}: pose {np.argmin(rigid)} is not a rigid transform. The input {form}.")
    return poses


def judge_poses(
    mjm: mujoco.MjModel, arm: SerialArm, reach_map: ReachMap | None, poses: np.ndarray, tier: Tier, device: str
) -> np.ndarray:
    """Return a mask of the TCP poses in the base frame that an arm reaches, shape (N,), bool.

    `reach_map` may be None if the tier is `ik`.

    Raises:
        NotSupportedError: The tier is `clear` or `path`, which depends on a layout.
    """
    if tier >= Tier.CLEAR:
        raise NotSupportedError(
            f"reach --tier {tier.word}: this tier needs a layout, whose objects the arm has to avoid, but --poses "
            f"gives none. Use `reachable: {tier.word}` in a scene, or --tier ik here."
        )
    if tier == Tier.IK:
        return _solvable(mjm, arm, poses, device)
    assert reach_map is not None  # `find_map` raises an error, and `default_tier` is `ik` without a map
    return reach_map.verdict(poses, device) >= tier.least_verdict


def _solvable(mjm: mujoco.MjModel, arm: SerialArm, poses: np.ndarray, device: str) -> np.ndarray:
    """Return a mask (N,) of the poses that an arm reaches within its joint limits, without touching itself."""
    reached = np.zeros(len(poses), bool)
    left = np.arange(len(poses))
    flat = np.reshape([[*pose[:3, 3], *quaternion(pose[:3, :3])] for pose in poses], (-1, 7))
    for seed in range(_ROUNDS):
        joints, ok = solve(arm, flat[left], device, seed=seed)
        left, joints = left[ok], joints[ok]  # poses without a solution stay unreached
        hits = hits_itself(mjm, arm, joints)
        reached[left[~hits]] = True
        left = left[hits]
        if not len(left):
            break
    return reached


def hits_itself(mjm: mujoco.MjModel, arm: SerialArm, joints: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of the rows of joint positions (N, njoint) at which the arm touches itself in MuJoCo.

    If two geoms already overlap in the model's first keyframe, an overlap up to that depth does not count.
    """
    data = mujoco.MjData(mjm)
    if mjm.nkey:
        mujoco.mj_resetDataKeyframe(mjm, data, 0)
    home = _depths(mjm, data)
    hits = np.zeros(len(joints), bool)
    for i, q in enumerate(joints):
        data.qpos[arm.qposadr] = q
        hits[i] = any(depth > home.get(geoms, 0.0) + _ROUNDING for geoms, depth in _depths(mjm, data).items())
    return hits


def _depths(mjm: mujoco.MjModel, data: mujoco.MjData) -> dict[tuple[int, int], float]:
    """Return the depth [m] of each pair of geoms that overlap at the positions in `data`."""
    mujoco.mj_kinematics(mjm, data)
    return {geoms: -dist for geoms, (dist, _) in deepest_contacts(mjm, data).items() if dist < 0.0}
