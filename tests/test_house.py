"""The house as CONTRIBUTING.md draws it: every module has its tests, and none grows too large."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "sceniris_gym"
SOURCES = [path.relative_to(PACKAGE) for path in sorted(PACKAGE.rglob("*.py"))]
MODULES = [path for path in SOURCES if path.name != "__init__.py"]
LONGEST_FUNCTION = 80
DEEPEST_LOOPS = 3
DOCUMENTED = ("sceniris_gym", "envs", "examples", "assets", "benchmarks", "docs", "tests")
SUBORDINATE = re.compile(r"(What|Where|Whether|How|Who|That)\b")


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    """Yield the functions and methods of a module, those inside of others too."""
    tree = ast.parse((PACKAGE / path).read_text())
    return (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def loops(node: ast.AST) -> int:
    """Return how many loops stand inside one another, those of functions inside not counted."""
    inside = [loops(child) for child in ast.iter_child_nodes(node) if not isinstance(child, ast.FunctionDef)]
    return max(inside, default=0) + isinstance(node, ast.For | ast.While)


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_tests_mirror_the_source(path: Path):
    """A module has tests in a file of its name, in the same folder of tests/."""
    assert (ROOT / "tests" / path.with_name(f"test_{path.name}")).is_file()


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_functions_are_short_and_flat(path: Path):
    """At most 80 lines and three levels of loops."""
    long = [f.name for f in functions(path) if (f.end_lineno or 0) - f.lineno + 1 > LONGEST_FUNCTION]
    deep = [f.name for f in functions(path) if loops(f) > DEEPEST_LOOPS]
    assert (long, deep) == ([], [])


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_kernels_are_private_and_their_launcher_follows(path: Path):
    """The function or class after a kernel, or after several, launches it, or them one by one."""
    tree = ast.parse((PACKAGE / path).read_text())
    kernels: list[str] = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and any("kernel" in ast.unparse(d) for d in node.decorator_list):
            assert node.name.startswith("_")
            kernels.append(node.name)
        elif kernels and isinstance(node, ast.FunctionDef | ast.ClassDef):
            launched = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)} & set(kernels)
            assert launched, f"'{node.name}' stands between {kernels} and their launchers"
            kernels = [name for name in kernels if name not in launched]
    assert kernels == []


def test_contributing_names_every_room():
    """Each folder of the package is in the table of rooms, and the page stays short."""
    page = (ROOT / "CONTRIBUTING.md").read_text()
    table = page.split("## The rooms")[1].split("\n## ")[0]
    rooms = {f"{path.parent.relative_to(PACKAGE)}/" for path in PACKAGE.rglob("*.py")} - {"./", "importers/"}
    assert [room for room in sorted(rooms) if f"`{room}`" not in table] == []
    assert len(page.encode()) <= 15_000


@pytest.mark.parametrize("folder", ["sceniris_gym", "envs", "examples", "assets", "benchmarks", "docs", "tests"])
def test_first_lines_are_sentences_about_the_thing(folder: str):
    """No docstring opens with a relative clause, or asks a question."""
    clauses = {"What", "Where", "Whether", "How", "Who", "That", "Which"}
    offenders = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (doc := ast.get_docstring(node)):
                first = doc.splitlines()[0]
                if first.split()[0].strip(",") in clauses or first.endswith("?"):
                    offenders.append(f"{path.relative_to(ROOT)}: {first}")
    assert offenders == []
