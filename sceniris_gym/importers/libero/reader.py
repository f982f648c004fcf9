"""Problem files of LIBERO, read as scenes of this package: `read_bddl`."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.paths import user_path
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ModelWarning, SceneFileError, SceneKeyError, UnknownNameError
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.geometry.resting_poses import HomeShape
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.importers.libero.kinds import FIXTURES, OBJECTS, WORKSPACES, Kind, Workspace
from sceniris_gym.importers.libero.problem import Predicate, Problem, Region, read_problem
from sceniris_gym.importers.libero.things import INNER, load_thing, stand_in
from sceniris_gym.scene import backdrop
from sceniris_gym.scene.adopt import place_on
from sceniris_gym.scene.assemble import attach, compile_spec, make_kind
from sceniris_gym.scene.support import subtree

_CLUTTER = "clutter"
_AROUND = 0.1  # clutter keeps within this distance [m] of the rectangles of the file
_RADIUS = 0.035  # radius [m] by which most of LIBERO's objects keep from the edge of a site
_ZONE = 0.007  # half height [m] of the zone over a rectangle in which a goal counts a thing as on it
_THICK = 0.05  # thickness of a work surface [m]


@dataclass(frozen=True)
class LiberoTask:
    """A problem file as a scene and a goal.

    Attributes:
        scene: The scene; its model is an MjSpec in which each thing is a body of its name. `THING/REGION` are sites.
        problem: The file as it is written: `language`, `goal`, `of_interest`, and the class of each thing.
    """

    scene: SceneConfig
    problem: Problem

    @property
    def goal(self) -> tuple[Predicate, ...]:
        """The predicates that all hold at the end."""
        return self.problem.goal


def read_bddl(
    path: str | Path,
    *,
    assets: str | Path | None = None,
    widen: float = 1.0,
    clutter: int = 0,
    robot: str | Mapping[str, Any] | None = None,
) -> LiberoTask:
    """Read a problem file of LIBERO (BDDL).

    Rectangles become regions of the work surface, sites of fixtures and objects regions of the body that has them.
    `Open`, `Close`, `Turnon` and `Turnoff` become ranges of joints, as LIBERO draws them.

    Args:
        path: The file.
        assets: The folder of LIBERO's models, which has `stable_hope_objects` and the like. Without it, and for a
            class that it lacks, boxes of stated sizes stand in, and a warning names them.
        widen: Factor by which rectangles grow about their centres, up to the edge of the work surface.
        clutter: Number of further objects in each layout, drawn from twice as many of classes that the file does not
            use. They stand within 10 cm of the file's rectangles.
        robot: An arm for LIBERO's place beside the work surface: an asset, or a mapping as in a scene file.

    Returns:
        The scene, and the goal.

    Raises:
        SceneFileError: The file, the folder or a model is missing or cannot be read.
        SceneKeyError: A part of the file is missing or malformed, or a thing has no place.
        UnknownNameError: An unknown section, predicate, class, thing or region.
        ArgumentError: `widen` is not a positive number, or `clutter` not a possible one.

    Warns:
        ModelWarning: Boxes stand in for models.
    """
    problem = read_problem(path)
    if not (isinstance(widen, int | float) and 0.0 < widen < math.inf):
        raise ArgumentError(f"read_bddl: widen {widen!r} should be a positive number, such as 2.")
    more = [name for name in OBJECTS if name not in problem.objects.values()]
    if isinstance(clutter, bool) or not isinstance(clutter, int) or not 0 <= 2 * clutter <= len(more):
        raise ArgumentError(f"read_bddl: clutter {clutter!r} should be a whole number from 0 to {len(more) // 2}.")
    added = {f"{_CLUTTER}_{name}": name for name in more[: 2 * clutter]}
    problem = replace(problem, objects={**problem.objects, **added})
    surface, space = _workspace(problem)
    spec = _model(problem, surface, space, None if assets is None else user_path(assets, Path(), "read_bddl: assets"))
    objects = _Places(problem, surface, space, spec, widen).words(list(added))
    words: dict[str, Any] = {"objects": objects}
    if surface == FLOOR:
        words["floor"] = {"size": np.subtract(space.high, space.low).tolist()}
    if added:
        words["groups"] = {_CLUTTER: {"of": list(added), "count": clutter}}
    place_on(spec, words)
    if robot is not None:
        words["robot"] = {"base": space.base, **({"asset": robot} if isinstance(robot, str) else robot)}
    return LiberoTask(SceneConfig.load({"name": problem.path.stem, "model": spec, **words}), problem)


def _workspace(problem: Problem) -> tuple[str, Workspace]:
    """Return the work surface by its name in the file; a floor is the scene's 'floor'."""
    found = [name for name, kind in problem.fixtures.items() if kind in WORKSPACES]
    if len(found) != 1:
        listing = ", ".join(WORKSPACES)
        raise SceneKeyError(
            f"{problem.path}: a problem should have one work surface among its fixtures ({listing}), has {len(found)}."
        )
    return found[0], WORKSPACES[problem.fixtures[found[0]]]


def _kinds(problem: Problem) -> dict[str, Kind]:
    """Return the class of everything but the work surface, checked."""
    found = {}
    for things, table, word in ((problem.fixtures, FIXTURES, "fixture"), (problem.objects, OBJECTS, "object")):
        for name, kind in things.items():
            if kind in table:
                found[name] = table[kind]
            elif word == "object" or kind not in WORKSPACES:
                valid = [*table, *WORKSPACES] if word == "fixture" else table
                raise UnknownNameError(f"class of {word}", kind, problem.where(problem.lines[name]), valid)
    return found


def _model(problem: Problem, surface: str, space: Workspace, assets: Path | None) -> mujoco.MjSpec:
    """Return a specification with the work surface, the zones on it, and everything in the file at the origin."""
    if assets is not None and not assets.is_dir():
        raise SceneFileError(
            f"read_bddl: assets: there is no folder '{assets}'. Give the folder that has 'stable_hope_objects'."
        )
    spec = mujoco.MjSpec()
    backdrop.set_options(spec)
    _add_surface(spec, problem, surface, space)
    boxes = {}
    for name, kind in _kinds(problem).items():
        word = problem.things[name]
        where = f"{problem.where(problem.lines[name])}: {name}" if name in problem.lines else f"read_bddl: {name}"
        child = None if assets is None else load_thing(word, kind, assets, where)
        if child is None:
            child, boxes[word] = stand_in(kind), kind
        root = attach(spec, child, name, spec.worldbody.add_frame(), where)
        make_kind(spec, root, name, "fixture" if name in problem.fixtures else "free", where)
    if boxes:
        sizes = ", ".join(f"{word} ({' x '.join(f'{s:g}' for s in kind.size)} m)" for word, kind in boxes.items())
        remedy = "Give assets=, the folder of LIBERO's models." if assets is None else f"'{assets}' lacks them."
        warnings.warn(ModelWarning(f"{problem.path}: boxes stand in for {sizes}. {remedy}"), stacklevel=3)
    return spec


def _add_surface(spec: mujoco.MjSpec, problem: Problem, surface: str, space: Workspace) -> None:
    """Add the work surface, its frame at the origin of rectangles, and a site for each rectangle."""
    x, y, z = space.origin
    body = spec.worldbody
    if surface != FLOOR:
        body = body.add_body(name=surface, pos=[x, y, space.top])
        middle, half = 0.5 * np.add(space.low, space.high), 0.5 * np.subtract(space.high, space.low)
        body.add_geom(
            name=f"{surface}/top",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[*(middle - [x, y]), -0.5 * _THICK],
            size=[*half, 0.5 * _THICK],
            rgba=[0.8, 0.7, 0.55, 1.0],
        )
    for region in problem.regions.values():
        if region.target == surface and region.boxes:
            low, high = np.reshape(region.boxes[0], (2, 2))
            size = [*(0.5 * (high - low)), _ZONE]
            pos = [*(0.5 * (low + high)), z if surface == FLOOR else z - space.top]
            kind = mujoco.mjtGeom.mjGEOM_BOX
            body.add_site(name=f"{surface}/{region.name}", type=kind, pos=pos, size=size, rgba=np.zeros(4))


class _Places:
    """The words of objects: their supports, regions, orientations and joints."""

    def __init__(self, problem: Problem, surface: str, space: Workspace, spec: mujoco.MjSpec, widen: float) -> None:
        self._problem, self._surface, self._space, self._spec, self._widen = problem, surface, space, spec, widen
        self._kinds = _kinds(problem)
        self._mjm = compile_spec(spec, str(problem.path))
        self._data = mujoco.MjData(self._mjm)
        mujoco.mj_kinematics(self._mjm, self._data)
        self._pieces = extract_pieces(self._mjm, "physics", where=dict.fromkeys(range(self._mjm.nbody), problem.path.name))

    def words(self, added: list[str]) -> dict[str, Any]:
        """Return the words of all objects by name; those of `added` stand anywhere around the rectangles."""
        found: dict[str, dict[str, Any]] = {}
        for predicate in self._problem.init:
            if predicate.word in ("On", "In"):
                found[predicate.names[0]] = self._place(predicate)
        for predicate in self._problem.init:
            if predicate.word not in ("On", "In"):
                name, joints = self._state(predicate)
                found.get(name, {}).setdefault("joints", {}).update(joints)
        boxes = np.array([b for r in self._problem.regions.values() for b in r.boxes if r.target == self._surface])
        for name in added:
            around = (*(boxes[:, :2].min(0) - _AROUND), *(boxes[:, 2:].max(0) + _AROUND))
            found[name] = self._on_surface(name, around, self._kinds[name].yaw)
        for name in self._kinds:
            if name not in found:
                line = self._problem.where(self._problem.lines[name])
                raise SceneKeyError(f"{line}: '{name}' should have a place in ':init', such as (On {name} REGION).")
        return found

    def _place(self, predicate: Predicate) -> dict[str, Any]:
        """Return the words of the thing that an `On` or `In` of the start places."""
        name, target = predicate.names
        where = f"{self._problem.where(predicate.line)}: {predicate}"
        if name not in self._kinds:
            raise UnknownNameError("thing", name, where, self._kinds)
        region = self._problem.regions.get(target)
        yaw = self._kinds[name].yaw if region is None or name in self._problem.objects else np.degrees(region.yaw)
        if region is not None and region.target == self._surface:
            if not region.boxes:
                raise SceneKeyError(f"{where}: region '{region.name}' should have ':ranges', as it is on the surface.")
            return self._on_surface(name, region.boxes[0], tuple(yaw))
        if region is None:
            return self._on_thing(name, target, where)
        return self._on_site(name, region, predicate.word, where)

    def _on_surface(self, name: str, box: tuple[float, ...], yaw: tuple[float, float]) -> dict[str, Any]:
        low, high = np.reshape(box, (2, 2))
        middle, half = 0.5 * (low + high), 0.5 * self._widen * (high - low)
        origin = np.array(self._space.origin[:2])
        corners = np.clip([middle - half, middle + half], self._space.low - origin, self._space.high - origin)
        corners = corners + self._pivot(name, yaw)
        return self._words(name, yaw) | {"on": self._surface, "region": {"box": corners.tolist()}}

    def _on_thing(self, name: str, target: str, where: str) -> dict[str, Any]:
        """Return the words of a thing that stands on the middle of another one, or anywhere on the surface."""
        yaw = self._kinds[name].yaw
        if target == self._surface:
            return self._words(name, yaw) | {"on": target}
        yaw = self._relative(yaw, target)
        point = self._pivot(name, yaw).tolist()
        return self._words(name, yaw) | {"on": f"{target}/{INNER}", "region": {"points": [point]}}

    def _on_site(self, name: str, region: Region, word: str, where: str) -> dict[str, Any]:
        """Return the words of a thing on or in a site, which keeps its radius from the edge of half of it."""
        site = self._site(region, where)
        yaw = self._relative(self._kinds[name].yaw, region.target)
        radius = self._spec.site(f"{name}/horizontal_radius_site")
        turned = np.abs(matrix(np.asarray(site.quat)) @ site.size)
        away = np.linalg.norm(radius.pos[:2]) if radius is not None else _RADIUS
        half = np.abs(0.5 * turned[:2] - away)
        middle = site.pos[:2] + self._pivot(name, yaw)
        support = {"On": "on", "In": "in"}[word]
        region_words = {"box": [(middle - half).tolist(), (middle + half).tolist()]}
        return self._words(name, yaw) | {support: site.parent.name, "region": region_words}

    def _words(self, name: str, yaw: tuple[float, float]) -> dict[str, Any]:
        kind = {"kind": "fixture"} if name in self._problem.fixtures else {}
        return {**kind, "orientation": {"yaw": [float(angle) for angle in yaw]}}

    def _relative(self, yaw: tuple[float, float], target: str) -> tuple[float, float]:
        """Return a heading in the world as one relative to a thing, in the middle of its own headings."""
        its = self._kinds[target].yaw
        for predicate in self._problem.init:
            if predicate.names[0] == target and target in self._problem.fixtures and predicate.word == "On":
                region = self._problem.regions.get(predicate.names[1])
                its = (0.0, 0.0) if region is None else tuple(np.degrees(region.yaw))
        turn = math.remainder(0.5 * sum(yaw) - 0.5 * sum(its), 360.0)
        half = 0.5 * (yaw[1] - yaw[0])
        return turn - half, turn + half

    def _pivot(self, name: str, yaw: tuple[float, float]) -> np.ndarray:
        """Return where the pivot is, from the origin that LIBERO places, in the middle of the headings [m]."""
        root = self._mjm.body(name).id
        inside = subtree(self._mjm, root)
        shape = HomeShape(self._data, root, [p for p in self._pieces if p.body in inside])
        x, y = shape.variant(np.array([1.0, 0.0, 0.0, 0.0])).pivot[:2]
        angle = math.radians(0.5 * sum(yaw))
        return np.array([math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y])

    def _state(self, predicate: Predicate) -> tuple[str, dict[str, Any]]:
        """Return the thing and the joints that a predicate such as `Open` moves."""
        where = f"{self._problem.where(predicate.line)}: {predicate}"
        region = self._problem.regions.get(predicate.names[0])
        name = predicate.names[0] if region is None else region.target
        kind = self._kinds.get(name)
        if kind is None or predicate.word not in kind.states:
            can = [n for n, k in self._kinds.items() if predicate.word in k.states]
            raise UnknownNameError(f"thing for {predicate.word}", predicate.names[0], where, can)
        body = self._spec.body(name) if region is None else self._site(region, where).parent
        found = body.find_all("joint") if region is None else list(body.joints)
        return name, {joint.name.removeprefix(f"{name}/"): {"range": list(kind.states[predicate.word])} for joint in found}

    def _site(self, region: Region, where: str) -> mujoco.MjsSite:
        site = self._spec.site(f"{region.target}/{region.name}")
        if site is None:
            own = [s.name.partition("/")[2] for s in self._spec.sites if s.name.startswith(f"{region.target}/")]
            raise UnknownNameError(f"site of '{region.target}'", region.name, where, own)
        return site
