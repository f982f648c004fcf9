"""Training of a policy for a task with rsl-rl's PPO, with evaluations on unseen layouts.

A run writes to its folder: `log.jsonl` (a line every few iterations and for every evaluation), `model.pt` (a checkpoint
every 20 seconds and after every evaluation), `judged.json` (the last evaluation, layout by layout) and `config.json`,
with a hash of the sources. Training time does not include compilation and evaluations. For evaluations, see
judging.py.

A resumed run continues from the checkpoint. The log is cut off at the checkpoint, and unfinished episodes are dropped.
Every world starts a new episode, but counts its steps from the step count of the dropped episode on. Runs that resume
from the same checkpoint see the same data, but not the data of an uninterrupted run.
"""

import json
import math
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch

from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper
from sceniris_gym.errors import ArgumentError
from sceniris_gym.files import as_json, read_bytes, replacing, write_text
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.levels.curriculum import LevelReplay
from sceniris_gym.progress import tell
from sceniris_gym.scene.build import build_model
from sceniris_gym.training import layout_sources, settings
from sceniris_gym.training.judging import judge, judges_of
from sceniris_gym.training.runner import load_checkpoint, runner_of
from sceniris_gym.training.task_scenes import NAMESPACE, SEED_SPACING, hashes_of, make_env, scene_of

FREE = ("out", "resume", "trust", "device", "minutes", "million_steps", "layouts")
FREE += ("every", "evaluate_every", "save_every")
"""Options that may differ when a run is resumed, because they have no effect on a training iteration."""


class Run:
    """A training run that can be stopped and resumed.

    Args:
        options: The options of the run.
        show: Function that is called with every line of the log.

    Attributes:
        checkpoint: The file of the latest checkpoint.
        log: The log of training and evaluations.

    Raises:
        ArgumentError: The options or the changed settings are wrong, or the checkpoint belongs to a run with other
            options.
        ScenirisError: The task is unknown, or its scene cannot be compiled.
    """

    def __init__(self, options: settings.Options, show: Callable[[str], object] = lambda line: None) -> None:
        options.check()
        self.options = options = replace(options, task=options.task.removeprefix(NAMESPACE))
        self.checkpoint, self.log = options.out / settings.MODEL, options.out / settings.LOG
        self.settings, self.show = settings.settings_of(options.task, options.changes), show
        if self.resumes:
            self._check_same()
        # Only training layouts: evaluation layouts do not depend on these options.
        checked = options.reachable and not options.uniform
        self._compiled = compiled = compile_scene(scene_of(options.task, reachable=checked), options.device)
        seed = (1 + options.seed) * 16 * SEED_SPACING
        words = {}
        if options.bank:
            rows = layout_sources.valid_rows(compiled, options.bank, seed)
            words = layout_sources.words_of(layout_sources.bank(rows))
        elif options.uniform:
            words = layout_sources.words_of_uniform(options.task, compiled.scene)
        if options.curriculum:
            words["curriculum"] = LevelReplay(options.curriculum)
        self.env = RslRlVecEnvWrapper(make_env(options.task, options.num_envs, compiled, **words), seed)
        self._judged = (options.judged or options.task).removeprefix(NAMESPACE)
        self.judges = judges_of(self._judged, options.layouts, options.device)
        self._warm_up()
        self.runner = runner_of(self.env, self.settings, options.seed)
        self.seconds = self.judged_at = self.saved_at = 0.0
        self.iterations = 0

    @property
    def resumes(self) -> bool:
        """True if the run continues from a checkpoint: `options.resume` is set and the file exists."""
        return self.options.resume and self.checkpoint.exists()

    @property
    def env_steps(self) -> int:
        """Control steps so far, of all worlds together."""
        return self.iterations * self.settings.steps * self.options.num_envs

    @property
    def finished(self) -> bool:
        """True if `minutes` of training have passed or `million_steps` are taken."""
        options = self.options
        most = math.inf if options.million_steps is None else 1e6 * options.million_steps
        return self.seconds >= 60.0 * options.minutes or self.env_steps >= most

    def go(self) -> dict[str, Any]:
        """Train until finished, with evaluations in between and at the end. Return the last evaluation."""
        options = self.options
        options.out.mkdir(parents=True, exist_ok=True)
        if self.resumes:
            self._load()
        else:
            self.checkpoint.unlink(missing_ok=True)  # of an earlier run
            write_text(self.log, "")
            self._teach()
        write_text(options.out / settings.CONFIG, as_json(self._config(), indent=1))
        while not self.finished:
            self._train(options.every)
            judged = self.finished or self.seconds - self.judged_at >= options.evaluate_every
            if judged:
                self._judge()
            if judged or self.seconds - self.saved_at >= options.save_every:
                self._save()
        if not settings.evaluations(options.out):  # the checkpoint was already beyond the end of this run
            self._judge()
        return settings.evaluations(options.out)[-1]

    def _config(self) -> dict[str, Any]:
        task, parts = self.options.task, {"options": asdict(self.options), "settings": asdict(self.settings)}
        hashes = {"sources": settings.source_hash()} | hashes_of(task, build_model(scene_of(task, reachable=True)))
        return parts | {part: {"hash": value} for part, value in hashes.items()}

    def _check_same(self) -> None:
        """Check that the run to resume had the same options (except FREE), settings and hashes."""
        file = self.options.out / settings.CONFIG
        told, wanted = settings.read_parts(self.options.out), json.loads(as_json(self._config()))
        for part, values in wanted.items():
            for name, value in values.items():
                before = told.get(part, {}).get(name)
                if name not in FREE and before != value:
                    raise ArgumentError(
                        f"{file}: the run to resume has {part}.{name} = {before!r}, not {value!r}. Give the same "
                        "options, another --out, or leave out --resume to start again."
                    )

    def _warm_up(self) -> None:
        """Compile and allocate everything for training, by training a policy that is then discarded."""
        for i, env in enumerate(self.judges.values()):
            tell("first steps", i, 1 + len(self.judges))
            env.step(torch.zeros(env.num_envs, env.num_actions, device=env.device))
        tell("first steps", len(self.judges), 1 + len(self.judges))
        runner = runner_of(self.env, self.settings, self.options.seed)
        # Imitation requires a loaded teacher. The untrained teacher is good enough here.
        runner.alg.teacher_loaded = True  # pyrefly: ignore[missing-attribute]
        runner.learn(1, init_at_random_ep_len=True)

    def _teach(self) -> None:
        """Train the teacher, if there is one. The time counts towards `minutes`, but the steps do not count."""
        if not hasattr(self.runner.alg, "teacher"):
            return
        options, seed = self.options, (1 + self.options.seed) * 16 * SEED_SPACING
        seeing = {"images": {}, "observation_groups": ("critic",)}
        env = RslRlVecEnvWrapper(make_env(options.task, options.num_envs, self._compiled, **seeing), seed)
        runner_of(env, self.settings, options.seed).learn(1, init_at_random_ep_len=True)  # compiles everything
        teacher = runner_of(env, self.settings, options.seed)
        while self.seconds < 60.0 * min(self.settings.teacher, options.minutes):
            start = self._clock()
            teacher.learn(1)
            self.seconds += self._clock() - start
        self._tell("teacher", env.unwrapped.statistics.read())
        with replacing(options.out / settings.TEACHER) as file:
            teacher.save(str(file))
            load_checkpoint(self.runner, file, str(env.device))
        env.close()

    def _train(self, iterations: int) -> None:
        self.runner.alg.entropy_coef = self.settings.entropy_after(self.env_steps)
        steps, before, start, whole = self.env_steps, self.seconds, self._clock(), int(60.0 * self.options.minutes)
        for _ in range(iterations):
            tell("seconds of training", int(self.seconds), max(whole, int(self.seconds)))
            self.runner.learn(1)
            self.seconds = before + self._clock() - start
            self.iterations += 1
            if self.finished:
                break
        steps, seconds = self.env_steps - steps, self.seconds - before
        valid = float(self.env.log["Reset/valid_share"])
        std = float(self.runner.alg.get_policy().output_std.detach().mean())
        causes = {key.removeprefix("Reset/reject_"): value for key, value in self.env.log.items() if "reject_" in key}
        rejected = {cause: round(share, 4) for cause, value in causes.items() if (share := float(value)) > 0}
        rates = {"steps_per_second": round(steps / seconds), "valid_share": valid, "action_std": std}
        self._tell("train", self.env.unwrapped.statistics.read() | rates | {"rejected": rejected})

    def _judge(self) -> None:
        """Evaluate the policy and log the result. `judged.json` has the result per layout of the last evaluation."""
        self.judged_at = self.seconds
        policy, options = self.runner.get_inference_policy(str(self.env.device)), self.options
        found = {name: judge(policy, env, self._judged, options.layouts) for name, env in self.judges.items()}
        judged = {"env_steps": self.env_steps, "seconds": self.seconds, **found}
        write_text(options.out / settings.JUDGED, as_json(judged))
        self._tell("eval", settings.without_layouts(found))

    def _save(self) -> None:
        self.saved_at = self.seconds
        state, layouts = self.env.unwrapped.state, self.env.unwrapped.randomizer.layouts
        progress = {
            "seconds": self.seconds,
            "iterations": self.iterations,
            "judged_at": self.judged_at,
            "log_size": self.log.stat().st_size,
            "episode": layouts.episode.cpu(),
            "elapsed": state.elapsed.cpu(),
        }
        sampler = self.env.unwrapped.randomizer.levels
        if sampler is not None:
            state_of = sampler.state().items()  # as tensors and text, because untrusted files may hold only weights
            progress["levels"] = {k: v.tolist() if v.dtype.kind == "U" else torch.from_numpy(v) for k, v in state_of}
        with replacing(self.checkpoint) as temporary:
            self.runner.save(str(temporary), progress)

    def _load(self) -> None:
        """Restore the checkpoint: networks, clock, log and the episodes of all worlds."""
        device, randomizer = self.env.device, self.env.unwrapped.randomizer
        progress = load_checkpoint(self.runner, self.checkpoint, str(device), trust=self.options.trust)
        with settings.of_a_run(self.checkpoint):
            self.seconds, self.iterations = float(progress["seconds"]), int(progress["iterations"])
            self.judged_at, self.saved_at = float(progress["judged_at"]), self.seconds
            write_text(self.log, read_bytes(self.log)[: progress["log_size"]].decode())
            if randomizer.levels is not None:
                kept = {k: v.cpu() if isinstance(v, torch.Tensor) else v for k, v in progress["levels"].items()}
                randomizer.levels.restore({name: np.asarray(values) for name, values in kept.items()})
            else:
                seed = randomizer.layouts.seed
                randomizer.reseed(layouts={"seed": seed, "episode": progress["episode"] + 1})
            self.env.reset()  # starts the next episodes
            self.env.episode_length_buf = progress["elapsed"].to(device)
        # not the same action noise as at the start of the run
        torch.manual_seed(self.options.seed * SEED_SPACING + self.iterations)

    def _clock(self) -> float:
        if self.env.unwrapped.device.type == "cuda":
            torch.cuda.synchronize(self.env.device)
        return time.perf_counter()

    def _tell(self, kind: str, values: dict[str, Any]) -> None:
        line = as_json({"kind": kind, "seconds": round(self.seconds, 2), "env_steps": self.env_steps, **values})
        with self.log.open("a") as file:
            file.write(line + "\n")
        self.show(line)
