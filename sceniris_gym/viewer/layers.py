"""The layers that can be laid over the first world, by name."""

from __future__ import annotations

from collections.abc import Callable

from sceniris_gym.viewer.clearances import sketch_clearances
from sceniris_gym.viewer.grasps import sketch_grasps
from sceniris_gym.viewer.regions import sketch_regions
from sceniris_gym.viewer.relations import sketch_relations
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import Sketch


def sketch_names(world: ShownWorld, only: str | None = None) -> Sketch:
    """Write the name of each object above it."""
    sketch = Sketch()
    for name in world.compiled.object_names:
        if world.is_shown(name) and only in (None, name):
            low, high = world.box(name)
            middle = (low + high) / 2.0
            middle[2] = high[2] + 0.01
            sketch.words.append((name, middle))
    return sketch


SKETCHES: dict[str, Callable[[ShownWorld, str | None], Sketch]] = {
    "names": sketch_names,
    "regions": sketch_regions,
    "relations": sketch_relations,
    "clearances": sketch_clearances,
    "grasps": sketch_grasps,
}
"""The function of each layer. It sketches one object of a world, or all."""
PARKED, REACH = "parked objects", "reach map"
"""Layers without a sketch: they move bodies, or are a picture."""
SEEN, COLLIDED, BOTH = "what is seen", "what collides", "both"
"""The geometry of the worlds that is drawn. Colliding geometry is drawn in the first world only."""
HINTS = {
    "names": "The name of every object.",
    "regions": "Where the words of the scene let each object stand, in this world's joint state.",
    "relations": "An arrow from each anchor, and the area that a relation leaves.",
    "clearances": "From each object to what is nearest, and how far it has to be. Red: too near.",
    "grasps": "Grasps that the layout was accepted for; blue is the approach.",
    PARKED: "Objects that their group left out, in a row before the scene.",
    REACH: "A slice of the arm's reachability map, at the height below.",
}
