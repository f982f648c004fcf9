"""Problem files as scenes: layouts without contacts, notices, arguments, and an arm beside the table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import pytest

from sceniris_gym.errors import ArgumentError, ModelWarning, SceneFileError, SceneKeyError
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from tests.importers.libero.problems import KITCHEN, STACK, write


@pytest.mark.parametrize("text", ["kitchen", "floor"])
def test_layouts_have_no_contacts(text: str, tmp_path: Path):
    """By MuJoCo C, apart from parts of one fixture, and with an arm in LIBERO's place."""
    path = write(tmp_path) if text == "kitchen" else write(tmp_path, STACK)
    with pytest.warns(ModelWarning, match="boxes stand in for"):
        task = read_bddl(path, robot="panda", clutter=1)
    compiled = compile_scene(task.scene, "cpu")
    assert task.scene.robot is not None
    assert task.scene.robot.base == ((-0.66, 0.0, 0.912) if text == "kitchen" else (-0.6, 0.0, 0.0))
    table, mjm = make_table(compiled, 64, 0), compiled.mjm
    data, root = mujoco.MjData(mjm), mjm.body_rootid[mjm.geom_bodyid]
    assert table.valid.all()
    for qpos, pos, quat in zip(table.qpos, table.mocap_pos, table.mocap_quat, strict=True):
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos, pos, quat
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_collision(mjm, data)
        ends = root[data.contact.geom]
        assert not ((data.contact.dist < 0.0) & (ends[:, 0] != ends[:, 1])).any()


def test_the_notice_names_the_classes_and_their_sizes(tmp_path: Path):
    """And the argument that would replace them."""
    with pytest.warns(ModelWarning) as told:
        read_bddl(write(tmp_path))
    (text,) = (str(warning.message) for warning in told)
    assert "plate (0.138 x 0.137 x 0.019 m)" in text
    assert "akita_black_bowl" in text
    assert text.endswith("Give `assets`, the folder libero/libero/assets of LIBERO's repository.")


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
@pytest.mark.parametrize("name", ["clutter_alphabet_soup", "object", "top_level"])
def test_things_of_any_name_stay_as_the_file_has_them(name: str, tmp_path: Path):
    """Also one that clutter or a part of a model has, too."""
    task = read_bddl(write(tmp_path, KITCHEN.replace("plate_1", name)), clutter=2)
    added = [thing for thing in task.problem.objects if thing not in ("akita_black_bowl_1", "akita_black_bowl_2", name)]
    assert task.problem.objects[name] == "plate" and len(added) == len(set(added)) == 4
    assert set(task.scene.objects) == {*added, *task.problem.things} - {"kitchen_table"}
    task = read_bddl(write(tmp_path, KITCHEN.replace("wooden_cabinet_1", name)), clutter=2)
    assert task.problem.fixtures[name] == "wooden_cabinet" and name in task.scene.objects


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"widen": 0.0}, "widen 0.0 should be a positive number"),
    ({"widen": "2"}, "widen '2' should be a positive number"),
    ({"clutter": -1}, "clutter -1 should be a whole number from 0 to 12"),
    ({"clutter": 13}, "clutter 13 should be a whole number from 0 to 12"),
    ({"clutter": 1.5}, "clutter 1.5 should be a whole number"),
]


@pytest.mark.parametrize(("arguments", "message"), WRONG, ids=[str(w[0]) for w in WRONG])
def test_wrong_arguments_are_refused(arguments: dict[str, Any], message: str, tmp_path: Path):
    """With what they should be."""
    with pytest.raises(ArgumentError, match=message):
        read_bddl(write(tmp_path), **arguments)


def test_a_folder_of_models_has_to_exist(tmp_path: Path):
    """A class that it lacks is a notice, a folder that is not there an error."""
    with pytest.raises(SceneFileError, match=r"there is no folder .*Give .* libero/libero/assets"):
        read_bddl(write(tmp_path), assets=tmp_path / "models")
    with pytest.warns(ModelWarning, match=r"lacks these\. Give .* libero/libero/assets"):
        read_bddl(write(tmp_path), assets=tmp_path)


def test_a_problem_has_one_work_surface(tmp_path: Path):
    """None is an error that lists them; the floor has its own name."""
    with pytest.raises(SceneKeyError, match=r"bddl:10: 'ground - floor' should have the name and the class 'floor'"):
        read_bddl(
            write(
                tmp_path,
                STACK.replace("floor - floor", "ground - floor")
                .replace("target floor", "target ground")
                .replace(" floor_", " ground_"),
            )
        )
    text = STACK.replace("floor - floor", "floor - flat_stove")
    with pytest.raises(SceneKeyError, match=r"one work surface among its fixtures \(kitchen_table, .*\), has 0"):
        read_bddl(write(tmp_path, text))
