"""The process in which Scene Synthesizer works: attempts are counted as the paper counts them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.paper.synthesizer_process import make_scene

WORDS = {"attempts": 10, "drawer": "cabinet_upper_drawer", "joints": {"upper": [0.1, 0.2], "lower": [0.0, 0.05]}}
ASSETS: dict[str, Any] = dict.fromkeys(("floor", "cabinet", "apple", "banana"))


class Synth:
    """A stand-in for Scene Synthesizer, which places everything but `refused` and notes what it is asked."""

    def __init__(self, refused: str = "") -> None:
        self.refused = refused
        self.asked: list[tuple[str, dict[str, Any]]] = []

    def Scene(self, seed: Any) -> Synth:
        """Return the scene, which is itself."""
        return self

    def add_object(self, asset: Any, name: str, **words: Any) -> None:
        """Note it."""
        self.asked.append((name, words))

    def label_support(self, name: str, **words: Any) -> None:
        """Note it."""
        self.asked.append((f"label {name}", words))

    def update_configuration(self, values: list[float], **words: Any) -> None:
        """Note it."""
        self.asked.append(("joints", {"values": values, **words}))

    def place_object(self, name: str, asset: Any, **words: Any) -> bool:
        """Note it, and refuse one of them."""
        self.asked.append((name, words))
        return name != self.refused

    def get_transform(self, name: str) -> np.ndarray:
        """Return a pose."""
        return np.eye(4)


def test_drawers_are_drawn_before_anything_is_put_beside_them():
    """Ten attempts are nine retries; the banana is for the drawer."""
    synth = Synth()
    scene = make_scene(synth, ASSETS, WORDS, np.random.default_rng(0))
    assert scene is not None
    asked = [name for name, _ in synth.asked]
    assert asked == ["floor", "label floor", "cabinet", "joints", "apple", "label drawer", "banana"]
    words = dict(synth.asked)
    assert words["banana"] == {"support_id": "drawer", "max_iter": 9}
    assert 0.1 <= scene["joints"]["upper"] <= 0.2
    assert words["joints"]["values"] == list(scene["joints"].values())
    assert set(scene["poses"]) == {"cabinet", "apple", "banana"}


@pytest.mark.parametrize("refused", ["cabinet", "apple", "banana"])
def test_a_scene_without_room_is_none(refused: str):
    """Nothing is placed after what had no room."""
    synth = Synth(refused)
    assert make_scene(synth, ASSETS, WORDS, np.random.default_rng(0)) is None
    assert synth.asked[-1][0] == refused
