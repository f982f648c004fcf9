"""The files of a run, and the shares in them."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import pytest

from sceniris_gym.errors import ArgumentError
from sceniris_gym.files import as_json
from sceniris_gym.training.records import read_config, success_interval
from sceniris_gym.training.settings import Settings


def test_intervals_are_those_of_wilson():
    """The values of Brown, Cai and DasGupta's definition, worked out by hand for 8 of 10; and the ends."""
    assert success_interval(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert success_interval(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert success_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, "has no config.json"),
        ({"config.json": "{}"}, "has no model.pt"),
        ({"config.json": "{}", "model.pt": ""}, "config.json: should be as 'sceniris-gym train' writes it: 'options'"),
        ({"config.json": "[", "model.pt": ""}, "config.json: should be as 'sceniris-gym train' writes it: "),
    ],
)
def test_a_folder_without_a_run_is_refused(tmp_path: Path, files: dict[str, str], words: str):
    """The error says what is missing, or what is wrong with it."""
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(ArgumentError) as refused:
        read_config(tmp_path)
    assert words in str(refused.value)


def test_task_and_settings_are_read_as_they_were_written(tmp_path: Path):
    """JSON has lists where settings have tuples; what is made of either is the same."""
    settings = Settings(hidden=(8,), gamma=0.5)
    told = {"options": {"task": "A-v0"}, "settings": asdict(settings)}
    (tmp_path / "config.json").write_text(as_json(told))
    (tmp_path / "model.pt").touch()
    task, read = read_config(tmp_path)
    assert (task, list(read.hidden), read.gamma) == ("A-v0", [8], 0.5)
