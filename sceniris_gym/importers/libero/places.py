"""Scene entries of LIBERO's objects and fixtures: model or stand-in box, support, region, orientation and joints."""

import math
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from shapely import Point

from sceniris_gym.errors import SceneKeyError, UnknownNameError, check_names
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.geometry.resting_poses import HomeShape
from sceniris_gym.geometry.rotations import matrix, of_angles
from sceniris_gym.geometry.supports import level_surfaces
from sceniris_gym.importers.libero.kinds import FIXTURES, OBJECTS, ROTATION, WORKSPACES, Kind, Workspace, moving
from sceniris_gym.importers.libero.problem import Predicate, Problem, Region
from sceniris_gym.scene.assemble import compile_spec
from sceniris_gym.scene.model_files import load_model
from sceniris_gym.scene.support import subtree

INNER = "object"
"""Name of the body below a model's root that LIBERO places."""
HIDDEN = 3
"""Group of collision geoms, which are not drawn. LIBERO's models have them in group 0."""
_FILES = (
    "articulated_objects/{0}.xml",
    "stable_hope_objects/{0}/{0}.xml",
    "stable_scanned_objects/{0}/{0}.xml",
    "turbosquid_objects/{0}/{0}.xml",
)
_BOX = mujoco.mjtGeom.mjGEOM_BOX
_DENSITY = 300.0  # kg/m^3
_COLOUR = [0.7, 0.6, 0.5, 1.0]
_STAND_INS = Path(__file__).with_name("stand_ins")


def load_thing(name: str, kind: Kind, assets: Path, where: str) -> mujoco.MjSpec | None:
    """Load LIBERO's model of a class, and turn it upright. Return None if the folder `assets` lacks this model.

    Raises:
        SceneFileError: MuJoCo cannot read the model, or a file that it refers to is missing.
    """
    file = next((file for path in _FILES if (file := assets / path.format(name)).is_file()), None)
    if file is None:
        return None
    spec = load_model(file, where, _with_unique_names)
    spec.njmax = spec.nconmax = -1  # the scene sets these sizes
    for geom in spec.geoms:
        geom.group = geom.group or HIDDEN
    spec.compiler.inertiagrouprange = [HIDDEN, HIDDEN]  # as in robosuite, collision geoms carry the mass
    inner = spec.body(INNER)
    inner.pos, inner.quat = np.zeros(3), ROTATION[kind.up]
    return spec


def stand_in(name: str, kind: Kind) -> mujoco.MjSpec:
    """Return a model of boxes that stands in for LIBERO's model of a class. It has the same size as LIBERO's model.

    A class with hollow or moving parts has a file in the folder `stand_ins`. The others are one box.
    """
    if (file := _STAND_INS / f"{name}.xml").is_file():
        return load_model(file, name)
    spec, half = mujoco.MjSpec(), 0.5 * np.array(kind.size)
    body = spec.worldbody.add_body().add_body(name=INNER)
    body.add_geom(type=_BOX, pos=[0.0, 0.0, half[2]], size=half, density=_DENSITY, rgba=_COLOUR)
    return spec


def _with_unique_names(text: str) -> str:
    """Make the names in `<asset>` of an MJCF text unique. MuJoCo rejects two elements of the same type and name."""
    root = ElementTree.fromstring(text)
    seen: Counter[tuple[str, str]] = Counter()
    for element in (element for asset in root.iter("asset") for element in asset if element.get("name")):
        key = element.tag, element.attrib["name"]
        seen[key] += 1
        if seen[key] > 1:
            element.set("name", f"{key[1]}_{seen[key]}")
    return ElementTree.tostring(root, encoding="unicode")


_AROUND = 0.1  # clutter stays within this distance [m] of the file's rectangles
_EVERYWHERE = (-math.inf, -math.inf, math.inf, math.inf)
_GAP = 0.0005  # height of an object above its support [m]
_POINT = 0.00005  # half edge [m] of the rectangle that replaces a point
_RADIUS = 0.025  # margin [m] that most of LIBERO's objects keep to the edge of a site


def kinds_of(problem: Problem) -> dict[str, Kind]:
    """Return the class of each object and fixture, without the work surface. Reject classes that are not known."""
    found = {}
    for name, kind in problem.things.items():
        word, table = ("object", OBJECTS) if name in problem.objects else ("fixture", {**FIXTURES, **WORKSPACES})
        if kind not in table:
            raise UnknownNameError(f"class of {word}", kind, problem.places[name], table)
        if isinstance(known := table[kind], Kind):
            found[name] = known
    return found


def _rounded(values: Any) -> list:
    """Round lengths [m] or angles [degrees] for a scene file."""
    return (np.round(values, 6) + 0.0).tolist()


class Places:
    """Translates a problem into scene file entries: supports, regions, orientations and joints of all objects."""

    def __init__(self, problem: Problem, surface: str, space: Workspace, spec: mujoco.MjSpec, widen: float) -> None:
        self._problem, self._surface, self._space, self._spec, self._widen = problem, surface, space, spec, widen
        self._yaw = {name: np.array(kind.yaw) for name, kind in kinds_of(problem).items()}
        for word, (name, *names) in ((predicate.word, predicate.names) for predicate in problem.init):
            if word == "On" and name in problem.fixtures and (region := problem.regions.get(names[0])):
                self._yaw[name] = np.degrees(region.yaw)
        where = str(problem.path)
        self._mjm = compile_spec(spec, where)
        self._data = mujoco.MjData(self._mjm)
        mujoco.mj_kinematics(self._mjm, self._data)
        self._pieces = extract_pieces(self._mjm, "physics", where=dict.fromkeys(range(self._mjm.nbody), where))

    def words(self, added: list[str]) -> dict[str, Any]:
        """Return the scene file entry of each object and fixture, by name.

        The objects in `added` (the clutter) may stand anywhere in and near the rectangles of the problem file.
        """
        placing = [predicate for predicate in self._problem.init if predicate.word in ("On", "In")]
        count = Counter(predicate.names[0] for predicate in placing)
        for name in self._yaw:
            if count[name] != 1 and name not in added:
                raise SceneKeyError(
                    f"{self._problem.places[name]}: '{name}' should have one place in ':init', such as (On {name} "
                    f"REGION), has {count[name]}."
                )
        found = {predicate.names[0]: self._place(predicate) for predicate in placing}
        for predicate in self._problem.init:
            if predicate not in placing:
                name, joints = self._state(predicate)
                found[name].setdefault("joints", {}).update(joints)
        regions = self._problem.regions.values()
        boxes = [box for r in regions for box in r.boxes if r.target == self._surface] or [_EVERYWHERE]
        for name in added:
            low, high = np.min(boxes, axis=0)[:2] - _AROUND, np.max(boxes, axis=0)[2:] + _AROUND
            found[name] = self._on_surface(name, np.array([low, high])) | {"ratio_on_support": 1}
        return found

    def _place(self, predicate: Predicate) -> dict[str, Any]:
        """Return the scene file entry of the object or fixture that a start predicate `On` or `In` places."""
        (name, target), where = predicate.names, predicate.where
        check_names("object or fixture", [name], where, self._yaw)
        region = self._problem.regions.get(target)
        if region is not None and region.target == self._surface:
            if len(region.boxes) != 1:
                raise SceneKeyError(
                    f"{where}: region '{region.name}' of the work surface should have one rectangle in ':ranges', "
                    f"has {len(region.boxes)}."
                )
            low, high = np.reshape(region.boxes[0], (2, 2))
            half = np.maximum(0.5 * self._widen * (high - low), _POINT)
            return self._on_surface(name, 0.5 * (low + high) + np.array([-half, half]))
        if name in self._problem.fixtures:
            raise SceneKeyError(f"{where}: a fixture should be on a rectangle of the work surface '{self._surface}'.")
        if region is not None:
            return self._on_site(name, region, predicate.word, where)
        if target not in (self._surface, *self._problem.objects):
            raise UnknownNameError("object or region", target, where, [*self._problem.objects, *self._problem.regions])
        return self._on_thing(name, target)

    def _on_surface(self, name: str, corners: np.ndarray) -> dict[str, Any]:
        """Return the scene file entry of an object whose origin is in a rectangle of the work surface.

        Args:
            name: The object.
            corners: Low and high corner of the rectangle [m], shape (2, 2). Parts of it off the surface are cut away.
        """
        origin = np.array(self._space.origin[:2])
        inside = np.clip(corners, self._space.low - origin, self._space.high - origin)
        return {"on": self._surface, **self._within(name, self._yaw[name], inside)}

    def _on_thing(self, name: str, target: str) -> dict[str, Any]:
        """Return the scene file entry of an object on a target: the work surface, or another object.

        On the work surface, the object may be anywhere. On another object, it is over the middle, higher than the rim.
        """
        if target == self._surface:
            return {"on": target, **self._within(name, self._yaw[name])}
        yaw, support = self._relative(name, target), self._mjm.body(f"{target}/{INNER}").id
        point = self._pivot(name, yaw)
        pieces = [p for p in self._pieces if p.body == support]
        levels = level_surfaces(support, pieces, open_above=True)
        carrying = [level.height for level in levels if level.region.intersects(Point(point))]
        top = max(piece.bounds[1][2] for piece in pieces)
        gap = {"gap": round(top - carrying[-1] + _GAP, 6)} if carrying else {}
        middle = {"region": {"points": _rounded([point])}}
        return {"on": f"{target}/{INNER}", **self._within(name, yaw), **middle, **gap}

    def _on_site(self, name: str, region: Region, word: str, where: str) -> dict[str, Any]:
        """Return the scene file entry of an object on or in a site.

        As in LIBERO, the object's origin lies in a rectangle around the site's centre. A side of the rectangle is
        |L / 2 - 2 r| long, if L is the length of the site along this side, and r is the object's radius.

        Args:
            name: The object.
            region: The region of the problem, which names the site.
            word: The predicate, `On` or `In`.
            where: Prefix of error messages.
        """
        site = self._site(region, where)
        radius = self._spec.site(f"{name}/horizontal_radius_site")
        rotated = np.abs(matrix(np.asarray(site.quat)) @ site.size)
        away = radius.pos[0] if radius is not None else _RADIUS
        half = np.abs(0.5 * rotated[:2] - away)
        corners = site.pos[:2] + np.array([-half, half])
        return {word.lower(): site.parent.name, **self._within(name, self._relative(name, region.target), corners)}

    def _within(self, name: str, yaw: np.ndarray, corners: np.ndarray | None = None) -> dict[str, Any]:
        """Return the keys `kind`, `orientation` and `region` of an object.

        Args:
            name: The object.
            yaw: Least and greatest heading [degrees], shape (2,).
            corners: Low and high corner [m] of the rectangle for the object's origin, shape (2, 2). None for no region.
        """
        kind = {"kind": "fixture"} if name in self._problem.fixtures else {}
        region = {} if corners is None else {"region": {"box": _rounded(corners + self._pivot(name, yaw))}}
        return {**kind, "orientation": {"yaw": _rounded(yaw)}, **region}

    def _relative(self, name: str, target: str) -> np.ndarray:
        """Return an object's least and greatest heading [degrees], relative to the mean heading of `target`."""
        yaw = self._yaw[name]
        return yaw - yaw.mean() + math.remainder(yaw.mean() - self._yaw[target].mean(), 360.0)

    def _pivot(self, name: str, yaw: np.ndarray) -> np.ndarray:
        """Return the vector [m] in x and y from an object's origin to its pivot, at the object's mean heading.

        The vector is needed because LIBERO's rectangles are for origins, and regions are for pivots.
        """
        root = self._mjm.body(name).id
        inside = subtree(self._mjm, root)
        shape = HomeShape(self._data, root, [p for p in self._pieces if p.body in inside])
        pivot = shape.stable_pose(np.array([1.0, 0.0, 0.0, 0.0])).pivot
        return (matrix(of_angles(np.radians([0.0, 0.0, yaw.mean()]))) @ pivot)[:2]

    def _state(self, predicate: Predicate) -> tuple[str, dict[str, Any]]:
        """Return the fixture in a predicate such as `Open`, and the `joints` entries that make the predicate true."""
        name, positions = moving(self._problem, predicate)
        region = self._problem.regions.get(predicate.names[0])
        found = self._spec.body(name).find_all("joint")
        if region is not None:
            found = self._site(region, predicate.where).parent.joints
        if not found:
            raise SceneKeyError(f"{predicate.where}: '{predicate.names[0]}' is fixed. Name a moving part or '{name}'.")
        return name, {joint.name.removeprefix(f"{name}/"): {"range": list(positions)} for joint in found}

    def _site(self, region: Region, where: str) -> mujoco.MjsSite:
        site = self._spec.site(f"{region.target}/{region.name}")
        if site is None:
            own = [s.name.partition("/")[2] for s in self._spec.sites if s.name.startswith(f"{region.target}/")]
            raise UnknownNameError(f"site of '{region.target}'", region.name, where, own)
        return site
