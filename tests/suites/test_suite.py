"""Files of suites: read as they were written, and what is no suite."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, ScenirisError
from sceniris_gym.scene.build import build_model
from sceniris_gym.suites.suite import Suite
from sceniris_gym.training.task_scenes import scene_of


def test_a_suite_is_read_as_it_was_written(suite: Path, tmp_path: Path):
    """The digest covers each line."""
    read = Suite.read(suite)
    read.write(tmp_path / "again.jsonl")
    again = Suite.read(tmp_path / "again.jsonl")
    assert again == read
    again._replace(cases=again.cases[:-1]).write(tmp_path / "again.jsonl")
    assert Suite.read(tmp_path / "again.jsonl").digest != read.digest


def test_what_is_no_suite_is_refused(suite: Path):
    """Another law, keys and types, numbers of cases, and rows that are missing."""
    head, *lines = suite.read_text().splitlines()
    told, case = json.loads(head), json.loads(lines[0])
    for first, rest, words in (
        ({"suite": 7}, lines, "should have law 1 of suites, got 7"),
        ({"extra": 1}, lines, "extra"),
        ({}, [json.dumps({**case, "grade": "high"})], "grade"),
        ({}, [json.dumps({**case, "case": 3})], "numbered from 0 on"),
        ({}, [], "numbered from 0 on"),
        ({}, [json.dumps({**case, "row": 900})], "row"),
        ({}, ["nonsense"], "should be a file of 'sceniris-gym suite'"),
    ):
        suite.write_text("\n".join([json.dumps(told | first), *rest]))
        with pytest.raises(ScenirisError, match=words):
            Suite.read(suite)
    with pytest.raises(ArgumentError, match=r"none.jsonl: should be a file"):
        Suite.read(suite.with_name("none.jsonl"))


@pytest.mark.parametrize("name", ["clutter_extract", "drawer_pick", "tabletop_lift_any"])
def test_shipped_suites_have_their_scenes(name: str):
    """Their hashes are those of the widened scenes, and of each id."""
    read = Suite.read(shipped("envs", ".jsonl")[name])
    config = SceneConfig.load(scene_of(read.head.task, reachable=True), read_changes(read.head.changes))
    assert build_model(config).hash == read.head.hash
    assert {case.id.split(":")[0] for case in read.cases} == {read.head.hash}
