"""The `generate` command's work: figures of what was written, alone or in shares."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import MagicMock

import pytest

from sceniris_gym.commands.generate import generate, verify
from sceniris_gym.dataset import manifest, reader
from sceniris_gym.dataset.manifest import DatasetPlan
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.layout.tables import make_table
from tests.layout.scenes import compile_on_cpu


def test_figures_are_those_of_all_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Shares of valid rows, the first id, and how many parts are left for the others."""
    monkeypatch.setattr(manifest, "PART_ROWS", 8)
    compiled = compile_on_cpu("clutter")
    plan = DatasetPlan.of(compiled, 20, 5, "train")
    found = generate(compiled, plan, tmp_path, Shard(3, 4), chunk=None, resume=False)
    assert (found["missing_parts"], found["valid"], found["first_pass_valid"]) == (3, None, None)
    found = generate(compiled, plan, tmp_path, Shard(1, 2), chunk=None, resume=False)
    assert (found["complete"], found["missing_parts"]) == (False, 2)
    found = generate(compiled, plan, tmp_path, Shard(0, 2), chunk=None, resume=False)
    table = make_table(compiled, 20, 5)
    assert found["complete"]
    assert "missing_parts" not in found
    assert found["valid"] == table.valid.mean()
    assert found["first_pass_valid"] == table.first_pass_valid.mean()
    assert found["first_id"] == compiled.layout_id(5, 0)
    assert (found["layouts"], found["parts"], found["folder"]) == (20, 3, str(tmp_path))


def test_a_data_set_is_read_once_to_be_verified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Its manifest, for the verdict and for the checksums."""
    compiled = compile_on_cpu("clutter")
    plan = DatasetPlan.of(compiled, 4, 0, "train")
    generate(compiled, plan, tmp_path, Shard(), chunk=None, resume=False)
    read = MagicMock(side_effect=manifest.read_manifest)
    monkeypatch.setattr(reader, "read_manifest", read)
    assert verify(tmp_path)["ok"]
    assert read.call_count == 1
