"""The `audit` command: makes or loads layouts and rejected candidates of a scene, and judges them."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.physics import equalities, without_log
from sceniris_gym.commands.answer import OK, listing, verdict
from sceniris_gym.errors import SceneFileError, check_names
from sceniris_gym.files import UNREADABLE, read_arrays, replacing
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.columns import columns, row_types
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table, read_rejected
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable

PROMISES = {
    "missed_collisions": ("layouts collide", "missed_pairs"),
    "false_alarms": ("candidates rejected without a collision", "false_alarm_pairs"),
    "invalid": ("rows not finite", "invalid_by"),
    "misplaced": ("layouts with an object out of place", "misplaced_by"),
    "relation_violations": ("relations, orientations or groups broken", "relations_by"),
    "broken_equalities": ("equalities broken", "worst_equality"),
    "unreached": ("grasps out of reach", "unreached_by"),
}
"""Finding that is zero if a promise holds -> its text in reports, and the finding with details."""

_WORLDS = 1024  # worlds that are reset until enough candidates were rejected
_EPISODES = 1000  # greatest number of these resets, for scenes with hardly any rejections


def rejected_candidates(compiled: CompiledScene, n: int, seed: int, split: str) -> tuple[LayoutTable, list[str]]:
    """Make layouts until n candidates were rejected for collision.

    Returns:
        The layouts, each with its rejected object at the candidate pose, and the names of the rejected objects. If
        the scene has hardly any rejections, there are fewer than n layouts.
    """
    generator = LayoutGenerator._recording(compiled, _WORLDS, n, seed=seed, split=split)
    for _ in range(_EPISODES):
        generator.generate()
        if generator.layouts.view.rejected_count.numpy()[0] >= n:
            break
    rejected = read_rejected(generator)
    return rejected.states, [compiled.placed[i] for i in rejected.objects]


class Rows(NamedTuple):
    """Rows to judge: layouts, and candidates that were rejected for collision.

    Attributes:
        table: The layouts.
        rejected, names: More layouts, each with its rejected object at the candidate pose, and the objects' names.
        seed, split: Seed of the first layout, and the split of all layouts.
    """

    table: LayoutTable
    rejected: LayoutTable
    names: list[str]
    seed: int
    split: str = "train"


def make_rows(compiled: CompiledScene, layouts: int, rejected: int, seed: int, split: str = "train") -> Rows:
    """Make layouts and rejected candidates of a scene, on the device of `compiled`."""
    table = make_table(compiled, layouts, seed, split=split)
    candidates = rejected_candidates(compiled, rejected, seed, split) if rejected else (table[slice(0, 0)], [])
    return Rows(table, *candidates, seed, split)


def save_rows(compiled: CompiledScene, rows: Rows, path: Path) -> dict[str, Any]:
    """Write rows to an npz file, and return figures for the report. An error leaves no partial file."""
    parts = {"layouts": rows.table, "rejected": rows.rejected}
    arrays = {f"{part}_{name}": getattr(t, name) for part, t in parts.items() for name in COLUMNS}
    arrays |= {
        "rejected_object": np.array(rows.names, str),
        "rejected_cause": np.array(["collision"] * len(rows.names), str),
        "hash": np.array(compiled.hash),
        "config": np.array(compiled.config.canonical()),
        "split": np.array(rows.split),
        "seed": np.array(rows.seed % 2**64, np.uint64),
    }
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)
    found = {"scene": compiled.config.name, "hash": compiled.hash, "seed": rows.seed, "file": str(path)}
    return found | {"layouts": len(rows.table), "rejected": len(rows.rejected)}


def load_rows(compiled: CompiledScene, path: Path) -> Rows:
    """Read rows from a file of `save_rows`.

    Raises:
        SceneFileError: The file is missing, or `save_rows` did not write it.
        SceneMismatchError: The rows belong to another scene.
        UnknownNameError: The scene does not place a rejected object.
    """
    try:
        arrays = read_arrays(path)
        found = str(arrays["hash"])
        table, rejected = (_table_of(arrays, part, found) for part in ("layouts", "rejected"))
        names, seed, split = arrays["rejected_object"], int(arrays["seed"]), str(arrays["split"])
    except UNREADABLE as error:
        raise SceneFileError(f"--load {path}: should be a file of 'sceniris-gym audit --save': {error}") from error
    compiled.scene.check_hash(found, f"--load {path}:", "Give the scene of the rows, and the same changes by --set.")
    _check_columns(compiled, path, table, rejected, names)
    return Rows(table, rejected, names.tolist(), seed, split)


def _table_of(arrays: dict[str, np.ndarray], part: str, scene: str) -> LayoutTable:
    """Return the part "layouts" or "rejected" of a stored file as a table. Columns that older files lack are blank."""
    nrow = len(arrays[f"{part}_status"])
    later = {f"{part}_{name}": COLUMNS[name].blanks(nrow) for name in ("start", "param", *columns("draw"))}
    rows: dict[str, Any] = {name: (later | arrays)[f"{part}_{name}"] for name in COLUMNS}
    return LayoutTable(**rows, scene=scene)


def _check_columns(
    compiled: CompiledScene, path: Path, table: LayoutTable, rejected: LayoutTable, names: np.ndarray
) -> None:
    """Reject columns that do not fit the scene: shapes, types, and names of rejected objects."""

    def check(name: str, found: np.ndarray, shape: tuple[int, ...], dtype: Any) -> None:
        if found.shape != shape:
            raise SceneFileError(f"--load {path}: {name} should have shape {shape}, got {found.shape}. Save it again.")
        if not np.can_cast(found.dtype, dtype, "same_kind"):
            raise SceneFileError(f"--load {path}: {name} should have type {dtype}, got {found.dtype}. Save it again.")

    check("rejected_object", names, (len(np.atleast_1d(rejected.valid)),), "<U1")
    for part, rows in (("layouts", table), ("rejected", rejected)):
        n = len(np.atleast_1d(rows.valid))
        for name, (dtype, shape) in row_types(compiled).items():
            if rows is table or "nreach" not in COLUMNS[name].shape:  # the audit reads no grasps or paths of candidates
                check(f"{part}_{name}", getattr(rows, name), (n, *shape), dtype)
    check_names("object", names.tolist(), f"--load {path}: rejected_object", compiled.placed)


def _finite(rows: Rows) -> tuple[np.ndarray, np.ndarray, dict[str, str]]:
    """Return masks of finite layouts and of finite candidates, and by column a text that lists the non-finite rows."""
    found, by = [], {}
    for part, table in (("layouts", rows.table), ("rejected", rows.rejected)):
        known = {name: np.isfinite(getattr(table, name)) for name in ("qpos", "mocap_pos", "mocap_quat")}
        finite = {name: column.all(axis=tuple(range(1, column.ndim))) for name, column in known.items()}
        by |= {f"{part} {name}": f"rows {_runs(np.flatnonzero(~f))}" for name, f in finite.items() if not f.all()}
        found.append(np.all(list(finite.values()), axis=0))
    return found[0], found[1], by


def _runs(numbers: np.ndarray) -> str:
    """Return ascending numbers as text, such as "0 3-5 9"."""
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return " ".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)


@without_log()
def judge_rows(compiled: CompiledScene, rows: Rows, settled: int | None = None) -> dict:
    """Judge rows, and return the findings as plain numbers and names.

    Rows with a non-finite number count as invalid and are not judged further. `settled` is the number of layouts that
    are simulated for half a second, or None for all layouts.
    """
    finite, finite_candidates, invalid_by = _finite(rows)
    table, candidates = rows.table[finite], rows.rejected[finite_candidates]
    names = np.array(rows.names, str)[finite_candidates].tolist()
    auditor = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)
    broken, worst, weakest = equalities(compiled.mjm, table)
    report = auditor.judge(table, settled=int(finite[:settled].sum()))
    claims = reach_claims(compiled, table)
    unreached = judge_reach(compiled, table, claims)
    unstable = sum(count for count, _ in report.unstable.values())
    alarms = auditor.judge_rejected(candidates, names, compiled.placed)
    found = {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "geometry": compiled.config.geometry,
        "device": compiled.device,
        "seed": rows.seed,
        "split": rows.split,
        "layouts": len(rows.table),
        "valid": int(table.valid.sum()),
        "invalid": int((~finite).sum() + (~finite_candidates).sum()),
        "invalid_by": invalid_by,
        "missed_collisions": report.colliding,
        "missed_pairs": dict(Counter(" ".join(c.owners) for c in report.conflicts)),
        "rejected": len(rows.rejected),
        "false_alarms": len(alarms),
        "false_alarm_pairs": dict(Counter(" ".join(a.owners or ()) for a in alarms)),
        "broken_equalities": broken,
        "equality_worst": worst,
        "worst_equality": weakest,
        "deepest_penetration_m": report.depth,
        "deepest_pair": " ".join(report.penetration.owners) if report.penetration else "",
        "allowed_contacts": {
            " ".join(names): f"{why}; {home:.2g} m deep there, {depth:.2g} m in layouts"
            for names, (why, home, depth) in report.allowed.items()
        },
        "misplaced": len({m.row for m in report.misplaced}),
        "misplaced_by": dict(Counter(f"{m.name} {m.cause}" for m in report.misplaced)),
        "relation_violations": report.relation_violations,
        "relations_by": {f"{k.name} {k.word}": k.broken for k in report.kept if k.broken},
        "relation_worst_m": max((k.worst for k in report.kept if k.unit == "m"), default=0.0),
        "relation_worst_rad": max((k.worst for k in report.kept if k.unit == "rad"), default=0.0),
        "reach_claims": int(sum(np.isfinite(claim.pose[:, 0]).sum() for claim in claims)),
        "unreached": len(unreached),
        "unreached_by": dict(Counter(f"{u.name} {u.cause}" for u in unreached)),
        "settled": report.settled,
        "unstable": unstable,
        "unstable_by": {kind: f"{n} layouts, the first: {text}" for kind, (n, text) in report.unstable.items()},
        "frozen_joints": list(report.frozen),
        "moved": report.moved,
        "moved_share": sum(report.moved.values()) / max((report.settled - unstable) * len(report.moved), 1),
        "fast": report.fast,
        "top_speed_m_s": report.top_speed,
    }
    return {OK: not any(found[promise] for promise in PROMISES), **found}


def report(found: Mapping[str, Any]) -> str:
    """Return the findings as text: the verdict, then the findings that are not empty or zero."""
    broken = []
    for name, (text, detail) in PROMISES.items():
        if found[name]:
            by = found.get(detail, {})
            by = by.items() if isinstance(by, Mapping) else [(by, found["equality_worst"])]
            broken.append(f"{found[name]} {text}" + f" ({', '.join(f'{key} {value}' for key, value in by)})")
    made = f"{found['layouts']:,} layouts of '{found['scene']}', {found['rejected']:,} rejected candidates"
    return "\n".join([verdict(found, f"{made}: {'; '.join(broken) or 'all promises hold'}"), listing(_filled(found))])


def _filled(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the findings that are not empty or zero, without the verdict."""
    filled = {name: {k: n for k, n in v.items() if n} if isinstance(v, Mapping) else v for name, v in found.items()}
    return {name: value for name, value in filled.items() if value and name != OK}
