"""The scene that the audit judges: owners, carriers, solids, start pose, and outlines of objects from above."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.collisions import Tree
from sceniris_gym.audit.geometry import Form, Poses, Rows, Solid, convex_hull, home_of, solids_of, subtree
from sceniris_gym.audit.supports import surface_of
from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.scene import SceneConfig


class Carrier(NamedTuple):
    """The body or geom that carries an object.

    Attributes:
        body: Id of the body, 0 for the world.
        geom: Id of the carrying geom, None for any geom of the body.
        owner: The object that owns the body, None for the world and for bodies that never move.
        is_ground: Whether the carrier is the ground workspace, whose size is in the scene file.
    """

    body: int
    geom: int | None = None
    owner: str | None = None
    is_ground: bool = False


class JudgedScene:
    """A scene as the audit sees it.

    Args:
        mjm: The model.
        config: The scene.
        bodies: Object name -> root body id.

    Attributes:
        tree: Owners of the bodies.
        markers: Names of the objects that may intersect anything.
        placed: Object name -> its ObjectConfig, for all placed objects.
        solids: The solids of the scene, without markers.
        home: The model's data at the start pose.

    Raises:
        NotSupportedError: A geom has a type that the audit does not support.
    """

    def __init__(self, mjm: mujoco.MjModel, config: SceneConfig, bodies: Mapping[str, int]) -> None:
        self.mjm, self.config, self.bodies = mjm, config, bodies
        self.tree, self.home = Tree(mjm, bodies, config.home), home_of(mjm, config.home)
        self.markers = {name for name, part in config.objects.items() if part.kind == "marker"}
        self.placed = {name: part for name, part in config.parts.items() if part.is_placed}
        self.solids = [s for s in solids_of(mjm, config.geometry) if self.owner(s) not in self.markers]

    def owner(self, solid: Solid) -> str:
        """Return the name of the object that owns a solid."""
        return self.tree.owner[self.mjm.geom_bodyid[solid.geom]]

    def at_home(self, geom: int, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a geom's position [m] (3,) and rotation (3, 3) in a body's frame, both at the start pose."""
        home, back = self.home, self.home.xmat[body].reshape(3, 3).T
        return back @ (home.geom_xpos[geom] - home.xpos[body]), back @ home.geom_xmat[geom].reshape(3, 3)

    def carrier(self, parent: str) -> Carrier:
        """Return the carrier of an object.

        Args:
            parent: Name of the support: 'floor', an object, a member, a body inside it, or a geom or body of the model.
        """
        mjm, bodies = self.mjm, self.bodies
        if parent == FLOOR and self.config.floor is not None:
            return Carrier(0, is_ground=True)
        owner = max((name for name in bodies if parent.startswith(f"{name}/")), key=len, default="")
        part = parent.removeprefix(f"{owner}/")
        if parent in bodies:
            return Carrier(bodies[parent], owner=parent)
        if owner in bodies:
            own = self.config.objects[owner].body or owner
            spaces = (own, own.rpartition("/")[0])  # names of an attached model have a prefix
            names = [part, *(f"{space}/{part}" for space in spaces)]
            ids = [mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name) for name in reversed(names)]
            inside = [i for i in ids if i in subtree(mjm, bodies[owner])]
            if inside:
                return Carrier(inside[0], owner=owner)
        geom = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_GEOM, parent)
        body = int(mjm.geom_bodyid[geom]) if geom >= 0 else mjm.body(parent).id
        _, nearest = max(((root, n) for n, root in bodies.items() if body in subtree(mjm, root)), default=(0, None))
        return Carrier(body, geom if geom >= 0 else None, nearest)

    def hulls(self, solids: list[Solid]) -> dict[str, np.ndarray]:
        """Return the corners of each placed object's convex hull in the start pose [m], in the frame of its root.

        Args:
            solids: Solids of the model. An object without solids is a point.

        Returns:
            Object name -> corners, shape (n, 3).
        """
        parts: dict[str, list[np.ndarray]] = {name: [] for name in self.placed}
        found: dict[tuple, np.ndarray] = {}  # equal solids, such as the handles of furniture, are many
        for solid in solids:
            name = self.owner(solid)
            if name in parts and solid.form is not Form.HALFSPACE:
                pos, mat = self.at_home(solid.geom, self.bodies[name])
                shape = solid.form, solid.radius, solid.size.tobytes(), solid.vertices.tobytes()
                if shape not in found:
                    found[shape] = surface_of(solid)[0]
                parts[name].append(found[shape] @ mat.T + pos)
        return {
            name: convex_hull(np.concatenate(points))[0] if points else np.zeros((1, 3))
            for name, points in parts.items()
        }


_UPRIGHT = 1e-3  # an x axis with a shorter horizontal part points straight up or down


@dataclass(frozen=True)
class Outline:
    """One object seen from above in each row.

    Attributes:
        pivot: Bottom centre of the bounds [m], world frame, shape (nrow, 3). For a robot, the origin of its base.
        heading: Direction of the root's x axis [rad], shape (nrow,). If the x axis points straight up or down, the
            direction of the y axis minus a right angle.
        low, high: Lower and upper bounds [m] relative to the pivot, shape (nrow, 2). The first coordinate is along the
            heading, the second is to the left of the heading.
    """

    pivot: np.ndarray
    heading: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def corners(self) -> np.ndarray:
        """Return the corners of the bounds [m], seen from above, counter-clockwise, shape (nrow, 4, 2)."""
        x = np.stack([self.low[:, 0], self.high[:, 0], self.high[:, 0], self.low[:, 0]], 1)
        y = np.stack([self.low[:, 1], self.low[:, 1], self.high[:, 1], self.high[:, 1]], 1)
        c, s = np.cos(self.heading)[:, None], np.sin(self.heading)[:, None]
        return self.pivot[:, None, :2] + np.stack([c * x - s * y, s * x + c * y], 2)

    def span(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and greatest world coordinate [m] of the bounds along a unit vector per row (nrow, 2)."""
        along = np.einsum("nkj,nj->nk", self.corners(), direction)
        return along.min(1), along.max(1)


@dataclass(frozen=True)
class Seen:
    """The objects of a scene in some rows, seen from above.

    Attributes:
        poses: The poses in the rows.
        outlines: Object name -> its outline.
        roots: The same for upright fixtures and static objects with drawn joints, without parts that joints move, and
            for objects with variants.
        present: Object name -> mask of the rows with the object, shape (nrow,).
        support_heading: Object name -> heading of the support's x axis [rad], shape (nrow,). 0 on the floor and in the
            air.
    """

    poses: Poses
    outlines: Mapping[str, Outline]
    roots: Mapping[str, Outline]
    present: Rows
    support_heading: Rows


class Outlines:
    """Computes the outlines of the objects of a scene.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: JudgedScene) -> None:
        self.scene = scene
        self._solids: dict[str, list[Solid]] = {name: [] for name in scene.bodies}
        for solid in scene.solids:
            if scene.owner(solid) in scene.bodies and solid.form is not Form.HALFSPACE:
                self._solids[scene.owner(solid)].append(solid)
        self._still = {name: self._off_joints(name) for name, o in scene.config.objects.items() if o.is_open_furniture}

    def see(self, poses: Poses, present: Rows) -> Seen:
        """Return the outlines of all objects from above, for the checks of relations, orientations and groups.

        Args:
            poses: Poses in the rows.
            present: Object name -> mask of the rows with the object, shape (nrow,).
        """
        headings = {}
        for name, part in self.scene.config.parts.items():
            headings[name] = np.zeros(len(poses.xpos))
            if part.support is not None:
                x = poses.xmat[:, self.scene.carrier(part.support.parent).body, :, 0]
                headings[name] = np.arctan2(x[:, 1], x[:, 0])
        outlines = {name: self.outline(name, poses) for name in self.scene.bodies}
        roots = {name: self._of_solids(outlines[name], name, own, poses) for name, own in self._still.items() if own}
        for name, members in self.scene.config.variants.items():  # relations name the object, not its variants
            there = np.argmax([present[member] for member in members], axis=0), np.arange(len(poses.xpos))
            for found in (roots, outlines):
                own = [found.get(member, outlines[member]) for member in members]
                found[name] = Outline(*(np.stack([getattr(o, f.name) for o in own])[there] for f in fields(Outline)))
        return Seen(poses, outlines, roots, present, headings)

    def outline(self, name: str, poses: Poses) -> Outline:
        """Return the outline of an object in each row.

        The bounds enclose the object with its joints as in the row. The pivot is at the height of the bounds' bottom.
        Seen from above, the pivot is the centre of the bounds with the joints at home, or, for `orientation: any`, with
        the joints as in the row. A robot's pivot is the origin of its base.
        """
        root = self.scene.bodies[name]
        at, heading = poses.xpos[:, root], _heading(poses.xmat[:, root])
        if not self._solids[name]:
            return Outline(at, heading, np.zeros((len(at), 2)), np.zeros((len(at), 2)))
        axes = Rotation.from_euler("z", -heading[:, None]).as_matrix()
        solids = self._solids[name]
        low, high = self._bounds(name, solids, poses, axes)
        if name in self.scene.config.all_robots:
            return Outline(at, heading, low[:, :2], high[:, :2])
        part = self.scene.config.parts.get(name)
        any_way_up = part is not None and part.drawn_orientation.kind == "any"
        ends = (low, high) if any_way_up else self._bounds(name, solids, self._with_joints_at_home(name, poses), axes)
        middle = (ends[0] + ends[1]) / 2
        middle[:, 2] = low[:, 2]
        pivot = at + np.einsum("nk,nkj->nj", middle, axes)
        return Outline(pivot, heading, (low - middle)[:, :2], (high - middle)[:, :2])

    def _off_joints(self, name: str) -> list[Solid]:
        """Return the solids of an object that no joint moves relative to its root."""
        mjm, root = self.scene.mjm, self.scene.bodies[name]
        doors = [body for body in subtree(mjm, root) if body != root and mjm.body_jntnum[body]]
        moved = {part for body in doors for part in subtree(mjm, body)}
        return [solid for solid in self._solids[name] if mjm.geom_bodyid[solid.geom] not in moved]

    def _of_solids(self, outline: Outline, name: str, solids: list[Solid], poses: Poses) -> Outline:
        """Return the outline of an object with the bounds of only some of its solids."""
        axes = Rotation.from_euler("z", -outline.heading[:, None]).as_matrix()
        at = np.einsum("nkj,nj->nk", axes, outline.pivot - poses.xpos[:, self.scene.bodies[name]])[:, :2]
        low, high = self._bounds(name, solids, poses, axes)
        return replace(outline, low=low[:, :2] - at, high=high[:, :2] - at)

    def _bounds(self, name: str, solids: list[Solid], poses: Poses, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and greatest coordinates [m] of solids along axes (nrow, 3, 3), relative to a root."""
        at, low, high = poses.xpos[:, self.scene.bodies[name]], [], []
        for solid in solids:
            middle = np.einsum("nkj,nj->nk", axes, poses.geom_xpos[:, solid.geom] - at)
            local = (axes @ poses.geom_xmat[:, solid.geom]).transpose(1, 0, 2)
            low.append(middle + np.stack([solid.lowest(up) for up in local], 1))
            high.append(middle - np.stack([solid.lowest(-up) for up in local], 1))
        return np.min(low, axis=0), np.max(high, axis=0)

    def _with_joints_at_home(self, name: str, poses: Poses) -> Poses:
        """Return a copy of the poses in which the joints of one object are at home."""
        root, pos, mat = self.scene.bodies[name], poses.geom_xpos.copy(), poses.geom_xmat.copy()
        for solid in self._solids[name]:
            at, rotation = self.scene.at_home(solid.geom, root)
            pos[:, solid.geom] = poses.xpos[:, root] + poses.xmat[:, root] @ at
            mat[:, solid.geom] = poses.xmat[:, root] @ rotation
        return replace(poses, geom_xpos=pos, geom_xmat=mat)


def _heading(mat: np.ndarray) -> np.ndarray:
    """Return the headings [rad] of bodies with rotations `mat` (nrow, 3, 3), shape (nrow,)."""
    x, y = mat[:, :2, 0], mat[:, :2, 1]
    upright = np.linalg.norm(x, axis=1) < _UPRIGHT
    return np.where(upright, np.arctan2(y[:, 1], y[:, 0]) - np.pi / 2, np.arctan2(x[:, 1], x[:, 0]))
