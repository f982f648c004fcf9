"""Solvers that MuJoCo-Warp lacks, and scenes that do not fit into memory, are refused before anything is allocated."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import MemoryLimitError, NotSupportedError, ScenirisError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator, generator_memory
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import CPU_SIZE
from sceniris_gym.program.checks import simulation
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.scene.build import build_model
from sceniris_gym.sim.fit import make_worlds
from tests.layout.scenes import compile_on_cpu

MODEL = """<mujoco><option solver="{}"/><worldbody><body name="floor"><geom type="box" size="1 1 .1"/></body>
  <body name="a" pos="0 0 .5"><freejoint/><geom type="box" size=".02 .02 .02"/></body></worldbody></mujoco>"""
GIB = 1 << 30


def test_a_solver_that_mujoco_warp_lacks_is_refused_as_a_scene(tmp_path: Path):
    """By compile_scene with the scene's name, so not by the first environment; the others compile."""
    (tmp_path / "mine.yaml").write_text("{model: model.xml, bank: 1, objects: {a: {on: floor}}}")
    (tmp_path / "model.xml").write_text(MODEL.format("PGS"))
    with pytest.raises(NotSupportedError, match=r"mine\.yaml: MuJoCo-Warp has no solver PGS\. Use Newton or CG"):
        compile_scene(tmp_path / "mine.yaml", "cpu", cache=False)
    (tmp_path / "model.xml").write_text(MODEL.format("CG"))
    compile_scene(tmp_path / "mine.yaml", "cpu", cache=False)


def system(monkeypatch: pytest.MonkeyPatch, folder: Path, available: int, limit: str, used: int = 0) -> None:
    """Let the system say these bytes."""
    files = {"_MEMINFO": f"MemTotal: 1 kB\nMemAvailable: {available // 1024} kB\n", "_LIMIT": limit, "_USED": str(used)}
    for name, text in files.items():
        (folder / name).write_text(text)
        monkeypatch.setattr(simulation, name, folder / name)


def test_memory_is_what_the_system_and_the_container_leave(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The lesser of both; a container without a limit says `max`; where nobody says anything, nothing is refused."""
    system(monkeypatch, tmp_path, 8 * GIB, "max")
    assert simulation.free_memory("cpu") == 8 * GIB
    system(monkeypatch, tmp_path, 8 * GIB, str(5 * GIB), 2 * GIB)
    assert simulation.free_memory("cpu") == 3 * GIB
    system(monkeypatch, tmp_path, GIB, str(5 * GIB), 2 * GIB)
    assert simulation.free_memory("cpu") == GIB
    monkeypatch.setattr(simulation, "_MEMINFO", tmp_path / "nowhere")
    assert simulation.free_memory("cpu") is None
    simulation.check_memory("anything", 1 << 60, "cpu", "")


def test_what_does_not_fit_is_told_with_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As a MemoryError too, for those who wait for one; it survives pickling."""
    system(monkeypatch, tmp_path, GIB, "max")
    simulation.check_memory("this", GIB, "cpu", "Use less.")
    with pytest.raises(
        MemoryLimitError, match=r"^this: takes 2\.0 GiB or more, but only 1\.0 GiB are free on cpu. Use less.$"
    ) as caught:
        simulation.check_memory("this", 2 * GIB, "cpu", "Use less.")
    error = caught.value
    assert isinstance(error, ScenirisError)
    assert isinstance(error, MemoryError)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_more_worlds_than_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """By their number and scene, before their arrays are made."""
    system(monkeypatch, tmp_path, GIB, "max")
    with pytest.raises(MemoryLimitError, match=r"mid\.yaml: 16,777,216 worlds: .*Use fewer worlds \(at most"):
        LayoutGenerator(compile_on_cpu("mid"), 1 << 24)
    with pytest.raises(MemoryLimitError, match=r"^make_worlds: 16,777,216 worlds: .*Use fewer worlds \(at most"):
        make_worlds(compile_on_cpu("mid"), 1 << 24)


def test_as_many_worlds_fit_as_the_error_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The number in the error is accepted, and the next one is refused."""
    system(monkeypatch, tmp_path, 3 * GIB, "max")
    parts = (GIB, 1 << 20), (0, 1 << 20)
    with pytest.raises(MemoryLimitError, match=r"^this: 1,025 worlds: takes 3\.0 GiB.*at most 1,024\), or another"):
        simulation.check_worlds("this", 1025, "cpu", *parts)
    memory = simulation.check_worlds("this", 1024, "cpu", *parts)
    assert (memory.needed, memory.most) == (3 * GIB, 1024)
    assert str(memory) == "1,024 worlds take 3.00 GiB of 3.00 GiB free on cpu"
    monkeypatch.setattr(simulation, "_MEMINFO", tmp_path / "nowhere")
    assert str(simulation.check_worlds("this", 1 << 40, "cpu", (0, GIB))).endswith("GiB on cpu")


def test_what_worlds_take_is_all_counted():
    """By the arrays that there are."""
    compiled, taken = compile_on_cpu("mid"), []
    for nworld in (1000, 2000):
        view = LayoutGenerator(compiled, nworld).layouts.view
        arrays = [a for a in (getattr(view, name) for name in LayoutsView.__annotations__) if isinstance(a, wp.array)]
        taken.append(sum(a.size * wp.types.type_size_in_bytes(a.dtype) for a in arrays))
    # a mocap body's two arrays are views of one, whose rows are longer than both
    assert generator_memory(compiled, CPU_SIZE)[1] == pytest.approx((taken[1] - taken[0]) / 1000, rel=0.1)


def test_more_pairs_than_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """By the scene; here pairs are made large instead of many."""
    system(monkeypatch, tmp_path, GIB, "max")
    monkeypatch.setattr(simulation, "_PAIR_BYTES", 2 * GIB)
    with pytest.raises(MemoryLimitError, match=r"the pairs of .* colliders.*Use fewer objects"):
        upload_scene(build_model(SceneConfig.load("mid")), "cpu")
