"""Imports all things of a folder in parallel; a failure or a crash of one stops no other."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from sceniris_gym.errors import MeshError, SceneFileError, ScenirisError
from sceniris_gym.files import write_text
from sceniris_gym.importers.things.importer import SUFFIXES, Options, import_thing

MOST_SECONDS = 1800.0
"""The longest that one thing may take; none with fewer than `MOST_FACES` faces was seen to take a tenth of it."""


@dataclass(frozen=True)
class Outcome:
    """The result of an import.

    Attributes:
        source: The file of the thing.
        asset: The MJCF file that was written; None if the thing was refused.
        manifest: Its manifest; None if the thing was refused.
        error: The reason for which it was refused; None if it was not.
    """

    source: Path
    asset: Path | None
    manifest: dict[str, Any] | None
    error: ScenirisError | None


def things_in(folder: Path) -> list[Path]:
    """Return all files below a folder that can be imported, in alphabetical order.

    Meshes that a URDF of the folder refers to are parts of it, and no things of their own.
    """
    found = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    texts = [path.read_text(errors="replace") for path in found if path.suffix.lower() == ".urdf"]
    parts = {Path(name).name for text in texts for name in re.findall(r'filename\s*=\s*"([^"]+)"', text)}
    return [path for path in found if path.name not in parts]


def import_folder(
    sources: Iterable[Path],
    out: Path,
    options: Options | None = None,
    *,
    jobs: int | None = None,
    done: Callable[[Outcome], object] = lambda outcome: None,
    seconds: float = MOST_SECONDS,
) -> list[Outcome]:
    """Import things, each in a process of its own, and write `manifest.json` into the folder of assets.

    Args:
        sources: Their files; assets get their names, with a number where a name comes again.
        out: The folder of assets.
        options: The choices for all of them. Nobody is asked.
        jobs: The number of imports at a time; by default one for each core.
        done: Called with each outcome as it arrives.
        seconds: The longest that one may take.

    Returns:
        The outcomes, in the order of the sources.
    """
    sources = list(sources)
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


def _targets(sources: list[Path], out: Path) -> list[Path]:
    """Return an MJCF file for each source, with a name that MuJoCo and scene files accept."""
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
    """Import one thing in a process of its own."""
    context = multiprocessing.get_context("spawn")
    near, far = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(far, source, target, options), daemon=True)
    process.start()
    far.close()
    answer: Any = None
    try:
        if near.poll(seconds):
            answer = near.recv()
        else:
            process.terminate()
            answer = SceneFileError(f"{source}: it took more than {seconds:g} s. Reduce its faces.")
    except EOFError:
        process.join()
        answer = SceneFileError(
            f"{source}: the process that imported it ended with status {process.exitcode}. Export it again, e.g. "
            "with Blender, or reduce its faces."
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
    except Exception as error:  # one thing of many: its error is reported, and the others go on
        far.send(SceneFileError(f"{source}: it cannot be imported: {type(error).__name__}: {error}"))
