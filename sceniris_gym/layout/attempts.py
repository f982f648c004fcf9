"""`attempts: auto`: find by trial how many candidates an object gets before its layout restarts."""

from dataclasses import replace

import numpy as np

from sceniris_gym.config.bounds import MOST_ATTEMPTS
from sceniris_gym.errors import FallbackWarning
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import FEWEST_ATTEMPTS, CompiledScene
from sceniris_gym.program.device import Cause, Program, copied
from sceniris_gym.program.notices import warn

# Worlds of the probe, worlds per batch, and the most worlds that may restart (less than 1%).
_NWORLD = 1024
_CHUNK = 128
_MOST_RESTARTS = 10


def find_attempts(compiled: CompiledScene) -> int:
    """Try 10, 20, 40, ... attempts, and return the first number that lets less than 1% of the worlds restart.

    The number depends only on the scene, because seeds and streams are fixed. Worlds with an empty region are not
    counted, because more attempts would not help them. Stages after placing are not run. A layout that succeeds with
    fewer attempts stays the same with more attempts, so each step retries only the failed worlds. A step stops early
    once too many worlds have failed. If every world fails even with the maximum number of attempts, the minimum is
    returned, so that compilation rejects the scene sooner. If only some worlds restart with the maximum, a
    FallbackWarning is given and the maximum is returned.

    Args:
        compiled: A scene with an empty bank.
    """
    trial = replace(compiled, program=copied(Program, compiled.program))
    trial.program.restarts = 0
    attempts = trial.program.attempts = FEWEST_ATTEMPTS
    pending, enough = _still_failing(trial, np.arange(_NWORLD, dtype=np.uint64))
    if len(pending) == _NWORLD and not enough:  # try the most attempts first
        trial.program.attempts = MOST_ATTEMPTS
        failing, is_rare = _still_failing(trial, pending)
        if len(failing) == _NWORLD and not is_rare:
            return FEWEST_ATTEMPTS
    while not enough and attempts < MOST_ATTEMPTS:
        attempts = trial.program.attempts = min(2 * attempts, MOST_ATTEMPTS)
        pending, enough = _still_failing(trial, pending)
    if not enough:
        text = (
            f"{compiled.config.where}: attempts: auto stopped at {attempts}, where more than 1% of the worlds still "
            "restart. Give the objects larger regions or fewer neighbours ('sceniris-gym check' shows which), or write "
            "a smaller number: if an object has no room left, further attempts only take time."
        )
        warn(FallbackWarning(text))
    return attempts


def _still_failing(trial: CompiledScene, seeds: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the seeds of worlds that still fail, and whether few enough worlds would restart.

    If too many worlds would restart, the remaining worlds are not tried, and the result includes their seeds.
    """
    left: list[np.ndarray] = []
    restarts = 0
    for start in range(0, len(seeds), _CHUNK):
        chunk = seeds[start : start + _CHUNK]
        generator = LayoutGenerator(trial, len(chunk), seed=chunk, split="train_bank")
        generator.launch_placing(None)
        failed = chunk[generator.layouts.view.status.numpy() != LayoutStatus.VALID]
        left.append(failed)
        restarts += len(failed) - _ended_at_once(generator)
        if restarts > _MOST_RESTARTS:
            return np.concatenate([*left, seeds[start + _CHUNK :]]), False
    return np.concatenate(left), True


def _ended_at_once(generator: LayoutGenerator) -> int:
    """Return the number of worlds with an empty region. Further attempts would not help these worlds."""
    retries = generator.compiled.program.obj_retry_if_empty.numpy() != 0
    counts = generator.layouts.view.rejections.numpy()[: len(retries), [Cause.EMPTY, Cause.REGION]]
    return int(counts[~retries].sum())
