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


def test_things_stand_wholly_on_their_supports_where_they_can(tmp_path: Path, capfd: pytest.CaptureFixture):
    """A plank is longer than the post below it, so it hangs over, and a cube on the plank does not."""
    (tmp_path / "post.xml").write_text(
        '<mujoco><worldbody><body name="post" pos="0.5 0 0.2"><geom type="box" size="0.04 0.04 0.2"/></body>'
        '<body name="plank" pos="0.5 0 0.41"><freejoint/><geom type="box" size="0.15 0.03 0.01"/></body>'
        '<body name="cube" pos="0.5 0 0.43"><freejoint/><geom type="box" size="0.01 0.01 0.01"/></body>'
        "</worldbody></mujoco>"
    )
    out = tmp_path / "scene.yaml"
    cli.main(["init", str(tmp_path / "post.xml"), "-o", str(out), "--device", "cpu"])
    lines = out.read_text().splitlines()
    plank = lines.index("  plank: {on: post}")
    assert lines[plank - 1] == "  # It may hang over: `ratio_on_support: 1` finds no place."
    assert lines[plank + 1] == "  cube: {on: plank, ratio_on_support: 1}"
    cli.main(["check", str(out), "--device", "cpu"])
    assert "100.00% valid" in capfd.readouterr().out


def test_a_model_that_cannot_be_read_is_an_error(tmp_path: Path):
    """Of ours, with the path."""
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(SceneFileError, match=r"bad\.xml"):
        init(tmp_path / "bad.xml", "cpu")
