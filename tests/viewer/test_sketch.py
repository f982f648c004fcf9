"""Sketches: everything that is in one gets onto the page below its name, and goes with it."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.viewer.sketch import BLUE, PALETTE, RED, Sketch
from tests.viewer.pages import page

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")
from viser import ArrowsHandle


def test_a_drawn_sketch_is_on_the_page_until_it_is_drawn_again():
    """Surfaces, lines, arrows, axes and words; drawn again they replace what was there."""
    sketch = Sketch()
    triangle = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    sketch.surfaces.append((triangle, np.array([[0, 1, 2]]), RED, 0.5))
    sketch.outline(triangle, BLUE)
    sketch.arrows.append((triangle[:2], BLUE))
    sketch.axes.append((np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))
    sketch.labels.append(("here", np.zeros(3)))
    assert len(sketch.lines) == 3
    with page() as server:
        names = ["surface0", "lines", "arrow0", "axes", "word0"]
        for _ in range(2):
            sketch.draw(server, "layer", np.array([1.0, 2.0, 3.0]))
            assert all(server.scene.get_handle_by_name(f"/layer/{name}") is not None for name in names)
        frame = server.scene.get_handle_by_name("/layer")
        assert frame is not None
        assert frame.position == pytest.approx([1.0, 2.0, 3.0])
        Sketch().draw(server, "layer", np.zeros(3))
        assert all(server.scene.get_handle_by_name(f"/layer/{name}") is None for name in names)


def test_red_is_only_for_what_is_wrong():
    """No object of a layer has its colour."""
    assert RED not in PALETTE


def test_arrows_are_as_thick_as_it_takes_to_see_them():
    """In a room more than on a table; a short one stays slim."""
    sketch = Sketch()
    for length in (1.0, 0.05):
        sketch.arrows.append((np.array([[0.0, 0.0, 0.0], [length, 0.0, 0.0]]), BLUE))
    with page() as server:
        for size in (1.0, 4.0):
            sketch.draw(server, "layer", np.zeros(3), size)
            long, short = (server.scene.get_handle_by_name(f"/layer/arrow{i}") for i in range(2))
            assert isinstance(long, ArrowsHandle)
            assert isinstance(short, ArrowsHandle)
            assert long.shaft_radius == pytest.approx(0.006 * size)
            assert short.head_length < 0.05 / 2.0
