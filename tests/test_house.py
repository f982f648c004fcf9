"""The house as CONTRIBUTING.md draws it: every module is on its map and has its tests, and none grows too large."""

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
OUTSIDE_OF_LAYOUT = [path for path in MODULES if path.parts[0] != "layout"]
LONGEST_FUNCTION = 80
DEEPEST_LOOPS = 3


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    """Yield the functions and methods of a module, those inside of others too."""
    tree = ast.parse((PACKAGE / path).read_text())
    return (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def loops(node: ast.AST) -> int:
    """Return how many loops stand inside one another, those of functions inside not counted."""
    inside = [loops(child) for child in ast.iter_child_nodes(node) if not isinstance(child, ast.FunctionDef)]
    return max(inside, default=0) + isinstance(node, ast.For | ast.While)


def mapped_modules() -> set[str]:
    """Return the modules on the map: names before an entry's description, below the folder that the indent says."""
    text = (ROOT / "CONTRIBUTING.md").read_text().split("## The package")[1].split("\n## ")[0]
    tree = text.split("    sceniris_gym/\n")[1].split("    envs/")[0]
    found: set[str] = set()
    folders: list[tuple[int, str]] = []
    for line in tree.splitlines():
        indent = len(line) - len(line.lstrip())
        while folders and folders[-1][0] >= indent:
            folders.pop()
        entry = re.split(r" {2,}", line.strip())[0]
        inside = "".join(f"{name}/" for _, name in folders)
        if entry.endswith("/"):
            folders.append((indent, entry.removesuffix("/")))
        found |= {inside + name for name in re.findall(r"[\w/]+\.py", line)}
    return found


@pytest.mark.parametrize("path", OUTSIDE_OF_LAYOUT, ids=str)
def test_tests_mirror_the_source(path: Path):
    """A module has tests in a file of its name, in the same folder of tests/."""
    assert (ROOT / "tests" / path.with_name(f"test_{path.name}")).is_file()


@pytest.mark.parametrize("path", MODULES, ids=str)
def test_functions_are_short_and_flat(path: Path):
    """At most 80 lines and three levels of loops."""
    long = [f.name for f in functions(path) if (f.end_lineno or 0) - f.lineno + 1 > LONGEST_FUNCTION]
    deep = [f.name for f in functions(path) if loops(f) > DEEPEST_LOOPS]
    assert (long, deep) == ([], [])


@pytest.mark.parametrize("path", OUTSIDE_OF_LAYOUT, ids=str)
def test_kernels_are_private_and_their_launcher_follows(path: Path):
    """What comes after a kernel, or after several, launches them one by one."""
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


def test_the_map_in_contributing_is_the_tree():
    """Every module is on it, and nothing that is not there."""
    assert mapped_modules() == {str(path) for path in MODULES} | {"__init__.py"}
