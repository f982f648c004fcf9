"""Imports a thing: reads, scales, repairs, cuts into convex parts, weighs, tries how it rests, and writes an asset."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.errors import ArgumentError, MeshError, NotSupportedError, SceneFileError, SceneKeyError, import_extra
from sceniris_gym.files import no_file
from sceniris_gym.geometry.framing import box_corners
from sceniris_gym.geometry.pieces import extract_pieces, mesh_vertices
from sceniris_gym.geometry.resting_poses import HomeShape
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.importers.things import meshes
from sceniris_gym.importers.things.convex_parts import Parts, convex_parts, inertia_of
from sceniris_gym.importers.things.grasps import GraspSite, antipodal_grasps
from sceniris_gym.importers.things.meshes import read_urdf
from sceniris_gym.importers.things.repair import Solid, check_faces, repair
from sceniris_gym.importers.things.thing import Inertia, Link, Surface, Thing, write_asset
from sceniris_gym.importers.things.units import UPRIGHT, Ask, find_scale, find_up, parse_scale

SECONDS, STILL = 0.5, 0.01
"""An asset rests in a pose if no point of its bounds moves by more than 1 cm in half a second."""
_GAP = 0.0005  # m over the floor, as in scenes
_MOST = 6  # poses that are tried, the most probable ones
_STANDING = 0.985  # cosine of 10 degrees: a stable pose this near to the authored one is that one


@dataclass(frozen=True)
class Rest:
    """A resting pose.

    Attributes:
        quat: Orientation of the asset, wxyz, its heading being 0.
        probability: The share of throws after which the asset rests in it.
        moved: The distance that it moves in the half second after it is put down in it [m].
    """

    quat: np.ndarray
    probability: float
    moved: float


def resting_poses(path: Path) -> list[Rest]:
    """Return the most probable poses in which an asset rests; none if it rolls from all of them."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.worldbody.bodies[0].add_freejoint()
    mjm = spec.compile()
    home = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, home)
    mujoco.mj_comPos(mjm, home)
    try:
        poses = HomeShape(home, 1, extract_pieces(mjm, "physics")).stable(str(path))
    except SceneKeyError:  # it rolls, or its centre of mass is outside of it
        return []
    return [Rest(quat, share, moved(path, quat)) for quat, share in poses[:_MOST]]


def stands(rests: list[Rest], up: np.ndarray) -> bool:
    """Return whether this direction in the asset's frame, shape (3,), points up in one of the poses."""
    return any(matrix(rest.quat)[2] @ up > _STANDING for rest in rests)


def moved(path: Path, quat: np.ndarray) -> float:
    """Put an asset on a floor and return how far the corners of its bounds move [m] in half a second.

    Args:
        path: Its MJCF.
        quat: Its orientation, wxyz.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.worldbody.bodies[0].add_freejoint()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], friction=[0.8, 0.005, 0.0001])
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    data.qpos[3:7] = quat
    mujoco.mj_kinematics(mjm, data)
    points = [
        data.geom_xpos[g] + mesh_vertices(mjm, mjm.geom_dataid[g]) @ data.geom_xmat[g].reshape(3, 3).T
        for g in range(mjm.ngeom)
        if mjm.geom_contype[g] and mjm.geom_dataid[g] >= 0
    ]
    every = np.concatenate(points)
    data.qpos[2] = _GAP - every[:, 2].min()
    low, high = every.min(axis=0), every.max(axis=0)
    local = box_corners(0.5 * (low + high), 0.5 * (high - low)) @ matrix(quat)
    start = data.qpos[:3] + local @ matrix(quat).T
    while data.time < SECONDS:
        mujoco.mj_step(mjm, data)
    end = data.qpos[:3] + local @ matrix(data.qpos[3:7]).T
    return float(np.linalg.norm(end - start, axis=1).max())


SUFFIXES = (*meshes.SUFFIXES, ".usd", ".usda", ".usdc", ".usdz", ".urdf")
"""Suffixes of the files that can be imported."""
_FRAME = Inertia(1e-6, np.zeros(3), 1e-12 * np.eye(3))
"""Inertia of a link that is only a frame."""
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Options:
    """The user's choices for an import.

    Attributes:
        scale: Metres for each unit of length, or the name of a unit; None for the file's own, or a guess.
        up: The axis that points up; None likewise.
        density: In kg/m^3.
        tolerance: The largest distance of convex parts from the surface [m]; None for 2 mm or 2%, whichever is larger.
        shell: Whether open surfaces are sheets, which enclose nothing.
    """

    scale: str | None = None
    up: str | None = None
    density: float = 500.0
    tolerance: float | None = None
    shell: bool = False

    def check(self) -> None:
        """Refuse numbers that make no sense.

        Raises:
            ArgumentError: The scale, the density or the tolerance is out of range.
        """
        if self.scale is not None:
            parse_scale(self.scale)
        for name, value, least, most in (
            ("density", self.density, 0.01, 1e5),
            ("tolerance", self.tolerance, 1e-6, 10.0),
        ):
            if value is not None and not least <= value <= most:
                raise ArgumentError(f"{name}: {value!r} should be from {least:g} to {most:g}.")


def import_thing(source: Path, out: Path, options: Options | None = None, ask: Ask | None = None) -> dict[str, Any]:
    """Import a thing as an asset.

    Args:
        source: A file of one of `SUFFIXES`.
        out: The MJCF file to write; meshes, pictures and `manifest.json` go into a folder of its name beside it.
        options: The user's choices.
        ask: Asks the user for the scale where it makes no sense; None if nobody can be asked.

    Returns:
        The manifest: what was read, guessed, repaired and measured, with the hashes of all files.

    Raises:
        MeshError: It is empty, flat, open, too large, too small or thin, has too many faces, or no convex parts fit.
        SceneFileError: It cannot be read, or a file that it refers to does not exist.
        NotSupportedError: It is of another kind, or has something that things cannot have.
        MissingExtraError: It needs a package of the extra `import`.
    """
    options = options or Options()
    options.check()
    where = str(source)
    thing = _read(source)
    check_faces([surface for link in thing.links for surface in link.touched], where)
    scale, scale_how = find_scale(thing, options.scale, ask, where)
    thing = thing.scaled(scale)
    touched = {link.name: link.touched for link in thing.links if link.touched}
    solids = {name: repair(some, f"{where}: {name}", shell=options.shell) for name, some in touched.items()}
    if not solids:
        raise MeshError(f"{where}: nothing of it has a volume.", "flat")
    cut = {name: convex_parts(solid, where, options.tolerance) for name, solid in solids.items()}
    patched = [
        replace(link, surfaces=(*link.surfaces, *solids[link.name].patches))
        if link.name in solids and not link.solids
        else link
        for link in thing.links
    ]
    thing = replace(thing, name=out.stem, links=tuple(patched))
    written = [_written(link, solids.get(link.name), cut.get(link.name), options.density, where) for link in patched]
    asset = replace(thing, links=tuple(written))
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".import-", dir=out.parent) as folder:
        draft = Path(folder) / out.name
        write_asset(asset, [], draft)
        rests = resting_poses(draft)
        up, up_how = find_up(thing, options.up, lambda axis: stands(rests, np.eye(3)["xyz".index(axis)]))
        turn = UPRIGHT[up]
        bare = tuple(replace(link, surfaces=link.touched, solids=()) for link in thing.links)
        points = replace(thing, links=bare).points() @ turn.T
        low, high = points.min(axis=0), points.max(axis=0)
        shift = np.array([*(-0.5 * (low + high)[:2]), -low[2]])
        asset = asset.moved(turn, shift)
        grasps = _grasps(thing.moved(turn, shift).links[0], asset.links[0])
        shutil.rmtree(draft.parent / draft.stem)
        files = write_asset(asset, grasps, draft)
        rests = resting_poses(draft)
        tags = {"graspable": bool(grasps), "rigid": len(asset.links) == 1, "stands": stands(rests, _UP)}
        manifest = {
            "source": source.name,
            "sha256": _hash(source),
            "meters_per_unit": scale,
            "scale": scale_how,
            "up": up,
            "up_from": up_how,
            "size_m": [round(float(v), 5) for v in high - low],
            "mass_kg": round(sum(link.inertia.mass for link in asset.links if link.inertia), 6),
            **_findings(thing, solids.values(), cut.values(), rests),
            "grasps": len(grasps),
            "tags": [tag for tag, holds in tags.items() if holds],
            "files": {file.name: _hash(file) for file in files},
        }
        (draft.parent / draft.stem / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n")
        target = out.parent / out.stem
        if target.exists():
            shutil.rmtree(target)
        os.replace(draft.parent / draft.stem, target)
        os.replace(draft, out)
    return manifest


def _read(source: Path) -> Thing:
    suffix = source.suffix.lower()
    if not source.is_file():
        raise SceneFileError(
            f"{source}: {no_file(source)}. Give the path of one ({', '.join(SUFFIXES)}), or of a folder of them."
        )
    if suffix not in SUFFIXES:
        raise NotSupportedError(f"{source}: it should be one of {', '.join(SUFFIXES)}. Export it as one of them.")
    if suffix == ".urdf":
        return read_urdf(source)
    if suffix in meshes.SUFFIXES:
        return meshes.read_mesh(source)
    import_extra("pxr", "import", "usd-core")
    from sceniris_gym.importers.things.usd import read_usd

    return read_usd(source)


def _written(link: Link, solid: Solid | None, parts: Parts | None, density: float, where: str) -> Link:
    """Return a link as it is written: with an inertia, and its convex parts as solids."""
    if solid is None or parts is None:
        return replace(link, inertia=link.inertia or _FRAME)
    hulls = tuple(Surface(np.asarray(part.vertices), np.asarray(part.faces)) for part in parts.meshes)
    inertia = link.inertia or inertia_of(solid, parts, density, f"{where}: {link.name}")
    return replace(link, solids=hulls, inertia=inertia)


def _grasps(link: Link, written: Link) -> list[GraspSite]:
    """Return grasps of the root link that keep clear of its surface, and of its convex parts as it is written."""
    if not written.solids:
        return []
    triangles = np.concatenate([surface.vertices[surface.faces] for surface in link.touched])
    parts = [part.vertices for part in written.solids]
    return antipodal_grasps(triangles, np.concatenate([triangles.reshape(-1, 3)[::7], triangles.mean(axis=1), *parts]))


def _findings(thing: Thing, solids: Iterable[Solid], cut: Collection[Parts], rests: list[Rest]) -> dict[str, Any]:
    """Return the repairs, parts, resting poses and notes of the manifest."""
    notes = [*thing.notes]
    if not any(rest.moved < STILL for rest in rests):
        notes.append("it rests in no pose: it rolls or tips over")
    elif not stands(rests, _UP):
        notes.append("as it is written it tips over: give it 'orientation: stable', or --up")
    return {
        "repaired": [line for solid in solids for line in solid.report],
        "parts": sum(len(parts.meshes) for parts in cut),
        "method": "; ".join(parts.method for parts in cut),
        "error_mm": round(1000.0 * max(parts.fit.error for parts in cut), 3),
        "tolerance_mm": round(1000.0 * max(parts.tolerance for parts in cut), 3),
        "rests": [
            {
                "quat": [round(float(v), 6) for v in rest.quat],
                "probability": round(rest.probability, 4),
                "moved_mm": round(1000.0 * rest.moved, 3),
            }
            for rest in rests
        ],
        "notes": notes,
    }


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
