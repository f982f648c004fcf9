"""Long runs: random masks, seeds and faults in two environments, and what of memory, rates and layouts changes.

python -m tests.stress.soak --minutes 30 [--scenes mid clutter] [--num-envs 256] [--device cpu] [--seed 0]

Every round resets random worlds of each batch, with new seeds now and then, after nan and infinity were put into the
state of some of them. A sample of the layouts is judged by MuJoCo C. The table at the end has a row
for each tenth of the run; the exit status is 1 if anything invalid was served.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

_DEEP = 1.0e-4  # m, of a contact in a fresh layout that counts
_SAMPLE = 4  # layouts of a round that MuJoCo C judges
_FAULTS = (np.nan, np.inf, -np.inf)


@dataclass
class Row:
    """Counts of one part of a run."""

    resets: int = 0
    fallbacks: int = 0
    invalid: int = 0
    not_finite: int = 0
    audited: int = 0
    deep: int = 0
    seconds: float = 0.0

    def text(self) -> str:
        """The row as a line of the table, with the memory and the descriptors of this moment."""
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        memory, files = pages * resource.getpagesize() / 2**20, len(os.listdir("/proc/self/fd"))
        numbers = (self.resets, self.resets / max(self.seconds, 1e-9), self.fallbacks, self.invalid, self.not_finite)
        return " ".join(f"{x:>12.0f}" for x in (*numbers, self.audited, self.deep)) + f" {memory:>12.2f} {files:>6}"


HEAD = " ".join(
    f"{name:>12}"
    for name in ("resets", "resets/s", "fallbacks", "invalid", "not finite", "audited", "over 0.1 mm", "RSS [MB]")
)


@dataclass
class Soak:
    """A batch of worlds of one scene that is reset at random."""

    scene: str
    num_envs: int
    device: str | None
    draws: np.random.Generator
    row: Row = field(default_factory=Row)

    def __post_init__(self) -> None:
        self.compiled = compile_scene(self.scene, self.device)
        self.batch = Batch(self.compiled.scene, self.num_envs, self.compiled.device)
        self.randomizer = ResetRandomizer(self.compiled, self.batch.model, self.batch.data)
        self.plain = mujoco.MjData(self.compiled.mjm)
        self.randomizer.reset()

    def round(self) -> None:
        """Spoil some worlds, reset those and others, and judge what came of it."""
        data, draws = self.batch.data, self.draws
        mask = draws.random(self.num_envs) < draws.choice([0.02, 0.3, 1.0])
        spoilt = mask & (draws.random(self.num_envs) < 0.2)
        for array in (data.qpos, data.qvel, data.ctrl, data.qacc_warmstart):
            values = array.numpy()
            if values.shape[1]:
                values[spoilt, int(draws.integers(values.shape[1]))] = draws.choice(_FAULTS)
                wp.copy(array, wp.array(values, dtype=array.dtype, device=array.device))
        if draws.random() < 0.2:
            seeds = draws.integers(0, 2**63, self.num_envs, dtype=np.uint64)
            self.randomizer.pipeline.reseed(mask, seed=seeds)
        self.randomizer.reset(mask)
        if draws.random() < 0.2:
            self.batch.step()
        else:
            self._judge(mask)
        self.row.resets += int(mask.sum())

    def _judge(self, mask: np.ndarray) -> None:
        status = self.randomizer.layouts.status.cpu().numpy()[mask]
        self.row.fallbacks += int((status == LayoutStatus.FALLBACK).sum())
        self.row.invalid += int((status == LayoutStatus.NONE).sum())
        state = [getattr(self.batch.data, name).numpy()[mask] for name in ("qpos", "qvel", "ctrl", "xpos")]
        self.row.not_finite += int(
            sum((~np.isfinite(part)).reshape(len(part), math.prod(part.shape[1:])).any(axis=1).sum() for part in state)
        )
        for world in np.flatnonzero(mask)[:_SAMPLE]:
            self.plain.qpos[:] = self.batch.data.qpos.numpy()[world]
            if self.compiled.mjm.nmocap:
                self.plain.mocap_pos[:] = self.batch.data.mocap_pos.numpy()[world]
                self.plain.mocap_quat[:] = self.batch.data.mocap_quat.numpy()[world]
            mujoco.mj_fwdPosition(self.compiled.mjm, self.plain)
            self.row.audited += 1
            self.row.deep += int((self.plain.contact.dist[: self.plain.ncon] < -_DEEP).any())


def main() -> None:
    """Run, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--scenes", nargs="+", default=["mid", "clutter"])
    parser.add_argument("--num-envs", type=int, default=256)
    parser.add_argument("--device")
    parser.add_argument("--seed", type=int, default=0)
    words = parser.parse_args()
    draws = np.random.default_rng(words.seed)
    soaks = [Soak(scene, words.num_envs, words.device, draws) for scene in words.scenes]
    wrong, part = 0, 60.0 * words.minutes / 10
    print(f"{'scene':<12} {HEAD} {'files':>6}", flush=True)
    for _ in range(10):
        end = time.monotonic() + part
        while time.monotonic() < end:
            for soak in soaks:
                start = time.monotonic()
                soak.round()
                soak.row.seconds += time.monotonic() - start
        for soak in soaks:
            print(f"{soak.scene:<12} {soak.row.text()}", flush=True)
            wrong += soak.row.invalid + soak.row.not_finite + soak.row.deep
            soak.row = Row()
    sys.exit(int(wrong > 0))


if __name__ == "__main__":
    main()
