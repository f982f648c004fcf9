"""Objects that never failed need no waves of their own."""

from dataclasses import replace

import pytest

from benchmarks.wave_profile import count_waves
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.wave.ahead import count_ahead
from sceniris_gym.layout.wave.search import default_size
from tests.layout.starting import starting

SIZE = replace(default_size("cpu"), candidates=4096, busy=4096)
AHEAD = {"mid": "cabinet", "kitchen": "counter shelf cupboard", "drawer_pick": "robot cabinet apple"}


@pytest.mark.parametrize("scene", AHEAD)
def test_what_never_failed_is_drawn_ahead(scene: str):
    """Up to an object that did, a reach target or the last object; each of the others has a wave, as all find room."""
    compiled = compile_scene(scene, "cpu")
    ahead = AHEAD[scene].split()
    assert list(compiled.placed[: count_ahead(compiled, SIZE)]) == ahead
    waves = count_waves(LayoutGenerator(compiled, 4, size=SIZE), None)["waves"]
    assert len(waves) == len(compiled.placed) - len(ahead)


def test_a_cpu_draws_nothing_ahead():
    """One lane has nothing to gain."""
    assert count_ahead(compile_scene("mid", "cpu"), default_size("cpu")) == 0


def test_what_a_start_places_at_a_marker_is_not_drawn_ahead():
    """It is moved there in its wave."""
    compiled = starting()
    assert compiled.placed[count_ahead(compiled, SIZE)] == "apple"
