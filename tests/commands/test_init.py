"""The `init` command: what it writes compiles at once, whatever of the model cannot be placed."""

from __future__ import annotations

import gc
import math
import re
from pathlib import Path

import numpy as np
import pytest

from sceniris_gym import cli
from sceniris_gym.commands.init import init, write_suite
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneFileError
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.importers.libero.reader import LiberoTask, read_bddl
from sceniris_gym.importers.models.first_scene import first_scene
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from tests.importers.libero.problems import STACK, write
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


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_scene_file_that_exists_is_kept(tmp_path: Path, capfd: pytest.CaptureFixture):
    """Of a model, and of a problem file; a folder of problem files needs a folder that does not exist."""
    (tmp_path / "table.xml").write_text(TABLE)
    for folder in ("files", "own"):
        (tmp_path / folder).mkdir()
    file, own = write(tmp_path / "files", STACK), tmp_path / "own/scene.yaml"
    own.write_text("mine")
    kept = f"init: {own} exists. Give another --out, or remove this file."
    for model, out, refused in (
        (tmp_path / "table.xml", own, kept),
        (file, own, kept),
        (file.parent, own.parent, "it is a folder"),
    ):
        with pytest.raises(SystemExit, match="2"):
            cli.main(["init", str(model), "-o", str(out), "--device", "cpu"])
        assert refused in capfd.readouterr().err
    assert ([path.name for path in own.parent.iterdir()], own.read_text()) == (["scene.yaml"], "mine")


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
    assert lines[plank - 1] == "  # It may overhang its support: `ratio_on_support: 1` finds no place."
    assert lines[plank + 1] == "  cube: {on: plank, ratio_on_support: 1}"
    cli.main(["check", str(out), "--device", "cpu"])
    assert "100.00% valid" in capfd.readouterr().out


def test_what_falls_over_lies_and_what_stands_on_something_aslant_stands_elsewhere(tmp_path: Path):
    """A card on its edge, a leaning tray, and a cube on it. A pen, which no pose would keep, is commented out."""
    (tmp_path / "cards.xml").write_text(
        '<mujoco><worldbody><body name="table" pos="0 0 0.2"><geom type="box" size="0.4 0.4 0.2"/></body>'
        '<body name="card" pos="0 0 0.45"><freejoint/><geom type="box" size="0.002 0.03 0.045" euler="0 10 0"/></body>'
        '<body name="tray" pos="0.2 0 0.44" euler="0 30 0"><freejoint/><geom type="box" size="0.04 0.04 0.01"/></body>'
        '<body name="cube" pos="0.2 0 0.48"><freejoint/><geom type="box" size="0.01 0.01 0.01"/></body>'
        '<body name="ramp" pos="0.3 0.3 0.5" euler="0 20 0"><geom type="box" size="0.05 0.05 0.01"/></body>'
        '<body name="pen" pos="-0.2 0 0.5"><freejoint/><geom type="capsule" size="0.005 0.05"/></body>'
        "</worldbody></mujoco>"
    )
    scene = init(tmp_path / "cards.xml", "cpu")
    whole = {"on": "table", "ratio_on_support": 1}
    lies = {**whole, "orientation": "stable"}
    assert scene.words()["objects"] == {"card": lies, "tray": lies, "cube": whole}
    assert "unstable in every pose" in {entry.name: entry.why for entry in scene.objects}["pen"]
    assert "may overhang" not in scene.text()
    assert [support.name for support in scene.supports] == ["table"]


def test_an_arm_without_names_is_written_with_names_by_place(tmp_path: Path):
    """Its hand, too, at which the tool is: an empty name was a KeyError. As an asset, it has the same names."""
    model = tmp_path / "arm.xml"
    key = '<keyframe><key qpos="0 0.5 0 0 0 0 0 0"/></keyframe></mujoco>'
    model.write_text(re.sub(r' name="\w+"', "", arm(FINGERS)).replace("</mujoco>", key))
    scene = init(model, "cpu")
    assert scene.words()["robot"] == {"in_model": "body_1", "tcp": {"body": "body_8", "offset": [0.0, 0.0, 0.07]}}
    asset = {"asset": str(model), "keyframe": "key_0", "tcp": scene.words()["robot"]["tcp"]}
    for words, site in ((scene.words(), "tcp"), ({"robot": asset}, "arm/tcp")):
        home = compile_scene({**words, "floor": {"size": [2, 2]}}, "cpu", overrides={"bank": 4}).scene.home
        assert home.site(site).xpos == pytest.approx((0.57 * math.sin(0.5), 0.0, 0.2 + 0.57 * math.cos(0.5)), abs=1e-6)


def test_a_model_that_cannot_be_read_is_an_error(tmp_path: Path):
    """Of ours, with the path."""
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(SceneFileError, match=r"bad\.xml"):
        init(tmp_path / "bad.xml", "cpu")


def test_an_arm_on_a_cart_is_written_with_the_joints_that_drive_it(tmp_path: Path):
    """A cart with named joints can be drawn below its arm, and a robot whose base is free is named whole."""
    joints = (
        '<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/><joint name="turn"/>'
    )
    model = tmp_path / "cart.xml"
    cart = f'<worldbody><body name="cart" pos="0 0 .11">{joints}<geom size="0.1"/>'
    model.write_text(arm(FINGERS).replace("<worldbody>", cart).replace("</worldbody>", "</body></worldbody>"))
    scene = init(model, "cpu")
    assert scene.robot is not None
    assert scene.robot.words["in_model"] == "base"
    assert "An arm of 6 joints, with fingers." in scene.robot.notes
    (cart,) = scene.fixtures
    mug = {"asset": "mug", "on": "floor", "reachable": "ik", "region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}}
    words = {**scene.words(), "floor": {"size": [3, 3]}, "objects": {cart.name: cart.words, "mug": mug}}
    compiled = compile_scene({**words, "restarts": 60}, "cpu", overrides={"bank": 4})
    drawn = make_table(compiled, 40, 0).qpos[:, [compiled.mjm.joint(name).qposadr[0] for name in ("x", "y", "turn")]]
    assert (np.ptp(drawn, axis=0) > 0.2).all()
    free = arm(FINGERS).replace('<body name="base">', '<body name="base" pos="0 0 1"><freejoint/>')
    model.write_text(free.replace("</mujoco>", '<actuator><position joint="j1"/></actuator></mujoco>'))
    (robot,) = first_scene(model).objects
    assert "`robot: {in_model: base, tcp: {body: hand, offset: [0.0, 0.0, 0.07]}}`" in robot.why


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_problem_file_of_libero_becomes_a_scene_file_with_its_model(tmp_path: Path, capfd: pytest.CaptureFixture):
    """The same layouts come of the scene file as of the problem file; the goal is a comment."""
    problem, out = write(tmp_path), tmp_path / "kitchen.yaml"
    cli.main(
        [
            "init",
            str(problem),
            "-o",
            str(out),
            "--widen",
            "2",
            "--clutter",
            "1",
            "--robot",
            "panda",
            "--arena",
            "--device",
            "cpu",
        ]
    )
    assert "(On akita_black_bowl_1 plate_1)" in capfd.readouterr().out
    text = out.read_text()
    assert "# Goal: (On akita_black_bowl_1 plate_1) (Close wooden_cabinet_1_top_region)" in text
    assert "model: kitchen_model/scene.xml" in text
    written = compile_scene(out, "cpu")
    direct = compile_scene(read_bddl(problem, widen=2.0, clutter=1, robot="panda", arena=True).scene, "cpu")
    assert written.placed == direct.placed
    assert set(written.config.cameras) == {"agentview", "robot0_eye_in_hand"}
    ours, theirs = make_table(written, 32, 0), make_table(direct, 32, 0)
    np.testing.assert_allclose(ours.qpos, theirs.qpos, atol=1e-6)
    np.testing.assert_allclose(ours.mocap_pos, theirs.mocap_pos, atol=1e-6)


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_folder_of_problem_files_becomes_a_folder_of_scenes(tmp_path: Path, capfd: pytest.CaptureFixture):
    """A refused file does not stop the others. It is named with its reason, and the exit status is 1."""
    files, out = tmp_path / "files", tmp_path / "suite"
    (files / "goal").mkdir(parents=True)
    write(files / "goal", STACK)
    with pytest.raises(SystemExit, match="2"):
        cli.main(["init", str(files), "-o", str(out) + ".yaml"])
    assert "Give a folder." in capfd.readouterr().err
    write(files, STACK.replace("- cookies", "- kookies"))
    with pytest.raises(SystemExit, match="1"):
        cli.main(["init", str(files), "-o", str(out), "--device", "cpu"])
    head, done, refused = capfd.readouterr().out.splitlines()
    assert head == "FAIL: 1 of 2 problem files written"
    assert done == f"goal/problem.bddl  {out}/goal/problem.yaml  (In akita_black_bowl_1 basket_1_contain_region)"
    assert refused.startswith("problem.bddl") and "refused: UnknownNameError: " in refused and "'kookies'" in refused
    assert set(SceneConfig.load(out / "goal/problem.yaml").objects) == {"akita_black_bowl_1", "cookies_1", "basket_1"}


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_folder_of_problem_files_needs_the_memory_of_one(tmp_path: Path):
    """Each file's models are gone when the next file is read, although they are in reference cycles."""
    alive = []

    def read(file: Path) -> LiberoTask:
        alive.append(sum(isinstance(thing, ContactRules) for thing in gc.get_objects()))
        return read_bddl(file)

    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
        write(tmp_path / name, STACK)
    gc.collect()
    write_suite(tmp_path, tmp_path / "suite", read, "cpu")
    assert alive == [alive[0]] * 3


def test_a_folder_without_problem_files_is_refused(tmp_path: Path):
    """A folder of models, for example."""
    with pytest.raises(SceneFileError, match=r"contains no problem files\. Give a folder that contains \.bddl files"):
        cli.init(tmp_path, tmp_path / "suite")
    with pytest.raises(NotSupportedError, match=r"-o FOLDER for a folder of problem files"):
        cli.init(tmp_path)


def test_options_of_problem_files_belong_to_them_alone(tmp_path: Path):
    """A model takes none of them, and a problem file needs a place for its model."""
    model = tmp_path / "table.xml"
    model.write_text(TABLE)
    with pytest.raises(
        NotSupportedError, match=r"--assets, --widen, --clutter, --robot and --arena need a problem file"
    ):
        cli.init(model, widen=2.0)
    with pytest.raises(NotSupportedError, match=r"becomes two files, a scene and its model. Give -o FILE.yaml"):
        cli.init(write(tmp_path))


def test_a_conflict_of_attached_models_is_told_once(tmp_path: Path, capfd: pytest.CaptureFixture):
    """On a line, although MuJoCo prints three at each of the four times that the model is read."""
    ball = "<body name='BALL'><freejoint/><geom size='.03' pos='0 0 .03'/></body>"
    arm = f"<mujoco model='arm'><size njmax='300'/><worldbody>{ball}</worldbody></mujoco>".replace("BALL", "theirs")
    (tmp_path / "arm.xml").write_text(arm)
    (tmp_path / "cell.xml").write_text(
        "<mujoco model='cell'><size njmax='500'/><asset><model name='arm' file='arm.xml'/></asset><worldbody>"
        f"<geom name='ground' type='plane' size='1 1 .1'/>{ball.replace('BALL', 'ball')}"
        "<frame pos='.5 0 0'><attach model='arm' prefix='a_'/></frame></worldbody></mujoco>"
    )
    cli.main(["init", str(tmp_path / "cell.xml"), "-o", str(tmp_path / "cell.yaml"), "--device", "cpu"])
    told = [line for line in capfd.readouterr().err.splitlines() if "conflict" in line or "parent has" in line]
    assert len(told) == 1
    assert told[0].startswith("warning: Attach conflict when attaching 'arm' to 'cell'")
    assert told[0].endswith("njmax: parent has 500, child has 300, keeping parent value")
