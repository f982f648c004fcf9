"""Makes the cases of a suite."""

from collections import ChainMap, Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.files import as_json
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.params import ParamTable
from sceniris_gym.suites.axes import AXES, Axis, Base, axes_of
from sceniris_gym.suites.edits import STEPS, Editor
from sceniris_gym.suites.suite import LAW, Case, Head, Suite
from sceniris_gym.training.policies import GROUP
from sceniris_gym.training.task_scenes import make_env, scene_of, spec_of
from sceniris_gym.vector.arguments import as_task
from sceniris_gym.vector.settings import as_image_config

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
    given = spec_of(task).kwargs
    images = as_image_config(as_task(given["task"]).images, given.get("images"))
    base = Base.of(compile_scene(config, device), images, grades)
    own, edited = tuple(n for n in names if n in AXES), [n for n in names if n in STEPS]
    axes = axes_of(base, own) if own or not edited else {}
    widened = {key: value for axis in axes.values() for key, value in axis.widened.items()}
    nominal = {key: value for axis in axes.values() for key, value in axis.nominal.items()}
    axes = {"nominal": Axis({}, {}, lambda *_: {}, (0,)), **axes}
    if cumulative:
        split, draws = max(axis.split for axis in axes.values()), [axis.draw for axis in axes.values()]
        axes["cumulative"] = Axis(
            {}, {}, lambda grade, r: dict(ChainMap(*(draw(grade, r) for draw in draws))), split=split
        )
    compiled = compile_scene(SceneConfig.load(config, widened), device)
    if "objects.confounder_can" in widened:
        seen = [make_env(task, 1, scene).observation_names.get(GROUP) for scene in (base.compiled, compiled)]
        if seen[0] != seen[1]:
            raise ArgumentError(f"--axes clutter: a policy of {task} observes the added objects. Give other --axes.")
    split, refused = "train" if any(config.groups[name].splits for name in config.variants) else "eval", Counter[str]()
    editor = Editor(compiled, nominal, _SPARE * number, FIRST_SEED, split) if edited else None
    table, cases = ParamTable(compiled, tuple(nominal)) if editor is None else editor.params, list[Case]()
    for name, axis in axes.items():
        for grade in axis.grades or range(1, grades + 1):
            for i in range(number):
                drawn = axis.draw(grade, np.random.default_rng([grade, i, *name.encode()]))
                text = table.text(table.rows({**nominal, **drawn}, 1)[0])
                cases.append(Case(0, compiled.layout_id(FIRST_SEED + i, 0, axis.split or split, text), name, grade))
    if editor is not None:
        for name in edited:
            made = [editor.edits(name, grade, number) for grade in range(1, grades + 1)]
            cases += [case for found, _ in made for case in found]
            refused += sum((causes for _, causes in made), Counter[str]())
            if cases[-1].axis != name:
                why = next((why for why, _ in refused.most_common() if why.startswith(name)), "no layout is valid")
                raise ArgumentError(f"--axes {name}: no edit of a layout passes the checks ({why}).")
    changes = (*changes, *(f"{key}={as_json(value)}" for key, value in widened.items()))
    head = Head(LAW, task, config.name, compiled.hash, changes, table.names)
    return Suite(head, [replace(case, case=i) for i, case in enumerate(cases)]), refused
