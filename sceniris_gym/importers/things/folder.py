"""Imports all files of a folder in parallel. A failure or crash of one import does not stop the others."""

import json
import multiprocessing
import os
import re
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from sceniris_gym.errors import MeshError, SceneFileError, ScenirisError
from sceniris_gym.files import write_text
from sceniris_gym.importers.things.importer import SUFFIXES, Options, import_thing

MOST_SECONDS = 1800.0
"""Time limit of one import [s]. All tested files, with up to `MOST_FACES` faces, took less than a tenth of this."""


@dataclass(frozen=True)
class Outcome:
    """The result of an import.

    Attributes:
        source: The imported file.
        asset: The MJCF file that was written, or None after an error.
        manifest: The asset's manifest, or None after an error.
        error: The error that rejected the file, or None.
    """

    source: Path
    asset: Path | None
    manifest: dict[str, Any] | None
    error: ScenirisError | None


def things_in(folder: Path) -> list[Path]:
    """Return all files below a folder that can be imported, in alphabetical order.

    Meshes are left out if a URDF file in the folder refers to them, because they are imported with the URDF file.
    """
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    texts = [path.read_text(errors="replace") for path in found if path.suffix.lower() == ".urdf"]
    parts = {Path(name).name for text in texts for name in re.findall(r'filename\s*=\s*"([^"]+)"', text)}
    return [path for path in found if path.name not in parts]


def import_folder(
    sources: Sequence[Path],
    out: Path,
    options: Options | None = None,
    *,
    jobs: int | None = None,
    done: Callable[[Outcome], object] = lambda outcome: None,
    seconds: float = MOST_SECONDS,
) -> list[Outcome]:
    """Import files in parallel, one process per file, and write `manifest.json` to the output folder.

    Args:
        sources: The files. Each asset gets the name of its file, with a number if the name is taken.
        out: The output folder.
        options: The options for all imports. Imports do not prompt the user.
        jobs: Number of parallel imports. By default, one per core.
        done: Callback that receives each outcome as it arrives.
        seconds: Time limit of one import [s].

    Returns:
        The outcomes, in the order of the sources.
    """
    out.mkdir(parents=True, exist_ok=True)
    targets = _targets(sources, out)

    def work(pair: tuple[Path, Path]) -> Outcome:
        outcome = _isolated(*pair, options or Options(), seconds)
        done(outcome)
        return outcome

    with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
        outcomes = list(pool.map(work, zip(sources, targets, strict=True)))
    imported = {str(o.source): {"asset": o.asset.name, **(o.manifest or {})} for o in outcomes if o.asset is not None}
    refused = {str(o.source): _told(o.error) for o in outcomes if o.error}
    write_text(out / "manifest.json", json.dumps({"imported": imported, "refused": refused}, indent=1) + "\n")
    return outcomes


def _told(error: ScenirisError) -> dict[str, str]:
    told = {"error": type(error).__name__, "reason": str(error)}
    return told | {"fault": error.reason} if isinstance(error, MeshError) else told


def _targets(sources: Sequence[Path], out: Path) -> list[Path]:
    """Return the path of the MJCF file for each source. The names have only characters that scene files accept."""
    taken: set[str] = set()
    targets = []
    for source in sources:
        stem = re.sub(r"\W+", "_", source.stem).strip("_") or "thing"
        name, number = stem, 2
        while name in taken:
            name, number = f"{stem}_{number}", number + 1
        taken.add(name)
        targets.append(out / f"{name}.xml")
    return targets


def _isolated(source: Path, target: Path, options: Options, seconds: float) -> Outcome:
    """Import one file in a separate process."""
    context = multiprocessing.get_context("spawn")
    near, far = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(far, source, target, options), daemon=True)
    process.start()
    far.close()
    try:
        if near.poll(seconds):
            answer = near.recv()
        else:
            process.terminate()
            answer = SceneFileError(f"{source}: the import took more than {seconds:g} s. Reduce the number of faces.")
    except EOFError:
        process.join()
        answer = SceneFileError(
            f"{source}: its import process ended with status {process.exitcode}. Export the file again, e.g. with "
            "Blender, or reduce its faces."
        )
    finally:
        process.join()
        near.close()
    if isinstance(answer, ScenirisError):
        return Outcome(source, None, None, answer)
    return Outcome(source, target, answer, None)


def _work(far: Connection, source: Path, target: Path, options: Options) -> None:
    try:
        far.send(import_thing(source, target, options))
    except ScenirisError as error:
        far.send(error)
    except Exception as error:  # reported as this file's outcome: the other imports continue
        far.send(SceneFileError(f"{source}: the import failed: {type(error).__name__}: {error}. Export it again."))
