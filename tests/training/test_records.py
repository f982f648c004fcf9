"""The files of a run and the shares in them, and the hash of the sources that results depend on."""

from __future__ import annotations

import os
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError, SceneKeyError
from sceniris_gym.files import as_json
from sceniris_gym.training.settings import (
    Settings,
    evaluations,
    read_checkpoint,
    read_config,
    read_parts,
    source_hash,
    success_interval,
)


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
        (
            {"config.json": "{}", "model.pt": ""},
            "config.json: should be a file of 'sceniris-gym train': KeyE",
        ),
        ({"config.json": "[", "model.pt": ""}, "config.json: should be a file of 'sceniris-gym train': "),
        ({"config.json": "[1]", "model.pt": ""}, "config.json: should be a file of 'sceniris-gym train': "),
        (
            {"config.json": '{"options": {"task": 5}, "settings": {}}', "model.pt": ""},
            "options.task should be a str",
        ),
        ({"config.json": '{"options": {}, "scene": null}', "model.pt": ""}, "config.json: should be a file of"),
    ],
)
def test_a_folder_without_a_run_is_refused(tmp_path: Path, files: dict[str, str], words: str):
    """The error says what is missing, or what is wrong with it."""
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(ArgumentError) as refused:
        read_config(tmp_path)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"steps": -1}, "config.json: settings: steps: -1 "),
        ({"hidden": "x"}, "config.json: settings: hidden: 'x' "),
        ({"hidden": [0]}, "config.json: settings: hidden.0: 0 "),
        ({"gamma": 2.0}, "config.json: settings: gamma: 2.0 "),
        ({"width": 1}, "config.json: settings: width: 1 "),
    ],
)
def test_settings_that_no_training_has_are_refused(tmp_path: Path, settings: dict[str, object], words: str):
    """By their names, as the options of the command are."""
    (tmp_path / "config.json").write_text(as_json({"options": {"task": "A-v0"}, "settings": settings}))
    (tmp_path / "model.pt").touch()
    with pytest.raises(SceneKeyError) as refused:
        read_config(tmp_path)
    assert words in str(refused.value)


def test_a_pipe_is_no_configuration(tmp_path: Path):
    """It is not waited for, in the place of any of the files."""
    for name in ("config.json", "log.jsonl", "model.pt"):
        os.mkfifo(tmp_path / name)
    for read in (read_parts, evaluations, lambda folder: read_checkpoint(folder / "model.pt", "cpu")):
        with pytest.raises(ArgumentError, match="a pipe or a device"):
            read(tmp_path)


def test_a_log_that_is_cut_off_is_told(tmp_path: Path):
    """By its name."""
    (tmp_path / "log.jsonl").write_text('{"kind": "eval"}\n{"kind": "ev')
    with pytest.raises(ArgumentError, match=r"log\.jsonl: should be a file of 'sceniris-gym train'"):
        evaluations(tmp_path)


class _Touching:
    """Unpickled, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)


def test_a_checkpoint_is_read_as_weights_unless_it_is_trusted(tmp_path: Path):
    """A pickle in it is executed only where the user says so."""
    file, touched = tmp_path / "model.pt", tmp_path / "touched"
    torch.save({"actor_state_dict": _Touching(touched)}, file)
    with pytest.raises(ArgumentError, match=r"model\.pt: should hold only weights.* executes .*--trust"):
        read_checkpoint(file, "cpu")
    assert not touched.exists()
    read_checkpoint(file, "cpu", trust=True)
    assert touched.exists()
    whole = file.read_bytes()
    file.write_bytes(np.random.default_rng(1).bytes(1000))
    with pytest.raises(ArgumentError, match=r"model\.pt: is damaged or has no weights"):
        read_checkpoint(file, "cpu")
    file.write_bytes(whole[:200])
    with pytest.raises(ArgumentError, match=r"model\.pt: should be a file of 'sceniris-gym train'"):
        read_checkpoint(file, "cpu", trust=True)


def test_task_and_settings_are_read_as_they_were_written(tmp_path: Path):
    """JSON has lists where settings have tuples; what is made of either is the same."""
    settings = Settings(hidden=(8,), gamma=0.5)
    told = {"options": {"task": "A-v0"}, "settings": asdict(settings)}
    (tmp_path / "config.json").write_text(as_json(told))
    (tmp_path / "model.pt").touch()
    task, read = read_config(tmp_path)
    assert (task, list(read.hidden), read.gamma) == ("A-v0", [8], 0.5)


def test_the_hash_of_the_sources_depends_on_what_results_depend_on(tmp_path: Path):
    """On a line of a task, and not on a line of the docs; links into the package count once."""
    package = tmp_path / "sceniris_gym"
    for name in ("envs/task.py", "docs/page.md", "sceniris_gym/cli.py", "assets/cup.obj"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1")
    first = source_hash(package=package)
    (tmp_path / "docs/page.md").write_text("2")
    (package / "envs").symlink_to(tmp_path / "envs")
    assert source_hash(package=package) == first
    (tmp_path / "envs/task.py").write_text("2")
    assert source_hash(package=package) != first


def test_an_installed_package_has_the_hash_of_its_repository(tmp_path: Path):
    """There tasks and assets lie inside of the package, and neither benchmarks nor docs are."""
    for name in ("envs/task.py", "benchmarks/run.py", "sceniris_gym/cli.py", "sceniris_gym/layout/seeds.py"):
        (tmp_path / "repository" / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / "repository" / name).write_text(name)
    shutil.copytree(tmp_path / "repository" / "sceniris_gym", tmp_path / "site" / "sceniris_gym")
    shutil.copytree(tmp_path / "repository" / "envs", tmp_path / "site" / "sceniris_gym" / "envs")
    hashes = {source_hash(package=tmp_path / where / "sceniris_gym") for where in ("repository", "site")}
    assert len(hashes) == 1
