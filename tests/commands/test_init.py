"""The `init` command: what it writes compiles at once, whatever of the model cannot be placed."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym import cli
from sceniris_gym.commands.init import init
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneFileError
from sceniris_gym.layout.compile import compile_scene
from tests.importers.models.models import FINGERS, TABLE, arm


def test_what_is_written_compiles_beside_its_model(tmp_path: Path, capfd: pytest.CaptureFixture):
    """The model is named relative to the scene file."""
    (tmp_path / "models").mkdir()
    (tmp_path / "models/table.xml").write_text(TABLE)
    out = tmp_path / "scene.yaml"
    cli.main(["init", str(tmp_path / "models/table.xml"), "-o", str(out), "--device", "cpu"])
    assert "no robot; placed: can, a, top, ball; commented out, with reasons: pin" in capfd.readouterr().out
    assert "model: models/table.xml" in out.read_text()
    assert compile_scene(out, "cpu").placed == ("can", "a", "top", "ball")


def test_it_is_written_to_stdout_by_default(tmp_path: Path, capfd: pytest.CaptureFixture):
    """The file is valid as it is, with a robot that can reach."""
    model = tmp_path / "arm.xml"
    model.write_text(arm(FINGERS))
    cli.main(["init", str(model), "--device", "cpu"])
    out = tmp_path / "scene.yaml"
    out.write_text(capfd.readouterr().out)
    assert SceneConfig.load(out).robot is not None
    assert "reachable: ik" in out.read_text()


def test_what_cannot_be_placed_is_commented_out_with_the_error(tmp_path: Path):
    """A can that the shelf above leaves no room for; what is lower stays."""
    model = tmp_path / "table.xml"
    shelf = '<body name="shelf" pos="0.5 0 0.641"><geom type="box" size="0.4 0.5 0.1"/></body></worldbody>'
    model.write_text(TABLE.replace("</worldbody>", shelf))
    scene = init(model, "cpu")
    why = {entry.name: entry.why for entry in scene.objects}
    assert "no valid layout was found: 'can' could not be placed" in why["can"]
    assert list(scene.words()["objects"]) == [name for name, reason in why.items() if not reason]
    assert {"a", "ball"} <= set(scene.words()["objects"])


def test_what_is_larger_than_its_support_may_hang_over(tmp_path: Path):
    """A plate on a block, with a note; what fits on its support lies there as a whole."""
    model = tmp_path / "table.xml"
    plate = '<body name="plate" pos="0.4 0.2 0.51"><freejoint/><geom type="cylinder" size="0.15 0.01"/></body>'
    model.write_text(TABLE.replace('<body name="top"', plate + '<body name="top"'))
    scene = init(model, "cpu")
    words = scene.words()["objects"]
    assert words["plate"] == {"on": "a"}
    assert words["a"]["ratio_on_support"] == 1
    assert "No place was found where it lies on its support as a whole" in scene.text("table.xml")


def test_a_model_that_cannot_be_read_is_an_error(tmp_path: Path):
    """Of ours, with the path."""
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(SceneFileError, match=r"bad\.xml"):
        init(tmp_path / "bad.xml", "cpu")
