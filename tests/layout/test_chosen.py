"""Layouts and seeds that a user chose: for which worlds, in which order, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import compile_on_cpu

HALF = np.array([True, False, False, True])


@pytest.fixture(scope="module")
def empty() -> CompiledScene:
    """A scene without objects."""
    return compile_on_cpu({"objects": {}})


def _next(generator: LayoutGenerator) -> list[tuple[int, int]]:
    view = generator.layouts.view
    return list(zip(view.next_seed.numpy().tolist(), view.next_episode.numpy().tolist(), strict=True))


@pytest.mark.parametrize(
    ("worlds", "seed", "expected"),
    [
        (None, 7, [7, 8, 9, 10]),
        (HALF, 7, [7, 1, 2, 10]),
        ([3, 0], [50, 60], [60, 1, 2, 50]),
        ([3, 0], [50, 60, 70, 80], [50, 1, 2, 80]),
        ([3, 0, 2, 1], [50, 60, 70, 80], [60, 80, 70, 50]),
        (HALF, torch.tensor([50, 60]), [50, 1, 2, 60]),
        (slice(1, 3), np.array([2**64 - 1, 5], np.uint64), [0, 2**64 - 1, 5, 3]),
    ],
)
def test_seeds_go_to_the_chosen_worlds_in_order_or_to_all_worlds(empty: CompiledScene, worlds, seed, expected):
    """An integer counts on by the ids of worlds; worlds that are not chosen keep theirs."""
    generator = LayoutGenerator(empty, 4)
    generator.reseed(worlds, seed=seed)
    assert _next(generator) == [(wanted, 0) for wanted in expected]


def test_layouts_are_ids_or_what_info_has(empty: CompiledScene):
    """One for all chosen worlds, one for each of them, or one for each world; None keeps a world's next layout."""
    generator = LayoutGenerator(empty, 4)
    one, other = empty.layout_id(9, 5), empty.layout_id(2**64 - 1, 6)
    generator.reseed(HALF, layouts=one)
    assert _next(generator) == [(9, 5), (1, 0), (2, 0), (9, 5)]
    generator.reseed([2, 1], layouts=[one, other])
    assert _next(generator) == [(9, 5), (2**64 - 1, 6), (9, 5), (9, 5)]
    generator.reseed(layouts=[None, None, other, None])
    assert _next(generator)[2:] == [(2**64 - 1, 6), (9, 5)]
    seed = torch.tensor([-1, 3])  # two's complement, as in `info`
    generator.reseed([0, 3], layouts={"seed": seed, "episode": 1, "fallback": torch.zeros(2)})
    assert _next(generator) == [(2**64 - 1, 1), (2**64 - 1, 6), (2**64 - 1, 6), (3, 1)]


def test_seeds_in_a_tensor_are_in_twos_complement(empty: CompiledScene):
    """As in `info` and in layouts; a negative seed of NumPy is a mistake."""
    generator = LayoutGenerator(empty, 4)
    generator.reseed(seed=torch.tensor([-1, -(2**63), 0, 5]))
    assert _next(generator) == [(2**64 - 1, 0), (2**63, 0), (0, 0), (5, 0)]
    for wrong in (np.array([-1, 1, 0, 5]), torch.tensor([1.0, 2.0, 3.0, 4.0])):
        with pytest.raises(ArgumentError, match=r"seed\[0\]="):
            generator.reseed(seed=wrong)


@pytest.mark.parametrize(
    ("words", "error", "match"),
    [
        ({}, ArgumentError, "^worlds should have `seed` or `layouts`, got neither"),
        (
            {"seed": 1, "layouts": {"seed": 1, "episode": 0}},
            ArgumentError,
            "^worlds should have `seed` or `layouts`, got both",
        ),
        ({"layouts": {"seed": -1, "episode": 0}}, ArgumentError, r"layouts\['seed'\] should be from 0 to 2\^64 - 1"),
        ({"layouts": {"seed": [0, -1], "episode": 0}}, ArgumentError, r"layouts\['seed'\] should be from 0"),
        (
            {"seed": [1, 2, 3]},
            ArgumentError,
            "seed should be a single value, or a list of 2, one for each .* got a list of 3",
        ),
        ({"layouts": []}, ArgumentError, "layouts should be a single value, or a list of 2, .* got a list of 0"),
        ({"layouts": {"seed": 0}}, ArgumentError, "keys 'seed' and 'episode'"),
        ({"layouts": {"seed": 0.5, "episode": 0}}, ArgumentError, r"layouts\['seed'\] should be an integer"),
        ({"layouts": {"seed": [0, 1], "episode": [0] * 4}}, ArgumentError, r"layouts\['seed'\] should be an integer"),
        ({"layouts": {"seed": 0, "episode": -1}}, ArgumentError, r"layouts\['episode'\] should be from 0 to 2\^31 - 2"),
        (
            {"layouts": [{"seed": 0, "episode": 0}] * 2},
            ArgumentTypeError,
            "a layout id, a sequence of them, or a mapping",
        ),
        ({"layouts": [(0, 0), (1, 0)]}, ArgumentTypeError, "a layout id, a sequence of them, or a mapping"),
        ({"layouts": 3}, ArgumentError, "a layout id, a sequence of them, or a mapping"),
        ({"layouts": "a:train:0:0"}, SceneMismatchError, "belongs to scene"),
        ({"layouts": ["nonsense", None]}, ArgumentError, "should be scenehash:split:seed:episode"),
    ],
)
def test_what_names_no_layouts_is_refused(empty: CompiledScene, words: dict[str, Any], error, match: str):
    """By the argument's name, before any world's next layout changes."""
    generator = LayoutGenerator(empty, 4)
    with pytest.raises(error, match=match):
        generator.reseed(HALF, **words)
    assert _next(generator) == [(i, 0) for i in range(4)]


def test_a_world_with_two_entries_is_refused(empty: CompiledScene):
    """Of seeds or layouts. A single entry, or an entry for each world, leaves no doubt."""
    generator = LayoutGenerator(empty, 4)
    ids = [empty.layout_id(9, 5), empty.layout_id(9, 6)]
    for name, words in (("seed", {"seed": [5, 6]}), ("layouts", {"layouts": ids})):
        with pytest.raises(ArgumentError, match=rf"worlds should be distinct, .* of {name}, got \[1, 1\]"):
            generator.reseed([1, 1], **words)
    assert _next(generator) == [(i, 0) for i in range(4)]
    generator.reseed([1, 1], layouts=ids[0])
    generator.reseed([2, 2], seed=[5, 6, 7, 8])
    assert _next(generator) == [(0, 0), (9, 5), (7, 0), (3, 0)]
