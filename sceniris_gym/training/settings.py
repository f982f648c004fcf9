"""The options of a run, the PPO settings of each shipped task, and the files in the folder of a run.

Most readers of these files do not import torch.
"""

import hashlib
import json
import math
import pickle
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro
from pydantic import ConfigDict, Field, NonNegativeFloat, PositiveFloat, PositiveInt, TypeAdapter

from sceniris_gym.config.bounds import COUNT
from sceniris_gym.config.fields import reading
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, check_names, check_type
from sceniris_gym.files import opened, read_bytes


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
    """Return the tuned settings of a task, or the default settings if it has none, with the given changes.

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
        seed: seed of the run. If two runs have different seeds, their layout seeds are at least 16 * 2^20 apart
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
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"]), range(2**31)] = 0
    num_envs: Annotated[int, COUNT] = 4096
    minutes: float = 5.0
    million_steps: float | None = None
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("results/train")
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    trust: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    device: Annotated[str | None, tyro.conf.arg(metavar="STR")] = None
    bank: int | None = None
    curriculum: str | None = None
    uniform: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    reachable: bool = True
    judged: str | None = None
    changes: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(name="set", metavar="KEY=VALUE")] = ()
    layouts: Annotated[int, tyro.conf.arg(aliases=["-n"]), COUNT] = 4096
    every: Annotated[int, COUNT] = 10
    evaluate_every: float = 60.0
    save_every: float = 20.0

    def check(self) -> None:
        """Reject invalid options.

        Raises:
            ArgumentError: The message names the option and its valid values.
        """
        if self.bank is not None and (self.bank < 1 or self.uniform):
            raise ArgumentError(f"--bank {self.bank}: should be 1 or more layouts, and not be combined with --uniform.")
        for name, value in (("minutes", self.minutes), ("million_steps", self.million_steps)):
            if value is not None and not value > 0.0:
                raise ArgumentError(f"--{name.replace('_', '-')} {value}: should be above 0.")


CONFIG, LOG, MODEL, JUDGED, TEACHER = "config.json", "log.jsonl", "model.pt", "judged.json", "teacher.pt"
PICKLE = "is a pickle, and reading it executes its code. Give --trust if you trust its author."
"""The end of errors about files that are only read with --trust."""
PACKAGE = Path(__file__).parents[1]
ENDINGS = {"sceniris_gym": (".py",), "envs": (".py", ".yaml"), "assets": (".xml", ".obj", ".reach")}


@contextmanager
def of_a_run(file: Path) -> Iterator[None]:
    """Context for code that reads a file of a run. Errors in this code become an error that names the file.

    Raises:
        ArgumentError: The code raised an error, for example because the file is cut off.
    """
    try:
        yield
    except Exception as error:  # JSON, torch and rsl-rl raise classes that differ between versions
        if isinstance(error, ArgumentError) and str(file.parent) in str(error):
            raise
        raise ArgumentError(f"{file}: should be a file of 'sceniris-gym train': {error!r:.200}.") from None


def read_config(folder: Path) -> tuple[str, Settings]:
    """Return the task and the settings of the run in a folder.

    Raises:
        ArgumentError: The folder has no `config.json` or no `model.pt`. The message names the missing file.
        SceneKeyError: A setting has the wrong type, or is out of range.
    """
    for name in (CONFIG, MODEL):
        if not (folder / name).is_file():
            raise ArgumentError(
                f"{folder}: should be the folder of a run of 'sceniris-gym train TASK --out {folder}', "
                f"but has no {name}."
            )
    told = read_parts(folder)
    with of_a_run(folder / CONFIG):
        task, settings = told["options"]["task"], told["settings"]
    check_type(task, str, f"{folder / CONFIG}: options.task")
    return task, as_settings(settings, f"{folder / CONFIG}: settings")


def read_parts(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the parts of the configuration of the run in `folder`: options, settings, and hashes.

    Raises:
        ArgumentError: The file `config.json` cannot be read.
    """
    with of_a_run(folder / CONFIG):
        return {name: dict(part) for name, part in json.loads(read_bytes(folder / CONFIG)).items()}


def read_checkpoint(file: Path, device: str, *, trust: bool = False) -> Any:
    """Return the contents of a checkpoint of rsl-rl.

    Args:
        file: The checkpoint.
        device: The device of its tensors, as torch names it.
        trust: Read all contents, even if this executes code in the file.

    Raises:
        ArgumentError: The file cannot be read, or holds more than weights and is not trusted.
    """
    import torch

    with of_a_run(file), opened(file) as found:
        try:
            return torch.load(found, map_location=device, weights_only=not trust)
        except pickle.UnpicklingError as error:
            names_code = "GLOBAL" in str(error)  # other errors mean that the bytes are not a pickle of torch
            why = f"should hold only weights. The rest {PICKLE}" if names_code else "is damaged or has no weights."
            raise (error if trust else ArgumentError(f"{file}: {why}")) from None


def evaluations(folder: Path) -> list[dict[str, Any]]:
    """Return the lines about evaluations in the log of a run, in the order of the log.

    Raises:
        ArgumentError: The log cannot be read.
    """
    with of_a_run(folder / LOG):
        return [line for line in map(json.loads, read_bytes(folder / LOG).splitlines()) if line["kind"] == "eval"]


def without_layouts(found: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return the results of evaluations by kind of layouts (`valid`, `unfiltered`), without results per layout."""
    return {name: {key: value for key, value in one.items() if key != "each"} for name, one in found.items()}


def share(one: dict[str, Any]) -> str:
    """Return the success rate of an evaluation and its 95% interval as text."""
    return "{:.1%} ({:.1%} to {:.1%})".format(one["success"], *one["interval"])


def success_interval(successes: int, number: int) -> tuple[float, float]:
    """Return the ends of the 95% Wilson interval (Wilson 1927) of a success rate, with z = 1.96."""
    from scipy.stats import binomtest  # takes a second to import

    if number == 0:
        return 0.0, 1.0
    interval = binomtest(successes, number).proportion_ci(math.erf(1.96 / math.sqrt(2.0)), "wilson")
    return float(interval.low), float(interval.high)


def source_hash(package: Path = PACKAGE) -> str:
    """Return the hash of the package's code, tasks and assets. A repository and its installed wheel have the same hash.

    Args:
        package: The folder of the package. It contains the tasks and assets or, in a repository, is next to them.
    """
    digest = hashlib.sha256()
    for name, endings in ENDINGS.items():
        inside = package / name
        folder = package if name == "sceniris_gym" else inside if inside.exists() else package.parent / name
        for path in sorted(folder.rglob("*")):
            parts = path.relative_to(folder).parts
            if path.suffix in endings and not (folder == package and parts[0] in ENDINGS):
                digest.update("/".join((name, *parts)).encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    print(source_hash())
