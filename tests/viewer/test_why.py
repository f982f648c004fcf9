"""Why: a rejected candidate is red where it would have stood, and words say what was wrong."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.blame import Hit
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.program.device import Cause
from sceniris_gym.scene.build import build_model
from sceniris_gym.viewer.deck import LayoutDeck, Where
from sceniris_gym.viewer.sketch import GREY, ORANGE, RED
from sceniris_gym.viewer.why import (
    CAUSES,
    bodies_before,
    explain,
    sketch_candidate,
    table_in_html,
    world_of,
    worst_by_body,
)
from tests.viewer.worlds_on_show import compiled_scene


@pytest.fixture(scope="module")
def deck() -> LayoutDeck:
    """Layouts of a scene that rejects often."""
    return LayoutDeck(compiled_scene("clutter"), 1)


def test_every_cause_has_words():
    """Every cause that can be shown is explained."""
    assert set(CAUSES) == {cause.name.lower() for cause in Cause if cause != Cause.NONE}


def test_a_candidate_is_red_and_later_objects_are_not_there(deck: LayoutDeck):
    """Its surface is around where it would have stood; what comes later in the order of placement is hidden."""
    pytest.importorskip("mjviser", reason="needs the extra 'viewer'")
    for candidate in deck.rejected(Where())[:8]:
        world = world_of(deck.compiled, candidate)
        hits = deck.blame.hits(world.data, candidate.number) if candidate.cause == "collision" else []
        sketch = sketch_candidate(world, candidate, hits, [])
        assert {colour for _, _, colour, _ in sketch.surfaces} == {RED}
        middle = np.concatenate([vertices for vertices, _, _, _ in sketch.surfaces]).mean(axis=0)
        low, high = world.box(candidate.name)
        assert np.all(middle > low - 0.01)
        assert np.all(middle < high + 0.01)
        later = set(deck.compiled.placed[candidate.number + 1 :])
        assert world.unplaced == later
        assert [text for text, _ in sketch.labels] == [f"{candidate.name}: {candidate.cause}"]


def test_a_floor_that_is_hit_is_outlined_where_it_is(deck: LayoutDeck):
    """MuJoCo's box of a plane reaches kilometres down; the outline is the rectangle that the scene file gives."""
    pytest.importorskip("mjviser", reason="needs the extra 'viewer'")
    mjm, candidate = deck.compiled.mjm, deck.rejected(Where())[0]
    own = int(np.flatnonzero(mjm.geom_bodyid == deck.compiled.scene.bodies[candidate.name])[0])
    floor = mjm.geom("floor").id
    hit = Hit((own, floor), "both", -0.01, 0.0)
    sketch = sketch_candidate(world_of(deck.compiled, candidate), candidate, [hit], [])
    outline = np.concatenate([ends for ends, colour in sketch.lines if colour == ORANGE][1:])
    assert np.ptp(outline, axis=0) == pytest.approx([*2.0 * mjm.geom_size[floor, :2], 0.0])
    assert outline[:, 2] == pytest.approx(0.0)


def test_what_hides_a_candidate_is_found_and_drawn_as_glass():
    """A block behind a wall: the wall stands before it for an eye in front, and nothing does for one above."""
    pytest.importorskip("mjviser", reason="needs the extra 'viewer'")
    spot = {"region": {"box": [[-0.001, 0.2], [0.001, 0.202]]}, "orientation": "fixed"}
    scene = {
        "floor": {"size": [1.0, 1.0]},
        "objects": {
            "chest": {"asset": "chest", "kind": "static"},
            "block": {"asset": "block", "on": "floor", **spot, "clearance": 0.001},
            "other": {"asset": "block", "on": "floor", **spot},
        },
    }
    compiled = upload_scene(build_model(SceneConfig.load(scene)), "cpu")
    deck = LayoutDeck(compiled, 1)
    candidate = next(c for c in deck.rejected(Where()) if c.name == "other")
    world = world_of(compiled, candidate)
    assert bodies_before(world, candidate, np.array([0.0, 0.0, 1.0])) == compiled.scene.subtree("block")
    before = bodies_before(world, candidate, np.array([0.0, -1.0, 0.0]))
    assert set(before) >= set(compiled.scene.subtree("chest")[:1])
    sketch = sketch_candidate(world, candidate, [], before)
    assert {colour for _, _, colour, _ in sketch.surfaces} == {RED, GREY}


def test_words_name_object_cause_count_and_what_is_in_the_way(deck: LayoutDeck):
    """For a collision: which bodies, how deep, and how far they should be apart; each other body once."""
    candidate = next(c for c in deck.rejected(Where()) if c.cause == "collision")
    hits = deck.blame.hits(world_of(deck.compiled, candidate).data, candidate.number)
    text = explain(deck.compiled, candidate, hits)
    assert text.startswith(f"{candidate.name}: collision (")
    worst = worst_by_body(deck.compiled.mjm, hits)
    assert worst[0] is hits[0]
    assert text.count("In the way:") == len(worst) <= 3
    assert str(worst[0]) in text
    others = [deck.compiled.mjm.geom_bodyid[hit.geoms[1]] for hit in worst]
    assert len(set(others)) == len(others)


def test_the_table_has_a_row_for_each_object_and_a_column_for_each_cause():
    """And says of how many layouts it is."""
    table = table_in_html(
        {"apple": {"overhead": 3, "collision": 0}, "pear": {"overhead": 0, "collision": 12}}, 200, 150
    )
    assert "200 layouts, 75.0% valid" in table
    assert table.count("<tr>") == 3
    assert "<td>pear</td><td align=right>-</td><td align=right>12</td>" in table
    assert "no candidates" in table_in_html({}, 10, 10)
