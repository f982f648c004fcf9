"""What is accepted although it was probably not meant: one warning for each kind, with its extent and the remedy."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator

import mujoco
import numpy as np
import trimesh

from sceniris_gym.config.fields import MOST_FAR
from sceniris_gym.errors import ModelWarning
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.geometry.pieces import Piece, PieceType, flat_faces, geom_name
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.model import SceneModel

# A hull that is larger than its mesh by more than this factor fills something in.
_FILLED = 1.3
# The largest extent of a thing [m]; beyond, its units are probably others.
_SMALLEST, _LARGEST = 1.0e-3, 50.0
# How deep [m] two things that stand still may overlap: files are rounded.
_SUNK = 1.0e-3
# How far [m] geoms may reach from the origin, along an axis: up to there rounding stays below what counts as touching.
_FINE = 128.0


def warn_of_oddities(scene: SceneModel, plan: Plan) -> None:
    """Warn of what is odd in a scene: `ModelWarning`, once for each kind of oddity."""
    kinds = _flat(scene, plan), _filled(scene, plan), _sizes(scene, plan), _sunk(scene, plan), _coarse(scene, plan)
    for text in itertools.chain(*kinds):
        warnings.warn(f"{scene.config.where}: {text}", ModelWarning, stacklevel=2)


def _flat(scene: SceneModel, plan: Plan) -> Iterator[str]:
    """Faces without area, which have no inside and no normal."""
    if scene.config.geometry != "visual":
        return
    counts = {p.geom: _flat_number(p.mesh) for p in plan.pieces if p.mesh is not None}
    found = [f"{count} of geom '{geom_name(scene.mjm, geom)}'" for geom, count in counts.items() if count]
    if found:
        yield (
            f"faces without area are left out: {_some(found)}. Nothing is lost if the mesh is closed without them; "
            "merge its vertices and remove degenerate faces to be rid of this."
        )


def _filled(scene: SceneModel, plan: Plan) -> Iterator[str]:
    """Meshes that collide as a hull much larger than they are."""
    if scene.config.geometry != "physics":
        return
    mjm, found = scene.mjm, []
    for p in plan.pieces:
        if p.type == PieceType.HULL and p.mesh is not None:
            mesh = int(mjm.geom_dataid[p.geom])
            vert, face = mjm.mesh_vertadr[mesh], mjm.mesh_faceadr[mesh]
            surface = trimesh.Trimesh(
                mjm.mesh_vert[vert : vert + mjm.mesh_vertnum[mesh]].astype(float),
                mjm.mesh_face[face : face + mjm.mesh_facenum[mesh]],
            )
            ratio = p.mesh.volume / abs(surface.volume) if surface.is_watertight and surface.volume else 1.0
            if ratio > _FILLED:
                found.append(f"geom '{geom_name(mjm, p.geom)}' ({ratio:.2g} times its volume)")
    if found:
        yield (
            f"MuJoCo collides meshes as their convex hulls, which fill the hollows of {_some(found)}. Compose them of "
            "several convex geoms, or use `geometry: visual` if only placing should see the hollows."
        )


def _flat_number(mesh: trimesh.Trimesh) -> int:
    """How many faces of a mesh have no area, those among them that are left out already."""
    return int(flat_faces(mesh.triangles).sum()) + mesh.metadata.get("left_out", 0)


def _sizes(scene: SceneModel, plan: Plan) -> Iterator[str]:
    """Objects of a size that suggests other units."""
    found = []
    for name in plan.slots:
        bodies = set(scene.subtree(name))
        ends = [plan.extents(p) for p in plan.pieces if p.body in bodies and p.type != PieceType.PLANE]
        if ends:
            size = float((np.max([high for _, high in ends], 0) - np.min([low for low, _ in ends], 0)).max())
            if not _SMALLEST <= size <= _LARGEST:
                found.append(f"'{name}' ({size:.3g} m)")
    if found:
        yield (
            f"implausible sizes, as {_SMALLEST:g} to {_LARGEST:g} m are usual: {_some(found)}. Lengths are in metres: "
            "give a mesh in other units a `scale`, e.g. 0.001 for millimetres."
        )


def _sunk(scene: SceneModel, plan: Plan) -> Iterator[str]:
    """What stands still for good and is inside of something else that does; MuJoCo never reports such contacts."""
    if scene.config.geometry != "physics":
        return
    mjm, config = scene.mjm, scene.config
    placed = {body for n, part in config.objects.items() if part.kind != "static" for body in scene.subtree(n)}
    still = [p for p in plan.pieces if p.body not in placed]
    rules = ContactRules(mjm, "physics")
    deepest: dict[tuple[str, str], float] = {}
    for a, b in _near(mjm, plan.home, still):
        roots = [int(mjm.body_rootid[p.body]) for p in (a, b)]
        excluded = roots[0] == roots[1] or rules.excludes(a.body, b.body)
        if excluded or not rules.meet(a.contact_class, b.contact_class):
            continue
        depth = -mujoco.mj_geomDistance(mjm, plan.home, a.geom, b.geom, 0.0, None)
        if depth > _SUNK:
            names = mjm.body(roots[0]).name, mjm.body(roots[1]).name
            deepest[names] = max(depth, deepest.get(names, 0.0))
    if deepest:
        found = [f"'{one}' is {1e3 * depth:.3g} mm inside '{other}'" for (one, other), depth in deepest.items()]
        yield (
            f"what stands still overlaps: {_some(found)}. Nothing moves them apart; correct their positions (for the "
            "robot `robot.base`), or exclude the pair if that is meant."
        )


def _coarse(scene: SceneModel, plan: Plan) -> Iterator[str]:
    """What reaches so far that rounding there may use up the clearance of something that is placed or drawn."""
    mjm, found = scene.mjm, []
    drawn = [o.config for o in plan.objects if o.config is None or o.config.kind != "marker"]
    least = min((c.clearance if c is not None and c.is_placed else 0.0 for c in drawn), default=np.inf)
    if np.any(mjm.geom_margin > 0.0) or np.any(mjm.pair_margin > 0.0):  # nothing may come into a margin
        least = min(least, 0.0)
    for p in (p for p in plan.pieces if drawn and p.type != PieceType.PLANE):
        low, high = plan.extents(p)
        reach = float(np.abs([low, high]).max())
        resolution = float(np.spacing(np.float32(reach)))
        if reach > _FINE and resolution > least and np.all(low <= MOST_FAR) and np.all(high >= -MOST_FAR):
            found.append(f"geom '{geom_name(mjm, p.geom)}' ({reach:.4g} m, {1e6 * resolution:.2g} um)")
    if found:
        yield (
            f"what reaches beyond {_FINE:g} m from the world's origin is rounded, and things of less 'clearance' "
            f"may touch it: {_some(found)}. Use a plane or smaller geoms, or a 'clearance' of 0.0001 or more."
        )


def _near(mjm: mujoco.MjModel, home: mujoco.MjData, pieces: list[Piece]) -> Iterator[tuple[Piece, Piece]]:
    """Pairs of pieces whose geoms' bounding spheres meet at home. All of a row at once: scenes have thousands."""
    geoms = [p.geom for p in pieces]
    at, radius = home.geom_xpos[geoms], mjm.geom_rbound[geoms]
    radius = np.where(radius > 0.0, radius, np.inf)  # 0 for a plane
    for i, one in enumerate(pieces):
        apart = np.linalg.norm(at[i + 1 :] - at[i], axis=1)
        for j in np.flatnonzero(apart <= radius[i + 1 :] + radius[i]):
            yield one, pieces[i + 1 + j]


def _some(found: list[str], most: int = 5) -> str:
    """The first of a list of findings, and how many more there are."""
    more = f", and {len(found) - most} more" if len(found) > most else ""
    return ", ".join(found[:most]) + more
