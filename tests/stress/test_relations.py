"""The command that measures how well the words of the placement language are kept."""

from __future__ import annotations

import re

from sceniris_gym.config.relations import FRAMES, RELATION_WORDS
from sceniris_gym.config.scene import SceneConfig
from tests.layout.related import Shapes
from tests.stress import relations


def test_every_word_has_a_scene(tmp_path):
    """All words of relations, frames, distances, measures and orientations are measured."""
    configs = [SceneConfig.load(scene) for scene in relations.scenes(Shapes(tmp_path)).values()]
    things = [config.objects["q"] for config in configs]
    used = [relation for thing in things for relation in thing.relations]
    assert {relation.word for relation in used} == set(RELATION_WORDS)
    assert {relation.frame for relation in used} > set(FRAMES)
    given = {word for r in used if r.distance is not None for word in r.distance.model_fields_set}
    assert given == {"min", "max", "equal", "tolerance"}
    assert {relation.measure for relation in used} == {"origin", "bounds"}
    assert {relation.side for relation in used} == {None, "left", "right", "front", "back"}
    assert {thing.drawn_orientation.kind for thing in things} == {"yaw", "stable", "any", "face_to"}


def test_a_line_for_each_word_says_the_worst(capsys):
    """Two words by their beginning; a point beside something lies on a strip of 40 um around its line."""
    status = relations.main(["--layouts", "50", "--jobs", "1", "--words", "near", "beside left"])
    near, beside, total = [line for line in capsys.readouterr().out.splitlines() if "broken" in line]
    assert re.match(r"near +50 layouts \(50 fresh\)  0 broken  worst -.* m, .* rad$", near)
    assert re.match(r"beside left +50 layouts \(50 fresh\)  0 broken  worst 2.0e-05 m", beside)
    assert total.startswith("2 words, 0 broken")
    assert status == 0
