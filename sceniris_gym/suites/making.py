"""Makes the cases of a suite."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.files import as_json
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.params import ParamTable
from sceniris_gym.progress import tell
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.suites.axes import AXES, Axis, Base, Values, axes_of
from sceniris_gym.suites.edits import STEPS, Edited, Editor
from sceniris_gym.suites.suite import LAW, Case, Head, Suite
from sceniris_gym.training.task_scenes import scene_of, spec_of
from sceniris_gym.vector.arguments import as_task

FIRST_SEED = 1 << 62
"""Seed of the first layout. Seeds of trainings are far below."""
_SPARE = 4
"""Number of nominal layouts per edited case. A layout that no edit fits is left out."""


def make(
    task: str,
    names: Sequence[str] = (),
    grades: int = 5,
    number: int = 40,
    *,
    changes: Sequence[str] = (),
    cumulative: bool = False,
    device: str | None = None,
) -> tuple[Suite, Counter[str]]:
    """Return a suite, and the number of refused edits by axis and cause.

    Case i of each axis and grade has the same seed as the nominal case i. Edits take the first layouts that they fit.

    Args:
        task: The task, as `spec_of` takes it.
        names: Axes. Without names, all axes that the task has, except shifts and turns.
        grades: Number of grades.
        number: Number of cases for each axis and grade.
        changes: Changes of the task's scene, as `--set` takes them.
        cumulative: Also make cases that change the params of all axes at once.
        device: Device on which layouts are made.

    Raises:
        UnknownNameError: There is no such axis.
        ArgumentError: The task lacks an axis, or all edits of an axis are refused.
        ScenirisError: The task is unknown, or the widened scene cannot be compiled.
    """
    check_names("axis", names, "--axes", (*AXES, *STEPS))
    config = SceneConfig.load(scene_of(task, reachable=True), read_changes(changes))
    base = Base.of(compile_scene(config, device), as_task(spec_of(task).kwargs["task"]), grades)
    own, edited = tuple(n for n in names if n in AXES), [n for n in names if n in STEPS]
    axes = axes_of(base, own) if own or not edited else {}
    widened = {key: value for axis in axes.values() for key, value in axis.widened.items()}
    nominal = {key: value for axis in axes.values() for key, value in axis.nominal.items()}
    axes = {"nominal": Axis({}, {}, lambda *_: {}, (0,)), **axes}
    if cumulative:
        axes["cumulative"] = _all_at_once([*axes.values()])
    compiled = compile_scene(SceneConfig.load(config, widened), device)
    table, found, rows, refused = ParamTable(compiled, tuple(nominal)), [], [], Counter[str]()
    split = "train" if any(config.groups[name].splits for name in config.variants) else "eval"
    for name, axis in axes.items():
        for grade in axis.grades or range(1, grades + 1):
            for i in range(number):
                random = np.random.default_rng([grade, i, *name.encode()])
                text = table.text(table.rows({**nominal, **axis.draw(grade, random)}, 1)[0])
                found.append(Case(0, compiled.layout_id(FIRST_SEED + i, 0, axis.split or split, text), name, grade))
    if edited:
        generator = LayoutGenerator(compiled, _SPARE * number, split=split, params=table.names)
        generator.set_params(nominal)
        generator.reseed(seed=FIRST_SEED)
        generator.generate()
        editor, layouts = Editor(compiled), generator.table()
        for axis in edited:
            made = [one for g in range(1, grades + 1) for one in _edits(editor, layouts, axis, g, number, refused)]
            if not made:
                why = next((why for why, _ in refused.most_common() if why.startswith(axis)), "no layout is valid")
                raise ArgumentError(f"--axes {axis}: no edit of a layout passes the checks ({why}).")
            for i, (case, row) in enumerate(made, len(rows)):
                name = compiled.layout_id(int(row.seed[0]), 0, split, table.text(row.param[0]))
                found.append(replace(case, id=name, row=i))
                rows.append(row)
    changes = (*changes, *(f"{key}={as_json(value)}" for key, value in widened.items()))
    head = Head(LAW, task, config.name, compiled.hash, changes, table.names)
    cases = [replace(case, case=i) for i, case in enumerate(found)]
    return Suite(head, cases, LayoutTable.concatenate(rows) if rows else None), refused


def _all_at_once(axes: Sequence[Axis]) -> Axis:
    def draw(grade: int, random: np.random.Generator) -> Values:
        return {key: value for axis in axes for key, value in axis.draw(grade, random).items()}

    return Axis({}, {}, draw, split=max(axis.split for axis in axes))


def _edits(
    editor: Editor, layouts: LayoutTable, axis: str, grade: int, number: int, refused: Counter[str]
) -> list[tuple[Case, LayoutTable]]:
    """Return at most `number` cases of one axis and grade with their rows, and count refused edits."""
    random, made = np.random.default_rng([grade, *axis.encode()]), []
    for i in np.flatnonzero(layouts.valid):
        one = editor.edit(layouts[i], axis, grade, random)
        if isinstance(one, Edited):
            made.append((Case(0, "", axis, grade, ("clipped",) * one.clipped, one.edits), one.row))
        else:
            refused[f"{axis} {grade}: {one}"] += 1
        tell(f"{axis} {grade}", len(made), number)
        if len(made) == number:
            break
    return made
