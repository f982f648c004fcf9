"""Outcome of a case: refused in our words, a sound layout, or one of those that must never be."""

from __future__ import annotations

import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ScenirisError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from tests.fuzz.calls import wrong_call, wrong_file
from tests.fuzz.scenes import write_assets, wrong_model, wrong_scene
from tests.fuzz.uses import wrong_use

SLOW = 20.0
"""Seconds after which a case counts as a hang."""
BAD = ("traceback", "hang", "nonsense")
_FAR = 200.0  # m: the floor's half and all that can be added to it


@dataclass
class Findings:
    """Counts of the outcomes of cases, and descriptions of those that should not have been."""

    counts: Counter[str] = field(default_factory=Counter)
    bad: list[str] = field(default_factory=list)


def fuzz(
    first: int, number: int, folder: Path, tell: Callable[[int], object] = lambda _: None, *, uses: bool = False
) -> Findings:
    """Run cases `first` to `first + number - 1`, each a function of its number alone; those of `uses` are others."""
    write_assets(folder)
    found = Findings()
    for case in range(first, first + number):
        draws = np.random.default_rng(case)
        start = time.monotonic()
        what, why = _ended(draws, folder, uses)
        if time.monotonic() - start > SLOW:
            what, why = "hang", f"{time.monotonic() - start:.0f} s ({what})"
        found.counts[what] += 1
        if what in BAD:
            found.bad.append(f"case {case}: {what}: {why}")
        tell(1)
    return found


def _ended(draws: np.random.Generator, folder: Path, uses: bool) -> tuple[str, str]:
    kind = draws.random()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if uses:
                wrong = wrong_use(draws, folder)
                if wrong is not None:
                    return "nonsense", wrong
            elif kind < 0.25:
                wrong_call(draws)
            elif kind < 0.45:
                wrong_file(draws, folder)
            else:
                scene = (wrong_model if kind < 0.55 else wrong_scene)(draws, folder)
                wrong = _nonsense(scene)
                if wrong is not None:
                    return "nonsense", wrong
    except ScenirisError as error:
        return ("refused", "") if len(str(error)) > 10 else ("traceback", "an error without a sentence")
    except Exception as error:
        at = traceback.extract_tb(error.__traceback__)[-1]
        return "traceback", f"{type(error).__name__}: {str(error)[:200]} ({Path(at.filename).name}:{at.lineno})"
    return "accepted", ""


def _nonsense(scene: dict[str, Any]) -> str | None:
    """Return an impossibility in the layouts of a scene, by MuJoCo's own kinematics; None if there is none."""
    compiled = compile_scene(SceneConfig.load(scene), "cpu")
    generator = LayoutGenerator(compiled, 4)
    generator.generate()
    mjm, layouts = compiled.mjm, generator.layouts
    if (layouts.status.cpu().numpy() == 0).any():
        return "a world without a layout"
    data = mujoco.MjData(mjm)
    for qpos, pos, quat in zip(
        *(a.cpu().numpy() for a in (layouts.qpos, layouts.mocap_pos, layouts.mocap_quat)), strict=True
    ):
        data.qpos[:] = qpos
        if mjm.nmocap:
            data.mocap_pos[:], data.mocap_quat[:] = pos, quat
        exact = data.qpos.copy()
        mujoco.mj_normalizeQuat(mjm, exact)
        if not np.isfinite(qpos).all() or np.abs(exact - qpos).max(initial=0.0) > 1e-3:
            return f"qpos {qpos}"
        if mjm.nmocap and np.abs(np.linalg.norm(quat, axis=1) - 1.0).max() > 1e-3:
            return f"mocap_quat {quat}"
        mujoco.mj_kinematics(mjm, data)
        placed = [data.xpos[compiled.scene.bodies[n]] for n, o in compiled.config.objects.items() if o.is_placed]
        if placed and not (np.abs(placed) < _FAR).all():
            return f"places {placed}"
    if not 0.0 < mjm.opt.timestep <= 1.0 or np.isnan(mjm.geom_friction).any():
        return "a model that cannot be stepped"
    return None
