"""Reads and writes of Warp kernels, found in their syntax trees and in those of all functions that they call.

An access belongs to a parameter of the kernel: to an array, or to a field of a struct. The size of an array is no read
of it. An atomic operation and an augmented assignment both read and write. Anything that cannot be followed, such as an
array handed to an unknown function, raises `UnclearError`, so that no access is missed in silence.

`python -m tests.kernel_accesses --write` writes the comment lines of all kernels, which tests/test_kernels.py compares.
"""

from __future__ import annotations

import argparse
import ast
import builtins
import textwrap
from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NamedTuple

Mode = Literal["read", "write", "both"]
Definition = ast.FunctionDef | ast.ClassDef | ast.Assign
WIDTH = 120


class UnclearError(Exception):
    """Code in which reads and writes cannot be followed."""


class Access(NamedTuple):
    """A read or a write through a parameter: of its field, or of itself if `field` is None."""

    param: str
    field: str | None
    written: bool


class StructName(NamedTuple):
    """The module and the name of a Warp struct."""

    module: str
    name: str


@dataclass(frozen=True)
class Kind:
    """A declared type: an array of so many dimensions, 0 for a single value; of structs, or of numbers and vectors."""

    ndim: int
    struct: StructName | None


@dataclass(frozen=True)
class Origin:
    """The parameter, and the field of it, that an array or a struct in a function's body comes from."""

    param: str
    field: str | None
    kind: Kind


@dataclass
class Module:
    """The syntax tree of a module, and the names in it."""

    name: str
    text: str
    definitions: dict[str, Definition] = field(init=False, default_factory=dict)
    imports: dict[str, tuple[str, str]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        for node in self.tree.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                self.definitions[node.name] = node
            elif isinstance(node, ast.Assign):
                self.definitions |= {target.id: node for target in node.targets if isinstance(target, ast.Name)}
            elif isinstance(node, ast.ImportFrom) and node.module:
                self.imports |= {alias.asname or alias.name: (node.module, alias.name) for alias in node.names}

    @cached_property
    def tree(self) -> ast.Module:
        """The syntax tree."""
        return ast.parse(self.text)

    @property
    def kernels(self) -> Iterator[ast.FunctionDef]:
        """The kernels, in the order of the file."""
        for node in ast.walk(self.tree):
            if isinstance(node, ast.FunctionDef) and is_decorated(node, "kernel"):
                yield node


def is_decorated(node: ast.AST, name: str) -> bool:
    """Return True if a function or class is decorated by `wp.<name>` or `wp.<name>(...)`."""
    if not isinstance(node, ast.FunctionDef | ast.ClassDef):
        return False
    return any(ast.unparse(d).partition("(")[0] == f"wp.{name}" for d in node.decorator_list)


class Package:
    """Kernels, functions and structs by module.

    Args:
        read: Return the text of a module, or None for one that is not part of the package.
    """

    def __init__(self, read: Callable[[str], str | None]) -> None:
        self._read = read
        self._modules: dict[str, Module | None] = {}
        self._accesses: dict[tuple[object, ...], frozenset[Access]] = {}

    def module(self, name: str) -> Module | None:
        """Return a module of the package; None for any other."""
        if name not in self._modules:
            text = self._read(name)
            self._modules[name] = None if text is None else Module(name, text)
        return self._modules[name]

    def resolve(self, module: Module, name: str) -> tuple[Module, Definition] | None:
        """Find what a name of a module stands for, through imports; None if that is outside of the package."""
        if name in module.definitions:
            return module, module.definitions[name]
        if name in module.imports:
            other, original = module.imports[name]
            found = self.module(other)
            return None if found is None else self.resolve(found, original)
        return None

    def kind(self, module: Module, annotation: ast.expr | None) -> Kind:
        """Return what an annotation of a parameter or field declares."""
        if isinstance(annotation, ast.Subscript):
            text = ast.unparse(annotation.value)
            if text.startswith("wp.array"):
                digits = text.removeprefix("wp.array").removesuffix("d")
                return Kind(int(digits or 1), self.kind(module, annotation.slice).struct)
        if isinstance(annotation, ast.Name):
            found = self.resolve(module, annotation.id)
            if found is not None and isinstance(found[1], ast.ClassDef) and is_decorated(found[1], "struct"):
                return Kind(0, StructName(found[0].name, found[1].name))
        elif annotation is None or ast.unparse(annotation) == "wp.array":
            raise UnclearError(f"{module.name}: a parameter or field without the type of its elements")
        return Kind(0, None)

    def fields(self, struct: StructName) -> dict[str, Kind]:
        """Return the fields of a struct in order."""
        module = self.module(struct.module)
        assert module is not None
        definition = module.definitions[struct.name]
        assert isinstance(definition, ast.ClassDef)
        declared = [node for node in definition.body if isinstance(node, ast.AnnAssign)]
        return {ast.unparse(node.target): self.kind(module, node.annotation) for node in declared}

    def groups(self, struct: StructName) -> dict[str, str]:
        """Return the group of each field below a comment on a line of its own: its first word, in small letters."""
        module = self.module(struct.module)
        assert module is not None
        definition, lines = module.definitions[struct.name], module.text.splitlines()
        found, group = {}, ""
        for node in (node for node in ast.walk(definition) if isinstance(node, ast.AnnAssign)):
            row = node.lineno - 2
            while lines[row].lstrip().startswith("#"):
                group, row = lines[row].strip("# :").split()[0].strip(",:").lower(), row - 1
            found[ast.unparse(node.target)] = group
        return found

    def holds_arrays(self, kind: Kind) -> bool:
        """Return True for an array, and for a struct with an array in it."""
        if kind.ndim > 0:
            return True
        return kind.struct is not None and any(map(self.holds_arrays, self.fields(kind.struct).values()))

    def params(
        self, module: Module, function: ast.FunctionDef, given: Mapping[str, Kind] = MappingProxyType({})
    ) -> dict[str, Kind]:
        """Return the parameters of a kernel or function in order; those declared as `Any` are what a call gives."""
        return {arg.arg: given.get(arg.arg) or self.kind(module, arg.annotation) for arg in function.args.args}

    def accesses(
        self, module: Module, function: ast.FunctionDef, given: Mapping[str, Kind] = MappingProxyType({})
    ) -> frozenset[Access]:
        """Return what a kernel or function reads and writes through its parameters; `given` as in `params`."""
        key = module.name, function.name, *sorted(given.items(), key=repr)
        if key not in self._accesses:
            self._accesses[key] = frozenset(_Body(self, module, function, given).found)
        return self._accesses[key]

    def written_structs(self, module: Module) -> set[StructName]:
        """Return the structs that any kernel of a module writes into."""
        found = set()
        for kernel in module.kernels:
            params = self.params(module, kernel)
            for access in self.accesses(module, kernel):
                struct = params[access.param].struct
                if access.written and access.field is not None and struct is not None:
                    found.add(struct)
        return found

    def expected_comments(
        self, module: Module, kernel: ast.FunctionDef, titles: Mapping[StructName, str]
    ) -> dict[str, list[str]]:
        """Return the comment lines that belong above the parameters of a kernel whose struct has a title."""
        found, accesses = {}, self.accesses(module, kernel)
        for name, kind in self.params(module, kernel).items():
            if kind.struct is not None and kind.struct in titles:
                read = {a.field for a in accesses if a.param == name and not a.written}
                written = {a.field for a in accesses if a.param == name and a.written}
                ways = {"in": read - written, "out": written - read, "both": read & written}
                groups = {way: ", ".join(self._in_groups(kind.struct, names)) for way, names in ways.items() if names}
                told = [f"{way}: {names}" for way, names in groups.items()]
                text = f"# {titles[kind.struct]} {'; '.join(told)}"
                found[name] = textwrap.wrap(text, WIDTH - 4, subsequent_indent="#   ", break_long_words=False)
                found[name] *= bool(told)
        return found

    def _in_groups(self, struct: StructName, names: Set[str | None]) -> list[str]:
        """Return fields of a struct in their order, each group of which all are named as one, such as `rows*`."""
        members: dict[str, list[str]] = {}
        for name, group in self.groups(struct).items():
            members.setdefault(group or name, []).append(name)
        whole = {n: f"{group}*" for group, of in members.items() if len(of) > 1 and names >= {*of} for n in of}
        return list(dict.fromkeys(whole.get(name, name) for name in self.fields(struct) if name in names))


def comments_above(module: Module, arg: ast.arg) -> list[str]:
    """Return the comment lines directly above a parameter."""
    lines, above = module.text.splitlines(), []
    row = arg.lineno - 2
    while lines[row].lstrip().startswith("#"):
        above.append(lines[row].strip())
        row -= 1
    return above[::-1]


class _Body:
    """The accesses of one kernel or function, found statement by statement."""

    def __init__(self, package: Package, module: Module, function: ast.FunctionDef, given: Mapping[str, Kind]) -> None:
        self._package, self._module, self._function = package, module, function
        self.found: set[Access] = set()
        # arrays and structs by local name, those of parameters first
        self._origins = {
            name: Origin(name, None, kind)
            for name, kind in package.params(module, function, given).items()
            if kind.ndim > 0 or kind.struct is not None
        }
        self._statements(function.body)

    def _unclear(self, node: ast.AST, why: str) -> UnclearError:
        where = f"{self._module.name}:{getattr(node, 'lineno', '?')}: {self._function.name}"
        return UnclearError(f"{where}: {why}: {ast.unparse(node)}")

    def _record(self, origin: Origin, mode: Mode) -> None:
        if mode != "write":
            self.found.add(Access(origin.param, origin.field, written=False))
        if mode != "read":
            self.found.add(Access(origin.param, origin.field, written=True))

    def _statements(self, statements: list[ast.stmt]) -> None:
        for node in statements:
            match node:
                case ast.Assign(targets=[target], value=value):
                    self._assign(target, value)
                case ast.AugAssign(target=ast.Name(), value=value):
                    self._value(value)
                case ast.AugAssign(target=target, value=value):
                    self._value(value)
                    self._follow(target, "both")
                case ast.Expr(value=value):
                    self._value(value)
                case ast.If(test=test, body=body, orelse=orelse) | ast.While(test=test, body=body, orelse=orelse):
                    self._follow(test)  # `if mask:` asks for the array itself
                    self._statements(body + orelse)
                case ast.For(iter=iterated, body=body):
                    self._value(iterated)
                    self._statements(body)
                case ast.Return(value=value):
                    if value is not None:
                        self._value(value)
                case ast.Continue() | ast.Break() | ast.Pass():
                    pass
                case _:
                    raise self._unclear(node, "a statement of an unknown kind")

    def _assign(self, target: ast.expr, value: ast.expr) -> None:
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            for left, right in zip(target.elts, value.elts, strict=True):
                self._assign(left, right)
        elif isinstance(target, ast.Name):
            origin, known = self._follow(value), self._origins.get(target.id)
            if known is not None and known != origin and self._package.holds_arrays(known.kind):
                raise self._unclear(target, "an array or struct under a name that stood for another one")
            if origin is not None:
                self._origins[target.id] = origin
        else:
            self._value(value)
            for part in target.elts if isinstance(target, ast.Tuple) else [target]:
                if not isinstance(part, ast.Name):
                    self._follow(part, "write")

    def _value(self, node: ast.expr) -> None:
        """Evaluate an expression to a value; one that stands for arrays could not be followed from there on."""
        origin = self._follow(node)
        if origin is not None:
            if self._package.holds_arrays(origin.kind):
                raise self._unclear(node, "an array or struct that is not only indexed or handed to a function")
            self._record(origin, "read")

    def _follow(self, node: ast.expr, mode: Mode = "read") -> Origin | None:
        """Evaluate an expression: return the array or struct that it stands for, or record the access to a value."""
        match node:
            case ast.Name(id=name):
                return self._origins.get(name)
            case ast.Attribute(value=value, attr=name):
                return self._attribute(node, self._follow(value, mode), name, mode)
            case ast.Subscript(value=value, slice=index):
                origin = self._follow(value, mode)
                self._value(index)
                return None if origin is None else self._element(node, origin, index, mode)
            case ast.Call():
                self._call(node)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                self._follow(operand)
            case _:
                for child in ast.iter_child_nodes(node):
                    if isinstance(child, ast.expr):
                        self._value(child)
        return None

    def _attribute(self, node: ast.expr, origin: Origin | None, name: str, mode: Mode) -> Origin | None:
        if origin is None or (origin.kind.ndim > 0 and name == "shape"):
            return None
        if origin.kind.ndim > 0 or origin.kind.struct is None:
            raise self._unclear(node, "an attribute of an array other than its shape")
        kind = self._package.fields(origin.kind.struct)[name]
        found = Origin(origin.param, origin.field or name, kind)
        if kind.ndim > 0 or kind.struct is not None:
            return found
        if mode != "write":  # a struct is a copy of the caller's, whose numbers stay what they are
            self._record(found, "read")
        return None

    def _element(self, node: ast.expr, origin: Origin, index: ast.expr, mode: Mode) -> Origin | None:
        indices = index.elts if isinstance(index, ast.Tuple) else [index]
        left = origin.kind.ndim - len(indices)
        if left < 0 or any(isinstance(i, ast.Slice) for i in indices):
            raise self._unclear(node, "an index that is no element and no row of an array")
        if left > 0:
            return Origin(origin.param, origin.field, Kind(left, origin.kind.struct))
        self._record(origin, mode)
        return None

    def _call(self, node: ast.Call) -> None:
        name = ast.unparse(node.func)
        if name == "wp.static":
            return
        arguments = [*node.args, *(word.value for word in node.keywords)]
        if name.startswith("wp.atomic_") or name == "wp.lower_bound":
            origin = self._follow(arguments[0])
            if origin is not None:
                self._record(origin, "both" if "atomic" in name else "read")
            arguments = arguments[1:]
        elif isinstance(node.func, ast.Name):
            found = self._package.resolve(self._module, name)
            if found is not None and isinstance(found[1], ast.FunctionDef) and is_decorated(found[1], "func"):
                self._call_function(node, found[0], found[1])
                return
            if found is None and name not in self._module.imports and not hasattr(builtins, name):
                raise self._unclear(node, "a call of something unknown")
        elif not name.startswith("wp."):
            raise self._unclear(node, "a call of something unknown")
        for argument in arguments:
            self._value(argument)

    def _call_function(self, node: ast.Call, module: Module, function: ast.FunctionDef) -> None:
        params = self._package.params(module, function)
        handed = list(zip(params, node.args, strict=False)) + [(str(word.arg), word.value) for word in node.keywords]
        open_ones = {arg.arg for arg in function.args.args if arg.annotation and ast.unparse(arg.annotation) == "Any"}
        given = {p: o.kind for p, argument in handed if p in open_ones and (o := self._follow(argument)) is not None}
        params |= given
        accesses = self._package.accesses(module, function, given)
        for param, argument in handed:
            origin = self._follow(argument)
            if origin is None:
                continue
            if self._package.holds_arrays(origin.kind) and origin.kind != params[param]:
                raise self._unclear(node, f"'{param}' is declared as something else than it gets")
            for access in accesses:
                if access.param == param:
                    mode = "write" if access.written else "read"
                    self._record(Origin(origin.param, origin.field or access.field, origin.kind), mode)


ROOT = Path(__file__).parents[1]
TITLES = {
    StructName("sceniris_gym.layout.wave.search", "Search"): "Search",
    StructName("sceniris_gym.layout.wave.sides", "Regions"): "Regions",
    StructName("sceniris_gym.layout.reaching.search", "ReachSearch"): "ReachSearch",
    StructName("sceniris_gym.layout.layouts", "LayoutsView"): "Layouts",
    StructName("sceniris_gym.sim.derived_tables", "Derived"): "Derived",
    StructName("sceniris_gym.sim.write", "Poses"): "Poses",
    StructName("sceniris_gym.levels.buffer", "Buffer"): "Buffer",
}
"""Structs whose accesses stand before a kernel, with their names there."""


def path_of(name: str) -> Path:
    """Return the file of a module of this repository."""
    return ROOT / f"{name.replace('.', '/')}.py"


def read(name: str) -> str | None:
    """Return the text of a module of the package, or None."""
    return path_of(name).read_text() if name.startswith("sceniris_gym.") and path_of(name).is_file() else None


def of_package(package: Package) -> list[Module]:
    """Return the modules of sceniris_gym with kernels."""
    paths = [path for path in sorted((ROOT / "sceniris_gym").rglob("*.py")) if "@wp.kernel" in path.read_text()]
    modules = [package.module(".".join(path.relative_to(ROOT).with_suffix("").parts)) for path in paths]
    return [module for module in modules if module is not None]


def with_comments(package: Package, module: Module, titles: Mapping[StructName, str]) -> str:
    """Return the text of a module with the comment lines that belong above the parameters of its kernels."""
    lines = module.text.splitlines()
    args = [(arg, kernel) for kernel in module.kernels for arg in kernel.args.args]
    for arg, kernel in sorted(args, key=lambda pair: -pair[0].lineno):
        belongs = package.expected_comments(module, kernel, titles).get(arg.arg)
        if belongs is not None:
            row = arg.lineno - 1
            lines[row - len(comments_above(module, arg)) : row] = [f"    {line}" for line in belongs]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Name the files whose comment lines differ, or write them."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--write", action="store_true", help="write the lines")
    package, write = Package(read), parser.parse_args().write
    for module in of_package(package):
        if (text := with_comments(package, module, TITLES)) != module.text:
            print(path_of(module.name).relative_to(ROOT))
            if write:
                path_of(module.name).write_text(text)


if __name__ == "__main__":
    main()
