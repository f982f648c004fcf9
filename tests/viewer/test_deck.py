"""The layouts on show are the generator's, whatever else is on show, and what was rejected for them is counted."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.viewer.deck import LayoutDeck, Where
from sceniris_gym.viewer.why import world_of
from tests.viewer.worlds_on_show import compiled_scene

SCENE = "clutter"


@pytest.mark.parametrize("where", [Where(), Where("eval", 2**64 - 1, 3), Where("train", 7, 1)])
def test_layouts_are_those_of_the_generator(where: Where):
    """World i has seed + i, beyond the last seed from 0 on, at the episode that is asked for."""
    compiled = compiled_scene(SCENE)
    table = LayoutDeck(compiled, 3).make(where)
    for i in range(3):
        generator = LayoutGenerator(compiled, 1, seed=[(where.seed + i) % 2**64], split=where.split)
        for _ in range(where.episode + 1):
            generator.generate()
        np.testing.assert_array_equal(table.qpos[i], generator.layouts.qpos.cpu().numpy()[0])


def test_an_id_leads_to_its_layout_and_others_are_refused():
    """The id of a layout of this scene; one of another scene; and what is no id."""
    deck = LayoutDeck(compiled_scene(SCENE), 1)
    assert deck.find(f" {deck.compiled.layout_id(2**63, 5, 'eval')} ") == Where("eval", 2**63, 5)
    with pytest.raises(SceneMismatchError, match="'clutter' is now scene"):
        deck.find("0123456789abcdef:train:1:0")
    with pytest.raises(ArgumentError, match="should be scenehash"):
        deck.find("apple")


def test_arrows_stop_at_the_ends():
    """Neither seeds nor episodes go below zero, or beyond what they may be."""
    assert Where(seed=3).moved(seeds=-5) == Where(seed=0)
    assert Where(seed=2**64 - 1).moved(seeds=1) == Where(seed=2**64 - 1)
    assert Where(episode=0).moved(episodes=2) == Where(episode=2)
    assert Where(episode=2**31 - 1).moved(episodes=1).episode == 2**31 - 1


def test_rejected_candidates_are_all_that_were_tried_and_not_taken():
    """As many as the counts of this layout say, by object and cause, and again as many the second time."""
    compiled = compiled_scene(SCENE)
    deck = LayoutDeck(compiled, 1)
    for seed in (0, 1, 0):
        candidates = deck.rejected(Where(seed=seed))
        generator = LayoutGenerator(compiled, 1, seed=seed)
        generator.generate()
        counts = {(o, c): n for o, causes in generator.rejection_counts().items() for c, n in causes.items() if n}
        found = {key: sum((c.name, c.cause) == key for c in candidates) for key in counts}
        assert found == counts
        assert {(c.name, c.cause): c.count for c in candidates} == counts


def test_what_collides_is_found_and_what_hangs_over_an_edge_hits_nothing():
    """Every candidate that collided has hits, each too near; others need none."""
    deck = LayoutDeck(compiled_scene(SCENE), 1)
    candidates = [c for seed in range(3) for c in deck.rejected(Where(seed=seed))]
    collided = [c for c in candidates if c.cause == "collision"]
    assert collided
    for candidate in collided:
        hits = deck.blame.hits(world_of(deck.compiled, candidate).data, candidate.number)
        assert hits
        assert all(hit.distance <= hit.margin + 1e-4 for hit in hits)
        assert hits == sorted(hits, key=lambda hit: hit.distance - hit.margin)
        own = deck.compiled.scene.subtree(candidate.name)
        assert all(deck.compiled.mjm.geom_bodyid[hit.geoms[0]] in own for hit in hits)


def test_the_table_adds_up_over_layouts():
    """Counts of all layouts that were made; causes and objects that never were are left out."""
    compiled = compiled_scene(SCENE)
    deck = LayoutDeck(compiled, 4)
    deck.make(Where())
    deck.make(Where(seed=4))
    generator = LayoutGenerator(compiled, 8, seed=0)
    generator.generate()
    counts = generator.rejection_counts()
    table = deck.table()
    assert table
    assert all(counts[name][cause] == n for name, row in table.items() for cause, n in row.items())
    assert sum(map(sum, (row.values() for row in table.values()))) == sum(sum(row.values()) for row in counts.values())
    assert (deck.layouts, deck.valid) == (8, 8)
    deck.count_ahead()
    assert deck.layouts == 264
