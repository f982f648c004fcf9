"""Compiled scenes on disk: the same scene to the bit, and nothing that is read is trusted or executed."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import FallbackWarning, ModelWarning
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.layout import compile as compiling
from sceniris_gym.layout import scene_cache
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.scene_cache import VARIABLE, cache_folder, from_arrays, scene_key, store_arrays, to_arrays
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import box_mjcf

LAYOUT = ("qpos", "mocap_pos", "mocap_quat", "status", "present", "grasp", "grasp_qpos", "rejections")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of compiled scenes, which is empty."""
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    return tmp_path / "scenes"


@pytest.fixture
def only_read(monkeypatch: pytest.MonkeyPatch):
    """Return a function from whose call on nothing is compiled any more."""

    def refuse(*_: Any):
        raise AssertionError("it should have come from the cache")

    return lambda: monkeypatch.setattr(compiling, "_compiled", refuse)


def _layouts(compiled: CompiledScene, split: str) -> list[bytes]:
    """Two episodes of 100 worlds."""
    generator = LayoutGenerator(compiled, 100, seed=7, split=split)
    found = []
    for _ in range(2):
        generator.generate()
        found += [getattr(generator.layouts, name).cpu().numpy().tobytes() for name in LAYOUT]
    return found


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("scene", ["mid_16k", "hard_plus", "clutter", "tabletop_lift"])
def test_a_scene_from_the_cache_is_the_scene_that_was_compiled(scene: str, device: str, folder: Path, only_read: Any):
    """Bit by bit: its arrays, and the layouts of both splits. With faces, relations, groups, and an arm with a map."""
    without = compile_scene(scene, device, cache=False)
    assert not folder.exists()
    first = compile_scene(scene, device)
    only_read()
    second = compile_scene(scene, device)
    expected = to_arrays(without)
    for compiled in (first, second):
        arrays = to_arrays(compiled)
        assert set(arrays) == set(expected)
        for name, values in expected.items():
            assert arrays[name].dtype == values.dtype, name
            if name != "program.collider_mesh":  # addresses
                assert arrays[name].tobytes() == values.tobytes(), name
        for split in ("train", "eval"):
            assert _layouts(compiled, split) == _layouts(without, split)
    assert second.placed == without.placed == tuple(o.name for o in without.plan.objects)
    assert (second.slots, second.sides, second.attempts) == (without.slots, without.sides, without.attempts)


def test_grasps_and_gripper_are_the_same(folder: Path, only_read: Any):
    """A scene from the cache has the same arm and the same reach targets on the host."""
    first = compile_scene("tabletop_lift", "cpu").reaching
    only_read()
    second = compile_scene("tabletop_lift", "cpu").reaching
    assert first is not None
    assert second is not None
    assert repr(second.targets) == repr(first.targets)
    assert repr(second.arms[0].gripper) == repr(first.arms[0].gripper)
    assert second.arms[0].arm.hash == first.arms[0].arm.hash
    assert [type(t.tier) for t in second.targets] == [type(t.tier) for t in first.targets]


def _model(**words: Any):
    return build_model(SceneConfig.load({"base": "mid", **words}))


def test_whatever_matters_has_another_key(monkeypatch: pytest.MonkeyPatch):
    """A param that is not in the scene's hash, a number in the model, the start pose, and a version."""
    first = _model()
    keys = [scene_key(_model(), "cpu"), scene_key(_model(name="other"), "cpu")]
    first.mjm.geom_size[3, 0] += 1e-12
    keys.append(scene_key(first, "cpu"))
    first.home_qpos[0] += 1e-12
    keys.append(scene_key(first, "cpu"))
    monkeypatch.setattr(scene_cache, "_sources", lambda: "other versions")
    keys.append(scene_key(first, "cpu"))
    assert len(set(keys)) == len(keys)
    assert scene_key(_model(), "cpu") == scene_key(_model(), "cpu")


def test_warnings_come_again(tmp_path: Path, folder: Path, only_read: Any):
    """At every start, in the same words and of the same classes."""
    ball = {"asset": box_mjcf(tmp_path, "brick", 0.2, 0.2, 60.0), "on": "floor"}
    scene = {"floor": {"size": [0.52, 0.3]}, "objects": {"one": ball, "two": ball}, "restarts": 0, "attempts": 1}

    def heard() -> list[tuple[type, str]]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            compile_scene(scene, "cpu")
        return [(w.category, str(w.message)) for w in caught]

    first = heard()
    assert {ModelWarning, FallbackWarning} <= {kind for kind, _ in first}
    only_read()
    assert heard() == first


class _Executed:
    """Leaves a file behind when it is read from a pickle."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple:
        return (Path.touch, (self.path,))


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-2000])


def _flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[data.index(b"program.vert.npy") + 400] ^= 0xFF  # a number, and not a date or a length, which nobody reads
    path.write_bytes(data)


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _foreign(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, key=np.array("another"))


def _single(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def _lacking(path: Path) -> None:
    held = dict(np.load(path))
    del held["program.vert"]
    with path.open("wb") as file:
        np.savez(file, **held)


def _pickled(path: Path) -> None:
    held = dict(np.load(path))
    held["program.vert"] = np.array([_Executed(path.with_name("executed"))], dtype=object)
    with path.open("wb") as file:
        np.savez(file, **held)


@pytest.mark.parametrize("spoil", [_cut, _flip, _empty, _foreign, _single, _lacking, _pickled])
def test_a_file_that_is_none_is_made_anew(spoil: Any, folder: Path):
    """It is neither used nor executed, and the next start finds a good one."""
    first = compile_scene("mid", "cpu")
    (path,) = folder.iterdir()
    spoil(path)
    spoiled = path.read_bytes()
    second = compile_scene("mid", "cpu")
    assert second.bank.qpos.numpy().tobytes() == first.bank.qpos.numpy().tobytes()
    assert [file.name for file in folder.iterdir()] == [path.name]  # no traces of writing, and nothing executed
    assert path.read_bytes() != spoiled


@pytest.mark.parametrize("spoil", [lambda path: path.chmod(0o666), lambda path: os.chown(path, 12345, -1)])
def test_a_file_that_others_may_write_is_made_anew(spoil: Any, folder: Path):
    """Its numbers become indices in kernels: a well-formed file with other ones would read beyond arrays."""
    if os.geteuid() != 0:
        pytest.skip("needs the right to give files away")
    before = os.umask(0)
    try:
        first = compile_scene("mid", "cpu")
    finally:
        os.umask(before)
    (path,) = folder.iterdir()
    assert path.stat().st_mode & 0o777 == 0o600  # whatever the umask lets others do
    held = dict(np.load(path))
    held["bank.qpos"] += 1.0
    with path.open("wb") as file:
        np.savez(file, **held)
    spoil(path)
    second = compile_scene("mid", "cpu")
    assert second.bank.qpos.numpy().tobytes() == first.bank.qpos.numpy().tobytes()
    assert (path.stat().st_uid, path.stat().st_mode & 0o777) == (0, 0o600)


def test_it_can_be_turned_off_and_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """By the variable of its own, and by that of all caches."""
    monkeypatch.setenv(VARIABLE, "OFF")
    assert cache_folder() is None
    monkeypatch.setenv(VARIABLE, str(tmp_path / "mine"))
    assert cache_folder() == tmp_path / "mine" / "scenes"
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "sceniris_gym" / "scenes"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "sceniris_gym" / "scenes"
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("pwd.getpwuid", {}.__getitem__)  # a user who is not in the list of users
    assert cache_folder() is None


def test_a_folder_that_cannot_be_written_is_no_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A file stands where the folder would."""
    (tmp_path / "scenes").write_text("")
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    assert compile_scene("mid", "cpu").attempts == 10


def test_it_does_not_grow_without_end(folder: Path, monkeypatch: pytest.MonkeyPatch):
    """The file that was not used for longest goes first."""
    monkeypatch.setattr(scene_cache, "MOST_BYTES", 10_000)
    for number in range(5):
        store_arrays(f"scene{number}", {"values": np.zeros(500)})
        os.utime(folder / f"scene{number}.npz", (number, number))
        if number >= 1:
            assert scene_cache.load_arrays("scene0") is not None  # used, so the others are older
    assert sorted(path.name for path in folder.iterdir()) == ["scene0.npz", "scene4.npz"]


def test_what_a_process_left_unfinished_is_removed(folder: Path):
    """Not what another one is writing."""
    folder.mkdir()
    old, new = folder / ".scene.old.tmp", folder / ".scene.new.tmp"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (0, 0))
    store_arrays("scene", {"values": np.zeros(5)})
    assert sorted(path.name for path in folder.iterdir()) == [new.name, "scene.npz"]


def _uploaded(name: str) -> CompiledScene:
    return upload_scene(build_model(SceneConfig.load(name)), "cpu")


@pytest.mark.parametrize("name", ["mid_16k", "tabletop_lift"])
def test_every_field_of_the_device_comes_back(name: str):
    """By the declarations of the structs, which this test reads by itself."""
    compiled = _uploaded(name)
    again = from_arrays(compiled.scene, "cpu", to_arrays(compiled))
    structs: list[tuple[Any, Any, Any]] = [(Program, compiled.program, again.program)]
    if compiled.reaching is not None and again.reaching is not None:
        structs.append((Reach, compiled.reaching.arms[0].view, again.reaching.arms[0].view))
    assert len(structs) == (2 if name == "tabletop_lift" else 1)
    for declared, before, after in structs:
        compared = 0
        for field in set(declared.vars) - {"collider_mesh", "map", "arm"}:
            first, second = getattr(before, field), getattr(after, field)
            if isinstance(first, wp.array):
                assert (second.dtype, second.shape) == (first.dtype, first.shape), field
                first, second = first.numpy(), second.numpy()
            assert np.array_equal(first, second), field
            compared += 1
        assert compared > 30


def test_meshes_are_made_anew():
    """Each from the same triangles, and the program points to the new ones, in their order."""
    compiled = _uploaded("mid_16k")
    again = from_arrays(compiled.scene, "cpu", to_arrays(compiled))
    old, new = (c.program.collider_mesh.numpy() for c in (compiled, again))
    assert ((old > 0) == (new > 0)).all()
    assert not set(old[old > 0]) & set(new[new > 0])
    assert [mesh.id for mesh in again.meshes] == new[new > 0].tolist()
    for first, second in zip(compiled.meshes, again.meshes, strict=True):
        assert (first.points.numpy() == second.points.numpy()).all()


def test_a_tool_without_fingers_comes_back():
    """Its lists of joints are empty, and still lists of addresses."""
    compiled = _uploaded("tabletop_lift")
    assert compiled.reaching is not None
    nothing = np.zeros(0)
    tool = Gripper(1e3, 0.0, 0.0, 0.1, 0.01, 0.0, np.zeros(0, int), nothing, nothing)
    (arm,) = compiled.reaching.arms
    bare = replace(compiled, reaching=compiled.reaching._replace(arms=(replace(arm, gripper=tool),)))
    again = from_arrays(bare.scene, "cpu", to_arrays(bare)).reaching
    assert again is not None
    assert again.arms[0].gripper.qposadr.dtype == int
    assert [values.size for values in again.arms[0].gripper.poses(np.linspace(0.0, 1.0, 3))] == [0, 0]


@pytest.mark.parametrize("name", ["values", "program.vert", "program.nobject", "home_qpos"])
def test_what_is_missing_is_an_error(name: str):
    """No field is left at what Warp would put there."""
    compiled = _uploaded("mid")
    arrays = to_arrays(compiled)
    del arrays[name]
    with pytest.raises(KeyError):
        from_arrays(compiled.scene, "cpu", arrays)
