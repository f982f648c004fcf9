"""The `train` command: trains a policy for a task with rsl-rl's PPO, and evaluates the policy."""

import sys
from collections.abc import Mapping
from typing import Any

from tqdm import tqdm

from sceniris_gym.training.settings import SETTINGS, Options, share
from sceniris_gym.training.train import Run


def train(options: Options, quiet: bool = False) -> dict[str, Any]:
    """Train a policy for a task, print the log to stderr, and return the last evaluation.

    Args:
        options: The options of the run.
        quiet: Do not print the log.

    Raises:
        ScenirisError: See `Run`.
    """

    def show(line: str) -> None:
        if not quiet:
            tqdm.write(line, sys.stderr)  # does not break progress bars

    run = Run(options, show)
    task = run.options.task
    told = "" if task in SETTINGS else f"{task} trains with default settings (change them by --set): {run.settings}. "
    show(f"{told}The log gets a line after {options.every} iterations (--every 1: after each) and at each evaluation.")
    judged = run.go()
    del judged["kind"]
    return {"task": task, "model": str(run.checkpoint), **judged}


def report(found: Mapping[str, Any]) -> str:
    """Return the result of a training as a line of text."""
    shares = f"{share(found['valid'])} of valid layouts, {share(found['unfiltered'])} of unfiltered ones"
    after = f"after {found['seconds']:.0f} s, {found['env_steps'] / 1e6:.3g} million steps"
    return f"{found['task']}: {shares}, {after}; the policy is in {found['model']}"
