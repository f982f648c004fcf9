"""The list of columns: all that has rows of layouts takes its columns from the list, or is compared with it here."""

from __future__ import annotations

import ast
from typing import Any

import pytest

from sceniris_gym.layout.columns import BANKED, NEXT, columns, row_types
from sceniris_gym.layout.layout_id import ChosenLayouts
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.layout.stored import INTEGERS
from sceniris_gym.layout.tables import PARTS
from sceniris_gym.levels.buffer import Buffer, Episodes
from sceniris_gym.program.device_bank import Bank
from sceniris_gym.scene.layout_table import COLUMNS, Column
from sceniris_gym.sim.write import Poses
from tests.kernel_accesses import Kind, Package, StructName, read
from tests.layout.scenes import compiled_from
from tests.scene.memory import NEAR, cubes_on, spec_of

PACKAGE = Package(read)
VIEW = StructName("sceniris_gym.layout.layouts", "LayoutsView")
STATE = {*columns("pose")} - {"present", "start"}
"""Columns of the state of a world, which tables, audits and foreign libraries share."""


def line(name: str, column: Column) -> str:
    """Return the line of a struct that declares a column: vectors and quaternions are elements, and so are flags."""
    kinds = {"uint64": "wp.uint64", "int32": "int", "bool": "int", "float32": "float"}
    # pyrefly: ignore[bad-argument-type]
    wide = {3: "wp.vec3", 4: "wp.quat"}.get(column.shape[-1]) if column.shape else None
    ndim = 1 + len(column.shape) - (wide is not None)
    return f"{name}: wp.array{f'{ndim}d' if ndim > 1 else ''}[{wide or kinds[column.dtype]}]"


def declared(struct: Any) -> set[str]:
    """Return the lines that declare the fields of a struct."""
    module = PACKAGE.module(struct.cls.__module__)
    assert module is not None
    body = module.definitions[struct.key]
    return {ast.unparse(node) for node in ast.walk(body) if isinstance(node, ast.AnnAssign)}


def copied_by(name: str) -> tuple[set[str | None], set[str | None]]:
    """Return the columns that a function of layout/layouts.py reads of a row and writes into another."""
    module = PACKAGE.module(VIEW.module)
    assert module is not None
    function = module.definitions[name]
    assert isinstance(function, ast.FunctionDef)
    found = PACKAGE.accesses(module, function, {"source": Kind(0, VIEW)})
    return {a.field for a in found if a.param == "source"}, {a.field for a in found if a.written}


@pytest.mark.parametrize(("struct", "names"), [(LayoutsView, columns()), (Bank, BANKED)])
def test_a_struct_with_rows_of_layouts_declares_their_columns(struct: Any, names: tuple[str, ...]):
    """Each in a line of its own, with the type that the list says."""
    assert [text for name in names if (text := line(name, COLUMNS[name])) not in declared(struct)] == []


@pytest.mark.parametrize(
    ("function", "parts"),
    [("copy_poses", ["pose"]), ("copy_layout", ["pose", "grasp"]), ("copy_draws", ["draw"])],
)
def test_a_copied_row_has_all_columns_of_its_parts(function: str, parts: list[str]):
    """None is left behind, and no other is overwritten."""
    wanted = {*columns(*parts)}
    assert [wanted ^ found for found in copied_by(function)] == [set(), set()]


def written_by(module: str, name: str) -> set[str | None]:
    """Return the columns of layouts that a kernel writes."""
    found = PACKAGE.module(f"sceniris_gym.layout.{module}")
    assert found is not None
    kernel = next(kernel for kernel in found.kernels if kernel.name == name)
    return {access.field for access in PACKAGE.accesses(found, kernel) if access.written} & {*columns()}


def test_a_layout_that_is_served_has_all_columns():
    """The kernels that serve layouts write each of them; a stored one is not made, so nothing is counted."""
    assert written_by("ahead", "_serve") ^ {*columns()} == set()
    assert {*columns("count")} <= written_by("wave.settle", "_settle")
    stored = written_by("stored", "_make") | written_by("seeds", "_close")
    assert stored ^ {*columns()} == {"attempts", "first_pass_valid"}


def test_public_layouts_have_all_columns_and_the_bank_no_others():
    """`Layouts` has an attribute for each."""
    assert {*columns()} - vars(Layouts).keys() == set()
    assert {*BANKED, "ntrain"} ^ Bank.vars.keys() == set()  # pyrefly: ignore[missing-attribute]


def test_all_that_names_a_layout_has_its_key():
    """The next layout of a world, levels, episodes that are over, and the layouts that a reset asks for."""
    key = {*columns("key")}
    assert {*NEXT} == {f"next_{name}" for name in key} <= LayoutsView.vars.keys()  # pyrefly: ignore[missing-attribute]
    assert key | {*NEXT} <= Buffer.vars.keys()  # pyrefly: ignore[missing-attribute]
    assert key <= {*Episodes._fields}
    assert key == {*ChosenLayouts._fields} - {"given"}


def test_all_that_has_a_state_has_all_of_it():
    """Kernels that write resets, the record of rejected candidates, and arrays for JAX, which get the status, too."""
    assert Poses.vars.keys() == STATE  # pyrefly: ignore[missing-attribute]
    names: list[str] = [*LayoutsView.vars]  # pyrefly: ignore[missing-attribute]
    assert STATE | {"count", "cause", "object"} == {
        name.removeprefix("rejected_") for name in names if name.startswith("rejected_")
    }
    assert STATE | {"status"} == {*PARTS}


def test_all_integers_but_counts_have_bounds():
    """Indices and flags that kernels trust are checked where layouts come in; seeds may be any."""
    kept = {name for name in columns() if COLUMNS[name].dtype in ("int32", "bool")}
    assert {*INTEGERS, "attempts", "first_pass_valid"} ^ kept == set()


def test_a_row_has_its_shape_by_the_widths_of_the_scene():
    """Widths that a scene does not have are 0 unless they are given, and wide types come first."""
    compiled = compiled_from(spec_of(), cubes_on("ground", 2, region=NEAR))
    found = row_types(compiled, nvalue=5)
    assert found["qpos"] == ("float32", (compiled.mjm.nq,))
    assert (found["present"], found["param"]) == (("bool", (2,)), ("float32", (5,)))
    assert (found["grasp_pose"], found["grasp_qpos"]) == (("float32", (0, 7)), ("float32", (0, 0)))
