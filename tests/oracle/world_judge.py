"""MuJoCo C as the judge of worlds that were reset: nothing is inside of anything, what is put down stays, what is held
does not slip. Valid layouts and layouts from the bank alike, each in the model that was drawn for its world.

It knows the worlds and the words of the scene, and shares no code with what makes layouts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.oracle.world_models import WorldModels

STILL = 0.01
"""Greatest motion [m] of an object that stands."""
SECONDS = 0.5
"""Time [s] that it is watched; twice as long if it gets `_SUSPECT` by then."""
DEEP = 1e-4
"""Depth [m] from which on a contact counts at the start."""
SLIPPED = 2e-3
"""Motion [m] in the frame of the tool of what is held, from which on it counts."""
_SUSPECT = 0.003
_HELD_DEEP = 5e-4  # m, of a finger in what it holds, which is to be 0.3 mm
_HOME = 2e-5  # m, by how much deeper a pair may be that overlaps at home
_ELSEWHERE = 35.0  # m from the origin, where absent members of groups are


@dataclass(frozen=True)
class Verdict:
    """Verdict on one world.

    Attributes:
        seed: The seed of its layout.
        status: 1 for a valid layout, 2 for one from the bank.
        start: The number of its kind of start, -1 for none.
        deep: The greatest depth of a contact beyond what may be [m], 0 if there is none.
        pair: The two geoms.
        moved: The greatest motion of an object that should stand [m], infinite where MuJoCo C gave up.
        who: The object.
        slip: The motion of what is held in the frame of the tool [m], NaN without any.
    """

    seed: int
    status: int
    start: int
    deep: float
    pair: str
    moved: float
    who: str
    slip: float

    @property
    def faults(self) -> tuple[str, ...]:
        """Names of the faults: deep, moved, slipped."""
        found = {"deep": self.deep > DEEP, "moved": self.moved > STILL, "slipped": self.slip > SLIPPED}
        return tuple(name for name, wrong in found.items() if wrong)


@dataclass(frozen=True)
class _Hand:
    """A grasp of a world: bodies of the thing and of the robot, the body that moves, and the site of the tool."""

    thing: frozenset[int]
    robot: frozenset[int]
    root: int
    tool: int


class WorldJudge:
    """Judges the worlds of one reset.

    Args:
        compiled: The scene.
        seeds: The seed of each world's layout, shape (nworld,).

    Attributes:
        mjm: The model that is simulated.
        randomizer: What has reset the worlds.
        worlds: Their models and states.
    """

    def __init__(self, compiled: CompiledScene, seeds: np.ndarray) -> None:
        self.compiled, self.scene = compiled, compiled.scene.sim
        self.mjm = self.scene.mjm
        batch = Batch(compiled.scene, len(seeds), compiled.device, graph=False)
        seed: list[int] = seeds.tolist()
        self.randomizer = ResetRandomizer.of_batch(batch, compiled, seed=seed, prefetch=False, graph=False)
        self.randomizer.reset()
        self.worlds = WorldModels(self.mjm, batch.model, batch.data)
        layouts = self.randomizer.layouts
        self._seeds, self._status = seeds.tolist(), layouts.status.cpu().numpy().tolist()
        self._start, self._present = layouts.start.cpu().numpy().tolist(), layouts.present.cpu().numpy().astype(bool)
        self._standing = [
            (compiled.slots.index(name), self.scene.bodies[compiled.config.owners.get(name, name)], name)
            for name, words in compiled.config.objects.items()
            if words.kind == "free" and words.support is not None and words.stands and words.gap <= 0.005
            if words.drawn_orientation.kind != "any"
        ]
        placed = {compiled.config.owners.get(n, n) for n, words in compiled.config.objects.items() if words.is_placed}
        owner = {body: name for name in self.scene.bodies for body in self.scene.subtree(name)}
        self._owner = [owner.get(int(body), "") for body in self.mjm.geom_bodyid]
        self._placed = [name in placed for name in self._owner]
        self._at_home = self._home()

    def judge(self) -> Iterator[Verdict]:
        """Yield the verdicts, world by world."""
        data = mujoco.MjData(self.mjm)
        for world in range(self.worlds.nworld):
            mjm = self.worlds.model(world)
            self.worlds.put(data, world)
            hand = self._hand(world)
            mujoco.mj_forward(mjm, data)
            deep, pair = self._deepest(data, hand)
            moved, who, slip = self._motion(mjm, data, world, hand)
            start = self._start[world] if self.compiled.config.start else -1
            yield Verdict(self._seeds[world], self._status[world], start, deep, pair, moved, who, slip)

    def _home(self) -> dict[tuple[int, int], float]:
        """Return the distance of each pair of geoms that touches at home, of one object or of what is never placed."""
        data, found = mujoco.MjData(self.mjm), {}
        data.qpos[:] = self.scene.home_qpos
        mujoco.mj_forward(self.mjm, data)
        for contact in data.contact:
            a, b = sorted(contact.geom.tolist())
            if self._owner[a] == self._owner[b] or not (self._placed[a] or self._placed[b]):
                found[a, b] = min(found.get((a, b), 0.0), float(contact.dist))
        return found

    def _hand(self, world: int) -> _Hand | None:
        """Return what a world holds at its start, if anything."""
        config = self.compiled.config
        if not config.start or config.start[self._start[world]].robot != "grasp":
            return None
        of = str(config.start[self._start[world]].of)
        robot, thing = (
            config.robot_for(config.variants.get(of, (of,))[0]),
            self.scene.subtree(config.owners.get(of, of)),
        )
        root = thing[0]
        if not self.mjm.body_dofnum[root]:  # a drawer moves inside of its cabinet
            root = max(thing, key=lambda body: self.mjm.body_dofnum[body])
        tool = self.mjm.site(self.compiled.scene.tcps[robot]).id
        return _Hand(frozenset(thing), frozenset(self.scene.subtree(robot)), root, tool)

    def _deepest(self, data: mujoco.MjData, hand: _Hand | None) -> tuple[float, str]:
        """Return the greatest depth beyond what may be, and the geoms."""
        worst, pair = 0.0, ""
        for contact in data.contact:
            a, b = sorted(contact.geom.tolist())
            allowed = -self._at_home[a, b] + _HOME if (a, b) in self._at_home else 0.0
            bodies = set(self.mjm.geom_bodyid[[a, b]].tolist())
            if hand is not None and bodies & hand.thing and bodies & hand.robot:
                allowed = _HELD_DEEP
            depth = -float(contact.dist)
            if depth > max(allowed, worst):
                worst, pair = depth, " and ".join(self._name(geom) for geom in (a, b))
        return worst, pair

    def _name(self, geom: int) -> str:
        return self.mjm.geom(geom).name or f"geom {geom} of {self.mjm.body(self.mjm.geom_bodyid[geom]).name}"

    def _motion(
        self, mjm: mujoco.MjModel, data: mujoco.MjData, world: int, hand: _Hand | None
    ) -> tuple[float, str, float]:
        """Return the greatest motion of what should stand, its name, and how far what is held slips."""
        there = [(body, name) for slot, body, name in self._standing if self._present[world, slot]]
        there = [(b, n) for b, n in there if hand is None or b not in hand.thing]
        bodies = [body for body, _ in there if np.abs(data.xpos[body, :2]).max() < _ELSEWHERE]
        if not bodies and hand is None:
            return 0.0, "", float("nan")
        names = [name for body, name in there if body in bodies]
        before, held, slip = self._places(data, bodies), _in_hand(data, hand), float("nan")
        nstep = round(SECONDS / mjm.opt.timestep)
        motion = np.zeros(len(bodies))
        for turn in (1, 2):
            mujoco.mj_step(mjm, data, nstep)
            if data.time < (turn * nstep - 0.5) * mjm.opt.timestep:  # MuJoCo has reset what became too fast
                return float("inf"), "", slip
            mujoco.mj_kinematics(mjm, data)
            mujoco.mj_comPos(mjm, data)
            if turn == 1 and hand is not None:
                slip = float(np.linalg.norm(_in_hand(data, hand) - held))
            motion = np.linalg.norm(self._places(data, bodies) - before, axis=-1).max(axis=0, initial=0.0)
            if not _SUSPECT < motion.max(initial=0.0) <= STILL:
                break
        worst = int(motion.argmax()) if len(motion) else -1
        return float(motion.max(initial=0.0)), names[worst] if worst >= 0 else "", slip

    @staticmethod
    def _places(data: mujoco.MjData, bodies: list[int]) -> np.ndarray:
        """Return the frames' origins and the centres of mass of some bodies [m], shape (2, n, 3)."""
        return np.stack([data.xpos[bodies], data.xipos[bodies]])


def _in_hand(data: mujoco.MjData, hand: _Hand | None) -> np.ndarray:
    """Return the position of what is held in the frame of the tool [m], shape (3,)."""
    if hand is None:
        return np.zeros(3)
    return data.site_xmat[hand.tool].reshape(3, 3).T @ (data.xpos[hand.root] - data.site_xpos[hand.tool])
