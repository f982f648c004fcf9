"""`attempts: auto`: the number of candidates that an object gets before a layout starts again, found by trying."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sceniris_gym.config.bounds import MOST_ATTEMPTS
from sceniris_gym.errors import FallbackWarning
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import FEWEST_ATTEMPTS, CompiledScene
from sceniris_gym.program.device import Cause, Program, copied
from sceniris_gym.program.notices import warn

# Worlds of the probe, those that are tried at a time, and those that may restart: less than 1%.
_NWORLD = 1024
_CHUNK = 128
_MOST_RESTARTS = 10


def find_attempts(compiled: CompiledScene) -> int:
    """Return the attempts, 10 doubled as often as needed, with which less than 1% of the worlds would restart.

    They are a function of the scene alone, as seeds and streams are fixed. Worlds that end for a cause that no attempt
    cures (an empty region) do not count, and stages after placing are left out. More attempts change no layout that
    fewer suffice for, so only worlds that have failed so far are tried again, and only until too many have failed. A
    scene that no world is made of even with the most attempts gets the fewest, which refuse it sooner.

    Args:
        compiled: A scene with an empty bank.
    """
    trial = replace(compiled, program=copied(Program, compiled.program))
    trial.program.restarts = 0
    attempts, pending = FEWEST_ATTEMPTS, np.arange(_NWORLD, dtype=np.uint64)
    while True:
        trial.program.attempts = attempts
        pending, enough = _still_failing(trial, pending)
        if enough:
            return attempts
        if attempts == MOST_ATTEMPTS:
            break
        if attempts == FEWEST_ATTEMPTS and len(pending) == _NWORLD:  # what fails with the most fails with all below
            trial.program.attempts = MOST_ATTEMPTS
            failing, enough = _still_failing(trial, pending)
            if len(failing) == _NWORLD and not enough:
                return FEWEST_ATTEMPTS
        attempts = min(2 * attempts, MOST_ATTEMPTS)
    text = (
        f"{compiled.config.where}: attempts: auto stopped at {attempts}, with which more than 1% of the worlds still "
        "start again. Give the objects larger regions or fewer neighbours ('sceniris-gym check' shows which), or write "
        "a number: where an object has no room left, attempts only take time."
    )
    warn(FallbackWarning(text))
    return attempts


def _still_failing(trial: CompiledScene, seeds: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the seeds whose worlds fail or are not tried any more, and whether few enough of them would restart."""
    left: list[np.ndarray] = []
    restarts = 0
    for start in range(0, len(seeds), _CHUNK):
        chunk = seeds[start : start + _CHUNK]
        generator = LayoutGenerator(trial, len(chunk), seed=chunk, split="train_bank")
        generator.launch_placing(None)
        failed = chunk[generator.layouts.status.numpy() != LayoutStatus.VALID]
        left.append(failed)
        restarts += len(failed) - _ended_at_once(generator)
        if restarts > _MOST_RESTARTS:
            return np.concatenate([*left, seeds[start + _CHUNK :]]), False
    return np.concatenate(left), True


def _ended_at_once(generator: LayoutGenerator) -> int:
    """Return the number of worlds with nothing left of a region, which ends a layout whatever attempts there are."""
    retries = generator.compiled.program.obj_retry_if_empty.numpy() != 0
    counts = generator.layouts.rejections.numpy()[: len(retries), [Cause.EMPTY, Cause.REGION]]
    return int(counts[~retries].sum())
