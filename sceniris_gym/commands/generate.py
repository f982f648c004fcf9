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
    compiled: CompiledScene,
    n: int,
    folder: Path,
    *,
    seed: int = 0,
    split: str = "train",
    chunk: int | None = None,
    shard: Shard | None = None,
    resume: bool = False,
    formats: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Write a data set, or one process's shard, and return its figures.

    Args:
        compiled: The compiled scene.
        n: Number of layouts: row i is episode 0 of seed + i.
        folder: The folder to write to, created if missing.
        seed: Seed of the first row.
        split: "train" or "eval".
        chunk: Number of layouts made at once, or None for a number that suits the device. It does not affect layouts.
        shard: The parts that this process writes, or None for all parts.
        resume: Continue an incomplete data set.
        formats: Formats of parts in addition to `.npy`, out of `dataset.formats.FORMATS`, in alphabetical order.

    Raises:
        DatasetError, MissingExtraError: See `DatasetWriter`.
        OutputError: A file cannot be written.
        SceneKeyError: The scene's model is an MjModel, which cannot be written to `scene.zip`.
    """
    plan, shard = DatasetPlan.of(compiled, n, seed, split, formats), shard or Shard()
    if chunk is None:
        chunk = _CHUNK if compiled.device == "cpu" else _CHUNK_CUDA
    writer = DatasetWriter(compiled, plan, folder, shard, resume=resume)
    writer.write(chunk=chunk)
    records = writer.records()
    rows, valid, first = (sum(record[name] for record in records) for name in ("rows", "valid", "first_pass_valid"))
    figures = {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "first_id": compiled.layout_id(seed, 0, split),
        "layouts": n,
        "valid": valid / rows if rows else None,
        "first_pass_valid": first / rows if rows else None,
        "folder": str(folder),
        "parts": plan.parts,
        "formats": list(formats),
        "complete": writer.complete,
    }
    return figures if writer.complete else figures | {"missing_parts": plan.parts - len(records)}


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
