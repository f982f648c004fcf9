"""Reachability maps: the TCP poses that an arm reaches, looked up on the device in four coordinates.

A map is kinematic: it covers joint limits, but not self-collision or the scene. Inverse kinematics labels the corners
of the grid, so verdicts are practically exact in a cell whose corners all agree. The surface that bounds the reached
region runs through the other cells. Each corner stores its signed distance from that surface along the grid's axes. A
pose counts as reached if the distance, interpolated over the 16 corners of its cell, is positive. lookup.py defines the
coordinates and the lookup.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import MapError
from sceniris_gym.files import UNREADABLE, no_file, read_arrays
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.labels import end_turns
from sceniris_gym.reach.lookup import MapView, look_up, vec8h
from sceniris_gym.reach.solve import as_vec8, vec8

SUFFIX = ".reach"
"""Suffix of map files."""
CODE_VALUES = np.array([-1.0, -0.9, -0.7, -0.5, -0.3, -0.1, -0.6, -0.2, 0.2, 0.6, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0])
"""Signed distance for each code of a corner, in steps of the grid.

- 0 to 5: never reached, from far to near the surface.
- 6 and 7: reached in fewer than half of the base and wrist rotations, far and near.
- 8 and 9: reached in at least half, near and far.
- 10 to 15: reached in every rotation, from near to far.
"""
MOST_TURN_ERROR = 0.005
"""A map is `limited` if `turn_error` is above this fraction."""
MOST_FALSE_ACCEPTS = 0.005
"""A map is `coarse` if more than this fraction of the accepted poses are out of reach."""

_FORMAT = 1
_MOST = 100.0  # largest absolute value of a step or first coordinate in a file [m, rad]
_MOST_CORNERS = 1 << 16  # along an axis
_MEASURED = "false_accepts"  # missing in files if it was not measured


@dataclass(frozen=True, eq=False)
class ReachMap:
    """A reachability map of one arm, built by `build.build_map`.

    Attributes:
        arm: The arm.
        step, tilt_step: Steps of the grid along z, u and v [m], and along tilt [rad].
        z_low: First height of the grid in the base frame [m].
        u_low: First u and first v of the grid, relative to the first axis [m].
        nz, ntilt, nu: Number of corners along z, along tilt, and along each of u and v.
        rows: Rows of corners along v, as in lookup.MapView, shape (nz * nu, 3), int32.
        codes: Codes of the corners, as in CODE_VALUES, eight per word, uint32.
        pole_step, pole_z_low: Step and first height of the poles' tables [m]. A pole is an approach axis up or down.
        poles: Codes of the poles' tables by height and radius, 0 to 15, shape (2, nz, nradius), uint8.
        wit_cells: For each coarse cell, by (z, tilt, u, v), the first row in `wit_joints` and the number of rows, shape
            (..., 2), int32.
        wit_joints: Witnesses: joint positions from which inverse kinematics starts, (nwitness, njoint), float16.
        turn_error: Estimated fraction of reachable poses with a wrong verdict, because verdicts ignore base and wrist
            limits. The maximum over the grid and both poles.
        seed: Seed of the random joint positions from which inverse kinematics started in the build.
        false_accepts: Fraction of accepted poses that are out of reach, measured by measures.py. None in files of
            earlier versions, and if it could not be measured.
    """

    arm: SerialArm
    step: float
    tilt_step: float
    z_low: float
    u_low: float
    nz: int
    ntilt: int
    nu: int
    rows: np.ndarray
    codes: np.ndarray
    pole_step: float
    pole_z_low: float
    poles: np.ndarray
    wit_cells: np.ndarray
    wit_joints: np.ndarray
    turn_error: float
    seed: int
    false_accepts: float | None = None

    @property
    def limited(self) -> bool:
        """True if too many verdicts are wrong because of base or wrist limits. If so, use inverse kinematics."""
        return self.turn_error > MOST_TURN_ERROR

    @property
    def coarse(self) -> bool:
        """True if too many of the poses that the map accepts are out of reach, see `false_accepts`."""
        return self.false_accepts is not None and self.false_accepts > MOST_FALSE_ACCEPTS

    @property
    def nbytes(self) -> tuple[int, int]:
        """Size in memory [bytes] of the map without its witnesses, and of the witnesses."""
        size = self.rows.nbytes + self.codes.nbytes + self.poles.size // 2
        return size, self.wit_cells.nbytes + 16 * len(self.wit_joints)

    def save(self, path: Path) -> None:
        """Write a compressed file.

        To replace a map safely, the caller saves to a temporary path and renames the file.
        """
        held: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        held |= {"format": _FORMAT, "arm": self.arm.hash}
        with path.open("wb") as file:
            np.savez_compressed(file, **{name: part for name, part in held.items() if part is not None})

    @classmethod
    def load(cls, path: Path, arm: SerialArm, advice: str | None = None) -> ReachMap:
        """Read the map of an arm.

        Args:
            path: The file.
            arm: The arm.
            advice: Last sentence of error messages. By default, it gives the command that builds the map again, for
                an asset with the same name as the arm's base body.

        Raises:
            MapError: The file is missing, damaged or not a map, or was built for another arm.
        """
        again = f"Build it again: {build_command(arm.name, out=path)}." if advice is None else advice
        if not path.is_file():
            raise MapError(f"{path}: {no_file(path, 'reachability map')}. {again}")
        try:
            held: dict[str, Any] = read_arrays(path)
            version, made_for = int(held.pop("format")), str(held.pop("arm"))
            known = [f for f in fields(cls) if f.name != "arm" and (f.name != _MEASURED or f.name in held)]
            told = {f.name: held[f.name] if f.type == "np.ndarray" else held[f.name].item() for f in known}
        except UNREADABLE as error:
            raise MapError(f"{path}: the file is damaged, or not a reachability map ({error}). {again}") from error
        if version != _FORMAT:
            raise MapError(f"{path}: the map should have format {_FORMAT}, got format {version}. {again}")
        if made_for != arm.hash:
            raise MapError(
                f"{path}: the map fits the arm of hash {made_for}, but '{arm.name}' has hash {arm.hash}: links, "
                f"limits or TCP differ. {again}"
            )
        for wrong in _faults(told, len(arm.joints)):
            raise MapError(f"{path}: the reachability map is damaged: {wrong}. {again}")
        return cls(arm, **told)

    def view(self, device: str | wp.Device | None = None) -> MapView:
        """Copy the map to a device."""
        view = MapView()  # pyrefly: ignore[missing-argument]
        view.axis_x, view.axis_y = map(float, self.arm.axis_xy)
        view.nz, view.ntilt, view.nu = self.nz, self.ntilt, self.nu
        view.z_low, view.u_low = self.z_low, self.u_low
        view.per_meter, view.per_radian = 1.0 / self.step, 1.0 / self.tilt_step
        view.pole_nz, view.pole_nr = self.poles.shape[1:]
        view.pole_z_low, view.pole_per_meter = self.pole_z_low, 1.0 / self.pole_step
        view.wit_nz, view.wit_ntilt, view.wit_nu = self.wit_cells.shape[:3]
        view.wit_per_meter = view.per_meter / WITNESS_CELLS[0]
        view.wit_per_radian = view.per_radian / WITNESS_CELLS[1]
        view.njoint = len(self.arm.joints)
        view.base, view.wrist = end_turns(self.arm)
        view.home = vec8(*map(float, as_vec8(self.arm.home[None])[0]))
        with wp.ScopedDevice(device):
            view.rows = wp.array(self.rows, dtype=wp.vec3i)
            view.codes = wp.array(self.codes, dtype=wp.uint32)
            view.values = wp.array(CODE_VALUES, dtype=float)
            view.poles = wp.array(pack(self.poles.ravel()), dtype=wp.uint32)
            view.wit_cells = wp.array(self.wit_cells.reshape(-1, 2), dtype=wp.vec2i)
            view.wit_joints = wp.array(as_vec8(self.wit_joints).astype(np.float16), dtype=vec8h)
        return view

    def verdict(self, poses: np.ndarray, device: str | wp.Device | None = None) -> np.ndarray:
        """Look up poses.

        Args:
            poses: TCP poses in the base frame, shape (N, 4, 4).
            device: Warp's name of the device, or None for Warp's default.

        Returns:
            A tier.Verdict for each pose, shape (N,), uint8.
        """
        poses = np.asarray(poses, np.float64)
        return self.verdict_at(poses[:, :3, 3], poses[:, :3, 2], device)

    def verdict_at(self, pos: np.ndarray, approach: np.ndarray, device: str | wp.Device | None = None) -> np.ndarray:
        """Look up TCP positions [m] and unit approach axes, both (N, 3), base frame. Results are as in `verdict`."""
        with wp.ScopedDevice(device) as scope:
            verdicts = wp.zeros(len(pos), dtype=wp.uint8)
            look_up(self.view(scope), wp.array(pos, dtype=wp.vec3), wp.array(approach, dtype=wp.vec3), verdicts)
            return verdicts.numpy()


WITNESS_CELLS = (4, 6)
"""Size of a witness cell in grid steps, along z, u and v, and along tilt. By default 10 cm and 15 degrees."""


def pack(codes: np.ndarray) -> np.ndarray:
    """Pack four-bit codes, shape (N,), eight per word, starting at the lowest bits."""
    filled = np.zeros(-(-len(codes) // 8) * 8, np.uint32)
    filled[: len(codes)] = codes
    return np.bitwise_or.reduce(filled.reshape(-1, 8) << (4 * np.arange(8, dtype=np.uint32)), axis=1)


def map_path(asset: str) -> Path:
    """Return the path of an arm's map: next to a model file, or in the shipped assets if `asset` is an asset's name."""
    if asset.endswith((".xml", ".urdf")):
        return Path(asset).with_suffix(SUFFIX)
    return Path(str(resources.files("sceniris_gym.assets"))) / "maps" / f"{asset}{SUFFIX}"


def map_file(asset: str) -> Path | None:
    """Return the path of an arm's map, or None if the file does not exist."""
    path = map_path(asset)
    return path if path.is_file() else None


def why_not_map(arm: SerialArm, reach_map: ReachMap | None, asset: str, options: str = "") -> str | None:
    """Return why an arm should use inverse kinematics and not its map, or None if the map should be used.

    Args:
        arm: The arm.
        reach_map: The arm's map, or None.
        asset: Name of an asset, or path of an MJCF or URDF file.
        options: Options for `build_command`.
    """
    if arm.no_map is not None:
        return arm.no_map
    if reach_map is None:
        turns = arm.turns_freely(0) and arm.turns_freely(-1)
        doubt = "" if turns else ", maybe too inexact, as maps ignore the limits of the first and the last joint"
        how = f"build one, on a GPU in seconds, on a CPU core in hours{doubt}: {build_command(asset, options)}"
        return f"it has no map yet ({how})"
    if reach_map.limited:
        return (
            "its reach depends on the rotations of base and wrist, which maps ignore: its map is wrong about "
            f"{reach_map.turn_error:.1%} of the poses in reach, over all orientations or straight up or down"
        )
    if reach_map.coarse:
        return (
            f"its map is too coarse: {reach_map.false_accepts:.2%} of the poses that it accepts, over all orientations "
            f"or straight up or down, are out of reach (build it with finer steps than --step {reach_map.step:g} "
            f"--tilt-step {math.degrees(reach_map.tilt_step):.3g})"
        )
    return None


def default_tier(arm: SerialArm, reach_map: ReachMap | None) -> Tier:
    """Return the default tier of an arm: `map` if its map is accurate enough, `ik` otherwise."""
    return Tier.MAP if why_not_map(arm, reach_map, arm.name) is None else Tier.IK


def build_command(asset: str, options: str = "", out: str | Path | None = None) -> str:
    """Return the command that builds the map of an arm.

    Args:
        asset: Name of an asset, or path of an MJCF or URDF file.
        options: Additional options for the arm, such as its TCP.
        out: Path of the map. By default, `map_path` of the asset.
    """
    return " ".join(filter(None, [f"sceniris-gym reach {asset}", options, f"--build -o {out or map_path(asset)}"]))


def _faults(told: dict[str, Any], njoint: int) -> Iterator[str]:
    """Yield a description of each invalid value in a map file. Later lookups on the device rely on this check."""
    for name in ("nz", "ntilt", "nu", "seed"):
        if type(told[name]) is not int or (name != "seed" and not 2 <= told[name] < _MOST_CORNERS):
            yield f"{name} is {told[name]!r}"
    for name in ("step", "tilt_step", "pole_step", "z_low", "u_low", "pole_z_low", "turn_error"):
        value = told[name]
        if type(value) is not float or not math.isfinite(value) or (name.endswith("step") and value <= 0.0):
            yield f"{name} is {value!r}"
        elif abs(value) > _MOST:
            yield f"{name} is {value!r}, larger than any arm needs"
    share = told.get(_MEASURED, 0.0)
    if type(share) is not float or not 0.0 <= share <= 1.0:
        yield f"{_MEASURED} is {share!r}"
    if not told["codes"].any() and not told["poles"].any():
        yield "all of its codes are 0, out of reach"
    nz, ntilt, nu = told["nz"], told["ntilt"], told["nu"]
    shapes = {
        "rows": (np.int32, (nz * nu, 3)),
        "codes": (np.uint32, (None,)),
        "poles": (np.uint8, (2, None, None)),
        "wit_cells": (np.int32, (None, None, None, None, 2)),
        "wit_joints": (np.float16, (None, njoint)),
    }
    for name, (dtype, shape) in shapes.items():
        array = told[name]
        fits = len(array.shape) == len(shape) and all(b in (None, a) for a, b in zip(array.shape, shape, strict=True))
        if array.dtype != dtype or not fits:
            yield f"{name} holds {array.dtype} of shape {array.shape}"
    rows, poles, cells, joints = (told[name] for name in ("rows", "poles", "wit_cells", "wit_joints"))
    adr, low, length = rows.astype(np.int64).T
    if (rows < 0).any() or (low + length > nu).any() or (adr + ntilt * length > 8 * len(told["codes"])).any():
        yield "rows point outside codes"
    if min(poles.shape) < 2 or (poles > 15).any():
        yield "poles should be codes from 0 to 15 in at least 2 rows and columns"
    if 0 in cells.shape or cells.shape[2] != cells.shape[3]:
        yield f"wit_cells holds {cells.dtype} of shape {cells.shape}"
    if (cells < 0).any() or (cells.astype(np.int64).sum(axis=-1) > len(joints)).any():
        yield "wit_cells point outside wit_joints"
    if not np.isfinite(joints).all():
        yield "wit_joints have non-finite values"
