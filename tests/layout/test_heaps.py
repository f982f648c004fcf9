"""Layouts with heaps, in MuJoCo C's poses: all things of a heap lie in the bin as one of the rows has them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import compile_on_cpu, make, posed, read, write_mjcf
from tests.scene.heaping import THINGS, folder, words
from tests.versions import since_4


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """A bin of blocks on the floor, and a mug near one of them."""
    mug = {"asset": "mug", "on": "floor", "relations": [{"near": "a", "distance": {"max": 0.4}}]}
    scene = words(folder())
    scene["objects"]["mug"] = mug
    return compile_on_cpu(scene, bank=8)


def row_of(data: mujoco.MjData, pos: np.ndarray, quat: np.ndarray) -> int:
    """The settled row that the things lie in, exactly."""
    mat, at = data.body("bin").xmat.reshape(3, 3), data.body("bin").xpos
    found = np.array([mat.T @ (data.body(name).xpos - at) for name in THINGS])
    off = np.abs(pos - found).max((1, 2))
    row = int(off.argmin())
    assert off[row] < 1e-6
    for i, name in enumerate(THINGS):
        settled = np.zeros(9)
        mujoco.mju_quat2Mat(settled, quat[row, i].astype(float))
        assert mat.T @ data.body(name).xmat.reshape(3, 3) == pytest.approx(settled.reshape(3, 3), abs=2e-6)
    return row


def test_all_things_of_a_heap_are_those_of_one_row(compiled: CompiledScene):
    """Wherever the bin stands, and each row as often as the others."""
    with np.load(folder() / "pile.npz") as stored:
        pos, quat = stored["pos"], stored["quat"]
    rows = make(compiled, 300)
    assert (rows.status == LayoutStatus.VALID).all()
    counts = np.bincount([row_of(data, pos, quat) for data in posed(compiled, rows)], minlength=len(pos))
    assert len(counts) == 5
    assert ((counts - 60) ** 2 / 60).sum() < 18.5  # chi-squared with four degrees of freedom, 1e-3


def test_layouts_with_heaps_depend_on_seed_and_episode_alone(compiled: CompiledScene):
    """The same for fewer worlds, and other ones in the next episode."""
    few, many = make(compiled, 7), make(compiled, 40)
    assert few.bits() == many[:7].bits()
    generator = LayoutGenerator(compiled, 7)
    generator.generate()
    generator.generate()
    assert not np.array_equal(generator.layouts.qpos.numpy(), few.qpos)


@since_4("it settles other heaps, and the rod leaves one of them alone")
def test_what_stands_in_the_way_of_a_row_keeps_it_from_being_served(tmp_path: Path):
    """A rod that hangs into the bin, through a block of the first row: the others are served, after restarts."""
    with np.load(folder() / "pile.npz") as stored:
        pos, quat = stored["pos"], stored["quat"]
    x, y, z = pos[0, 0]
    rod = f'<geom type="capsule" fromto="{x} {y} {z} {x} {y} .5" size=".002"/>'
    scene = words(folder())
    scene["objects"]["bin"] |= {"region": {"box": [[-0.001, -0.001], [0.001, 0.001]]}, "orientation": "fixed"}
    scene["objects"]["rod"] = {"asset": write_mjcf(tmp_path, "rod", rod), "kind": "static"}
    compiled = compile_on_cpu(scene, bank=4)
    rows = make(compiled, 100)
    served = {row_of(data, pos, quat) for data in posed(compiled, rows)}
    assert 0 not in served
    assert len(served) > 1
    assert (rows.status == LayoutStatus.VALID).mean() > 0.9


def test_a_heap_is_redrawn_alone_in_its_container(compiled: CompiledScene):
    """Into one of the rows, in the bin as it stands, which keeps its bits."""
    with np.load(folder() / "pile.npz") as stored:
        pos, quat = stored["pos"], stored["quat"]
    generator = LayoutGenerator(compiled, 40, seed=2)
    generator.generate()
    before = read(generator.layouts)
    after = read(generator.redraw(generator.layouts, THINGS))
    assert (after.status == LayoutStatus.VALID).all()
    np.testing.assert_array_equal(after.mocap_pos, before.mocap_pos)
    old, new = ([row_of(data, pos, quat) for data in posed(compiled, rows)] for rows in (before, after))
    assert len(set(new)) == len(pos)
    assert old != new
