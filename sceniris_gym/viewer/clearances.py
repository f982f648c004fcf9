"""The layer of clearances: a line from each object to its nearest neighbour, with the distance and the least one."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import GREEN, RED, Sketch

_LOOKED = 0.3  # m; greatest distance of a neighbour that is drawn
_ROUNDING = 1.0e-6  # m
_ABOVE = 0.06  # m; height of a label above its line


def sketch_clearances(world: ShownWorld, only: str | None = None) -> Sketch:
    """Draw a line from each placed object to its nearest neighbour except its support, red if it is too near."""
    sketch, drawn, config = Sketch(), set(), world.compiled.config
    clearances = {name: part.clearance for name, part in {**config.objects, **config.all_robots}.items()}
    for name in [only] if only is not None else world.placed_names:
        nearest = nearest_to(world, name)
        if nearest is None or (nearest.other, name) in drawn:
            continue
        drawn.add((name, nearest.other))
        asked = max(clearances.get(part, 0.0) for part in (name, nearest.other))
        sketch.lines.append((nearest.ends, GREEN if nearest.distance >= asked - _ROUNDING else RED))
        words = f"{name} to {nearest.other}: {1e3 * nearest.distance:.0f} mm, at least {1e3 * asked:g}"
        sketch.words.append((words, nearest.ends.mean(axis=0) + [0.0, 0.0, _ABOVE]))
    return sketch


@dataclass(frozen=True)
class Nearest:
    """The nearest neighbour of an object.

    Attributes:
        other: The name of the neighbour, an object or a body.
        ends: The shortest line from the object to it, (2, 3) [m].
        distance: The length of that line [m]; negative if they overlap.
    """

    other: str
    ends: np.ndarray
    distance: float


def nearest_to(world: ShownWorld, name: str) -> Nearest | None:
    """Return the nearest colliding neighbour of an object; None if nothing is near.

    Its support, the objects on it, and the things of its heap do not count, because `clearance` does not apply to them.
    """
    mjm, data, scene = world.compiled.mjm, world.data, world.compiled.scene
    own = set(scene.subtree(name))
    ground = world.placed(name).ground
    heaps = world.compiled.config.heaps.values()
    heaped = [body for heap in heaps if name in heap.of for other in heap.of for body in scene.subtree(other)]
    aside = {*own, *([] if ground is None else [ground]), *heaped, *world.hidden_bodies()}
    collides = np.flatnonzero((mjm.geom_contype | mjm.geom_conaffinity) != 0).tolist()
    body_of, grounds = mjm.geom_bodyid.tolist(), {other: world.placed(other).ground for other in world.placed_names}
    carriers = {body: g for other, g in grounds.items() if g is not None for body in scene.subtree(other)}
    best, found = _LOOKED, None
    for a in (g for g in collides if body_of[g] in own):
        for b in (g for g in collides if body_of[g] not in aside):
            apart = np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) - mjm.geom_rbound[a] - mjm.geom_rbound[b]
            if carriers.get(body_of[b]) == body_of[a] or (mjm.geom_rbound[b] > 0.0 and apart > best):
                continue
            ends = np.zeros(6)
            distance = mujoco.mj_geomDistance(mjm, data, a, b, best, ends)
            if distance < best:
                best, found = distance, Nearest(_owner(world, b), ends.reshape(2, 3), distance)
    return found


def _owner(world: ShownWorld, geom: int) -> str:
    """Return the owner of a geom in the words of a scene file: an object, or a geom or body that never moves."""
    scene = world.compiled.scene
    body = int(scene.mjm.geom_bodyid[geom])
    objects = (name for name in scene.bodies if body in scene.subtree(name))
    own = scene.mjm.geom(geom).name if scene.mjm.body_weldid[body] == 0 else ""
    return next(objects, "") or own or (scene.mjm.body(body).name if body else "what never moves")
