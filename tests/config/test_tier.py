"""Tiers of reachability: their words, and that a stricter one never lets through what a laxer one refuses."""

from __future__ import annotations

from itertools import pairwise
from typing import get_args

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import TIERS, Tier, TierWord, Verdict
from sceniris_gym.errors import SceneKeyError

MAP_TIERS = [tier for tier in Tier if tier.needs_map]


def _accepted(tier: Tier) -> set[Verdict]:
    """Verdicts of a map for which placing goes on."""
    return {verdict for verdict in Verdict if verdict >= tier.least_verdict}


def _scene(word: object) -> SceneConfig:
    thing = {"asset": "apple", "on": "floor", "reachable": word}
    return SceneConfig.load({"floor": {"size": [1, 1]}, "robot": {"asset": "panda"}, "objects": {"thing": thing}})


def test_words_and_tiers_are_the_same_from_quick_to_thorough():
    """Every word is a tier and every tier has one, in the order of the numbers that a device compares."""
    assert get_args(TierWord) == TIERS == tuple(tier.word for tier in sorted(Tier))
    assert [Tier.of(word) for word in TIERS] == [*Tier]
    with pytest.raises(KeyError):
        Tier.of("maps")


def test_a_scene_file_takes_these_words_alone():
    """And yes or no, which name no tier."""
    assert [_scene(word).objects["thing"].reachable for word in TIERS] == [*TIERS]
    assert [_scene(word).objects["thing"].reachable for word in (True, False)] == [True, False]
    for word in ("MAP", "strict", "maps", 1, ""):
        with pytest.raises(SceneKeyError, match=r"objects\.thing\.reachable"):
            _scene(word)


def test_verdicts_are_ordered_from_no_to_yes():
    """A device compares their numbers: what is certain is at both ends, what is decided between corners within."""
    order = [Verdict.NO, Verdict.MIXED_NO, Verdict.MIXED_YES, Verdict.YES]
    assert sorted(Verdict) == order
    assert all(a < b for a, b in pairwise(order))


def test_the_quick_tiers_ask_the_map_and_the_thorough_ones_joints():
    """First those that the map decides, then those that need joints; the map's own no ends all of them."""
    assert [tier.needs_map for tier in Tier] == [True, True, False, False, False]
    assert all(Verdict.NO not in _accepted(tier) for tier in Tier)


def test_a_stricter_map_tier_lets_less_through():
    """Of the tiers that a map decides, each accepts a proper part of what the one before it does."""
    assert len(MAP_TIERS) > 1
    for laxer, stricter in pairwise(MAP_TIERS):
        assert _accepted(stricter) < _accepted(laxer)
    assert all(Verdict.YES in _accepted(tier) for tier in MAP_TIERS)


def test_tiers_that_ask_for_joints_are_not_stopped_by_a_map_that_is_in_doubt():
    """They look at whatever a map tier lets through, and more: the map spares them what is surely out of reach."""
    for tier in set(Tier) - set(MAP_TIERS):
        assert all(_accepted(tier) > _accepted(other) for other in MAP_TIERS)
        assert _accepted(tier) == set(Verdict) - {Verdict.NO}
