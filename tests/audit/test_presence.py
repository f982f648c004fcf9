"""The audit of groups: who is there, and that the absent ones are far away."""

import numpy as np

from sceniris_gym.audit.presence import presence
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import MJM, at, kept
from tests.commands.scenes import layout


def test_groups_count_who_is_there():
    """Too many, too few, one that is there and far away, and one that is absent and in the scene."""
    groups = {"some": {"of": ["can", "crate"], "count": 1}}
    far, here = at(42.0, 40.0), at(0.3, 0)
    rows = layout(MJM, 4)
    for row, place in enumerate((here, far, far, here)):
        rows.qpos[row] = layout(MJM, crate=place).qpos[0]
    present = np.array([[1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0]], bool)
    found = kept(LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, present), groups)
    assert (found["some", "count objects"].broken, found["some", "count objects"].checked) == (3, 4)
    assert found["crate", "present objects"].broken == 2
    assert found["can", "present objects"].broken == 1
    assert found["crate", "yaw rad"].checked == 2


def test_columns_are_objects_in_the_order_of_the_scene_and_then_the_robot():
    """By name, also of what is in no group."""
    objects = {"can": {"asset": "can", "on": "floor"}, "mug": {"asset": "mug", "on": "floor"}}
    scene = {"floor": {"size": [1.0, 1.0]}, "robot": {"asset": "panda"}, "objects": objects}
    rows = layout(MJM, 2)
    seen = np.array([[1, 0, 1], [0, 0, 1]], bool)
    found = presence(SceneConfig.load(scene), LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, seen))
    assert {name: there.tolist() for name, there in found.items()} == {
        "can": [True, False],
        "mug": [False, False],
        "robot": [True, True],
    }
