"""Objects with variants: how often each is there, and that what refers to the object means the variant that is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.related import Shapes, judged, near_middle, related, scene


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """The assets."""
    return Shapes(tmp_path_factory.mktemp("shapes"))


def anyone(shapes: Shapes, words: dict[str, dict] | None = None, **shared: Any) -> dict[str, Any]:
    """An object near the middle that is a cube, a bar or an L."""
    words, variants = words or {}, {"cube": shapes.cube, "bar": shapes.bar, "odd": shapes.odd}
    written = {name: {"asset": asset, **words.get(name, {})} for name, asset in variants.items()}
    place = {word: value for word, value in near_middle("").items() if word != "asset"}
    return {"variants": written, **place, **shared}


def drawn(compiled: CompiledScene, n: int, split: str = "train") -> np.ndarray:
    """Return which variants are there in `n` layouts, shape (n, 3)."""
    columns = [compiled.slots.index(name) for name in compiled.config.variants["a"]]
    present = make_table(compiled, n, 0, split=split).present[:, columns]
    assert (present.sum(1) == 1).all()
    return present


def test_variants_are_drawn_by_weight_and_split(shapes: Shapes):
    """In `train` 1 : 2 : 3, in `eval` without the last; independent of another object's variants."""
    words = {"cube": {"weight": 1}, "bar": {"weight": 2}, "odd": {"weight": 3, "split": "train"}}
    other = {"asset": [shapes.cube, shapes.bar], "on": "floor"}
    compiled = scene({"a": anyone(shapes, words), "b": other})
    counts = drawn(compiled, 6000).sum(0)
    assert stats.chisquare(counts, [1000, 2000, 3000]).pvalue > 0.001
    counts = drawn(compiled, 3000, "eval").sum(0)
    assert counts[2] == 0
    assert stats.chisquare(counts[:2], [1000, 2000]).pvalue > 0.001
    present = make_table(compiled, 6000, 7).present
    both = present[:, :3].T.astype(int) @ present[:, 3:5].astype(int)
    alone = np.outer(both.sum(1), both.sum(0)) / both.sum()
    assert stats.chisquare(both.ravel(), alone.ravel(), ddof=3).pvalue > 0.001


def test_members_of_a_group_are_drawn_by_weight(shapes: Shapes):
    """Two of three without replacement, each draw by the weights of those that are left."""
    names, weights = "abc", np.array([1.0, 2.0, 5.0])
    cubes = {name: {"asset": shapes.cube, "on": "floor"} for name in names}
    group = {"of": list(names), "count": 2, "weights": dict(zip(names, weights.tolist(), strict=True))}
    present = make_table(scene(cubes, groups={"some": group}), 4000, 0).present
    share = weights / weights.sum()
    orders = [(i, j, 3 - i - j) for i in range(3) for j in range(3) if i != j]
    first_out = np.zeros(3)
    for i, j, out in orders:
        first_out[out] += share[i] * share[j] / (1 - share[i])
    assert stats.chisquare((~present).sum(0), 4000 * first_out).pvalue > 0.001


REFERRING = {
    "near": {"relations": [{"near": "a", "measure": "bounds", "distance": {"max": 0.1}}]},
    "between": {"relations": [{"between": ["a", "z"], "width": 0.1}]},
    "beside": {"relations": [{"beside": "a", "side": "left"}]},
    "frame": {"relations": [{"left_of": "z", "frame": "a", "angle": 30}]},
    "face_to": {"orientation": {"face_to": "a", "yaw": [10, 30]}},
}


@pytest.mark.parametrize("name", REFERRING)
def test_what_refers_to_an_object_means_its_present_variant(name: str, shapes: Shapes):
    """The audit takes the outline of the variant that is there, and finds nothing else wrong either."""
    thing = related(shapes.bar, **REFERRING[name])
    compiled = scene({"a": anyone(shapes), "z": near_middle(shapes.odd, 0.5), "q": thing})
    table = make_table(compiled, 300, 0)
    assert table.valid.mean() > 0.95
    kept = judged(compiled, table)
    assert not [k for k in kept if k.broken]
    assert all(k.checked == 300 for k in kept if k.name == "q")
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table, settled=60)
    assert not report.conflicts
    assert not report.misplaced


def test_a_variant_is_a_matter_of_seed_and_episode(shapes: Shapes):
    """Alone or among others, and whatever came before: the same bits."""
    words = {"cube": {"weight": 2}}
    near = related(shapes.bar, {"near": "a", "distance": {"max": 0.5}})
    compiled = scene({"a": anyone(shapes, words), "q": near})
    many = make_table(compiled, 40, 100)
    for i in (0, 7, 39):
        one = LayoutGenerator(compiled, 3, seed=[5, 100 + i, 9])
        one.generate()
        one.reseed(seed=[5, 100 + i, 9])
        one.generate()
        assert (one.layouts.present.numpy()[1] == many.present[i]).all()
        assert one.layouts.qpos.numpy()[1].tobytes() == many.qpos[i].tobytes()


def test_variants_of_one_object_are_not_tested_against_each_other(shapes: Shapes):
    """No pair of colliders is of two variants, whereas two objects have pairs."""
    compiled = scene({"a": anyone(shapes), "q": {"asset": shapes.cube, "on": "floor"}})
    owner = compiled.scene.owners
    pairs = {tuple(sorted((owner.get(a, ""), owner.get(b, "")))) for a, b, *_ in compiled.program.pair_bodies.numpy()}
    assert ("a/bar", "q") in pairs
    assert not [pair for pair in pairs if all(name.startswith("a/") for name in pair)]
