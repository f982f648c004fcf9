"""Success on things that training never saw, after training on one thing and on eight.

    python -m benchmarks.lift_any --things 1 --seed 0 --out results/lift_any/1_0 --device cuda:0

Trains TabletopLiftAny-v0 with all its things for training, or with one of them, for the same number of control steps.
Judges the policy on the eight things that are held out, the same layouts for all runs, and on layouts of the split
`train`, with the things that it was trained on. A run that was stopped goes on when started again. Prints a line of
JSON, which it also leaves in `lift_any.json` in its folder: for both kinds the share of successes, its 95% interval,
and the share of each thing.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import gymnasium
import tyro

from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.files import replacing
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.registration import ENTRY_POINTS
from sceniris_gym.training.judging import EVAL_SEED, judge
from sceniris_gym.training.settings import Options as Training
from sceniris_gym.training.settings import settings_of
from sceniris_gym.training.task_scenes import make_env
from sceniris_gym.training.train import Run

TASK = "TabletopLiftAny-v0"
ALONE = ("can", "brick", "lemon")
"""The thing of a run with one thing, by the remainder of its seed."""


@dataclass(frozen=True)
class Options:
    """Options of a run.

    Attributes:
        things: number of things that the policy is trained on
        seed: number of the run, which also chooses the one thing
        out: folder of the run
        million_steps: control steps of all worlds together
        num_envs: number of worlds
        layouts: layouts that the policy is judged on, of each kind
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    things: Literal[1, 8] = 8
    seed: int = 0
    out: Path = Path("results/lift_any")
    million_steps: float = 20.0
    num_envs: int = 4096
    layouts: int = 4096
    device: str | None = None


def alone(thing: str) -> dict[str, Any]:
    """Return overrides of the task's scene that leave one of the things for training, and those for `eval`."""
    splits = SceneConfig.load("tabletop_lift_any").groups["target"].splits
    others = [name for name, split in splits.items() if split == "train" and name != f"target/{thing}"]
    return {f"objects.target.variants.{name.partition('/')[2]}.weight": 0 for name in others}


def task_of(things: int, seed: int) -> str:
    """Return the id of the task of a run, as MODULE:ID if it is registered here."""
    return TASK if things == 8 else f"benchmarks.lift_any:LiftOne{seed % len(ALONE)}-v0"


def by_thing(env: RslRlVecEnvWrapper, found: dict[str, Any], group: str) -> dict[str, Any]:
    """Return what judging found, with the successes of each variant of a group instead of those of each layout."""
    env.reset(seed=EVAL_SEED)  # the layouts that it was judged on
    randomizer, config = env.unwrapped.randomizer, env.unwrapped.compiled.config
    names = config.variants[group]
    valid = (env.unwrapped.state.layout_status == LayoutStatus.VALID).cpu().numpy()
    drawn = randomizer.variants.cpu().numpy()[valid, list(config.variants).index(group)][: found["layouts"]]
    verdicts: dict[str, list[int]] = {}
    for thing, success in zip(drawn, found["each"]["success"], strict=True):
        verdicts.setdefault(names[thing].partition("/")[2], []).append(success)
    shares = {name: round(sum(each) / len(each), 4) for name, each in sorted(verdicts.items())}
    return {name: found[name] for name in ("layouts", "success", "interval")} | {"things": shares}


def train(task: str, options: Options, group: str, changes: tuple[str, ...], minutes: float = 600.0) -> dict[str, Any]:
    """Train a task further, for some minutes at most, and judge it on variants of a group that it knows or not."""
    run = Run(
        Training(
            task,
            seed=options.seed,
            num_envs=options.num_envs,
            minutes=minutes,
            million_steps=options.million_steps,
            out=options.out,
            resume=True,
            device=options.device,
            changes=changes,
            layouts=options.layouts,
            evaluate_every=1e9,
        ),
        lambda line: print(line, flush=True),
    )
    run.go()
    policy = run.runner.get_inference_policy(str(run.env.device))
    held_out = run.judges["valid"]
    seen = RslRlVecEnvWrapper(make_env(task, held_out.num_envs, run.env.unwrapped.compiled))
    kinds = {"held_out": held_out, "trained": seen}
    found = {kind: by_thing(env, judge(policy, env, task, options.layouts), group) for kind, env in kinds.items()}
    return {"seed": options.seed, "env_steps": run.env_steps, "seconds": run.seconds, **found}


def main(options: Options) -> None:
    """Train, judge and print."""
    settings = settings_of(TASK)
    changes = tuple(f"{name}={getattr(settings, name)}" for name in ("gamma", "entropy", "steps"))
    found = train(task_of(options.things, options.seed), options, "target", changes)
    tell({"things": options.things, **found}, options.out / "lift_any.json")


def tell(line: dict[str, Any], path: Path) -> None:
    """Print a line of JSON, and write it to a file."""
    with replacing(path) as file:
        file.write_text(json.dumps(line))
    print(json.dumps(line), flush=True)


for number, thing in enumerate(ALONE):
    known = gymnasium.spec(f"sceniris_gym/{TASK}")
    kwargs = {**known.kwargs, "scene": "tabletop_lift_any", "overrides": alone(thing)}
    words = {"max_episode_steps": known.max_episode_steps, "kwargs": kwargs}
    if f"LiftOne{number}-v0" not in gymnasium.registry:
        gymnasium.register(id=f"LiftOne{number}-v0", **ENTRY_POINTS, **words)

if __name__ == "__main__":
    main(tyro.cli(Options))
