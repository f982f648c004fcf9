"""The `generate` command: writes a data set of layouts with their model."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sceniris_gym.commands.answer import OK, verdict
from sceniris_gym.dataset import reader
from sceniris_gym.dataset.manifest import DatasetPlan
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.dataset.writer import DatasetWriter
from sceniris_gym.errors import DatasetError
from sceniris_gym.program.compiled import CompiledScene

# Layouts made at once: enough to keep a GPU busy, and few enough for a CPU's caches.
_CHUNK, _CHUNK_CUDA = 4096, 16_384


def generate(
    compiled: CompiledScene, plan: DatasetPlan, folder: Path, shard: Shard, *, chunk: int | None, resume: bool
) -> dict[str, Any]:
    """Write a data set, or one process's shard, and return its figures.

    Args:
        compiled: The compiled scene.
        plan: The plan of the data set.
        folder: The folder to write to, created if missing.
        shard: The parts that this process writes.
        chunk: Number of layouts made at once, or None for a number that suits the device. It does not affect layouts.
        resume: Continue an incomplete data set.

    Raises:
        DatasetError, MissingExtraError: See `DatasetWriter`.
        OutputError: A file cannot be written.
        SceneKeyError: The scene's model is an MjModel, which cannot be written to `scene.zip`.
    """
    if chunk is None:
        chunk = _CHUNK if compiled.device == "cpu" else _CHUNK_CUDA
    records = DatasetWriter(compiled, plan, folder, shard, resume=resume).write(chunk=chunk)
    left, told = plan.parts - len(records), plan.fields
    rows, valid, first = (sum(record[name] for record in records) for name in ("rows", "valid", "first_pass_valid"))
    figures = {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "first_id": compiled.layout_id(told["seed"], 0, told["split"]),
        "layouts": plan.layouts,
        "valid": valid / rows if rows else None,
        "first_pass_valid": first / rows if rows else None,
        "folder": str(folder),
        "parts": plan.parts,
        "formats": told["formats"],
        "complete": left == 0,
    }
    return figures | {"missing_parts": left} if left else figures


def report(figures: Mapping[str, Any]) -> str:
    """Return the figures as text."""
    folder = figures["folder"]
    if not figures["complete"]:
        return f"{folder}: {figures['missing_parts']} of {figures['parts']} parts are left for the other processes"
    made = f"{figures['layouts']} layouts of '{figures['scene']}' written to {folder}, {figures['valid']:.2%} valid"
    return f"{made}; the first one is {figures['first_id']}"


def verify(folder: Path) -> dict[str, Any]:
    """Compare the files of a data set with its checksums, and return the verdict.

    Raises:
        DatasetError: The folder holds no complete data set.
    """
    dataset = reader.LayoutDataset(folder)
    names = ("scene", "hash", "split", "seed", "layouts")
    found = {name: dataset.manifest[name] for name in names} | {"folder": str(folder)}
    try:
        reader.verify(dataset)
    except DatasetError as error:
        return {OK: False, **found, "error": str(error)}
    return {OK: True, **found}


def report_of_files(found: Mapping[str, Any]) -> str:
    """Return the verdict on the files of a data set as text."""
    whole = f"{found['folder']}: {found['layouts']} layouts of '{found['scene']}', all files are whole"
    return verdict(found, found.get("error", whole))
