"""The options of a run, and the PPO settings of each shipped task."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from pydantic import ConfigDict, Field, NonNegativeFloat, PositiveFloat, PositiveInt, TypeAdapter

from sceniris_gym.config.fields import reading
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, check_names


@dataclass(frozen=True)
class Settings:
    """Settings of PPO.

    Attributes:
        hidden: widths of the hidden layers of actor and critic
        gamma: discount of a control step
        entropy: weight of the entropy bonus at the start
        last_entropy: weight of the entropy bonus at the end of a linear decay, None for a constant weight
        cooling: length of the decay, in millions of control steps
        init_std: standard deviation of the actions at the start
        steps: control steps of each world between two updates
        epochs: passes over the collected steps per update
        mini_batches: number of mini-batches per pass
        desired_kl: target KL divergence of the adaptive learning rate
        teacher: minutes to train a teacher first, for a policy that sees images. The teacher sees the critic's
            observations and no images, and the policy imitates it. If 0, PPO trains the policy without a teacher
    """

    __pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False)

    hidden: tuple[Annotated[PositiveInt, Field(le=1 << 16)], ...] = (256, 128, 64)
    gamma: Annotated[NonNegativeFloat, Field(le=1.0)] = 0.98
    entropy: NonNegativeFloat = 0.002
    last_entropy: NonNegativeFloat | None = None
    cooling: PositiveFloat = 40.0
    init_std: PositiveFloat = 1.0
    steps: Annotated[PositiveInt, Field(le=1 << 16)] = 24
    epochs: PositiveInt = 5
    mini_batches: PositiveInt = 4
    desired_kl: PositiveFloat = 0.01
    teacher: NonNegativeFloat = 0.0

    def entropy_after(self, env_steps: int) -> float:
        """Return the weight of the entropy bonus after `env_steps` control steps of all worlds together."""
        last = self.entropy if self.last_entropy is None else self.last_entropy
        return self.entropy + (last - self.entropy) * min(1.0, env_steps / (1e6 * self.cooling))


_OBJECTS = Settings(gamma=0.985, entropy=0.003, steps=32)
SETTINGS = {
    "TabletopReach-v0": Settings(),
    "TabletopReachEasy-v0": Settings(),
    "TabletopReachPixels-v0": Settings(epochs=2, teacher=2.0),
    "TabletopLift-v0": _OBJECTS,
    "TabletopLiftEasy-v0": _OBJECTS,
    "TabletopLiftAny-v0": _OBJECTS,
    "ClutterPush-v0": _OBJECTS,
    "DrawerPick-v0": replace(_OBJECTS, entropy=0.005),
    "ClutterExtract-v0": replace(_OBJECTS, hidden=(512, 256, 128), last_entropy=0.0005, init_std=0.6),
}
"""Tuned settings by task. Every other task uses the defaults."""


def settings_of(task: str, changes: Sequence[str] = ()) -> Settings:
    """Return the settings of a task, tuned if they exist and default otherwise, with the given changes.

    A change is written KEY=VALUE, with the value in YAML.

    Raises:
        UnknownNameError: A setting is unknown.
        SceneKeyError: A change is not of the form KEY=VALUE, or its value has the wrong type or is out of range.
    """
    tuned, changed = asdict(SETTINGS.get(task, Settings())), read_changes(changes)
    check_names("setting", changed, "--set", tuned)
    return as_settings(tuned | changed, "--set")


def as_settings(values: Mapping[str, Any], where: str) -> Settings:
    """Return settings from their values by name.

    Raises:
        SceneKeyError: A value is wrong. The message begins with `where`.
    """
    with reading(where):
        return TypeAdapter(Settings).validate_python(values)


@dataclass(frozen=True)
class Options:
    """Options of a run, as the command line takes them.

    Attributes:
        task: id of a task of this package, or MODULE:ID of your task, which MODULE registers on import
        seed: number of the run. The layout seeds of two runs are at least 16 * 2^20 apart if their numbers differ
        num_envs: number of worlds
        minutes: time of training, without compilation and evaluations
        million_steps: also stop after this number of control steps of all worlds together, in millions
        out: folder for config.json, log.jsonl, model.pt and judged.json
        resume: continue from the checkpoint in the folder, if it exists
        trust: read a checkpoint with more than weights, although that executes its code
        device: cpu, cuda:0, ..., by default cuda:0 if available, otherwise cpu
        bank: replay this number of stored layouts instead of fresh layouts
        curriculum: replay layouts by "learnability" or "failure" (see docs/levels.md), by default only fresh layouts
        uniform: place uniformly, without checks for collisions and reach
        reachable: train on layouts that fulfil `reachable` of the scene's objects
        judged: task on whose layouts the policy is evaluated, by default the trained task
        changes: change a setting, e.g. gamma=0.99 or hidden=[256, 128]
        layouts: number of layouts in each evaluation
        every: iterations between two lines of the log
        evaluate_every: seconds of training between two evaluations
        save_every: seconds of training between two checkpoints
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"])] = 0
    num_envs: int = 4096
    minutes: float = 5.0
    million_steps: float | None = None
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("results/train")
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    trust: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    device: str | None = None
    bank: int | None = None
    curriculum: str | None = None
    uniform: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    reachable: bool = True
    judged: str | None = None
    changes: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="set", metavar="KEY=VALUE")] = ()
    layouts: Annotated[int, tyro.conf.arg(aliases=["-n"])] = 4096
    every: int = 10
    evaluate_every: float = 60.0
    save_every: float = 20.0

    def check(self) -> None:
        """Reject invalid options.

        Raises:
            ArgumentError: The message names the option and its valid values.
        """
        if self.bank is not None and (self.bank < 1 or self.uniform):
            raise ArgumentError(f"--bank should be 1 or more layouts, and used without --uniform, got {self.bank}.")
        for name, value in (("minutes", self.minutes), ("million_steps", self.million_steps)):
            if value is not None and not value > 0.0:
                raise ArgumentError(f"--{name.replace('_', '-')} {value}: should be above 0.")
