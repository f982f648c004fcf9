"""Shows why candidates were rejected: draws a candidate in red at its place, and explains the cause in words."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from sceniris_gym.layout.blame import Hit
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.overview import VISIBLE_GROUPS, box_corners, geom_corners
from sceniris_gym.viewer.deck import Candidate
from sceniris_gym.viewer.shown import ShownWorld
from sceniris_gym.viewer.sketch import GREY, ORANGE, RED, Colour, Sketch
from sceniris_gym.viewer.worlds import body_mesh

_MOST_HITS = 3
_TOP = [1, 5, 7, 3]  # the upper corners among those of `box_corners`, one after another around the box
_ABOVE = 0.15  # m from a candidate to its label
_MOST_BEFORE = 20  # greatest number of surfaces along a ray
_BEYOND = 1e-4  # m behind a surface, where the next ray starts
CAUSES = {
    "overhead": "'on' requires open space above it, and 'inside' requires a part of its container above it",
    "footprint": "part of it hangs over the edge of its support",
    "collision": "it would touch an obstacle, or be nearer to one than its clearance",
    "empty": "its region and relations leave no area of its support",
    "region": "its relations do not hold at any point of the remaining region",
    "unreachable": "all of its grasps are out of the arm's reach",
    "no_ik": "inverse kinematics found no joints for its grasps",
    "no_path": "none of the paths that were tried to its grasps is free",
    "blocked": "the arm would hit an obstacle in all of its grasps",
    "falls": "it would fall, or make its support fall",
    "unsound": "the layout has non-finite numbers",
}
"""The meaning of each cause, in words that follow 'because'."""


def world_of(compiled: CompiledScene, candidate: Candidate) -> ShownWorld:
    """Return the world in the state in which a candidate was tried. Objects that are placed later have no place yet."""
    later = compiled.placed[candidate.number + 1 :]
    drawn = {name for name in later if name in compiled.config.parts and compiled.config.parts[name].is_placed}
    return ShownWorld(compiled, candidate.state, frozenset(drawn))


def bodies_before(world: ShownWorld, candidate: Candidate, direction: np.ndarray) -> list[int]:
    """Return the bodies that hide a candidate, such as the front of a drawer around it.

    Args:
        world: The world of the candidate, from `world_of`.
        candidate: The candidate.
        direction: Unit vector from the scene to the camera, shape (3,).
    """
    mjm, own = world.compiled.mjm, {0, *world.compiled.scene.subtree(candidate.name)}
    groups = np.isin(np.arange(mujoco.mjNGROUP), VISIBLE_GROUPS).astype(np.uint8)
    low, high = world.box(candidate.name)
    found, geom = set(), np.zeros(1, np.int32)
    for at in [(low + high) / 2.0, *box_corners((low + high) / 2.0, (high - low) / 2.0)]:
        for _ in range(_MOST_BEFORE):
            far = mujoco.mj_ray(mjm, world.data, at, direction, groups, 1, -1, geom)
            if far < 0.0:
                break
            found.add(int(mjm.geom_bodyid[geom[0]]))
            at = at + (far + _BEYOND) * direction
    return sorted(found - own)


def sketch_candidate(world: ShownWorld, candidate: Candidate, hits: Sequence[Hit], before: Sequence[int]) -> Sketch:
    """Draw a candidate in red, the geoms that it hits in orange, and bodies that hide it in translucent grey.

    Args:
        world: The world of the candidate, from `world_of`.
        candidate: The candidate.
        hits: The pairs of geoms that collide, worst first.
        before: The bodies that hide the candidate, from `bodies_before`.
    """
    sketch, mjm = Sketch(), world.compiled.mjm
    for body in world.compiled.scene.subtree(candidate.name):
        _add_body(sketch, world, body, RED, 0.8)
    for body in before:
        _add_body(sketch, world, body, GREY, 0.25)
    for hit in worst_by_body(mjm, hits):
        ends = np.zeros(6)
        mujoco.mj_geomDistance(mjm, world.data, *hit.geoms, 1.0, ends)
        sketch.lines.append((ends.reshape(2, 3), ORANGE))
        sketch.outline(geom_corners(mjm, world.data, np.array(hit.geoms[1:]))[_TOP], ORANGE)
    low, high = world.box(candidate.name)
    middle = (low + high) / 2.0
    top = np.array([*middle[:2], high[2] + _ABOVE])
    sketch.lines.append((np.stack([middle, top]), RED))
    sketch.labels.append((f"{candidate.name}: {candidate.cause}", top))
    return sketch


def explain(compiled: CompiledScene, candidate: Candidate, hits: Sequence[Hit]) -> str:
    """Return sentences that explain why a candidate was rejected. `hits` are its collisions, worst first."""
    times = f"{candidate.count} of its candidates" if candidate.count > 1 else "one candidate"
    lines = [f"{candidate.name}: {candidate.cause} ({times} in this layout)."]
    because = CAUSES[candidate.cause]
    if candidate.cause == "unreachable" and candidate.name in compiled.config.all_robots:
        because = "from there, all grasps of an object that it must reach are out of the arm's reach"
    lines.append(f"Rejected because {because}.")
    lines += [f"In the way: {hit}." for hit in worst_by_body(compiled.mjm, hits)]
    return "\n".join(lines)


def worst_by_body(mjm: mujoco.MjModel, hits: Sequence[Hit]) -> list[Hit]:
    """Return the worst hit on each body that a candidate hits, at most three. `hits` and the result are worst first."""
    first = {int(mjm.geom_bodyid[hit.geoms[1]]): hit for hit in reversed(hits)}
    return [hit for hit in hits if first[int(mjm.geom_bodyid[hit.geoms[1]])] is hit][:_MOST_HITS]


def table_in_html(counts: Mapping[str, Mapping[str, int]], layouts: int, valid: int) -> str:
    """Return rejection counts as an HTML table, with a row for each object and a column for each cause.

    Args:
        counts: Object -> cause -> number of rejected candidates.
        layouts: Number of layouts for which candidates were counted.
        valid: Number of valid layouts among them.
    """
    share = f"{valid / layouts:.1%}" if layouts else "none"
    head = f"<p>Rejected candidates in {layouts} layouts, {share} valid:</p>"
    if not counts:
        return f"{head}<p>no candidates</p>"
    cells = {name: "".join(f"<td align=right>{n or '-'}</td>" for n in row.values()) for name, row in counts.items()}
    rows = "".join(f"<tr><td>{name}</td>{cells[name]}</tr>" for name in counts)
    titles = "".join(f"<th align=right title='{CAUSES[c]}'>{c}</th>" for c in next(iter(counts.values())))
    return f"{head}<table width='100%'><tr><th align=left>object</th>{titles}</tr>{rows}</table>"


def _add_body(sketch: Sketch, world: ShownWorld, body: int, colour: Colour, opacity: float) -> None:
    mjm = world.compiled.mjm
    if (mesh := body_mesh(mjm, np.flatnonzero(mjm.geom_bodyid == body))) is not None:
        vertices, faces = mesh
        sketch.surfaces.append((world.from_body(body, vertices), faces, colour, opacity))
