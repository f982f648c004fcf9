"""Imports a thing: reads, scales, repairs, cuts into convex parts, weighs, tries how it rests, and writes an asset."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.errors import ArgumentError, FlatMeshError, NotSupportedError, SceneFileError, SliverError
from sceniris_gym.importers.things import meshes, usd
from sceniris_gym.importers.things.convex_parts import Parts, convex_parts
from sceniris_gym.importers.things.grasps import antipodal_grasps
from sceniris_gym.importers.things.inertia import inertia_of
from sceniris_gym.importers.things.repair import Solid, check_faces, repair
from sceniris_gym.importers.things.rest import STILL, Rest, resting_poses, stands
from sceniris_gym.importers.things.thing import LEAST_MOMENT, Inertia, Link, Surface, Thing
from sceniris_gym.importers.things.units import Ask, find_scale, find_up, parse_scale, upright
from sceniris_gym.importers.things.urdf import read_urdf
from sceniris_gym.importers.things.write import Body, write_asset

SUFFIXES = (*meshes.SUFFIXES, *usd.SUFFIXES, ".urdf")
"""What can be imported."""
_MARK = 1e-6  # kg, of a link that is nothing but a frame


@dataclass(frozen=True)
class Options:
    """What a user may say about a thing.

    Attributes:
        scale: Metres for each unit of length, or the name of a unit; None to take what the file says, or guess.
        up: The axis that points up; None likewise.
        density: In kg/m^3.
        tolerance: How far convex parts may be from the surface [m]; None for 2 mm or 2%, whichever is larger.
        shell: Whether open surfaces are sheets without inside.
    """

    scale: str | None = None
    up: str | None = None
    density: float = 500.0
    tolerance: float | None = None
    shell: bool = False

    def check(self) -> None:
        """Refuse numbers that make no sense.

        Raises:
            ArgumentError: The scale, the density or the tolerance is none.
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
        options: What is known of the thing.
        ask: Asks the user for the scale where it makes no sense; None if there is nobody to be asked.

    Returns:
        The manifest: what was read, guessed, repaired and measured, with the hashes of all files.

    Raises:
        MeshError: It is empty, flat, open, too large, too small or thin, has too many faces, or no convex parts fit.
        SceneFileError: It cannot be read, or a file that it refers to does not exist.
        NotSupportedError: It is of another kind, or has what things cannot have.
        MissingExtraError: It needs a package of the extra `import`.
    """
    options = options or Options()
    options.check()
    where = str(source)
    thing = _read(source)
    check_faces([surface for link in thing.links for surface in link.touched], where)
    scale, scale_how = find_scale(thing, options.scale, ask, where)
    thing = thing.scaled(scale)
    solids = [_solid(link, f"{where}: {link.name}", options.shell) for link in thing.links]
    if not any(solids):
        raise FlatMeshError(f"{where}: nothing of it has a volume.")
    cut = [solid and convex_parts(solid, where, options.tolerance) for solid in solids]
    weighed = [
        replace(
            link,
            surfaces=_patched(link, solid),
            inertia=_weigh(link, solid, parts, options.density, where),
        )
        for link, solid, parts in zip(thing.links, solids, cut, strict=True)
    ]
    thing = replace(thing, name=out.stem, links=tuple(weighed))
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".import-", dir=out.parent) as folder:
        draft = Path(folder) / out.name
        rests = _draft(thing, cut, np.eye(3), np.zeros(3), draft)
        up, up_how = find_up(thing, options.up, lambda axis: stands(rests, _axis(axis)))
        turn = upright(up)
        low, high = _bounds(thing, cut, turn)
        shift = np.array([*(-0.5 * (low + high)[:2]), -low[2]])
        shutil.rmtree(draft.parent / draft.stem)
        files, rests, grasps = _final(thing, cut, turn, shift, draft)
        manifest = {
            "source": source.name,
            "sha256": _hash(source),
            "meters_per_unit": scale,
            "scale": scale_how,
            "up": up,
            "up_from": up_how,
            "size_m": [round(float(v), 5) for v in high - low],
            "mass_kg": round(sum(link.inertia.mass for link in thing.links if link.inertia), 6),
            **_told(thing, solids, cut, rests),
            "grasps": grasps,
            "files": {file.name: _hash(file) for file in files},
        }
        text = json.dumps(manifest, indent=1)
        (draft.parent / draft.stem / "manifest.json").write_text(text + "\n")
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
            f"{source}: there is no such file. Give the path of one ({', '.join(SUFFIXES)}), or of a folder of them."
        )
    if suffix not in SUFFIXES:
        raise NotSupportedError(f"{source}: it should be one of {', '.join(SUFFIXES)}. Export it as one of them.")
    if suffix == ".urdf":
        return read_urdf(source)
    return usd.read_usd(source) if suffix in usd.SUFFIXES else meshes.read_mesh(source)


def _solid(link: Link, where: str, shell: bool) -> Solid | None:
    return repair(link.touched, where, shell=shell) if link.touched else None


def _patched(link: Link, solid: Solid | None) -> tuple[Surface, ...]:
    """What is seen of a link, with what closed its holes if that is also what is touched."""
    own = link.surfaces
    return (*own, solid.patches) if solid is not None and solid.patches is not None and not link.solids else own


def _weigh(link: Link, solid: Solid | None, parts: Parts | None, density: float, where: str) -> Inertia:
    if link.inertia is not None:
        return link.inertia
    if solid is None or parts is None:
        return Inertia(_MARK, np.zeros(3), np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) * _MARK * 1e-6)
    found = inertia_of(solid, parts, density)
    if (least := found.least) <= LEAST_MOMENT:
        raise SliverError(
            f"{where}: {link.name}: it is a sliver of {1e6 * found.mass:.2g} mg, and its least moment of inertia is "
            f"{least:.1g} kg m^2. It should be at least {LEAST_MOMENT:g} kg m^2 for MuJoCo. Leave it out, or give it a "
            "thickness; if it should be larger, give its --scale."
        )
    return found


def _draft(thing: Thing, cut: Sequence[Parts | None], turn: np.ndarray, shift: np.ndarray, path: Path) -> list[Rest]:
    """Write the thing so, and return how it rests."""
    _write(thing, cut, turn, shift, [], path)
    return resting_poses(path)


def _final(
    thing: Thing, cut: Sequence[Parts | None], turn: np.ndarray, shift: np.ndarray, path: Path
) -> tuple[list[Path], list[Rest], int]:
    """Write the thing upright, with its grasps; return the files, its resting poses, and how many grasps it has."""
    root = thing.moved(turn, shift).links[0]
    grasps = []
    if root.touched and cut[0] is not None:
        triangles = np.concatenate([surface.vertices[surface.faces] for surface in root.touched])
        points = np.concatenate([triangles.reshape(-1, 3)[::7], triangles.mean(axis=1)])
        parts = np.concatenate([part.vertices for part in cut[0].meshes]) @ turn.T + shift
        grasps = antipodal_grasps(triangles, np.concatenate([points, parts]), 0.0)
    files = _write(thing, cut, turn, shift, grasps, path)
    return files, resting_poses(path), len(grasps)


def _write(
    thing: Thing, cut: Sequence[Parts | None], turn: np.ndarray, shift: np.ndarray, grasps: list, path: Path
) -> list[Path]:
    moved, bodies = thing.moved(turn, shift), []
    for i, (link, parts) in enumerate(zip(moved.links, cut, strict=True)):
        shapes = [] if parts is None else [(np.asarray(m.vertices), np.asarray(m.faces)) for m in parts.meshes]
        if i == 0:
            shapes = [(vertices @ turn.T + shift, faces) for vertices, faces in shapes]
        assert link.inertia is not None
        bodies.append(Body(shapes, link.inertia))
    files = write_asset(moved, bodies, grasps, path)
    # MuJoCo knows meshes by their paths and times in seconds: it would take those of the draft, written just before.
    mujoco.mj_clearCache(mujoco.mj_getCache())
    return files


def _bounds(thing: Thing, cut: Sequence[Parts | None], turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The bounds of what is touched of a thing, turned [m]."""
    solids = tuple(
        replace(link, surfaces=link.touched, solids=()) if parts is not None else replace(link, surfaces=(), solids=())
        for link, parts in zip(thing.links, cut, strict=True)
    )
    points = replace(thing, links=solids).points() @ turn.T
    return points.min(axis=0), points.max(axis=0)


def _told(
    thing: Thing, solids: Sequence[Solid | None], cut: Sequence[Parts | None], rests: list[Rest]
) -> dict[str, Any]:
    """What was done and found, for the manifest."""
    made = [parts for parts in cut if parts is not None]
    notes = [*thing.notes]
    if not any(rest.moved < STILL for rest in rests):
        notes.append("it rests in no pose: it rolls or tips over")
    elif not stands(rests, np.array([0.0, 0.0, 1.0])):
        notes.append("as it is written it tips over: give it 'orientation: stable', or --up")
    return {
        "repaired": [line for solid in solids if solid is not None for line in solid.report],
        "parts": sum(len(parts.meshes) for parts in made),
        "method": "; ".join(parts.method for parts in made),
        "error_mm": round(1000.0 * max(parts.fit.error for parts in made), 3),
        "tolerance_mm": round(1000.0 * max(parts.tolerance for parts in made), 3),
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


def _axis(name: str) -> np.ndarray:
    return np.eye(3)["xyz".index(name)]


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
