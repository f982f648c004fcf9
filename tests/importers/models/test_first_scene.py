"""First scenes of models: their words, and the file that says them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneFileError
from sceniris_gym.importers.models.first_scene import first_scene
from sceniris_gym.scene.build import build_model
from tests.importers.models.models import FINGERS, TABLE, arm


def model(folder: Path, xml: str) -> Path:
    """Write a model and return its path."""
    path = folder / "model.xml"
    path.write_text(xml)
    return path


def test_free_bodies_stand_on_what_is_beneath_them(tmp_path: Path):
    """On a box before what stands on that; endless planes get a region; what has no freejoint is a comment."""
    scene = first_scene(model(tmp_path, TABLE))
    text = scene.text(tmp_path / "scene.yaml")
    assert YAML(typ="safe").load(text) == {
        "model": "model.xml",
        "objects": {
            "can": {"on": "table", "ratio_on_support": 1},
            "a": {"body": "a/main", "on": "table", "ratio_on_support": 1},
            "top": {"on": "a", "ratio_on_support": 1},
            "ball": {"on": "ground", "region": {"box": [[-0.8, -0.1], [-0.2, 0.5]]}},
        },
    }
    assert "# pin: {on: SUPPORT}" in text
    assert "Write <freejoint/> in their place" in text
    assert "table: 0.6 x 0.8 m, 0.48 m2" in text


def test_three_slides_and_three_hinges_are_a_free_body(tmp_path: Path):
    """It gets an entry as bodies with a freejoint do."""
    joints = [f'<joint type="{t}" axis="{i}"/>' for t in ("slide", "hinge") for i in ("1 0 0", "0 1 0", "0 0 1")]
    two = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
    scene = first_scene(model(tmp_path, TABLE.replace(two, "".join(joints))))
    assert scene.words()["objects"]["pin"] == {"on": "table", "ratio_on_support": 1}


def test_points_of_a_cloth_are_no_objects(tmp_path: Path):
    """Each is a body on three slides, and was commented out with the advice to write a freejoint."""
    cloth = '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".05 .05 .05" pos="0 0 1" mass=".1" dim="2"/>'
    scene = first_scene(model(tmp_path, TABLE.replace("</worldbody>", f"{cloth}</worldbody>")))
    assert [entry.name for entry in scene.objects] == ["can", "a", "top", "ball", "pin"]


def test_what_stands_on_something_that_is_commented_out_is_too(tmp_path: Path):
    """Each with its reason."""
    scene = first_scene(model(tmp_path, TABLE))
    scene.comment_out("a", "it is too heavy.")
    assert list(scene.words()["objects"]) == ["can", "ball"]
    lines = scene.text().splitlines()
    assert lines[lines.index("  # a: {body: a/main, on: table, ratio_on_support: 1}") - 1] == "  # it is too heavy."
    assert (
        lines[lines.index("  # top: {on: a, ratio_on_support: 1}") - 1]
        == "  # It stands on 'a', which is commented out."
    )


def test_a_robot_is_named_with_its_tool(tmp_path: Path):
    """Also where the model has nothing else."""
    scene = first_scene(model(tmp_path, arm(FINGERS)))
    assert scene.words()["robot"] == {"in_model": "base", "tcp": {"body": "hand", "offset": [0.0, 0.0, 0.07]}}
    assert scene.words()["objects"] == {}
    assert "no body with a freejoint" in scene.text()


def test_what_has_no_name_is_named_by_its_place(tmp_path: Path):
    """The root of a robot, a free body, the ground, and the only keyframe, which is the start pose."""
    robot = first_scene(model(tmp_path, arm(FINGERS).replace('<body name="base">', "<body>"))).words()["robot"]
    assert robot["in_model"] == "body_1"
    xml = TABLE.replace('<body name="ball"', "<body").replace('<geom name="ground"', "<geom")
    mjm = mujoco.MjModel.from_xml_string(xml)
    qpos = mjm.qpos0 + np.where(np.arange(mjm.nq) == 0, 0.01, 0.0)
    key = f'<keyframe><key qpos="{" ".join(map(str, qpos))}"/></keyframe></mujoco>'
    scene = first_scene(model(tmp_path, xml.replace("</mujoco>", key)))
    ball = next(name for name in scene.words()["objects"] if name.startswith("body_"))
    assert scene.words()["objects"][ball]["on"] == "geom_0"
    assert scene.words()["home"] == "key_0"
    built = build_model(SceneConfig.load(scene.words()))
    assert built.home_qpos.tolist() == qpos.tolist()
    assert mjm.geom_type[mjm.body_geomadr[built.bodies[ball]]] == mujoco.mjtGeom.mjGEOM_SPHERE
    assert built.support("geom_0", "").geom == 0
    named = first_scene(model(tmp_path, xml.replace("</mujoco>", key.replace("<key ", '<key name="u_ready" '))))
    assert named.words()["home"] == "u_ready"


def test_the_start_pose_is_a_home_of_an_attached_model(tmp_path: Path):
    """Named in the scene, if the whole model has no keyframe of that name; the first one, if there are several."""
    keys = "".join(
        f'<key name="{name}" qpos="0.5 0 {z} 1 0 0 0  0.4 0.2 0.46 1 0 0 0  0.4 0.2 0.52 1 0 0 0  -0.5 0.2 0.1 1 0 0 0'
        '  0 0"/>'
        for name, z in (("reset", 0.5), ("arm/home", 0.6), ("b/home", 0.7), ("home_b", 0.8))
    )
    xml = TABLE.replace("</mujoco>", f"<keyframe>{keys}</keyframe></mujoco>")
    scene = first_scene(model(tmp_path, xml))
    assert scene.words()["home"] == YAML(typ="safe").load(scene.text())["home"] == "arm/home"
    assert "# The start pose is its keyframe 'arm/home', of 'arm/home', 'b/home'." in scene.text()
    config = SceneConfig.load(scene.words())
    assert build_model(config).home_qpos[2] == 0.6
    scene = first_scene(model(tmp_path, xml.replace('"b/home"', '"home"')))
    assert "home" not in scene.words()
    assert "# The start pose is its keyframe 'home'." in scene.text()


def test_things_stand_on_a_table_that_moves_itself(tmp_path: Path):
    """The can touches the box around the table, whose ray begins there; but it is the table that carries the can."""
    legs = '<geom type="box" pos="0.2 0.2 -0.21" size="0.02 0.02 0.19"/>'
    table = '<body name="table" pos="0.5 0 0.4"><geom type="box" size="0.3 0.4 0.02" rgba="0 0 0 0"/>'
    low = TABLE.replace(table, f"{table}<freejoint/>{legs}").replace(
        '"can" pos="0.5 0 0.48"', '"can" pos="0.5 0 0.4799"'
    )
    objects = first_scene(model(tmp_path, low)).words()["objects"]
    assert objects["table"] == {"on": "ground", "region": {"box": [[0.2, -0.3], [0.8, 0.3]]}}
    assert objects["can"] == {"on": "table", "ratio_on_support": 1}


def test_a_missing_model_is_an_error_of_ours(tmp_path: Path):
    """As everywhere."""
    with pytest.raises(SceneFileError, match="there is no such file"):
        first_scene(tmp_path / "none.xml")
