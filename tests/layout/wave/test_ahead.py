"""Objects that never failed need no waves of their own."""

from dataclasses import replace

import pytest

from benchmarks.wave_profile import count_waves
from sceniris_gym.device import loading, sequence
from sceniris_gym.layout import generate
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.wave import ahead, draw
from sceniris_gym.layout.wave.ahead import count_ahead
from sceniris_gym.layout.wave.search import default_size
from tests.layout.starting import starting

SIZE = replace(default_size("cpu"), candidates=4096, busy=4096)
AHEAD = {"mid": "cabinet", "kitchen": "counter shelf cupboard", "drawer_pick": "robot cabinet apple"}


@pytest.mark.parametrize("scene", AHEAD)
def test_what_never_failed_is_drawn_ahead(scene: str):
    """Up to an object that did, a reach target or the last object; each of the others has a wave, as all find room."""
    compiled = compile_scene(scene, "cpu")
    first = AHEAD[scene].split()
    assert list(compiled.placed[: count_ahead(compiled, SIZE)]) == first
    waves = count_waves(LayoutGenerator(compiled, 4, size=SIZE), None)["waves"]
    assert len(waves) == len(compiled.placed) - len(first)


def test_a_cpu_draws_nothing_ahead():
    """One lane has nothing to gain."""
    assert count_ahead(compile_scene("mid", "cpu"), default_size("cpu")) == 0


def test_what_a_start_places_at_a_marker_is_not_drawn_ahead():
    """It is moved there in its wave."""
    compiled = starting()
    assert compiled.placed[count_ahead(compiled, SIZE)] == "apple"


def test_its_kernel_is_compiled_with_the_kernels_of_the_bank(monkeypatch: pytest.MonkeyPatch):
    """The bank needs no such kernel, but later generators on a GPU, which would compile it alone for 12 s."""
    together = list[set[str]]()
    monkeypatch.setattr(generate, "suited_size", lambda *_: SIZE)
    monkeypatch.setattr(loading, "_is_kept", lambda *_: False)
    monkeypatch.setattr(sequence, "load_modules", lambda all_, _: together.append({module.name for module, _ in all_}))
    compile_scene("mid", "cpu", overrides={"bank": 17})
    assert {draw.__name__, ahead.__name__} <= together[0]
