"""Kernels say what they read and write of structs: comment lines above each argument name its fields, and no others."""

from __future__ import annotations

import ast
import importlib
import re

import pytest

from tests.kernel_accesses import (
    ROOT,
    TITLES,
    Access,
    Module,
    Package,
    StructName,
    UnclearError,
    comments_above,
    is_decorated,
    of_package,
    read,
    with_comments,
)

PACKAGE = Package(read)
MODULES = of_package(PACKAGE)
KERNELS = [
    pytest.param(module, kernel, id=f"{module.name.partition('.')[2]}.{kernel.name}")
    for module in MODULES
    for kernel in module.kernels
]


@pytest.mark.parametrize(("module", "kernel"), KERNELS)
def test_a_kernel_names_the_fields_that_it_reads_and_writes(module: Module, kernel: ast.FunctionDef):
    """Directly above a struct: `# Search in: row, obj; out: counts*; both: cause`, in the order of its fields."""
    expected = PACKAGE.expected_comments(module, kernel, TITLES)
    for arg in kernel.args.args:
        if arg.arg in expected:
            lines = expected[arg.arg]
            belongs = "\n".join(f"    {line}" for line in lines)
            why = f"above '{arg.arg}' of {kernel.name} belongs (python -m tests.kernel_accesses --write)\n{belongs}"
            assert comments_above(module, arg) == lines, why


@pytest.mark.parametrize(("module", "kernel"), KERNELS)
def test_a_kernel_rounds_after_each_operation(module: Module, kernel: ast.FunctionDef):
    """A GPU would fuse products with sums, and round once where a CPU rounds twice."""
    if module.name.endswith(".newton"):
        pytest.importorskip("newton")
    options = getattr(importlib.import_module(module.name), kernel.name).module.options
    assert (options["fuse_fp"], options["enable_backward"]) == (False, False)


@pytest.mark.parametrize(("module", "kernel"), KERNELS)
def test_a_kernel_of_a_wave_takes_arrays_in_structs(module: Module, kernel: ast.FunctionDef):
    """Otherwise a CPU compiles it twice, by the strides of the arrays, inlines less, and copies the program at calls.

    Masks are read once in an episode, and columns where a param narrows a region.
    """
    arrays = {arg.arg for arg in kernel.args.args if "wp.array" in ast.unparse(arg.annotation or arg)}
    if {"program", "search"} <= {arg.arg for arg in kernel.args.args}:
        assert arrays <= {"mask", "columns"}


@pytest.mark.parametrize("room", ["collide", "device", "layout", "placement", "program", "reach"])
def test_layouts_need_no_function_that_devices_round_otherwise(room: str):
    """Warp's sines and powers are CUDA's and the C library's; those of device/transforms.py are one and the same."""
    found = r"\bwp\.(a?sinh?|a?cosh?|a?tanh?|atan2|exp2?|log(2|10)?|pow|cbrt|erf)\("
    paths = (ROOT / "sceniris_gym" / room).rglob("*.py")
    assert [path.name for path in paths if re.search(found, path.read_text())] == []


def test_all_other_structs_are_constant():
    """No kernel writes into the program, an arm or its map, so that these need no such lines."""
    assert {struct for module in MODULES for struct in PACKAGE.written_structs(module)} == set(TITLES)


@pytest.mark.parametrize(("module", "kernel"), KERNELS)
def test_arrays_that_a_kernel_writes_are_called_out(module: Module, kernel: ast.FunctionDef):
    """By `_out` at the end of their names, or by the heading of their section; all others are not."""
    accesses, heading, params = PACKAGE.accesses(module, kernel), "", PACKAGE.params(module, kernel)
    for arg in kernel.args.args:
        above = comments_above(module, arg)
        heading = " ".join(above) or heading
        if params[arg.arg].ndim > 0:
            called = re.search(r"\bout\b", f"{arg.arg.replace('_', ' ')} {heading}", re.IGNORECASE) is not None
            assert called == (Access(arg.arg, None, written=True) in accesses), arg.arg


MADE_UP = {
    "pkg.structs": """
@wp.struct
class State:
    size: int
    row: wp.array[int]
    pose: wp.array2d[wp.vec3]
    drawn: wp.array[Drawn]
    count: wp.array[int]

@wp.struct
class Drawn:
    yaw: float
""",
    "pkg.deep": """
from pkg.structs import State

@wp.func
def put(into: wp.array[wp.vec3], i: int):
    into[i] = wp.vec3(0.0)

@wp.func
def _place(other: State, i: int):
    put(other.pose[other.row[i]], i)

@wp.func
def middle(program: int, held: State, i: int) -> float:
    if i < held.row.shape[0]:
        _place(i=i, other=held)
    return 1.0
""",
}


def found_in(body: str, imports: str = "") -> set[str]:
    """Return the accesses of a made-up kernel through its parameters, as `name.field` with < (read) or > (written)."""
    head = "from pkg.structs import State, Drawn\nfrom pkg.deep import middle, put as stow\n" + imports
    kernel = "@wp.kernel\ndef _kernel(s: State, values: wp.array[float], mask: wp.array[bool], n: int):\n"
    text = head + kernel + "\n".join(f"    {line}" for line in body.strip().splitlines())
    package = Package((MADE_UP | {"pkg.made_up": text}).get)
    module = package.module("pkg.made_up")
    assert module is not None
    accesses = package.accesses(module, next(module.kernels))
    return {f"{'>' if a.written else '<'}{a.param}{'.' + a.field if a.field else ''}" for a in accesses}


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("x = s.row[n] + s.size", "<s.row <s.size"),
        ("s.row[n] = 1", ">s.row"),
        ("s.row[s.count[0]] = int(values[n])", ">s.row <s.count <values"),
        ("s.row[n] += 1", "<s.row >s.row"),
        ("at = wp.atomic_add(s.count, 0, s.row[n])", "<s.count >s.count <s.row"),
        ("values[n] = s.pose[n, 0][2]", ">values <s.pose"),
        ("s.pose[n, 0][2] = 1.0", ">s.pose"),
        ("s.drawn[n].yaw = 1.0", ">s.drawn"),
        ("d = s.drawn[n]\nd.yaw = 1.0", "<s.drawn"),
        ("d = Drawn()\nd.yaw = values[n]", "<values"),
        ("for i in range(s.pose.shape[0]):\n    x = i", ""),
        ("if mask:\n    if not mask[n]:\n        return\nwhile s.count[0] > 0:\n    n -= 1", "<mask <s.count"),
        ("a, b = s.row[n], s.count[n]", "<s.row <s.count"),
        ("pose = s.pose[n]\npose[0] = wp.vec3(0.0)", ">s.pose"),
        ("same = s\nsame.row[n] = 1", ">s.row"),
        ("stow(s.pose[n], 0)", ">s.pose"),
        ("x = middle(n, s, s.count[0])", "<s.count <s.row >s.pose"),
        ("local = wp.zeros(shape=(4,), dtype=wp.vec3)\nstow(local, n)", ""),
        ("x = wp.static(len(values))", ""),
    ],
)
def test_reads_and_writes_are_seen(body: str, expected: str):
    """Through two levels of functions of other modules, under other names, and through rows of arrays."""
    assert found_in(body) == set(expected.split())


GROUPED = """
@wp.struct
class State:
    # Rows, of which some wait
    # for another wave
    row: wp.array[int]
    trial: wp.array[int]
    ahead: wp.array[int]  # drawn before

    # Counts
    count: wp.array[int]
    # Poses
    qpos: wp.array[float]
    qvel: wp.array[float]
"""


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("x = s.row[n] + s.trial[n] + s.ahead[n]", ["# State in: rows*"]),
        ("x = s.row[n] + s.trial[n]", ["# State in: row, trial"]),
        ("s.row[n] = s.trial[n] + s.ahead[n]", ["# State in: trial, ahead; out: row"]),
        ("s.count[0] = 1\nx = s.qvel[n]\ns.qpos[n] += x * s.qvel[n]", ["# State in: qvel; out: count; both: qpos"]),
        ("s.qvel[n] = s.qpos[n]\ns.qpos[n] += s.qvel[n]", ["# State both: poses*"]),
        ("x = s.row.shape[0]", []),
    ],
)
def test_a_group_is_named_where_all_of_it_is_touched(body: str, expected: list[str]):
    """By the first word of the comment above its fields, and only if each is read, written, or both."""
    head = "from pkg.structs import State\n@wp.kernel\ndef _kernel(\n"
    args = "    # of another time\n    s: State,\n    n: int,\n):\n"
    text = head + args + "".join(f"    {line}\n" for line in body.splitlines())
    package = Package({"pkg.structs": GROUPED, "pkg.made_up": text}.get)
    titles = {StructName("pkg.structs", "State"): "State"}
    module = package.module("pkg.made_up")
    assert module is not None
    assert package.expected_comments(module, next(module.kernels), titles) == {"s": expected}
    comments = "".join(f"    {line}\n" for line in expected)
    assert with_comments(package, module, titles) == text.replace("    # of another time\n", comments)


@pytest.mark.parametrize(
    "body",
    [
        "unknown(s.row)",
        "wp.tile_load(s.row, 4)",
        "x = s.row if n > 0 else s.count",
        "row = s.row\nrow = s.count",
        "d = Drawn()\nd.rows = s.row",
        "middle(n, s.row, 0)",
        "with s:\n    pass",
        "x = s.row.ptr",
    ],
)
def test_what_cannot_be_followed_is_no_silence(body: str):
    """An array that is handed to something unknown, or kept under a name that stands for several."""
    with pytest.raises(UnclearError):
        found_in(body)


def test_every_kernel_of_the_package_is_seen():
    """Also one inside of a function, were there any."""
    texts = [path.read_text() for path in (ROOT / "sceniris_gym").rglob("*.py")]
    nodes = [node for text in texts for node in ast.walk(ast.parse(text))]
    assert sum(is_decorated(node, "kernel") for node in nodes) == len(KERNELS) > 40
