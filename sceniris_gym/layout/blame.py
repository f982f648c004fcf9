"""Who is in the way: for candidates that were rejected for collision, which geoms they hit, and how deep."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.geometry.colliders import Colliders, collect_colliders
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.leaves import SKIN
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.home_touch import HomeTouch
from sceniris_gym.program.pairs import PairRules, collider_pairs

_WORLDS = 64
_RECORDED = 512
_LOOKED_AT = 48  # of the recorded candidates of one object
_UNDECIDED = 1.0e-6  # m; what is apart by no more than this beyond the margin and the skin may be rejected


@dataclass(frozen=True)
class Obstruction:
    """The pair of geoms that most candidates of an object are rejected for.

    Attributes:
        pair: The geoms and their bodies, by name.
        share: Share of the candidates rejected for collision that it rejects.
        distance: Mean distance [m] in these; negative where they overlap.
        margin: The least distance [m] that is asked for; negative where they may be as deep as they are at home.
    """

    pair: str
    share: float
    distance: float
    margin: float

    def __str__(self) -> str:
        gap = f"{1e3 * abs(self.distance):.3g} mm {'deep' if self.distance < 0.0 else 'apart'} on average"
        rule = "deep is allowed, as at home" if self.margin < 0.0 else "apart is asked for"
        asked = f"{1e3 * abs(self.margin):.3g} mm {rule}"
        return f"{self.pair} ({gap}, {asked}; {self.share:.0%} of them)"


def obstructions(compiled: CompiledScene, split: str) -> dict[str, Obstruction]:
    """Return for each object that candidates are rejected of for collision what is in its way most.

    Distances are those of MuJoCo C, between what it collides, also with `geometry: visual`. Depths of geoms that are in
    each other at home are measured as they were there.
    """
    generator = LayoutGenerator(compiled, _WORLDS, split=split, rejected=_RECORDED)
    generator.generate()
    view, mjm = generator.layouts.view, compiled.mjm
    count = min(int(view.rejected_count.numpy()[0]), _RECORDED)
    objects = view.rejected_object.numpy()[:count]
    states = [a.numpy() for a in (view.rejected_qpos, view.rejected_mocap_pos, view.rejected_mocap_quat)]
    colliders = collect_colliders(compiled.plan.pieces, compiled.config.geometry == "visual", compiled.device)
    data, found = mujoco.MjData(mjm), {}
    for number in np.unique(objects):
        tests = _tests(compiled, colliders, int(number))
        rows = np.flatnonzero(objects == number)[:_LOOKED_AT]
        seen: Counter[tuple[int, int]] = Counter()
        distances: dict[tuple[int, int], list[float]] = {}
        for row in rows:
            data.qpos[:] = states[0][row]
            if mjm.nmocap:
                data.mocap_pos[:], data.mocap_quat[:] = states[1][row], states[2][row]
            mujoco.mj_kinematics(mjm, data)
            for pair, distance in _hits(compiled, data, tests).items():
                seen[pair] += 1
                distances.setdefault(pair, []).append(distance)
        if seen:
            pair, times = seen.most_common(1)[0]
            words = " and ".join(_name(mjm, geom) for geom in pair)
            found[compiled.placed[number]] = Obstruction(
                words, times / len(rows), float(np.mean(distances[pair])), tests[pair]
            )
    return found


def _tests(compiled: CompiledScene, colliders: Colliders, number: int) -> dict[tuple[int, int], float]:
    """Pairs of geoms that an object of the plan is tested for, and the least distance [m] of each."""
    rules = PairRules(compiled.scene, colliders)
    ground = compiled.plan.objects[number].ground
    found = {}
    for pair in collider_pairs(compiled.scene, compiled.plan, colliders)[number]:
        stands = ground is not None and rules.colliders.body[pair.b] == ground
        margin = rules.touch(pair.a, pair.b) if stands else pair.margin
        geoms = product(rules.geoms(pair.a), rules.geoms(pair.b)) if pair.geoms is None else [pair.geoms]
        found |= dict.fromkeys(geoms, margin)  # those that touch at home follow the others of their bodies
    return found


def _hits(
    compiled: CompiledScene, data: mujoco.MjData, tests: dict[tuple[int, int], float]
) -> dict[tuple[int, int], float]:
    mjm, depths, found = compiled.mjm, HomeTouch(compiled.mjm, data), {}
    pieces = {piece.geom: piece for piece in compiled.plan.pieces}
    for (a, b), margin in tests.items():
        nearest = margin + SKIN + _UNDECIDED
        if margin < 0.0:
            touch = depths.between(pieces[a], pieces[b], nearest)
            if touch is not None:
                found[a, b] = touch.distance
            continue
        reach = mjm.geom_rbound[a] + mjm.geom_rbound[b] + margin
        bounded = mjm.geom_rbound[a] > 0.0 and mjm.geom_rbound[b] > 0.0  # a plane is not
        if bounded and np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) > reach:
            continue
        distance = mujoco.mj_geomDistance(mjm, data, a, b, margin + 1e-3, None)
        if distance <= nearest:
            found[a, b] = distance
    return found


def _name(mjm: mujoco.MjModel, geom: int) -> str:
    body = mjm.body(int(mjm.geom_bodyid[geom])).name
    return f"geom '{mjm.geom(geom).name or geom}' of body '{body}'"
