"""Paths to grasps, followed by position actuators in MuJoCo C.

    python -m tests.stress.followed_paths tabletop_lift clutter_extract drawer_pick shelf cupboard --layouts 200

The targets of the arm's actuators move along the path, and slow down at its corners. They lead by the damping of the
actuators, and bear the arm's weight. The fingers are open as for `reachable: clear`. At the end, the TCP has to be
within 5 mm of where MuJoCo C has it in the grasp. Until then, no geom of the robot may touch another, except that the
hand may touch the target after the pre-grasp. A line for each scene: the share of paths that keep both.
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.reach import Reaching
from tests.layout.walked import opened, rows_of
from tests.stress.paths import scene_of

SPEED = 0.75  # rad/s or m/s, mean of the fastest joint on a piece of a path
GRASP_SPEED = 0.25  # from the pre-grasp on
NEAR = 5e-3  # m


class Follower:
    """The model of a scene in MuJoCo C, and its arm with position actuators."""

    def __init__(self, compiled: CompiledScene) -> None:
        self.compiled, self.m, self.d = compiled, compiled.mjm, mujoco.MjData(compiled.mjm)
        m = compiled.mjm
        assert compiled.reaching is not None
        self.reaching: Reaching = compiled.reaching
        robot = next(iter(compiled.config.all_robots))
        self.robot = np.isin(np.arange(m.nbody), list(compiled.scene.subtree(robot)))
        self.adr = self.reaching.arms[0].arm.qposadr
        joints = [int(np.flatnonzero(m.jnt_qposadr == adr)[0]) for adr in self.adr]
        self.dofs = m.jnt_dofadr[joints]
        self.own = [int(np.flatnonzero(m.actuator_trnid[:, 0] == joint)[0]) for joint in joints]
        self.gain, self.bias = m.actuator_gainprm[:, 0], m.actuator_biasprm[:, :3].T
        self.tcp = m.site(compiled.scene.tcps[robot]).id

    def follow(self, qpos: np.ndarray, mocap: tuple[np.ndarray, np.ndarray], corners: np.ndarray, target: str) -> str:
        """Follow a path from the state of a layout. Return "" or what went wrong."""
        m, d = self.m, self.d
        mujoco.mj_resetData(m, d)
        d.mocap_pos[:], d.mocap_quat[:] = mocap
        d.qpos[:] = qpos
        d.qpos[self.adr] = corners[-1]
        mujoco.mj_forward(m, d)
        wanted = d.site_xpos[self.tcp].copy()
        d.qpos[self.adr] = corners[0]
        mujoco.mj_forward(m, d)
        rest = (-self.bias[0] - self.bias[1] * d.actuator_length) / self.gain
        gear, targets = m.actuator_gear[self.own, 0], np.flatnonzero(np.isin(np.arange(m.nbody), self._bodies(target)))
        inertia = np.empty((m.nv, m.nv))
        for piece, (first, last) in enumerate(pairwise(corners)):
            seconds = np.abs(last - first).max() / (SPEED if piece < len(corners) - 2 else GRASP_SPEED)
            steps = int(np.ceil(seconds / m.opt.timestep)) + (200 if piece == len(corners) - 2 else 0)
            for k in range(steps if seconds > 0 else 0):
                u = min(k * m.opt.timestep / seconds, 1.0)
                at, speed = first + u * u * (3 - 2 * u) * (last - first), 6 * u * (1 - u) * (last - first) / seconds
                speeding = (6 - 12 * u) * (u < 1) * (last - first) / seconds**2
                mujoco.mj_fullM(m, d, inertia)
                force = (d.qfrc_bias - d.qfrc_gravcomp)[self.dofs] + inertia[np.ix_(self.dofs, self.dofs)] @ speeding
                force = (force + m.dof_damping[self.dofs] * speed) / gear - self.bias[2][self.own] * gear * speed
                d.ctrl[:] = rest
                held = -self.bias[0][self.own] - self.bias[1][self.own] * gear * at
                d.ctrl[self.own] = (held + force) / self.gain[self.own]
                mujoco.mj_step(m, d)
                touched = self._touched(targets if piece == len(corners) - 2 else [])
                if touched:
                    return f"piece {piece}: {touched}"
        off = np.linalg.norm(d.site_xpos[self.tcp] - wanted)
        return "" if off < NEAR else f"{1000 * off:.1f} mm off"

    def _bodies(self, target: str) -> list[int]:
        return list(self.compiled.scene.subtree(target))

    def _touched(self, targets: Any) -> str:
        for a, b in self.m.geom_bodyid[self.d.contact.geom[self.d.contact.dist < 0.0]]:
            if self.robot[a] != self.robot[b] and np.isin([a, b], targets).any():
                continue
            if self.robot[a] or self.robot[b]:
                return f"{self.m.body(a).name} touches {self.m.body(b).name}"
        return ""


def followed(name: str, layouts: int, seed: int) -> dict[str, Any]:
    """Follow all paths of some layouts of a scene, and return the counts."""
    compiled = compile_scene(scene_of(name), "cpu")
    generator = LayoutGenerator(compiled, layouts, seed=seed)
    generator.generate()
    follower, found = Follower(compiled), []
    for row in opened(compiled, rows_of(compiled, generator.layouts)):
        target = follower.reaching.targets[row.column].name
        found.append(follower.follow(row.qpos, (row.mocap_pos, row.mocap_quat), row.corners, target))
    wrong = [what for what in found if what]
    return {"scene": name, "paths": len(found), "share": 1.0 - len(wrong) / len(found), "wrong": wrong[:10]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--layouts", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("-o", "--out", type=Path)
    options = parser.parse_args()
    lines = [json.dumps(followed(name, options.layouts, options.seed)) for name in options.scenes]
    print("\n".join(lines))
    if options.out:
        options.out.write_text("\n".join(lines) + "\n")
