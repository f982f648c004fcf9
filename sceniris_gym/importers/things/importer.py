"""Imports an object: scales and repairs it, cuts it into convex parts, simulates how it rests, and writes an asset."""

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
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.geometry.resting_poses import HomeShape
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.importers.things import meshes
from sceniris_gym.importers.things.convex_parts import MOST_PARTS, Parts, convex_parts, inertia_of
from sceniris_gym.importers.things.grasps import GraspSite, antipodal_grasps
from sceniris_gym.importers.things.repair import Solid, check_faces, repair
from sceniris_gym.importers.things.thing import Inertia, Link, Surface, Thing, write_asset
from sceniris_gym.importers.things.units import UPRIGHT, Ask, find_scale, find_up
from sceniris_gym.progress import tell
from sceniris_gym.scene.overview import box_corners

SECONDS, STILL = 0.5, 0.01
"""An asset rests in a pose if no point of its bounds moves by more than 1 cm in half a second."""
_GAP = 0.0005  # height above the floor [m], as in scenes
_MOST = 6  # number of poses to simulate, most probable first. A pose with an axis up may be less probable.
_STANDING = 0.985  # cosine of 10 degrees: the largest tilt at which a stable pose counts as upright
_NEXT = 0.9  # cosine of 26 degrees: faces at smaller angles belong to a curved side, on which the object rolls


@dataclass(frozen=True)
class Rest:
    """A resting pose.

    Attributes:
        quat: Orientation of the asset, wxyz, at heading 0.
        probability: Estimated fraction of random throws after which the asset rests in this pose.
        moved: How far the asset moves in a simulation of half a second that starts in this pose [m].
        is_flat: False on a curved side of many faces, where the asset also rests on the faces next to this one.
    """

    quat: np.ndarray
    probability: float
    moved: float
    is_flat: bool


def resting_poses(path: Path) -> list[Rest]:
    """Return resting poses of an asset, most probable first: the first 6, and the first with each of its axes up.

    The list is empty if the asset has no stable pose. A bottle with many sides lies on each of them more often than it
    stands.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.worldbody.bodies[0].add_freejoint()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], friction=[0.8, 0.005, 0.0001])
    mjm = spec.compile()
    tell("resting poses", 0, 1)
    home = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, home)
    mujoco.mj_comPos(mjm, home)
    shape = HomeShape(home, 1, extract_pieces(mjm, "physics", {*range(1, mjm.nbody)}))
    try:
        poses = shape.stable(str(path))
    except SceneKeyError:  # it rolls, or its centre of mass is outside its hull
        return []
    points = np.concatenate(shape.points())
    ups = np.array([matrix(quat)[2] for quat, _ in poses])
    flat = (ups @ ups.T > _NEXT).sum(axis=1) == 1
    upright = (ups > _STANDING) & flat[:, None]
    kept = sorted({*range(min(_MOST, len(poses))), *upright.argmax(axis=0).tolist()})
    return [Rest(*poses[i], moved(mjm, points, poses[i][0]), bool(flat[i])) for i in kept]


def stands(rests: list[Rest], up: np.ndarray) -> bool:
    """Return whether the direction `up` points up, within 10 degrees, in one of the resting poses on a flat side.

    `up` is in the asset's frame, shape (3,).
    """
    return any(rest.is_flat and matrix(rest.quat)[2] @ up > _STANDING for rest in rests)


def moved(mjm: mujoco.MjModel, points: np.ndarray, quat: np.ndarray) -> float:
    """Simulate an asset on a floor for half a second. Return how far [m] a corner of its bounds moves at most.

    Args:
        mjm: A model of the asset with a free joint, on a floor.
        points: Vertices of the asset's collision geometry in the root's frame [m], shape (n, 3).
        quat: Initial orientation, wxyz.
    """
    data, rotated = mujoco.MjData(mjm), points @ matrix(quat).T
    low, high = rotated.min(axis=0), rotated.max(axis=0)
    data.qpos[2], data.qpos[3:7] = _GAP - low[2], quat
    local = box_corners(0.5 * (low + high), 0.5 * (high - low)) @ matrix(quat)
    start = data.qpos[:3] + local @ matrix(quat).T
    while data.time < SECONDS:
        mujoco.mj_step(mjm, data)
    return float(np.linalg.norm(data.qpos[:3] + local @ matrix(data.qpos[3:7]).T - start, axis=1).max())


SUFFIXES = (*meshes.SUFFIXES, ".usd", ".usda", ".usdc", ".usdz", ".urdf")
"""File suffixes that can be imported."""
_FRAME = Inertia(1e-6, np.zeros(3), 1e-12 * np.eye(3))
"""Inertia of a link without geometry."""
_UP = np.array([0.0, 0.0, 1.0])
_LIMITS = {"density": (0.01, 1e5), "tolerance": (1e-6, 10.0), "max_parts": (1, MOST_PARTS)}


@dataclass(frozen=True)
class Options:
    """The user's choices for an import.

    Attributes:
        scale: Metres per unit of length, as a number in text, or the name of a unit, such as "mm". If None, the scale
            comes from the file or is guessed.
        up: The axis of the file that points up: "x", "y" or "z". If None, it comes from the file or is guessed.
        density: Density [kg/m^3].
        tolerance: Largest distance between the convex parts and the surface [m]. If None, 2 mm or 2% of the longest
            edge of each link, whichever is larger, and more where this gives more than `max_parts`.
        max_parts: Greatest number of convex parts of a link. If None, 32, or 160 if a `tolerance` is given.
        shell: Whether the surfaces are sheets that enclose no volume. If so, holes in them are not closed.
    """

    scale: str | None = None
    up: str | None = None
    density: float = 500.0
    tolerance: float | None = None
    shell: bool = False
    max_parts: int | None = None

    def check(self) -> None:
        """Check the ranges of the options, except the scale, which `find_scale` checks.

        Raises:
            ArgumentError: The density, the tolerance or the number of parts is out of range.
        """
        for name, (least, most) in _LIMITS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise ArgumentError(f"{name}: {value!r} should be from {least:g} to {most:g}.")


def import_thing(source: Path, out: Path, options: Options | None = None, ask: Ask | None = None) -> dict[str, Any]:
    """Import a file as an asset.

    Args:
        source: A file with one of `SUFFIXES`.
        out: The MJCF file to write. Meshes, images and `manifest.json` go to a folder of the same name next to it.
        options: The user's choices.
        ask: Function that prompts the user for a scale if the object's size is implausible, see `find_scale`. If None,
            such a size is an error.

    Returns:
        The manifest: scale and up axis with their sources, repairs, measurements, and the hashes of all files.

    Raises:
        MeshError: The object is empty, flat, open, too large, too small or too thin, or has too many faces or
            non-finite vertices. Or the convex parts are too many or not within the tolerance.
        SceneFileError: The file cannot be read, or a file that it refers to does not exist.
        NotSupportedError: The file type, or an element such as a floating joint, is not supported.
        MissingExtraError: The import needs a package of the extra `import`.
    """
    options = options or Options()
    options.check()
    where = str(source)
    thing = _read(source)
    check_faces([surface for link in thing.links for surface in link.touched], where)
    scale, scale_how = find_scale(thing, options.scale, ask, where, options.density)
    thing = thing.scaled(scale)
    touched = {link.name: link.touched for link in thing.links if link.touched}
    solids = {name: repair(some, f"{where}: {name}", shell=options.shell) for name, some in touched.items()}
    if not solids:
        raise MeshError(f"{where}: it has no volume. Export a closed surface, or give it a thickness.", "flat")
    cut = {name: convex_parts(solid, where, options.tolerance, options.max_parts) for name, solid in solids.items()}
    patches = {link.name: solids[link.name].patches for link in thing.links if link.touched and not link.solids}
    patched = [replace(link, surfaces=(*link.surfaces, *patches.get(link.name, ()))) for link in thing.links]
    thing = replace(thing, name=out.stem, links=tuple(patched))
    written = [_written(link, solids.get(link.name), cut.get(link.name), options.density, where) for link in patched]
    asset = replace(thing, links=tuple(written))
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".import-", dir=out.parent) as folder:
        draft = Path(folder) / out.name
        write_asset(asset, [], draft)
        rests = resting_poses(draft)
        up, up_how = find_up(thing, options.up, lambda axis: stands(rests, np.eye(3)["xyz".index(axis)]))
        rotation = UPRIGHT[up]
        points = thing.points() @ rotation.T
        low, high = points.min(axis=0), points.max(axis=0)
        shift = np.array([*(-0.5 * (low + high)[:2]), -low[2]])
        asset = asset.moved(rotation, shift)
        tell("grasps", 0, 1)
        grasps = _grasps(thing.moved(rotation, shift).links[0], asset.links[0])
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
        raise SceneFileError(f"{source}: {no_file(source)}. Give a folder, or a file ({', '.join(SUFFIXES)}).")
    if suffix not in SUFFIXES:
        raise NotSupportedError(f"{source}: its type should be one of {', '.join(SUFFIXES)}. Export it as one of them.")
    if suffix == ".urdf":
        return meshes.read_urdf(source)
    if suffix in meshes.SUFFIXES:
        return meshes.read_mesh(source)
    import_extra("pxr", "import", "usd-core")
    from sceniris_gym.importers.things.usd import read_usd

    return read_usd(source)


def _written(link: Link, solid: Solid | None, parts: Parts | None, density: float, where: str) -> Link:
    """Return a link as it is written to the asset: its collision surfaces are the convex parts, and it has an inertia.

    Args:
        link: The link as read from the file.
        solid: The repaired surface of the link. None if the link has no geometry.
        parts: Convex parts of this surface, or None.
        density: Density [kg/m^3], for a link whose file gives no inertia.
        where: Prefix of error messages.
    """
    if solid is None or parts is None:
        return replace(link, inertia=link.inertia or _FRAME)
    hulls = tuple(Surface(np.asarray(part.vertices), np.asarray(part.faces)) for part in parts.meshes)
    inertia = link.inertia or inertia_of(solid, parts, density, f"{where}: {link.name}")
    return replace(link, solids=hulls, inertia=inertia)


def _grasps(link: Link, written: Link) -> list[GraspSite]:
    """Return grasps of the root link in which the open hand avoids the link's surface and its convex parts.

    Args:
        link: The link as read from the file.
        written: The link as written to the asset, with its convex parts.
    """
    if not written.solids:
        return []
    triangles = np.concatenate([surface.vertices[surface.faces] for surface in link.touched])
    parts = [part.vertices for part in written.solids]
    return antipodal_grasps(triangles, np.concatenate([triangles.reshape(-1, 3)[::7], triangles.mean(axis=1), *parts]))


def _findings(thing: Thing, solids: Iterable[Solid], cut: Collection[Parts], rests: list[Rest]) -> dict[str, Any]:
    """Return the manifest's entries on repairs, convex parts, resting poses and notes."""
    notes = [*thing.notes]
    if not any(rest.moved < STILL for rest in rests):
        notes.append("it has no stable pose: it rolls or tips over")
    elif not stands(rests, _UP):
        notes.append("it tips over in its default orientation: give it 'orientation: stable', or --up")
    return {
        "repaired": [line for solid in solids for line in solid.report],
        "parts": sum(len(parts.meshes) for parts in cut),
        "method": "; ".join(parts.method for parts in cut),
        "error_mm": round(1000.0 * max(parts.error for parts in cut), 3),
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
