"""docs/api/surface.txt: the public names with their signatures, so that a change of them is a visible diff.

python -m docs.make_surface
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "api" / "surface.txt"
LAZY = ("", "config", "pictures", "reach", "training")
"""Modules whose names `__init__.pyi` lists."""
PLAIN = ("levels", "libero", "adapters.mjlab")
"""Modules that import their names in `__init__.py`."""
WHOLE = ("adapters.jax", "adapters.newton", "adapters.rsl_rl", "adapters.sb3", "errors")
"""Modules of one file: each name without an underscore that is a class, or listed in `__all__`, is public."""
MODULES = (*LAZY, *PLAIN, *WHOLE, "cli")
Definition = ast.ClassDef | ast.FunctionDef


@cache
def tree_of(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def file_of(module: str) -> Path:
    """Return the file of a module, by its name within the package."""
    path = ROOT.joinpath("sceniris_gym", *module.split(".")) if module else ROOT / "sceniris_gym"
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


@cache
def public(module: str) -> dict[str, tuple[str, str]]:
    """Return the public names of a module: name -> (module that defines it, its name there)."""
    if module == "cli":
        return {"main": ("cli", "main")}
    path = file_of(module)
    if module in WHOLE:
        names = [node.name for node in tree_of(path).body if isinstance(node, Definition)]
        return {name: (module, name) for name in names if not name.startswith("_")}
    found = {}
    for node in tree_of(path.with_suffix(".pyi") if module in LAZY else path).body:
        if isinstance(node, ast.ImportFrom) and node.module:  # other than `errors` and other whole modules
            source = absolute(node, module)
            found |= {alias.asname or alias.name: (source, alias.name) for alias in node.names}
    return found


def absolute(node: ast.ImportFrom, module: str) -> str:
    """Return the module that an import names, within the package."""
    package = module.split(".")[: len(module.split(".")) - node.level + 1] if node.level else []
    return ".".join(part for part in [*package, (node.module or "").removeprefix("sceniris_gym.")] if part)


@cache
def definition(module: str, name: str) -> tuple[Definition | None, str]:
    """Return the class or function of a name, and the module that defines it."""
    for node in tree_of(file_of(module)).body:
        if isinstance(node, Definition) and node.name == name:
            return node, module
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sceniris_gym"):
            if name in [alias.asname or alias.name for alias in node.names]:
                return definition(absolute(node, module), name)
    return None, module


def members(node: ast.ClassDef, module: str) -> dict[str, ast.FunctionDef | ast.AnnAssign]:
    """Return the public methods, properties and fields of a class, with inherited members from the package."""
    found: dict[str, ast.FunctionDef | ast.AnnAssign] = {}
    for base in reversed(node.bases):
        parent, where = definition(module, ast.unparse(base))
        if isinstance(parent, ast.ClassDef):
            found |= members(parent, where)
    for each in node.body:
        if isinstance(each, ast.FunctionDef) and (
            not each.name.startswith("_") or each.name in ("__init__", "__call__")
        ):
            found[each.name] = each
        elif isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name) and each.target.id[0] != "_":
            found[each.target.id] = each
    return found


def lines(module: str, name: str) -> Iterator[str]:
    """Return the signatures of a public name and of its members."""
    full = ".".join(part for part in ("sceniris_gym", module, name) if part)
    node, where = definition(*public(module)[name])
    if isinstance(node, ast.FunctionDef):
        yield f"{full}{signature(node)}"
    elif isinstance(node, ast.ClassDef):
        yield f"{full}({', '.join(map(ast.unparse, node.bases))})"
        for key, each in sorted(members(node, where).items()):
            if isinstance(each, ast.AnnAssign):
                yield f"    {ast.unparse(each)}"
            elif any(ast.unparse(mark) == "property" for mark in each.decorator_list):
                yield f"    {key}: {ast.unparse(each.returns) if each.returns else 'Any'}"
            else:
                yield f"    {key}{signature(each)}"
    else:
        yield full


def signature(node: ast.FunctionDef) -> str:
    """Return the arguments of a function and what it returns."""
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return f"({ast.unparse(node.args)}){returns}"


def surface() -> str:
    """Return the text of the page."""
    return "".join(f"{line}\n" for module in MODULES for name in sorted(public(module)) for line in lines(module, name))


if __name__ == "__main__":
    PAGE.write_text(surface(), encoding="utf-8")
