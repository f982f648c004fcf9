"""Redraws in random physics states, judged by MuJoCo C: the new places are free, and nothing else differs by a bit.

python -m tests.stress.redraws --redraws 20000 --num-envs 1024 --device cuda:0

Each world has random velocities and controls for some steps, then a random set of its objects is redrawn in half of the
worlds. A contact of a redrawn object deeper than 0.1 mm is a failure, as is any other bit of the state that changes, in
these worlds and in the others. The exit status is 1 if there is one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import mujoco
import mujoco_warp as mjw
import numpy as np

if TYPE_CHECKING:
    from sceniris_gym.program.compiled import CompiledScene

DEEP = 1e-4
"""Depth [m] from which on a contact is a failure."""
SCENES = {
    "tabletop_lift": (("can",), ("block", "tin"), ("lemon",), ("orange", "can", "lemon")),
    "clutter": (("mug",), ("apple", "book", "pan"), ("chest",)),
    "kitchen_reset": (("mug",), ("bottle", "pan"), ("can", "book"), ("lemon",)),
    "drawer_open_pick": (("apple",), ("banana",), ("cabinet", "banana")),
    "table_top": (("mug",), ("chair", "banana")),
    "tabletop_lift_any": (("target",), ("first", "second")),
}
"""The objects that are redrawn together, by scene."""


class Judge:
    """MuJoCo C's model of a scene, and what of the state a redraw of some objects may write."""

    def __init__(self, mjm: mujoco.MjModel, bodies: Sequence[int]) -> None:
        self.mjm, self.data = mjm, mujoco.MjData(mjm)
        self.geoms = np.isin(mjm.geom_bodyid, bodies)
        joints = np.flatnonzero(np.isin(mjm.jnt_bodyid, bodies))
        owner = np.repeat(np.arange(mjm.njnt), np.diff([*mjm.jnt_qposadr, mjm.nq]))
        qpos, dofs = np.isin(owner, joints), np.isin(mjm.dof_jntid, joints)
        mocap = np.isin(np.arange(mjm.nmocap), mjm.body_mocapid[list(bodies)])
        held = [i for i in range(mjm.nu) if mjm.actuator_trnid[i, 0] in joints]
        own = {"qpos": qpos, "qvel": dofs, "qacc_warmstart": dofs, "mocap_pos": mocap, "mocap_quat": mocap}
        self.own = own | {"ctrl": np.isin(np.arange(mjm.nu), held)}

    def differences(self, before: dict[str, np.ndarray], after: dict[str, np.ndarray], placed: np.ndarray) -> list[str]:
        """Return the arrays of the state that differ where they should not."""
        found = []
        for name, old in before.items():
            differs = (old != after[name]) & ~(np.isnan(old) & np.isnan(after[name]))
            if name in self.own:
                differs[np.ix_(placed, self.own[name])] = False
            found += [name] if differs.any() else []
        return found

    def deepest(self, state: dict[str, np.ndarray], world: int) -> float:
        """Return how deep the redrawn objects are in anything else [m]."""
        d = self.data
        d.qpos[:] = state["qpos"][world]
        if self.mjm.nmocap:
            d.mocap_pos[:], d.mocap_quat[:] = state["mocap_pos"][world], state["mocap_quat"][world]
        mujoco.mj_kinematics(self.mjm, d)
        mujoco.mj_comPos(self.mjm, d)
        mujoco.mj_collision(self.mjm, d)
        own = self.geoms[d.contact.geom].any(axis=1)
        return float(max(-d.contact.dist[own].min(initial=0.0), 0.0))


def with_variants(compiled: CompiledScene, state: dict[str, np.ndarray], variant: np.ndarray) -> dict[str, np.ndarray]:
    """Return poses in the model with all variants, of which those that worlds do not have are far apart."""
    full, sim, rows = compiled.mjm, compiled.sim_mjm, np.arange(len(variant))
    found = {"qpos": np.tile(full.qpos0, (len(rows), 1))}
    found |= {name: np.zeros((len(rows), full.nmocap, width)) for name, width in (("mocap_pos", 3), ("mocap_quat", 4))}
    variants = {m: (i, k) for i, of in enumerate(compiled.config.variants.values()) for k, m in enumerate(of)}
    for body in range(1, full.nbody):
        name = full.body(body).name
        i, k = variants.get(name, (-1, -1))
        ours = sim.body(name.rpartition("/")[0] if i >= 0 else name)
        there = variant[:, i] == k if i >= 0 else np.ones(len(rows), bool)
        for joint in range(full.body_jntnum[body]):
            theirs, own = full.body_jntadr[body] + joint, ours.jntadr[0] + joint
            width = (7, 4, 1, 1)[full.jnt_type[theirs]]
            to, source = full.jnt_qposadr[theirs], sim.jnt_qposadr[own]
            found["qpos"][:, to : to + width] = state["qpos"][:, source : source + width]
            found["qpos"][~there, to] = 1e3 + 10.0 * body
        if full.body_mocapid[body] >= 0:
            for field in ("mocap_pos", "mocap_quat"):
                found[field][:, full.body_mocapid[body]] = state[field][:, ours.mocapid[0]]
            found["mocap_pos"][~there, full.body_mocapid[body], 0] = 1e3 + 10.0 * body
    return found


def try_scene(scene: str, number: int, num_envs: int, device: str | None, seed: int) -> dict[str, object]:
    """Redraw objects of a scene at least `number` times, and count what is wrong."""
    from sceniris_gym.layout.compile import compile_scene
    from sceniris_gym.layout.layouts import LayoutStatus
    from sceniris_gym.sim.batch import Batch
    from sceniris_gym.sim.randomizer import ResetRandomizer

    compiled, random = compile_scene(scene, device), np.random.default_rng(seed)
    model = compiled.scene
    batch = Batch(compiled.scene, num_envs, compiled.device)
    data = batch.data
    randomizer = ResetRandomizer.of_batch(batch, compiled, seed=seed)
    made = kept = deep = broken = 0
    worst, different = 0.0, set()
    choices = SCENES[scene]
    members = [[m for name in names for m in model.config.variants.get(name, (name,))] for names in choices]
    judges = [Judge(model.mjm, [b for name in names for b in model.subtree(name)]) for names in members]
    moved = [Judge(model.sim.mjm, [b for name in names for b in model.sim.subtree(name)]) for names in choices]
    turn = 0
    while made < number:
        if turn % 4 == 0:
            randomizer.reset()
        data.qvel.assign((data.qvel.numpy() + random.normal(0.0, 0.5, data.qvel.shape)).astype(np.float32))
        noise = random.normal(0.0, 0.3, data.ctrl.shape)
        data.ctrl.assign((data.ctrl.numpy() + noise).astype(np.float32))
        for _ in range(int(random.integers(1, 40))):
            mjw.step(batch.model, data)
        names, judge = choices[turn % len(choices)], judges[turn % len(choices)]
        before = {name: getattr(data, name).numpy().copy() for name in ResetRandomizer.STATE_FIELDS}
        mask = random.random(num_envs) < 0.5
        randomizer.redraw(names, mask)
        after = {name: getattr(data, name).numpy().copy() for name in ResetRandomizer.STATE_FIELDS}
        status = randomizer.redraw_status.cpu().numpy()
        placed = mask & (status == LayoutStatus.VALID)
        different |= set(moved[turn % len(choices)].differences(before, after, placed))
        if model.config.variants:
            after = with_variants(compiled, after, randomizer.variants.cpu().numpy())
        for world in np.flatnonzero(placed):
            depth = judge.deepest(after, int(world))
            worst, deep = max(worst, depth), deep + (depth > DEEP)
        broken += int((~np.isfinite(before["qpos"]).all(axis=1)).sum())
        made, kept, turn = made + int(placed.sum()), kept + int((mask & (status == LayoutStatus.KEPT)).sum()), turn + 1
    return {
        "scene": scene,
        "placed": made,
        "kept": kept,
        "worlds not finite": broken,
        "deeper than 0.1 mm": int(deep),
        "deepest [mm]": round(1e3 * worst, 5),
        "differ elsewhere": sorted(different),
    }


def main() -> int:
    """Try all scenes, print a line of JSON for each, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--redraws", type=int, default=20_000)
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--device", default=None)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    args = parser.parse_args()
    bad = False
    for scene in args.scenes:
        found = try_scene(scene, -(-args.redraws // len(args.scenes)), args.num_envs, args.device, args.seed)
        print(json.dumps(found), flush=True)
        bad |= bool(found["deeper than 0.1 mm"] or found["differ elsewhere"])
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
