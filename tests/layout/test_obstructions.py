"""Obstructions: the pairs of geoms that most candidates collide at, from the record of one generator."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.layout import blame as blame_module
from sceniris_gym.layout.blame import Blame, obstructions, recording
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import read_rejected
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import box_mjcf, compile_on_cpu, read

NWORLD = 200


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """Three crates beside a post, on a floor with little room; the last crate asks for the largest clearance."""
    folder = tmp_path_factory.mktemp("blame")
    crate: dict[str, Any] = {"asset": box_mjcf(folder, "crate", 0.2, 0.2, 0.1), "on": "floor"}
    post = {"asset": box_mjcf(folder, "post", 0.2, 0.2, 0.5), "kind": "static"}
    objects = {"post": post, "a": crate, "b": crate, "c": {**crate, "clearance": 0.02}}
    return compile_on_cpu({"floor": {"size": [0.8, 0.8]}, "objects": objects, "attempts": 3, "restarts": 40}, bank=8)


@pytest.fixture(scope="module")
def generator(compiled: CompiledScene) -> LayoutGenerator:
    """One that has made layouts with a record."""
    made = recording(LayoutGenerator(compiled, NWORLD, seed=3))
    made.generate()
    return made


def test_the_pair_that_is_most_in_the_way_is_told_with_its_share(compiled: CompiledScene, generator: LayoutGenerator):
    """Of each object that collided, among the first 48 of its candidates; for the first one that is the post."""
    found, rejected, blame = obstructions(generator), read_rejected(generator), Blame(compiled)
    data = mujoco.MjData(compiled.mjm)

    def hits_of(row: int, number: int) -> dict[str, float]:
        rejected.states.put(data, row)
        mujoco.mj_kinematics(compiled.mjm, data)
        return {hit.names: hit.distance for hit in blame.hits(data, number)}

    assert set(found) == set(compiled.placed)
    assert "of body 'a' and geom" in found["a"]
    assert "of body 'post'" in found["a"]
    assert "; 100% of collisions; 'a' is " in found["a"]
    for number, name in enumerate(compiled.placed):
        rows = np.flatnonzero(rejected.objects == number)[:48]
        hits = [hits_of(row, number) for row in rows.tolist()]
        told = [distances[pair] for distances in hits for pair in distances if found[name].startswith(f"{pair} (")]
        most = max(sum(pair in distances for distances in hits) for pair in {p for each in hits for p in each})
        assert len(told) == most
        assert f" ({-1e3 * np.mean(told):.3g} mm deep on average, " in found[name]
        sizes = f"'{name}' is 20 x 20 cm wide, its region 80 x 80 cm"
        assert found[name].endswith(f" mm apart is required; {most / len(rows):.0%} of collisions; {sizes})")


def test_pairs_are_listed_once_and_no_layout_is_made_again(generator: LayoutGenerator, monkeypatch: pytest.MonkeyPatch):
    """Whatever the number of objects: the record of the generator is enough."""
    listed: list[int] = []
    pairs = blame_module.collider_pairs
    monkeypatch.setattr(blame_module, "collider_pairs", lambda *words: listed.append(1) or pairs(*words))
    monkeypatch.setattr(LayoutGenerator, "__init__", None)
    assert len(obstructions(generator)) == 3
    assert listed == [1]


def test_a_record_changes_no_layout_and_has_what_the_exact_one_has(compiled: CompiledScene):
    """Restarts are tried at once all the same: of a generator that has room for them it holds candidates of more."""
    size = replace(default_size("cpu"), rows=64)
    made = recording(LayoutGenerator(compiled, NWORLD, seed=3, size=size))
    exact = LayoutGenerator._recording(compiled, NWORLD, seed=3, rejected=8 * NWORLD)
    plain = LayoutGenerator(compiled, NWORLD, seed=3)
    for each in (made, exact, plain):
        each.generate()
    assert read(made.layouts).bits() == read(exact.layouts).bits() == read(plain.layouts).bits()
    assert made.size.rows == 64
    found, expected = (_placed_so_far(each) for each in (made, exact))
    assert len(found) > len(expected) > 300
    assert set(expected) <= set(found)


def _placed_so_far(generator: LayoutGenerator) -> list[bytes]:
    """The poses of each recorded candidate and of what was placed before it; objects after it may be anywhere."""
    rejected = read_rejected(generator)
    return [
        qpos[: 7 * (number + 1)].tobytes() for number, qpos in zip(rejected.objects, rejected.states.qpos, strict=True)
    ]


def test_without_a_record_or_a_collision_nothing_is_in_the_way(compiled: CompiledScene, tmp_path: Path):
    """A generator that records nothing, and a scene with room for all."""
    bare = LayoutGenerator(compiled, 20)
    bare.generate()
    assert obstructions(bare) == {}
    roomy = compile_on_cpu(
        {"floor": {"size": [2, 2]}, "objects": {"a": {"asset": box_mjcf(tmp_path, "a", 0.1, 0.1, 0.1), "on": "floor"}}}
    )
    alone = recording(LayoutGenerator(roomy, 20))
    alone.generate()
    assert obstructions(alone) == {}
