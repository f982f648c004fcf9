"""The house as CONTRIBUTING.md draws it: every module has its tests, and none grows too large."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.sources import PACKAGE, ROOT, SOURCES, tree_of

MODULES = [path for path in SOURCES if path.name != "__init__.py"]
LONGEST_FUNCTION = 80
DEEPEST_LOOPS = 3
DOCUMENTED = ("sceniris_gym", "envs", "examples", "assets", "benchmarks", "docs", "tests")
PROBES = {"isinstance", "issubclass", "getattr", "hasattr", "type"}
PARTS = {"source", "layout_source", "maker", "generator", "pipeline", "ahead", "chooser", "sampler", "levels"}
STATE = {  # names of modules that hold state, each with its reason beside it
    "config/fields.py: where_now",
    "device/kernel_log.py: _told",
    "device/sequence.py: _LAUNCH_LOCK",
    "layout/ahead.py: _kept_longer",
    "program/notices.py: _noted",
    "progress.py: _listener",
}
EMPTY = {"[]", "{}", "dict()", "list()", "set()"}
HOLDERS = {"ContextVar", "Lock", "RLock", "Event", "Condition", "local", "count", "deque", "defaultdict", "Counter"}
CHANGES = {"add", "append", "clear", "discard", "extend", "insert", "pop", "popitem", "remove", "setdefault", "update"}
CLAUSES = {"What", "Where", "Whether", "How", "Who", "That", "Which"}


def functions(path: Path) -> Iterator[ast.FunctionDef]:
    """Yield the functions and methods of a module, those inside of others too."""
    return (node for node in statements(tree_of(path)) if isinstance(node, ast.FunctionDef))


def inside(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements right inside of a node, and its handlers and cases. Expressions have none."""
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        found = getattr(node, name, ())
        yield from found if isinstance(found, list) else ()


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and the statements in it, those inside of others too."""
    yield node
    for inner in inside(node):
        yield from statements(inner)


def is_kernel(node: ast.AST) -> bool:
    """Return whether a node is a function that Warp compiles as a kernel."""
    return isinstance(node, ast.FunctionDef) and any("kernel" in ast.unparse(d) for d in node.decorator_list)


def left_alone(path: Path) -> Iterator[str]:
    """Yield kernels that are public, and definitions that stand between kernels and their launchers."""
    kernels: list[str] = []
    for node in tree_of(path).body:
        if isinstance(node, ast.FunctionDef) and is_kernel(node):
            kernels.append(node.name)
            if not node.name.startswith("_"):
                yield f"{node.name} is public"
        elif kernels and isinstance(node, ast.FunctionDef | ast.ClassDef):
            launched = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)} & set(kernels)
            if not launched:
                yield f"'{node.name}' stands between {kernels} and their launchers"
            kernels = [name for name in kernels if name not in launched]
    yield from (f"{name} is never launched" for name in kernels)


def state(path: Path) -> Iterator[str]:
    """Yield names of a module that it changes, or that are made to be changed: locks, and tables that are empty."""
    nodes, changed = list(ast.walk(tree_of(path))), set[str]()
    for node in nodes:
        if isinstance(node, ast.Global):
            yield from node.names
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGES:
            changed.add(ast.unparse(node.func.value))
        elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store | ast.Del):
            changed.add(ast.unparse(node.value))
    for node in tree_of(path).body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            names = {
                ast.unparse(target) for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
            }
            made = ast.unparse(node.value.func).split(".")[-1] if isinstance(node.value, ast.Call) else ""
            empty = node.value is not None and ast.unparse(node.value) in EMPTY  # to be filled, maybe elsewhere
            yield from names if empty or made in HOLDERS else names & changed


def loops(node: ast.AST) -> int:
    """Return how many loops stand inside one another, those of functions inside not counted."""
    deepest = max((loops(child) for child in inside(node) if not isinstance(child, ast.FunctionDef)), default=0)
    return deepest + isinstance(node, ast.For | ast.While)


def test_tests_mirror_the_source():
    """A module has tests in a file of its name, in the same folder of tests/."""
    mirrors = [ROOT / "tests" / path.relative_to(PACKAGE).with_name(f"test_{path.name}") for path in MODULES]
    assert [str(path) for path in mirrors if not path.is_file()] == []


def test_functions_are_short_and_flat():
    """At most 80 lines and three levels of loops."""
    found = [(path, function) for path in MODULES for function in functions(path)]
    long = [f"{path}: {f.name}" for path, f in found if (f.end_lineno or 0) - f.lineno + 1 > LONGEST_FUNCTION]
    deep = [f"{path}: {f.name}" for path, f in found if loops(f) > DEEPEST_LOOPS]
    assert (long, deep) == ([], [])


def test_kernels_are_private_and_their_launcher_follows():
    """The function or class after a kernel, or after several, launches it, or them one by one."""
    assert [f"{path}: {wrong}" for path in MODULES for wrong in left_alone(path)] == []


def test_modules_hold_no_state():
    """Objects do; but for the few names of `STATE`, whose reasons stand beside them."""
    found = {f"{path.relative_to(PACKAGE)}: {name}" for path in SOURCES for name in state(path)}
    assert found == STATE


def test_contributing_names_every_room():
    """Each folder of the package is in the table of rooms, and the page stays short."""
    page = (ROOT / "CONTRIBUTING.md").read_text()
    table = page.split("## The rooms")[1].split("\n## ")[0]
    rooms = {f"{path.parent.relative_to(PACKAGE)}/" for path in PACKAGE.rglob("*.py")} - {"./", "importers/"}
    assert [room for room in sorted(rooms) if f"`{room}`" not in table] == []
    assert len(page.encode()) <= 15_000


def test_first_lines_are_sentences_about_the_thing():
    """No docstring opens with a relative clause, or asks a question."""
    offenders = []
    for path in (path for folder in DOCUMENTED for path in sorted((ROOT / folder).rglob("*.py"))):
        for node in statements(tree_of(path)):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (doc := ast.get_docstring(node)):
                first = doc.splitlines()[0]
                if first.split()[0].strip(",") in CLAUSES or first.endswith("?"):
                    offenders.append(f"{path.relative_to(ROOT)}: {first}")
    assert offenders == []


def test_nobody_probes_the_type_of_a_source():
    """A source, its prefetching and its chooser show by methods that all of them have what they do."""
    offenders = []
    for path in SOURCES:
        calls = (node for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call) and node.args)
        for function, of in ((ast.unparse(call.func), ast.unparse(call.args[0])) for call in calls):
            if function in PROBES and of.split(".")[-1].strip("_") in PARTS:
                offenders.append(f"{path}: {function}({of})")
    assert offenders == []
