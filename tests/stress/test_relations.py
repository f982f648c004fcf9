"""The command that measures how well the words of the placement language are kept."""

from __future__ import annotations

import json

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
    assert {words["align"] for words in keys if "align" in words} >= {"left", "front", "back", "middle"}
    assert {thing.drawn_orientation.kind for thing in things} == {"yaw", "stable", "any", "face_to", "with"}


def test_a_line_for_each_word_says_the_worst(capsys):
    """Two words by their beginning; a point beside something lies on a strip of 40 um around its line."""
    status = relations.main(["--layouts", "50", "--jobs", "1", "--words", "near, max", "beside in another"])
    lines = {line["word"]: line for line in map(json.loads, capsys.readouterr().out.splitlines()[-2:])}
    assert set(lines) == {"near, max", "beside in another's frame"}
    assert [(line["layouts"], line["fresh"], line["broken"]) for line in lines.values()] == [(50, 50, 0)] * 2
    assert lines["near, max"]["worst_m"] < 0.0
    assert 1e-5 < lines["beside in another's frame"]["worst_m"] < 2.1e-5
    assert status == 0
