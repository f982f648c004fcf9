"""Reads LIBERO's problem files as scenes of this package: `read_bddl`."""

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.loader import user_path
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ModelWarning, SceneFileError, SceneKeyError
from sceniris_gym.importers.libero.arena import add_arena, cameras
from sceniris_gym.importers.libero.kinds import OBJECTS, WORKSPACES, Workspace
from sceniris_gym.importers.libero.places import Places, kinds_of, load_thing, stand_in
from sceniris_gym.importers.libero.problem import Problem, read_problem
from sceniris_gym.scene import adopt, assemble, backdrop

_CLUTTER = "clutter"
_REMEDY = "Give `assets`, the folder libero/libero/assets of LIBERO's repository."
_ZONE = 0.007  # half height [m] of the zone over a rectangle: a goal counts an object in it as on the rectangle
_LEAST = 1e-6  # half edge [m] of the zone over a point
_THICK = 0.05  # thickness of a work surface [m]
_PANDA = {"joint2": {"value": -0.161037}, "joint4": {"value": -2.444597}, "joint6": {"value": 2.226752}}
"""Joints of the arm `panda` at which LIBERO's start pose differs from `home` [rad]."""


@dataclass(frozen=True)
class LiberoTask:
    """A problem file as a scene and a goal.

    Attributes:
        scene: The scene. Its model is an MjSpec with a body for each object and fixture, and a site for each region,
            named 'TARGET/REGION'.
        problem: The parsed file: `language`, `goal`, `of_interest`, and the class of each object and fixture.
    """

    scene: SceneConfig
    problem: Problem


def read_bddl(
    path: str | Path,
    *,
    assets: str | Path | None = None,
    widen: float = 1.0,
    clutter: int = 0,
    robot: str | Mapping[str, Any] | None = None,
    arena: bool = False,
) -> LiberoTask:
    """Read a problem file of LIBERO (BDDL).

    If an object starts in a rectangle, the rectangle becomes the object's region on the work surface. If the object
    starts on or in a site, it gets a region on the site's body. `Open`, `Close`, `Turnon` and `Turnoff` at the start
    become ranges of joint positions, with LIBERO's limits.

    Args:
        path: The file.
        assets: The folder of LIBERO's models, which contains `stable_hope_objects` and similar folders. Boxes stand in
            for missing models, and a warning lists these boxes and their sizes.
        widen: Factor by which each rectangle grows about its centre. The result is cut at the work surface's edge.
        clutter: Number of extra objects in each layout. Each layout draws them from 2 * `clutter` objects, whose
            classes the file does not use. They stand within 10 cm of the rectangle around all rectangles of the file.
        robot: An arm: the name of an asset, or a mapping as under `robot` in a scene file. Unless the mapping has a
            `base`, the arm stands where LIBERO puts its arm for this work surface. A `panda` starts in LIBERO's pose.
        arena: Also add LIBERO's cameras, floor, walls and furniture, and the mount of the arm. These
            parts come from `assets` if possible, and do not collide.

    Returns:
        The scene, and the problem with the goal.

    Raises:
        SceneFileError: The file, the folder or a model is missing or cannot be read.
        SceneKeyError: A part of the file is missing or malformed, or an object or fixture does not have exactly one
            place at the start.
        UnknownNameError: A section, predicate, class, object, fixture or region is unknown.
        ArgumentError: `widen` is not a positive number, or `clutter` is out of range.

    Warns:
        ModelWarning: Boxes stand in for models.
    """
    problem = read_problem(path)
    if not (isinstance(widen, int | float) and 0.0 < widen < math.inf):
        raise ArgumentError(f"read_bddl: widen {widen!r} should be a positive number, such as 2.")
    taken = {*problem.objects.values(), *problem.things}  # classes and names
    more = [name for name in OBJECTS if not taken & {name, f"{_CLUTTER}_{name}"}]
    if isinstance(clutter, bool) or not isinstance(clutter, int) or not 0 <= 2 * clutter <= len(more):
        raise ArgumentError(f"read_bddl: clutter {clutter!r} should be a whole number from 0 to {len(more) // 2}.")
    added = {f"{_CLUTTER}_{name}": name for name in more[: 2 * clutter]}
    problem = replace(problem, objects={**problem.objects, **added})
    surface, space = _workspace(problem)
    arm = robot if isinstance(robot, str) else None if robot is None else robot.get("asset")
    folder = None if assets is None else user_path(assets, Path(), "read_bddl: assets")
    spec = _model(problem, surface, space, folder)
    if arena:
        add_arena(spec, surface, problem.fixtures[surface], folder, arm=robot is not None)
    words: dict[str, Any] = {"objects": Places(problem, surface, space, spec, widen).words(list(added))}
    if surface == FLOOR:
        words["floor"] = {"size": np.subtract(space.high, space.low).tolist()}
    if added:
        words["groups"] = {_CLUTTER: {"of": list(added), "count": clutter}}
    adopt.edit_spec(spec, words)
    if robot is not None:
        home = {"joints": _PANDA} if arm == "panda" else {}
        words["robot"] = {"base": space.base, **home, **(robot if isinstance(robot, Mapping) else {"asset": robot})}
    if arena:
        words["cameras"] = cameras(problem.fixtures[surface], arm)
    return LiberoTask(SceneConfig.load({"name": problem.path.stem, "model": spec, **words}), problem)


def _workspace(problem: Problem) -> tuple[str, Workspace]:
    """Return the work surface of a problem: its name in the file, which is 'floor' for a floor, and its measures."""
    found = [name for name, kind in problem.fixtures.items() if kind in WORKSPACES]
    if len(found) != 1:
        listing = ", ".join(WORKSPACES)
        raise SceneKeyError(
            f"{problem.path}: a problem should have one work surface among its fixtures ({listing}), has {len(found)}."
        )
    name, kind = found[0], problem.fixtures[found[0]]
    if (name == FLOOR) != (kind == FLOOR):
        where = problem.places[name]
        raise SceneKeyError(f"{where}: '{name} - {kind}' should have the name and the class 'floor', or neither.")
    return name, WORKSPACES[kind]


def _model(problem: Problem, surface: str, space: Workspace, assets: Path | None) -> mujoco.MjSpec:
    """Build an MjSpec with the work surface, sites for its regions, and all objects and fixtures at the origin."""
    if assets is not None and not assets.is_dir():
        raise SceneFileError(f"read_bddl: assets: there is no folder '{assets}'. {_REMEDY}")
    spec = mujoco.MjSpec()
    spec.modelname = "scene"
    backdrop.set_options(spec)
    _add_surface(spec, problem, surface, space)
    boxes = {}
    for name, kind in kinds_of(problem).items():
        word = problem.things[name]
        where = f"{problem.places.get(name, 'read_bddl')}: {name}"
        child = None if assets is None else load_thing(word, kind, assets, where)
        if child is None:
            child, boxes[word] = stand_in(word, kind), kind
        root = assemble.attach(spec, child, name, spec.worldbody.add_frame(), where)
        assemble.make_kind(spec, root, name, "fixture" if name in problem.fixtures else "free", where)
    if boxes:
        sizes = ", ".join(f"{word} ({' x '.join(f'{s:g}' for s in kind.size)} m)" for word, kind in boxes.items())
        lack = "" if assets is None else f" '{assets}' lacks these."
        warnings.warn(ModelWarning(f"{problem.path}: boxes stand in for {sizes}.{lack} {_REMEDY}"), stacklevel=3)
    return spec


def _add_surface(spec: mujoco.MjSpec, problem: Problem, surface: str, space: Workspace) -> None:
    """Add the work surface, unless it is the floor, and a site for each region on it.

    The body of the work surface has its frame at the origin of the file's rectangles.
    """
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
            size = [*np.maximum(0.5 * (high - low), _LEAST), _ZONE]
            pos = [*(0.5 * (low + high)), z if surface == FLOOR else z - space.top]
            kind = mujoco.mjtGeom.mjGEOM_BOX
            body.add_site(name=f"{surface}/{region.name}", type=kind, pos=pos, size=size, rgba=np.zeros(4))
