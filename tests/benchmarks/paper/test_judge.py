"""The share of layouts that collide, against a closed form and against layouts that cannot."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.paper.judge import colliding
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training.layout_sources import unchecked
from tests.layout.scenes import box_mjcf, compile_on_cpu

FLOOR = 1.0  # m, edge of the floor
EDGES = (0.2, 0.4)  # m, of the two crates


@pytest.fixture(scope="module")
def crates(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """Two crates with fixed orientations on a square floor."""
    folder: Path = tmp_path_factory.mktemp("crates")
    objects = {}
    for i, edge in enumerate(EDGES):
        asset = box_mjcf(folder, f"crate_{i}", edge, edge, edge)
        objects[f"crate_{i}"] = {"asset": asset, "on": "floor", "orientation": "fixed"}
    return compile_on_cpu({"floor": {"size": [FLOOR, FLOOR]}, "objects": objects})


def test_without_checks_as_many_collide_as_chance_says(crates: CompiledScene):
    """Centres are uniform, so along each axis they are nearer than s with probability 2 s - s^2 of a floor of 1 m."""
    table = make_table(unchecked(crates), 3000, seed=0)
    s = sum(EDGES) / 2 / FLOOR
    share = (2 * s - s * s) ** 2
    assert share == pytest.approx(0.26, abs=0.001)
    assert colliding(crates, table) == pytest.approx(share, abs=4 * (share * (1 - share) / len(table)) ** 0.5)


def test_what_the_generator_makes_does_not_collide(crates: CompiledScene):
    """The same crates, checked."""
    assert colliding(crates, make_table(crates, 500, seed=0)) == 0.0


def test_gaps_below_the_clearance_are_no_collisions(crates: CompiledScene):
    """Other programs keep other clearances."""
    table = make_table(crates, 1, seed=0)
    first = table.qpos[0, :3].copy()
    table.qpos[0, 7:10] = first + [sum(EDGES) / 2 + 1e-4, 0.0, 0.0]
    assert colliding(crates, table) == 0.0
    table.qpos[0, 7] -= 2e-4
    assert colliding(crates, table) == 1.0
