"""Manifest of a data set, and the records of its parts."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.dataset.manifest import (
    DatasetPlan,
    checked,
    read_manifest,
    read_record,
    row_of,
)
from sceniris_gym.errors import DatasetError
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import compile_on_cpu

RECORD = {"rows": 3, "sha256": "0" * 64, "files": {}, "valid": 3, "first_pass_valid": 2}


def test_a_plan_names_the_rows_and_their_columns(crane: CompiledScene):
    """Columns of reach are there where something is to be reached, and no number lies at an odd address."""
    plain, reaching = (DatasetPlan.of(scene, 70_000, 5, "train") for scene in (compile_on_cpu("mid"), crane))
    assert "grasp" not in (plain.row.names or ())
    assert {"grasp", "grasp_pose", "grasp_qpos", "pregrasp_qpos"} <= set(reaching.row.names or ())
    assert (plain.fields["object_names"], reaching.fields["reachable_names"]) == (
        ["cabinet", "apple", "banana"],
        ["thing"],
    )
    for plan in (plain, reaching):
        assert plan.row == row_of(json.loads(json.dumps(plan.fields["columns"])))
        for kind, offset, *_ in (plan.row.fields or {}).values():
            assert offset % kind.base.alignment == 0
        rows = np.zeros(2, plan.row)
        assert rows.itemsize == rows[:1].nbytes
    assert plain.parts == 2
    assert (plain.rows(0), plain.rows(1)) == (range(65_536), range(65_536, 70_000))


def test_a_manifest_of_something_else_is_refused(tmp_path: Path):
    """Missing, no JSON, no mapping, a field too few, a part without its rows: each by file and field."""
    with pytest.raises(DatasetError, match=r"should be a complete data set.*--resume"):
        read_manifest(tmp_path)
    for text, words in (("{", "cannot be read"), ("[]", "'format'"), ('{"format": "1"}', "'format' should be 1 to")):
        (tmp_path / "dataset.json").write_text(text)
        with pytest.raises(DatasetError, match=words):
            read_manifest(tmp_path)
    (tmp_path / "dataset.json").write_text("[" * 100_000)
    with pytest.raises(DatasetError, match="cannot be read"):
        read_manifest(tmp_path)


def test_a_manifest_without_an_end_is_not_waited_for(tmp_path: Path):
    """A pipe, and a link to a device; nor is such a record."""
    path = tmp_path / "dataset.json"
    for make in (os.mkfifo, lambda path: path.symlink_to("/dev/zero")):
        path.unlink(missing_ok=True)
        make(path)
        with pytest.raises(DatasetError, match="a pipe or a device, not a file"):
            read_manifest(tmp_path)
        assert read_record(path) is None


def test_a_record_that_is_not_whole_is_none(tmp_path: Path):
    """So its part is made again."""
    path = tmp_path / "00000.json"
    assert read_record(path) is None
    for text in ("", '{"rows": 3', json.dumps(RECORD | {"rows": "3"}), "[]"):
        path.write_text(text)
        assert read_record(path) is None
    path.write_text(json.dumps(RECORD))
    assert read_record(path) == RECORD == checked(path, RECORD, {"rows": int})
