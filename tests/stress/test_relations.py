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
    keys = [relation.model_dump(exclude_none=True) for relation in used]
    assert {words["frame"] for words in keys if "frame" in words} > set(FRAMES)
    assert {key for words in keys for key in words.get("distance", ())} == {"min", "max", "equal", "tolerance"}
    assert {words["measure"] for words in keys if "measure" in words} == {"origin", "bounds"}
    assert {words["side"] for words in keys if "side" in words} == {"left", "right", "front", "back"}
    assert {thing.drawn_orientation.kind for thing in things} == {"yaw", "stable", "any", "face_to"}


def test_a_line_for_each_word_says_the_worst(capsys):
    """Two words by their beginning; a point beside something lies on a strip of 40 um around its line."""
    status = relations.main(["--layouts", "50", "--jobs", "1", "--words", "near, max", "beside in another"])
    beside, near, total = [line for line in capsys.readouterr().out.splitlines() if "broken" in line]
    assert re.match(r"near, max +50 layouts \(50 fresh\)  0 broken  worst -.* m, .* rad$", near)
    assert re.match(r"beside in another's frame +50 layouts \(50 fresh\)  0 broken  worst 2.0e-05 m", beside)
    assert total.startswith("2 words, 0 broken")
    assert status == 0
