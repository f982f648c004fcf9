"""Bad scenes, models, maps, files and calls end in our words or in sound layouts: nothing else, whatever they are."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz.judge import fuzz
from tests.fuzz.scenes import FIELDS

NUMBER = 300


def test_bad_input_ends_in_words_or_in_sound_layouts(tmp_path: Path):
    """No foreign traceback, no hang, no nonsense; and not everything is refused."""
    found = fuzz(0, NUMBER, tmp_path)
    assert found.bad == []
    assert sum(found.counts.values()) == NUMBER
    assert found.counts["refused"] > 100
    assert found.counts["accepted"] > 25


def test_wrong_uses_end_in_words_or_in_sound_layouts(tmp_path: Path):
    """Of environments, snapshots, levels, tables, ids and files; the ids of what follows make it again."""
    found = fuzz(0, 40, tmp_path, uses=True)
    assert found.bad == []
    assert found.counts["refused"] > 20
    assert found.counts["accepted"] > 1


def test_all_sections_of_a_scene_file_are_fuzzed():
    """Their fields come from the config itself, so that a new word is fuzzed as well."""
    for path in (
        ("floor", "size"),
        ("objects", "*", "joints", "*", "range"),
        ("objects", "*", "relations", "*", "near"),
    ):
        assert path in FIELDS
    assert ("groups", "*", "count") in FIELDS
