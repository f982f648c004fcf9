"""Train a task with rsl-rl's PPO, and evaluate the policy on layouts that it has not seen.

    python -m sceniris_gym.training.train TabletopReach-v0 --minutes 5 --out results/reach_0

writes to the folder `out`: `log.jsonl` (a line every few iterations, and one for every evaluation), `model.pt` (a
checkpoint every 20 seconds and after every evaluation) and `config.json`, with a hash of the sources. The clock starts
when everything is compiled; it stops during evaluations, which judging.py describes: 4,096 layouts of the
split "eval", on `valid` ones and on `unfiltered` ones, placed uniformly without checks. `judged.json` has the last one,
layout by layout.

`--resume` continues from the checkpoint: the log is cut off there, and unfinished episodes are dropped; every world
starts its next episode with the same number of elapsed steps. Runs that resume from the same checkpoint see the same
data, but not the data that an uninterrupted run would have seen.
"""

from __future__ import annotations

import json
import math
import os
import time
from ast import literal_eval
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import torch
import tyro
import warp as wp
from rsl_rl.runners import OnPolicyRunner

from sceniris_gym.adapters.rsl_rl import RslRlVecEnv
from sceniris_gym.files import replacing
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.training import layout_sources
from sceniris_gym.training.judging import judge, judges_of
from sceniris_gym.training.sources import source_hash
from sceniris_gym.training.task_scenes import SEED_SPACING, make_env, scene_of

FREE = ("out", "resume", "device", "minutes", "million_steps", "layouts", "every", "evaluate_every", "save_every")
"""Options that may differ when a run is resumed: they do not change what is learned in an iteration."""


@dataclass(frozen=True)
class Settings:
    """Settings of a task, fixed before any run.

    Attributes:
        hidden: widths of the layers of actor and critic
        gamma: discount of a control step
        entropy: weight of the entropy bonus at the start
        last_entropy: what it falls to with the steps, evenly; None is no change
        cooling: millions of control steps in which it falls
        init_std: standard deviation of the actions at the start
        steps: control steps of each world between two updates
        epochs: passes over them
        mini_batches: parts of a pass
        desired_kl: KL divergence to which the learning rate is adapted
    """

    hidden: tuple[int, ...] = (256, 128, 64)
    gamma: float = 0.98
    entropy: float = 0.002
    last_entropy: float | None = None
    cooling: float = 40.0
    init_std: float = 1.0
    steps: int = 24
    epochs: int = 5
    mini_batches: int = 4
    desired_kl: float = 0.01

    def entropy_after(self, env_steps: int) -> float:
        """Return the weight of the entropy bonus after so many control steps of all worlds together."""
        last = self.entropy if self.last_entropy is None else self.last_entropy
        return self.entropy + (last - self.entropy) * min(1.0, env_steps / (1e6 * self.cooling))


SETTINGS = {
    "TabletopReach-v0": Settings(),
    "TabletopReachEasy-v0": Settings(),
    "TabletopLift-v0": Settings(gamma=0.985, entropy=0.003, steps=32),
    "TabletopLiftEasy-v0": Settings(gamma=0.985, entropy=0.003, steps=32),
    "ClutterPush-v0": Settings(gamma=0.985, entropy=0.003, steps=32),
    "DrawerPick-v0": Settings(gamma=0.985, entropy=0.005, steps=32),
    "ClutterExtract-v0": Settings(
        hidden=(512, 256, 128), gamma=0.985, entropy=0.003, last_entropy=0.0005, init_std=0.6, steps=32
    ),
}


@dataclass(frozen=True)
class Options:
    """A run.

    Attributes:
        task: an id of this package without its namespace
        seed: number of the run; the layout seeds of two runs start at least 16 * 2^20 apart
        num_envs: worlds
        minutes: wall-clock time of training, without evaluations
        million_steps: stop after this many control steps of all worlds together, too; None is no limit
        out: folder for the results
        resume: continue from the checkpoint in `out`
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
        bank: replay this many stored layouts instead of making fresh ones
        uniform: place uniformly, without checks for collisions or reach
        reachable: false removes `reachable` from the scene's objects
        changes: settings to try instead of the task's, as name=value
        layouts: how many layouts a policy is judged on
        every: iterations between two lines of the log
        evaluate_every: seconds of training between two evaluations
        save_every: seconds of training between two checkpoints
    """

    task: Annotated[str, tyro.conf.Positional]
    seed: int = 0
    num_envs: int = 4096
    minutes: float = 5.0
    million_steps: float | None = None
    out: Path = Path("results/train")
    resume: bool = False
    device: str | None = None
    bank: int | None = None
    uniform: bool = False
    reachable: bool = True
    changes: tuple[str, ...] = ()
    layouts: int = 4096
    every: int = 10
    evaluate_every: float = 60.0
    save_every: float = 20.0


def settings_of(task: str, changes: Sequence[str] = ()) -> Settings:
    """Return the settings of a task, with `changes` as name=value.

    Raises:
        SystemExit: there are none for it, or no setting has that name
    """
    if task not in SETTINGS:
        raise SystemExit(f"There are no settings to train '{task}' with, only for {', '.join(SETTINGS)}.")
    changed: dict[str, Any] = {}
    names = [field.name for field in fields(Settings)]
    for change in changes:
        name, _, value = change.partition("=")
        if name not in names or not value:
            raise SystemExit(f"--changes takes name=value with a name out of {', '.join(names)}, got '{change}'.")
        changed[name] = literal_eval(value)
    return replace(SETTINGS[task], **changed)


def as_json(value: Any, indent: int | None = None) -> str:
    """Return strict JSON, in which numbers that are not finite are null and paths are text."""
    return json.dumps(_plain(value), allow_nan=False, indent=indent)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def runner_config(settings: Settings, seed: int) -> dict[str, Any]:
    """Return rsl-rl's configuration."""
    model = {
        "class_name": "MLPModel",
        "hidden_dims": list(settings.hidden),
        "activation": "elu",
        "obs_normalization": True,
    }
    noise = {"class_name": "GaussianDistribution", "init_std": settings.init_std, "std_range": (0.02, 2.0)}
    return {
        "seed": seed,
        "num_steps_per_env": settings.steps,
        "save_interval": 1_000_000_000,  # we write our own checkpoints
        "check_for_nan": False,  # would wait for the device at every step; non-finite worlds end by themselves
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**model, "distribution_cfg": noise},
        "critic": dict(model),
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": settings.epochs,
            "num_mini_batches": settings.mini_batches,
            "gamma": settings.gamma,
            "lam": 0.95,
            "entropy_coef": settings.entropy,
            "learning_rate": 1e-3,
            "schedule": "adaptive",
            "desired_kl": settings.desired_kl,
            "clip_param": 0.2,
            "value_loss_coef": 1.0,
            # values of several units would take hundreds of updates in clipped steps of 0.2
            "use_clipped_value_loss": False,
        },
    }


def runner_of(env: RslRlVecEnv, settings: Settings, seed: int) -> OnPolicyRunner:
    """Return rsl-rl's runner, with a policy that nothing has trained yet."""
    torch.manual_seed(seed)
    return OnPolicyRunner(env, runner_config(settings, seed), log_dir=None, device=str(env.device))


class Run:
    """A training run that can be stopped and resumed.

    Raises:
        SystemExit: the task has no settings here, the bank is none, or the checkpoint to resume from is of a run with
            other options
    """

    def __init__(self, options: Options) -> None:
        self.options, self.settings = options, settings_of(options.task, options.changes)
        if options.bank is not None and (options.bank < 1 or options.uniform):
            raise SystemExit(f"--bank takes 1 or more layouts, and no --uniform beside it, got {options.bank}.")
        if self.resumes:
            self._check_same()
        # evaluation layouts do not depend on the training layouts
        checked = options.reachable and not options.uniform
        compiled = compile_scene(scene_of(options.task, reachable=checked), options.device)
        seed = (1 + options.seed) * 16 * SEED_SPACING
        generator = None
        if options.bank:
            generator = layout_sources.bank(layout_sources.valid_rows(compiled, options.bank, seed))
        elif options.uniform:
            generator = layout_sources.uniform()
        self.env = RslRlVecEnv(make_env(options.task, options.num_envs, compiled, layout_source=generator), seed)
        self.judges = judges_of(options.task, options.layouts, options.device)
        self._warm_up()
        self.runner = runner_of(self.env, self.settings, options.seed)
        self.seconds = self.judged_at = self.saved_at = 0.0
        self.iterations = 0

    @property
    def checkpoint(self) -> Path:
        """The file from which a run resumes."""
        return self.options.out / "model.pt"

    @property
    def log(self) -> Path:
        """The log file of training and evaluations."""
        return self.options.out / "log.jsonl"

    @property
    def resumes(self) -> bool:
        """Whether to resume: it was asked for, and there is a checkpoint."""
        return self.options.resume and self.checkpoint.exists()

    @property
    def env_steps(self) -> int:
        """Control steps so far, of all worlds together."""
        return self.iterations * self.settings.steps * self.options.num_envs

    @property
    def finished(self) -> bool:
        """Whether the time is up, or all steps are taken."""
        options = self.options
        most = math.inf if options.million_steps is None else 1e6 * options.million_steps
        return self.seconds >= 60.0 * options.minutes or self.env_steps >= most

    def go(self) -> None:
        """Train until finished, with evaluations on the way and at the end."""
        options = self.options
        options.out.mkdir(parents=True, exist_ok=True)
        if self.resumes:
            self._load()
        else:
            self.checkpoint.unlink(missing_ok=True)  # of an earlier run
            self.log.write_text("")
        with replacing(options.out / "config.json") as file:
            file.write_text(as_json(self._config(), indent=1))
        while not self.finished:
            self._train(options.every)
            judged = self.finished or self.seconds - self.judged_at >= options.evaluate_every
            if judged:
                self.judged_at = self.seconds
                self._judge()
            if judged or self.seconds - self.saved_at >= options.save_every:
                self._save()

    def _config(self) -> dict[str, Any]:
        return {"options": asdict(self.options), "settings": asdict(self.settings), "sources": {"hash": source_hash()}}

    def _check_same(self) -> None:
        """Compare with the run that made the checkpoint."""
        file = self.options.out / "config.json"
        told, wanted = json.loads(file.read_text()), json.loads(as_json(self._config()))
        for part, values in wanted.items():
            for name, value in values.items():
                before = told.get(part, {}).get(name)
                if name not in FREE and before != value:
                    raise SystemExit(
                        f"{file}: the run to go on from has {part}.{name} = {before!r}, not {value!r}. Give it the "
                        "same options, another --out, or leave out --resume to begin anew."
                    )

    def _warm_up(self) -> None:
        """Compile and allocate everything that training needs, with a different policy from the one that is trained."""
        for env in self.judges.values():
            env.step(torch.zeros(env.num_envs, env.num_actions, device=env.device))
        runner_of(self.env, self.settings, self.options.seed).learn(1, init_at_random_ep_len=True)

    def _train(self, iterations: int) -> None:
        self.runner.alg.entropy_coef = self.settings.entropy_after(self.env_steps)
        start = self._clock()
        self.runner.learn(iterations)
        seconds = self._clock() - start
        self.seconds += seconds
        self.iterations += iterations
        steps = iterations * self.settings.steps * self.options.num_envs
        valid = float(self.env.log["Reset/valid_share"])
        std = float(self.runner.alg.get_policy().output_std.detach().mean())
        told = {"steps_per_second": round(steps / seconds), "valid_share": valid, "action_std": std}
        causes = {key.removeprefix("Reset/reject_"): value for key, value in self.env.log.items() if "reject_" in key}
        told["rejected"] = {cause: round(share, 4) for cause, value in causes.items() if (share := float(value)) > 0}
        self._tell("train", self.env.unwrapped.statistics.read() | told)

    def _judge(self) -> None:
        """Judge the policy; the verdict on each layout is in `judged.json`, of the last time only."""
        policy, options = self.runner.get_inference_policy(str(self.env.device)), self.options
        found = {name: judge(policy, env, options.task, options.layouts) for name, env in self.judges.items()}
        with replacing(options.out / "judged.json") as temporary:
            temporary.write_text(as_json({"env_steps": self.env_steps, "seconds": self.seconds, **found}))
        self._tell("eval", {name: {k: v for k, v in one.items() if k != "each"} for name, one in found.items()})

    def _save(self) -> None:
        self.saved_at = self.seconds
        state, layouts = self.env.unwrapped.state, self.env.unwrapped.randomizer.layouts
        progress = {
            "seconds": self.seconds,
            "iterations": self.iterations,
            "judged_at": self.judged_at,
            "log_size": self.log.stat().st_size,
            "episode": wp.to_torch(layouts.episode).cpu(),
            "elapsed": state.elapsed.cpu(),
        }
        with replacing(self.checkpoint) as temporary:
            self.runner.save(str(temporary), progress)

    def _load(self) -> None:
        """Restore the checkpoint: networks, clock, log and the episodes of all worlds."""
        progress = self.runner.load(str(self.checkpoint), map_location=str(self.env.device))
        self.seconds, self.iterations = progress["seconds"], progress["iterations"]
        self.judged_at, self.saved_at = progress["judged_at"], progress["seconds"]
        os.truncate(self.log, progress["log_size"])
        episode = wp.to_torch(self.env.unwrapped.randomizer.layouts.episode)
        episode.copy_(progress["episode"])
        self.env.reset()  # starts the next episodes
        self.env.episode_length_buf = progress["elapsed"].to(self.env.device)
        # different action noise than at the start of the run
        torch.manual_seed(self.options.seed * SEED_SPACING + self.iterations)

    def _clock(self) -> float:
        if self.env.unwrapped.device.type == "cuda":
            torch.cuda.synchronize(self.env.device)
        return time.perf_counter()

    def _tell(self, kind: str, values: dict[str, Any]) -> None:
        line = {"kind": kind, "seconds": round(self.seconds, 2), "env_steps": self.env_steps, **values}
        text = as_json(line)
        with self.log.open("a") as file:
            file.write(text + "\n")
        print(text, flush=True)


if __name__ == "__main__":
    Run(tyro.cli(Options)).go()
