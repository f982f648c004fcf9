"""Physics from a layout: MuJoCo C steps one world, in real time or slower."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.audit.physics import hold
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable

_LONGEST = 0.1  # s of physics between two pictures; a slow machine falls behind rather than freezes


class Player:
    """Steps one world from its layout on.

    Args:
        compiled: The scene.
        table: The layout, one row.

    Attributes:
        data: The state.
        running: False while physics is paused.
        speed: Seconds of physics in a second.
    """

    def __init__(self, compiled: CompiledScene, table: LayoutTable) -> None:
        self.mjm, self.table = compiled.mjm, table
        self.data = mujoco.MjData(compiled.mjm)
        self._closed = _closed_fingers(compiled, table)
        self.running, self.speed = False, 1.0
        self._debt = 0.0
        self.reset()

    def reset(self) -> None:
        """Go back to the layout, with controls that hold its joints, and close fingers that are around something."""
        mujoco.mj_resetData(self.mjm, self.data)
        self.table.put(self.data, 0)
        adr, closed = self._closed
        self.data.qpos[adr] = closed
        hold(self.mjm, self.data)
        self.table.put(self.data, 0)
        mujoco.mj_forward(self.mjm, self.data)
        self._debt = 0.0

    def advance(self, seconds: float) -> bool:
        """Let so much time [s] pass; return True if that took any step."""
        if not self.running:
            return False
        self._debt = min(self._debt + seconds * self.speed, _LONGEST)
        steps = int(self._debt / self.mjm.opt.timestep)
        self._debt -= steps * self.mjm.opt.timestep
        for _ in range(steps):
            mujoco.mj_step(self.mjm, self.data)
        return steps > 0

    def step(self) -> None:
        """Take a single step of physics."""
        mujoco.mj_step(self.mjm, self.data)

    def target_ranges(self) -> list[tuple[str, float, float]]:
        """Return name, least and greatest control of each actuator; unlimited ones get their joint's range, or +-1."""
        ranges = []
        for i in range(self.mjm.nu):
            low, high = self.mjm.actuator_ctrlrange[i]
            if not self.mjm.actuator_ctrllimited[i]:
                low, high = -1.0, 1.0
                joint = int(self.mjm.actuator_trnid[i, 0])
                of_joint = self.mjm.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
                if of_joint and self.mjm.jnt_limited[joint]:
                    low, high = self.mjm.jnt_range[joint]
            ranges.append((self.mjm.actuator(i).name or f"actuator {i}", float(low), float(high)))
        return ranges


def _closed_fingers(compiled: CompiledScene, table: LayoutTable) -> tuple[np.ndarray, np.ndarray]:
    """Return addresses in qpos of the fingers that hold something in a layout, and their closed positions."""
    if compiled.config.start and compiled.reaching is not None:
        kind = compiled.config.start[table.start[0]]
        for name in kind.targets(compiled.config.groups) if kind.robot == "grasp" else ():
            target = compiled.reaching.targets[compiled.reaching.names.index(name)]
            adr, closed = compiled.reaching.arm_of(target).gripper.poses(np.zeros(1))
            return adr, closed[0]
    return np.zeros(0, int), np.zeros(0)
