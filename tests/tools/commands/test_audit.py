"""The generator before its judge, in a scene that uses every word of the language."""

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.tools.commands.audit import judge, rejected_candidates

BUSY = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "panda", "base": [-0.5, 0.0, 0.0], "joints": {"*": {"noise": 0.02}}},
    "objects": {
        "table": {"asset": "table", "kind": "static"},
        "cabinet": {
            **{"asset": "cabinet", "kind": "fixture", "on": "floor"},
            "region": {"box": [[-0.9, -0.9], [0.9, 0.9]]},
            "joints": {"lower": {"fraction": [0.3, 1.0]}, "upper": {"choice": [0.0, 0.1, 0.25]}},
        },
        "can": {"asset": "can", "on": "table", "ratio_on_support": 1.0},
        "mug": {"asset": "mug", "on": "table", "clearance": 0.02, "ratio_on_support": 0.5},
        "bowl": {"asset": "bowl", "on": "table", "region": {"fraction": [[0.0, 0.0], [0.5, 1.0]]}},
        "apple": {"asset": "apple", "in": "cabinet/upper_drawer", "orientation": {"yaw": [-30, 30]}},
        "banana": {
            **{"asset": "banana", "inside": "cabinet/lower_drawer"},
            "region": {"fraction": [[0.1, 0.5], [0.9, 1.0]]},
        },
        "orange": {"asset": "orange", "on": "cabinet", "gap": 0.002},
        "goal": {"kind": "marker", "region": {"box": [[-0.2, -0.2, 0.6], [0.2, 0.2, 0.9]]}},
    },
}


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_no_fault_is_found_in_a_scene_of_every_word(geometry: str):
    """Robot, table, shelf, drawers, regions and roofs: nothing collides, is misplaced, or rejected for nothing."""
    compiled = compile_scene(SceneConfig.load(BUSY, {"geometry": geometry}), "cpu")
    found = judge(compiled, layouts=120, rejected=120, settled=0, seed=3)
    assert found["valid"] > 100
    assert found["rejected"] == 120
    for fault in ("missed_collisions", "false_alarms", "misplaced"):
        assert found[fault] == 0, found


def test_a_scene_that_rejects_nothing_gives_no_candidates():
    """One object alone on a floor never collides."""
    compiled = compile_scene(
        {"floor": {"size": [1.0, 1.0]}, "objects": {"can": {"asset": "can", "on": "floor"}}}, "cpu"
    )
    rows, names = rejected_candidates(compiled, 5, 0)
    assert len(rows) == 0
    assert names == []
