"""The `import` command: one thing with a picture and words, a folder of them, and what is asked for wrongly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image

from sceniris_gym import cli
from sceniris_gym.commands.import_things import import_many, import_one, report
from sceniris_gym.errors import NotSupportedError, SceneFileError
from sceniris_gym.importers.things.importer import Options
from tests.importers.things.shapes import box, write


def test_a_thing_becomes_an_asset_with_a_picture(tmp_path: Path, capfd: pytest.CaptureFixture):
    """One line of JSON on stdout; in words it says what was guessed, repaired and measured."""
    source = write(box(), tmp_path / "box.stl")
    cli.main(["import", str(source), "-o", str(tmp_path / "crate.xml"), "--json", "--device", "cpu"])
    out = capfd.readouterr().out
    assert out.count("\n") == 1
    found = json.loads(out)
    with Image.open(found["picture"]) as picture:
        assert len(picture.convert("RGB").getcolors(1 << 20) or []) > 50
    said = report(found)
    for words in ("0.04 x 0.06 x 0.1 m", "guessed", "1 convex", "mm off the surface", "rests     in "):
        assert words in said


def test_a_folder_is_no_asset_and_an_asset_no_folder(tmp_path: Path):
    """And a folder needs something to import."""
    with pytest.raises(NotSupportedError, match=r"ends in \.xml"):
        import_one(write(box(), tmp_path / "box.stl"), tmp_path / "crate.yaml", Options(), None, "cpu")
    with pytest.raises(NotSupportedError, match="Give a folder"):
        import_many(tmp_path, tmp_path / "crate.xml", Options(), 1, "cpu")
    (tmp_path / "empty").mkdir()
    with pytest.raises(SceneFileError, match="contains no files to import"):
        import_many(tmp_path / "empty", tmp_path / "out", Options(), 1, "cpu")
