"""The door: public names are those of the API pages, pages import nothing else, and one word means one argument."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest

import sceniris_gym
from docs.make_surface import MODULES, PAGE, Definition, definition, members, public, surface
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.vector_env import SceneVectorEnv

ROOT = Path(__file__).parents[1]
PUBLIC = {
    ".".join(part for part in ("sceniris_gym", module, name) if part): (module, name)
    for module in MODULES
    for name in public(module)
}
BLOCK = re.compile(r"^```python(?: title=\"[^\"]+\")?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SECOND_WORDS = {"mask", "env_ids", "indices", "seeds", "episodes", "ids", "rows", "knob", "knobs", "level", "levels"}
"""Other words for worlds, layouts, params and curricula."""
BOOLEANS = "takes only booleans"
PROTOCOL = "the word of the library that calls it"
ALLOWED = {
    **dict.fromkeys(("ArmController.start(mask)", "EpisodeStatistics.start(mask)"), BOOLEANS),
    **dict.fromkeys(("Task.on_reset(mask)", "LiberoGoalTask.on_reset(mask)"), BOOLEANS),
    **{f"State.{name}(mask)": BOOLEANS for name in ("put_joints", "put_pose", "scale_field", "sleep")},
    **{f"Sb3VecEnvWrapper.{n}(indices)": PROTOCOL for n in ("env_is_wrapped", "env_method", "get_attr", "set_attr")},
    **{
        f"PlaceLayouts.{n}(env_ids)": PROTOCOL for n in ("__call__", "reseed", "reset", "restore", "set_param", "state")
    },
    "scene_param_stages(env_ids)": PROTOCOL,
    "ResetRandomizer.write(rows)": "the row of a table for each world",
    "Layouts.create(rows)": "the number of rows",
    "LayoutDataset.rows(indices)": "rows of files, as `dataset[index]`",
}


def programs() -> list[tuple[str, str]]:
    """Return the Python code of all pages, examples and the notebook, with its file."""
    found = [
        (str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) for path in (ROOT / "examples").glob("*.py")
    ]
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        found += [(str(path.relative_to(ROOT)), code) for code in BLOCK.findall(path.read_text(encoding="utf-8"))]
    for path in (ROOT / "examples").glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        found += [(path.name, "".join(cell["source"])) for cell in cells if cell["cell_type"] == "code"]
    return found


def imported(code: str) -> set[str]:
    """Return the names of the package that a program imports."""
    found = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "sceniris_gym":
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.startswith("sceniris_gym.")}
    return found


def arguments(node: Definition, module: str) -> dict[str, list[str]]:
    """Return the arguments of a function, or of the public methods of a class, by its name."""
    functions = {"": node} if isinstance(node, ast.FunctionDef) else members(node, module)
    return {
        ".".join(filter(None, (node.name, name))): [
            a.arg for a in (*f.args.posonlyargs, *f.args.args, *f.args.kwonlyargs)
        ]
        for name, f in functions.items()
        if isinstance(f, ast.FunctionDef) and not name.startswith("launch_")
    }


def all_arguments() -> dict[str, list[str]]:
    """Return the arguments of all public functions and methods."""
    found: dict[str, list[str]] = {}
    for module, name in PUBLIC.values():
        node, where = definition(*public(module)[name])
        if node is not None:
            found |= arguments(node, where)
    return found


def test_the_api_pages_have_the_public_names_and_no_others():
    """The adapters and errors are shown by whole modules."""
    pages = (ROOT / "docs" / "api").glob("*.md")
    shown = {line.split()[1] for path in pages for line in path.read_text().splitlines() if line.startswith(":::")}
    whole = {"sceniris_gym.adapters", "sceniris_gym.errors"}
    assert shown - set(PUBLIC) == whole
    shown |= {name for name in PUBLIC if name.startswith(tuple(f"{module}." for module in whole))}
    made = {name: definition(*public(module)[key])[0] for name, (module, key) in PUBLIC.items()}
    drawn = [made[name] for name in shown & set(made)]  # the door has some names of other modules, too
    assert [name for name, node in made.items() if node not in drawn] == []


def test_pages_and_examples_import_public_names_only():
    """Also the notebook; tasks of the package are those of `sceniris_gym.envs`."""
    allowed = {*PUBLIC, *(f"sceniris_gym.{module}" for module in MODULES), "sceniris_gym"}
    private = {(path, name) for path, code in programs() for name in imported(code) - allowed}
    assert {(path, name) for path, name in private if not name.startswith("sceniris_gym.envs.")} == set()


def test_worlds_layouts_and_params_have_one_word():
    """In every public signature, protocols aside."""
    found = {f"{name}({word})" for name, words in all_arguments().items() for word in SECOND_WORDS.intersection(words)}
    assert found == set(ALLOWED)


def test_signatures_stay_small():
    """As users have to read them."""
    constructors = {name: len(words) - 1 for name, words in all_arguments().items() if name.endswith(".__init__")}
    assert {name: count for name, count in constructors.items() if count > 18} == {}
    assert constructors["SceneVectorEnv.__init__"] <= 18
    assert constructors["ResetRandomizer.__init__"] <= 14
    assert len(sceniris_gym.__all__) <= 40


@pytest.mark.parametrize(("shown", "capitals"), [(ResetRandomizer, ["STATE_FIELDS"]), (SceneVectorEnv, ["SETTABLE"])])
def test_only_constants_that_users_need_are_shown(shown: type, capitals: list[str]):
    """By `dir`, as an editor lists them."""
    assert [name for name in dir(shown) if name.isupper() and name[0] != "_"] == capitals


def test_the_list_of_the_surface_is_up_to_date():
    """`python -m docs.make_surface` writes it: a change of a public name or signature is a diff there."""
    assert PAGE.read_text(encoding="utf-8") == surface()
