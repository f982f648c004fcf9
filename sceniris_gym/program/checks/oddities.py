"""Warnings about scenes that are valid, but probably not as intended. Each warning names the parts and a remedy."""

from collections.abc import Iterator

import mujoco
import numpy as np

from sceniris_gym.config.bounds import MOST_FAR
from sceniris_gym.errors import ModelWarning
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.geometry.pieces import Piece, PieceType, flat_faces, geom_name, mesh_surface
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.notices import warn
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.model import SceneModel

# A hull that is larger than its mesh by more than this factor fills a hollow.
_FILLED = 1.3
# Usual extents of an object [m]. Outside of this range, the file probably has other units.
_SMALLEST, _LARGEST = 1.0e-3, 50.0
# Greatest usual extent [m] and mass [kg] of a free object. Furniture and buildings are fixed.
_LONGEST, _HEAVIEST = 2.0, 100.0
# A body's inertia is probably a placeholder if it is this many times as large as with all mass at its farthest corner.
_PLACEHOLDER = 10.0
# Most bodies by which the shared tree of variants exceeds the largest variant.
_UNSHARED = 3
# Greatest overlap [m] without a warning, for two geoms that layouts do not place: numbers in files are rounded.
_SUNK = 1.0e-3
# Remedy for an overlap that belongs to the model.
_EXCLUDE = 'if the overlap is intended, write <contact><exclude body1="..." body2="..."/></contact> in the file.'
# Flags that switch contact forces off.
_NO_CONTACTS = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
# Greatest distance [m] from the origin, along an axis, at which rounding stays below the skin of collision tests.
_FINE = 128.0


def warn_of_oddities(plan: Plan) -> None:
    """Warn about parts of a scene that are probably unintended. All findings of a kind share one `ModelWarning`."""
    is_physics = plan.scene.config.geometry == "physics"
    of_geometry = (_filled, _sunk) if is_physics else (_flat,)
    for kind in (*of_geometry, _sizes, _turning, _coarse, _unshared):
        for text in kind(plan):
            warn(ModelWarning(f"{plan.scene.config.where}: {text}"))


def _flat(plan: Plan) -> Iterator[str]:
    """Warn about mesh faces without area, which collision tests of visual geometry leave out."""
    meshes = {p.geom: p.mesh for p in plan.pieces if p.mesh is not None}
    counts = {g: int(flat_faces(m.triangles).sum()) + m.metadata.get("left_out", 0) for g, m in meshes.items()}
    found = [f"{count} of geom '{geom_name(plan.scene.mjm, geom)}'" for geom, count in counts.items() if count]
    if found:
        yield (
            f"faces without area are left out: {_some(found)}. This does no harm if the mesh is closed without them. "
            "To avoid this warning, merge the mesh's vertices and remove degenerate faces."
        )


def _filled(plan: Plan) -> Iterator[str]:
    """Warn about meshes whose convex hull is much larger than the mesh. MuJoCo collides a mesh as its convex hull."""
    mjm, found = plan.scene.mjm, []
    for p in plan.pieces:
        if p.type == PieceType.HULL and p.mesh is not None:
            surface = mesh_surface(mjm, int(mjm.geom_dataid[p.geom]))
            surface.merge_vertices()
            ratio = p.mesh.volume / abs(surface.volume) if surface.is_watertight and surface.volume else 1.0
            if ratio > _FILLED:
                found.append(f"geom '{geom_name(mjm, p.geom)}' ({ratio:.2g} times its volume)")
    if found:
        yield (
            f"MuJoCo collides meshes as their convex hulls, which fill the hollows of {_some(found)}. Split each of "
            "them into several convex geoms, or use `geometry: visual` if only placing has to respect the hollows."
        )


def _sizes(plan: Plan) -> Iterator[str]:
    """Warn about objects that are so large, small or heavy that their lengths are probably not in metres."""
    scene, found = plan.scene, []
    free = [name for name, o in scene.config.objects.items() if o.kind == "free"]
    for name in plan.slots:
        bodies = set(scene.subtree(name))
        ends = [(low, high) for p, low, high in plan.solids if p.body in bodies]
        if ends:
            size = float((np.max(ends, (0, 1)) - np.min(ends, (0, 1))).max())
            mass = float(scene.mjm.body_subtreemass[scene.bodies[name]])
            if name in free and (size > _LONGEST or mass > _HEAVIEST):
                found.append(f"'{name}' ({size:.3g} m, {mass:.3g} kg)")
            elif not _SMALLEST <= size <= _LARGEST:
                found.append(f"'{name}' ({size:.3g} m)")
    if found:
        yield (
            f"implausible sizes, as {_SMALLEST:g} to {_LARGEST:g} m are usual, and at most {_LONGEST:g} m and "
            f"{_HEAVIEST:g} kg for free objects: {_some(found)}. Lengths are in metres: correct the asset's `scale`, "
            "e.g. 0.001 for a mesh in millimetres."
        )


def _unshared(plan: Plan) -> Iterator[str]:
    """Warn about fixtures whose variants share few bodies, because each kind of joint has separate ones."""
    scene = plan.scene
    for name, members in scene.config.variants.items():
        shared, most = len(scene.shared_parts(name)), max(len(scene.subtree(member)) for member in members)
        if shared > most + _UNSHARED:
            yield (
                f"objects.{name}: its variants need {shared} bodies in the simulation, but none has more than {most}. "
                "Bodies are shared below the same parent, by slides or hinges, with or without limits: make joints "
                "alike, or name them in 'parts'."
            )


def _turning(plan: Plan) -> Iterator[str]:
    """Warn about free objects that are harder to turn than any distribution of their mass in their geoms."""
    mjm, found = plan.scene.mjm, []
    for body in sorted(body for o in plan.objects if o.kind == ObjectKind.FREE for body in o.bodies):
        ends = np.array([(low, high) for p, low, high in plan.solids if p.body == body])
        if len(ends):
            far = float(np.linalg.norm(np.abs(ends - plan.scene.home.xipos[body]).max((0, 1))))
            mass, inertia = float(mjm.body_mass[body]), float(mjm.body_inertia[body].max())
            if inertia > _PLACEHOLDER * mass * far**2:
                found.append(f"'{mjm.body(body).name}' ({inertia:.2g} kg m2, but {mass:.2g} kg within {far:.2g} m)")
    if found:
        yield (
            f"implausible inertias, probably placeholders, with which contacts hardly turn an object: {_some(found)}. "
            "Leave out <inertial>, so that MuJoCo computes it from the geoms, or correct `diaginertia`."
        )


def _sunk(plan: Plan) -> Iterator[str]:
    """Warn about geoms that overlap in the start pose and belong to bodies that layouts do not place."""
    scene, mjm = plan.scene, plan.scene.mjm
    is_pushed = not mjm.opt.disableflags & _NO_CONTACTS
    still: list[str] = []
    pushed: list[str] = []
    cures: dict[str, None] = {}
    placed = {body for o in plan.objects if o.kind != ObjectKind.STATIC for body in o.bodies}
    for depth, geoms in _overlaps(mjm, plan.scene.home, [p for p in plan.pieces if p.body not in placed]):
        free = [geom for geom in geoms if _can_move(mjm, geom)]
        one, other = geoms if not free or geoms[0] in free else reversed(geoms)
        text = f"{_geom_of(scene, one)} is {1e3 * depth:.3g} mm inside {_geom_of(scene, other)}"
        if not free:
            still.append(text)
        elif is_pushed:
            pushed.append(text)
            cures |= dict.fromkeys(_cure(scene, geom) for geom in free)
    if still:
        yield (
            f"geoms that never move overlap: {_some(still)}. Correct their positions (for a robot its `base`), or, "
            f"{_EXCLUDE}"
        )
    if pushed:
        yield (
            "movable geoms overlap other geoms in the start pose. Layouts do not move or test these pairs, and contact "
            f"forces push them apart: {_some(pushed)}. {'; '.join(cures)}; or, {_EXCLUDE}"
        )


def _overlaps(mjm: mujoco.MjModel, home: mujoco.MjData, pieces: list[Piece]) -> Iterator[tuple[float, tuple[int, int]]]:
    """Yield the deepest overlap of each pair of kinematic trees in the start pose: the depth [m] and the two geoms.

    A pair of trees may have two results: one for pairs with a movable geom, and one for pairs of geoms that cannot
    move. A tree may overlap itself, such as a robot whose links MuJoCo pushes apart.
    """
    rules = ContactRules(mjm, "physics")
    deepest: dict[tuple[int, int, bool], tuple[float, tuple[int, int]]] = {}
    for a, b in _near(mjm, home, pieces):
        roots = [int(mjm.body_rootid[p.body]) for p in (a, b)]
        is_rigid = roots[0] == roots[1] and mjm.body_weldid[a.body] == mjm.body_weldid[b.body]
        excluded = is_rigid or rules.is_parent(a.body, b.body) or rules.excludes(a.body, b.body)
        if excluded or not rules.meet(a.contact_class, b.contact_class):
            continue
        depth = -mujoco.mj_geomDistance(mjm, home, a.geom, b.geom, 0.0, None)
        key = roots[0], roots[1], _can_move(mjm, a.geom) or _can_move(mjm, b.geom)
        if depth > max(_SUNK, deepest[key][0] if key in deepest else 0.0):
            deepest[key] = depth, (a.geom, b.geom)
    yield from deepest.values()


def _can_move(mjm: mujoco.MjModel, geom: int) -> bool:
    """Return whether a joint moves a geom."""
    return bool(mjm.body_dofnum[mjm.body_weldid[mjm.geom_bodyid[geom]]])


def _owner(scene: SceneModel, geom: int) -> str:
    """Return the name of the object or robot that contains a geom, or else the name of the geom's root body."""
    root = int(scene.mjm.body_rootid[scene.mjm.geom_bodyid[geom]])
    return scene.owners.get(root) or str(scene.mjm.body(root).name)


def _geom_of(scene: SceneModel, geom: int) -> str:
    """Return the name of a geom and the name of its `_owner`, for messages."""
    return f"geom '{geom_name(scene.mjm, geom, scene.config.written)}' of '{_owner(scene, geom)}'"


def _cure(scene: SceneModel, geom: int) -> str:
    """Return the remedy for a movable geom that overlaps another geom in the start pose."""
    name, mjm = _owner(scene, geom), scene.mjm
    root = int(mjm.body_rootid[mjm.geom_bodyid[geom]])
    robot = scene.config.all_robots.get(name)
    if robot is not None and robot.in_model is None and root == scene.bodies[name]:
        return f"Correct the robot's keyframe or `{robot.section}.base`"
    if mjm.body_dofnum[root] != 6:
        return f"Correct the position of '{name}' or the start pose of its joints"
    if name in scene.bodies:
        return f"Give '{name}' an `on` or a `region`, or move it"
    return f"Place '{name}' as an object with `on` or `region`, or move it"


def _coarse(plan: Plan) -> Iterator[str]:
    """Warn about geoms so far from the world's origin that float32 rounds positions by more than an object's clearance.

    The further a geom reaches from the origin, the coarser the rounding. An object at a fixed place
    with drawn joints counts as having a clearance of 0.
    """
    mjm, found = plan.scene.mjm, []
    drawn = [o.config for o in plan.objects if o.config.kind != "marker"]
    least = min((c.clearance if c.is_placed else 0.0 for c in drawn), default=np.inf)
    if np.any(mjm.geom_margin > 0.0) or np.any(mjm.pair_margin > 0.0):  # rounding may not reach into a margin
        least = min(least, 0.0)
    for p, low, high in plan.solids if drawn else []:
        reach = float(np.abs([low, high]).max())
        resolution = float(np.spacing(np.float32(reach)))
        if reach > _FINE and resolution > least and np.all(low <= MOST_FAR) and np.all(high >= -MOST_FAR):
            found.append(f"geom '{geom_name(mjm, p.geom)}' ({reach:.4g} m, {1e6 * resolution:.2g} um)")
    if found:
        yield (
            f"geoms that reach beyond {_FINE:g} m from the world's origin are rounded. Objects may touch them if their "
            f"'clearance' is smaller than this rounding: {_some(found)}. Use a plane or smaller geoms, or a "
            "'clearance' of at least 0.0001."
        )


def _near(mjm: mujoco.MjModel, home: mujoco.MjData, pieces: list[Piece]) -> Iterator[tuple[Piece, Piece]]:
    """Yield the pairs of pieces whose bounding spheres meet in the start pose. No table of all pairs is stored."""
    geoms = [p.geom for p in pieces]
    at, radius = home.geom_xpos[geoms], mjm.geom_rbound[geoms]
    radius = np.where(radius > 0.0, radius, np.inf)  # 0 for a plane
    for i, one in enumerate(pieces):
        apart = np.linalg.norm(at[i + 1 :] - at[i], axis=1)
        for j in np.flatnonzero(apart <= radius[i + 1 :] + radius[i]):
            yield one, pieces[i + 1 + j]


def _some(found: list[str], most: int = 5) -> str:
    """Join the first `most` entries of a list, and add the number of the other entries."""
    more = f", and {len(found) - most} more" if len(found) > most else ""
    return ", ".join(found[:most]) + more
