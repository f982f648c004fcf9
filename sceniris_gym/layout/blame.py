"""Who is in the way: for candidates that were rejected for collision, which geoms they hit, and how deep."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.pairs import PairRules

_WORLDS = 64
_RECORDED = 512
_LOOKED_AT = 48  # of the recorded candidates of one object


@dataclass(frozen=True)
class Obstruction:
    """The pair of geoms that most candidates of an object are rejected for.

    Attributes:
        pair: The geoms and their bodies, by name.
        share: Share of the candidates rejected for collision that it rejects.
        distance: Mean distance [m] in these; negative where they overlap.
        margin: The least distance [m] that is asked for.
    """

    pair: str
    share: float
    distance: float
    margin: float

    def __str__(self) -> str:
        gap = f"{1e3 * abs(self.distance):.3g} mm {'deep' if self.distance < 0.0 else 'apart'} on average"
        return f"{self.pair} ({gap}, {1e3 * self.margin:.3g} mm apart is asked for; {self.share:.0%} of them)"


def obstructions(compiled: CompiledScene, split: str) -> dict[str, Obstruction]:
    """Return for each object that candidates are rejected of for collision what is in its way most.

    Distances are those of MuJoCo C, between what it collides, also with `geometry: visual`.
    """
    generator = LayoutGenerator(compiled, _WORLDS, split=split, rejected=_RECORDED)
    generator.generate()
    view, mjm = generator.layouts.view, compiled.mjm
    count = min(int(view.rejected_count.numpy()[0]), _RECORDED)
    objects = view.rejected_object.numpy()[:count]
    states = [a.numpy() for a in (view.rejected_qpos, view.rejected_mocap_pos, view.rejected_mocap_quat)]
    data, found = mujoco.MjData(mjm), {}
    for number in np.unique(objects):
        tests = _tests(compiled, int(number))
        rows = np.flatnonzero(objects == number)[:_LOOKED_AT]
        seen: Counter[tuple[int, int]] = Counter()
        distances: dict[tuple[int, int], list[float]] = {}
        for row in rows:
            data.qpos[:] = states[0][row]
            if mjm.nmocap:
                data.mocap_pos[:], data.mocap_quat[:] = states[1][row], states[2][row]
            mujoco.mj_kinematics(mjm, data)
            for pair, distance in _hits(mjm, data, tests).items():
                seen[pair] += 1
                distances.setdefault(pair, []).append(distance)
        if seen:
            pair, times = seen.most_common(1)[0]
            words = " and ".join(_name(mjm, geom) for geom in pair)
            found[compiled.placed[number]] = Obstruction(
                words, times / len(rows), float(np.mean(distances[pair])), tests[pair]
            )
    return found


def _tests(compiled: CompiledScene, number: int) -> dict[tuple[int, int], float]:
    """Pairs of geoms that an object of the plan is tested for, and the least distance [m] of each."""
    program, rules = compiled.program, PairRules(compiled.scene, compiled.colliders)
    first = int(program.obj_pairadr.numpy()[number])
    ground = compiled.plan.objects[number].ground
    found = {}
    for i in range(first, first + int(program.obj_pairnum.numpy()[number])):
        a, b = (int(array.numpy()[i]) for array in (program.pair_a, program.pair_b))
        stands = ground is not None and rules.colliders.body[b] == ground
        margin = rules.touch(a, b) if stands else float(program.pair_margin.numpy()[i])
        found |= dict.fromkeys(product(rules.geoms(a), rules.geoms(b)), margin)
    return found


def _hits(
    mjm: mujoco.MjModel, data: mujoco.MjData, tests: dict[tuple[int, int], float]
) -> dict[tuple[int, int], float]:
    found = {}
    for (a, b), margin in tests.items():
        reach = mjm.geom_rbound[a] + mjm.geom_rbound[b] + margin
        bounded = mjm.geom_rbound[a] > 0.0 and mjm.geom_rbound[b] > 0.0  # a plane is not
        if bounded and np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) > reach:
            continue
        distance = mujoco.mj_geomDistance(mjm, data, a, b, margin + 1e-3, None)
        if distance <= margin + 1e-5:
            found[a, b] = distance
    return found


def _name(mjm: mujoco.MjModel, geom: int) -> str:
    body = mjm.body(int(mjm.geom_bodyid[geom])).name
    return f"geom '{mjm.geom(geom).name or geom}' of body '{body}'"
