"""Imports between modules: the order of the house, the places of torch, and the load of `import sceniris_gym`."""

from __future__ import annotations

import gc
import importlib
import inspect
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import sceniris_gym
import sceniris_gym.sim
from docs.make_surface import MODULES
from sceniris_gym import ScenirisError, ScenirisWarning, errors
from tests.sources import PACKAGE, ROOT, SOURCES, imports

ORDER = {  # a module imports its own part of the house and those with a smaller number
    name: rank
    for rank, names in enumerate(
        [
            ["errors", "progress", "collecting", "stopping"],
            ["files"],
            ["device"],
            ["config"],
            ["geometry", "reach"],
            ["scene"],
            ["builders", "grasping", "importers", "audit"],
            ["program"],
            ["collide"],
            ["placement"],
            ["layout"],
            ["levels"],
            ["sim"],
            ["pictures"],
            ["vector"],
            ["adapters", "dataset", "libero"],
            ["training"],
            ["suites"],
            ["commands"],
            ["viewer"],
            ["cli"],
            ["__main__"],
        ]
    )
    for name in names
}
WITH_TORCH = {"vector", "adapters", "dataset", "libero", "training", "suites", "commands", "viewer"}
TORCH_LATER = {"audit/chain.py", "sim/snapshot.py"}
"""Files that import torch where it is used: a judged arm is a SerialChain, and a snapshot's rows are tensors."""
OUTSIDE = {"__init__", "registration"}  # the door of the package: looked at below, by what it loads


def part(path: Path) -> str:
    """Return the part of the house a file belongs to: 'config' for config/scene.py, 'cli' for cli.py."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def loaded_by(statement: str) -> set[str]:
    """Return the modules that a statement loads in a fresh interpreter."""
    code = f"import sys; {statement}; print(*sys.modules)"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_imports_go_one_way():
    """A file imports parts of the house that come before its own; the envs are reached by name only."""
    assert {part(path) for path in SOURCES} - OUTSIDE <= ORDER.keys()
    found = []
    for path in (path for path in SOURCES if part(path) not in OUTSIDE):
        own = part(path)
        for parts in (name.split(".") for name in imports(path)):
            if parts[0] == "sceniris_gym" and len(parts) > 1 and parts[1] != own:
                if ORDER.get(parts[1], ORDER["__main__"]) >= ORDER[own]:
                    found.append(f"{path} imports {'.'.join(parts)}")
    assert found == []


def rooms() -> dict[str, int]:
    """Return the rooms of CONTRIBUTING's table by the number of their line, as 'layout/wave' or 'errors'."""
    table = (ROOT / "CONTRIBUTING.md").read_text().split("## The rooms")[1].split("\n## ")[0]
    lines = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    names = [re.findall(r"`([^`]+)`", line) for line in lines]
    return {name.rstrip("/").removesuffix(".py"): i for i, line in enumerate(names) for name in line}


def test_rooms_import_what_stands_above_them_in_the_table():
    """Themselves, rooms inside of them, and rooms above: the order inside of `program/` and `layout/` counts, too."""
    rank, found = rooms(), []

    def room(name: str) -> str:
        parts = name.split(".")[1:]
        while parts and "/".join(parts) not in rank:
            parts.pop()
        return "/".join(parts)

    for path in (path for path in SOURCES if path.name != "__init__.py" and part(path) not in OUTSIDE):
        own = room(".".join(path.relative_to(ROOT).with_suffix("").parts))
        assert own, f"{path} is in no room"
        for name in imports(path):
            other = room(name) if name.startswith("sceniris_gym.") else own
            if other not in ("", own) and not other.startswith(f"{own}/") and rank[other] >= rank[own]:
                found.append(f"{path} imports {name}")
    assert found == []


def test_no_file_imports_itself_by_way_of_others():
    """There is no cycle among the files, also where only a type is needed."""
    modules = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in SOURCES}
    graph = {name: {other for other in imports(path) if other in modules} for name, path in modules.items()}
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the files


def test_torch_is_imported_only_where_it_may_be():
    """Scenes and layouts are made without torch, and worlds are reset."""
    without = [path for path in SOURCES if part(path) not in WITH_TORCH]
    without = [path for path in without if str(path.relative_to(PACKAGE)) not in TORCH_LATER]
    assert [str(path) for path in without if "torch" in {name.split(".")[0] for name in imports(path)}] == []


def test_only_the_audit_of_an_arm_loads_pytorch_kinematics(loaded: list[set[str]]):
    """One file imports it, and not before it judges an arm: other commands do not wait for it."""
    found = [path for path in SOURCES if "pytorch_kinematics" in {name.split(".")[0] for name in imports(path)}]
    assert found == [PACKAGE / "audit" / "chain.py"]
    judging = loaded_by("import sceniris_gym.cli, sceniris_gym.audit.auditor, sceniris_gym.audit.reach")
    assert "sceniris_gym.audit.chain" in judging
    assert not (judging | loaded[2]) & {"pytorch_kinematics", "torch"}


def test_the_audit_shares_no_code_with_the_generator():
    """The modules that judge layouts import nothing that makes them."""
    sources = [path for path in SOURCES if path.is_relative_to(PACKAGE / "audit")]
    assert sources
    assert not [name for path in sources for name in imports(path) if name.startswith("sceniris_gym.layout")]


@pytest.fixture(scope="module")
def told() -> list[str]:
    """Return what a fresh interpreter tells: its modules with the package, layouts, a reset; and reads of old names."""
    code = """
import sys, sceniris_gym
print("\\ntold:", *sys.modules)
from sceniris_gym import LayoutGenerator, LevelReplay, ResetRandomizer, compile_scene, errors, make_worlds
compiled = compile_scene({"objects": {}}, "cpu")
generator = LayoutGenerator(compiled, 2)
generator.generate()
generator.layouts.ids("train"), generator.rejection_counts(), generator.table()
print("\\ntold:", *sys.modules)
ResetRandomizer(compiled, *make_worlds(compiled, 2)).reset([1])
print("\\ntold:", *sys.modules)
LevelReplay(alpha=0.5)
print("\\ntold:", errors.old_names.cache_info())
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    return [line for line in out.splitlines() if line.startswith("told:")]


@pytest.fixture
def loaded(told: list[str]) -> list[set[str]]:
    """Return the modules that a fresh interpreter has after each step: the package, layouts, a reset."""
    return [set(line.split()) for line in told[:3]]


def test_importing_the_package_loads_nothing_heavy(loaded: list[set[str]]):
    """Only gymnasium and what it needs: no torch, warp, mujoco, trimesh or pydantic."""
    heavy = {"torch", "warp", "mujoco", "mujoco_warp", "trimesh", "shapely", "scipy", "pydantic", "tyro"}
    assert "gymnasium" in loaded[0]
    assert not loaded[0] & heavy


def test_public_modules_are_attributes_of_the_package():
    """Each is imported when its package is asked for it. Those of adapters need their libraries."""
    modules = [module for module in MODULES if module not in ("", "errors") and "." not in module]
    assert sceniris_gym.errors is errors  # at once
    for module in ("adapters", *modules, "adapters.rsl_rl", "adapters.sb3"):
        parent, _, name = f"sceniris_gym.{module}".rpartition(".")
        assert vars(sys.modules[parent])["__getattr__"](name) is sys.modules[f"{parent}.{name}"]


def test_scenes_and_layouts_are_made_without_torch(loaded: list[set[str]]):
    """From the scene to a table on the host, with ids and counts: only who reads a tensor loads torch."""
    assert "warp" in loaded[1]
    assert "torch" not in loaded[1]


def test_scenes_are_compiled_without_mujoco_warp():
    """Its kernels take a second to import, more if they are not imported as `sceniris_gym.sim` does."""
    found = loaded_by("import sceniris_gym; sceniris_gym.compile_scene({'objects': {}}, 'cpu')")
    assert "warp" in found
    assert "mujoco_warp" not in found


def test_a_randomizer_resets_without_torch(loaded: list[set[str]]):
    """Only a snapshot, or who reads a tensor, loads it."""
    assert len(loaded) == 3
    assert "mujoco_warp" in loaded[2]
    assert "torch" not in loaded[2]


def test_old_names_are_read_when_one_is_asked_for(told: list[str]):
    """Not by imports, nor by public names and calls with keywords."""
    assert "misses=0" in told[3]


ON_ANY = {
    "floor": {"size": [2, 2]},
    "objects": {
        "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor"},
        "lemon": {"asset": "lemon", "in": {"any": "cabinet"}},
    },
}


@pytest.mark.parametrize("scene", ["tabletop_lift", ON_ANY], ids=["tabletop_lift", "any"])
def test_a_second_start_imports_what_it_uses(scene: str | dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A scene from the cache needs no meshes, hulls or graphs, which take most of a second to import.

    Its key is the same in another process, which writes no second scene.
    """
    monkeypatch.setenv("SCENIRIS_GYM_CACHE", str(tmp_path))
    sceniris_gym.compile_scene(scene, "cpu")
    kept = sorted(tmp_path.rglob("*.npz"))
    second = loaded_by(
        "import sceniris_gym.vector.vector_env; import sceniris_gym;"
        f"sceniris_gym.LayoutGenerator(sceniris_gym.compile_scene({scene!r}, 'cpu'), 2)"
    )
    assert "mujoco_warp" in second
    assert not second & {"trimesh", "scipy", "networkx", "matplotlib", "PIL"}
    assert kept
    assert kept == sorted(tmp_path.rglob("*.npz"))


@pytest.mark.parametrize("collecting", [True, False])
@pytest.mark.parametrize("frozen", [True, False])
def test_the_garbage_collector_is_left_as_it_was(collecting: bool, frozen: bool):
    """It is paused while MuJoCo-Warp is imported."""
    before = gc.isenabled()
    gc.unfreeze()  # of what `conftest` froze
    try:
        if frozen:
            gc.freeze()
        if not collecting:
            gc.disable()
        importlib.reload(sceniris_gym.sim)
        assert gc.isenabled() is collecting
        assert (gc.get_freeze_count() > 0) is frozen
    finally:
        gc.unfreeze()
        (gc.enable if before else gc.disable)()


def test_every_public_name_is_there():
    """Each name of the stub can be had from the package, and is listed by dir()."""
    assert [name for name in sceniris_gym.__all__ if getattr(sceniris_gym, name, None) is None] == []
    assert set(sceniris_gym.__all__) <= set(dir(sceniris_gym))


def test_every_error_and_warning_is_of_one_base_each():
    """So that users can catch all errors by one class, and filter all warnings by another or each by its own."""
    kinds = [kind for name, kind in inspect.getmembers(errors, inspect.isclass) if name.endswith(("Error", "Warning"))]
    assert sceniris_gym.errors.ModelWarning in kinds
    for kind in kinds:
        assert issubclass(kind, ScenirisWarning if issubclass(kind, Warning) else ScenirisError)
    sources = [path for path in SOURCES if path != PACKAGE / "errors.py"]
    assert not [path for path in sources if re.search(r"class \w+\(.*Warning\)", path.read_text())]


def test_an_unknown_name_is_an_attribute_error():
    """As for any module."""
    with pytest.raises(AttributeError, match="attribute SceneConfigg"):
        _ = sceniris_gym.SceneConfigg  # pyrefly: ignore[missing-attribute]
