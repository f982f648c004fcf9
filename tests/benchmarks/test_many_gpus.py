"""The comparison of data sets that several GPUs made. tests/vector/test_ranks.py has the measurement."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rsl_rl")

from benchmarks.many_gpus import same_parts
from sceniris_gym import cli


def test_data_sets_are_compared_part_by_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Equal ones are, and one from other seeds is refused."""
    for name, seed in (("a", "0"), ("b", "0"), ("c", "1")):
        cli.main(["generate", "mid", "-n", "8", "--out", str(tmp_path / name), "--seed", seed, "--device", "cpu"])
    capsys.readouterr()
    same_parts(tmp_path / "a", tmp_path / "b")
    assert capsys.readouterr().out == "1 parts of 1 are the same\n"
    with pytest.raises(SystemExit, match="the rows differ"):
        same_parts(tmp_path / "a", tmp_path / "c")
