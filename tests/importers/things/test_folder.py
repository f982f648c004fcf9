"""Folders of things: each in a process of its own, so that what is wrong with one stops no other."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sceniris_gym.errors import MeshError, SceneFileError
from sceniris_gym.importers.things import folder as module
from sceniris_gym.importers.things.folder import Outcome, import_folder, things_in
from tests.importers.things.shapes import box, write


def test_bad_things_are_refused_and_the_others_go_on(tmp_path: Path):
    """Two of one name get a number; the manifest has both sides."""
    source = tmp_path / "in"
    (source / "more").mkdir(parents=True)
    write(box(), source / "crate.stl")
    write(box((0.1, 0.1, 0.1)), source / "more" / "crate.obj")
    (source / "bad.glb").write_bytes(b"nothing")
    write(box((0.1, 0.1, 0.0)), source / "sheet.stl")
    told: list[Outcome] = []
    outcomes = import_folder(things_in(source), tmp_path / "out", jobs=3, done=told.append)
    assert [outcome.source.name for outcome in outcomes] == ["bad.glb", "crate.stl", "crate.obj", "sheet.stl"]
    assert isinstance(outcomes[0].error, SceneFileError)
    assert [outcome.asset.name for outcome in outcomes if outcome.asset] == ["crate.xml", "crate_2.xml"]
    assert len(told) == 4
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert len(manifest["imported"]) == 2
    refused = {Path(source).name: told for source, told in manifest["refused"].items()}
    assert refused["bad.glb"]["error"] == "SceneFileError"
    assert (refused["sheet.stl"]["error"], refused["sheet.stl"]["fault"]) == ("MeshError", "flat")
    assert (tmp_path / "out" / "crate_2.xml").is_file()


def test_meshes_of_a_urdf_are_no_things_of_their_own(tmp_path: Path):
    """But others beside it are."""
    write(box(), tmp_path / "part.stl")
    write(box(), tmp_path / "other.stl")
    (tmp_path / "robot.urdf").write_text('<robot><mesh filename="part.stl"/></robot>')
    assert [path.name for path in things_in(tmp_path)] == ["other.stl", "robot.urdf"]


class _FakeProcess:
    """A process that ends before it answers."""

    exitcode = -11

    def __init__(self, **arguments: object) -> None:
        pass

    def start(self) -> None:
        """Do nothing."""

    def join(self) -> None:
        """Do nothing."""


def test_a_process_that_ends_is_told_with_its_status(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As one that a library brings down."""
    context = module.multiprocessing.get_context("spawn")
    monkeypatch.setattr(type(context), "Process", _FakeProcess)
    (outcome,) = import_folder([tmp_path / "a.stl"], tmp_path / "out", jobs=1)
    assert "ended with status -11" in str(outcome.error)


def test_errors_come_back_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With their class and reason."""
    sent: list[object] = []

    class Far:
        def send(self, answer: object) -> None:
            sent.append(answer)

    def refuse(*arguments: object) -> None:
        raise MeshError("scan.stl: too many", "large")

    monkeypatch.setattr(module, "import_thing", refuse)
    # pyrefly: ignore[bad-argument-type]
    module._work(Far(), tmp_path / "scan.stl", tmp_path / "scan.xml", module.Options())
    assert isinstance(sent[0], MeshError)
    assert sent[0].reason == "large"
