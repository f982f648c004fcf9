"""Readers for the files in a run's folder, and the hash of a run's sources. Most readers do not import torch."""

import hashlib
import json
import math
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sceniris_gym.errors import ArgumentError, check_type
from sceniris_gym.files import opened, read_bytes
from sceniris_gym.training.settings import Settings, as_settings

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
    """Return the parts of the configuration of the run in `folder`: options, settings, sources and scene.

    Raises:
        ArgumentError: The file cannot be read.
    """
    with of_a_run(folder / CONFIG):
        told = json.loads(read_bytes(folder / CONFIG))
        return {name: dict(part) for name, part in told.items()}


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


def scene_of_run(folder: Path) -> str | None:
    """Return the hash of the scene of the run in a folder, or None for a run of version 0.1.0, which wrote no hash."""
    return read_parts(folder).get("scene", {}).get("hash")


def evaluations(folder: Path) -> list[dict[str, Any]]:
    """Return the lines about evaluations in the log of a run, in the order of the log.

    Raises:
        ArgumentError: The log cannot be read.
    """
    with of_a_run(folder / LOG):
        lines = [json.loads(line) for line in read_bytes(folder / LOG).splitlines()]
        return [line for line in lines if line["kind"] == "eval"]


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


def source_hash(*more: Path, package: Path = PACKAGE) -> str:
    """Return the hash of the package's code, tasks and assets. A repository and its installed wheel have the same hash.

    Args:
        more: Other files to hash, because they affect results.
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
    for path in more:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    print(source_hash())
