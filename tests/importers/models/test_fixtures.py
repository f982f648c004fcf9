"""Joints of furniture and hands that a first scene proposes to draw."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from sceniris_gym.importers.models.first_scene import first_scene
from sceniris_gym.layout.tables import make_table
from tests.importers.models.models import TABLE
from tests.layout.scenes import compile_on_cpu


def test_joints_of_furniture_are_comments_that_can_be_drawn(tmp_path: Path):
    """Once their # is gone: near the start pose, which MuJoCo C confirms, and one pattern for many equal ones."""
    door = '<body pos="{0} 0 0"><joint name="{1}" range="{2}" {3}/><geom size=".05" mass="1"/></body>'
    ends = [("left", "-90 0", ""), ("right", "0 90", ""), ("knob", "0 0", 'limited="false"'), ("lid", "0 9", "")]
    doors = "".join(door.format(0.3 * i, *end) for i, end in enumerate(ends))
    shelf = "".join(door.format(0.3 * i, f"c/d{i}", "0 1", 'type="slide"') for i in range(5))
    follow = '<equality><joint joint1="lid" joint2="left" polycoef="0 -0.1 0 0 0"/></equality>'
    bodies = f'<body name="cab" pos="0 3 1">{doors}</body><body name="c/main" pos="0 5 1">{shelf}</body></worldbody>'
    path = tmp_path / "model.xml"
    path.write_text(TABLE.replace("</worldbody>", f"{bodies}{follow}"))
    scene = first_scene(path)
    assert "cab" not in scene.words()["objects"]
    text = scene.text(tmp_path / "scene.yaml")
    words = YAML(typ="safe").load(re.sub(r"# (cab|c): \{", r"\1: {", text))
    assert words["objects"]["c"] == {"body": "c/main", "kind": "static", "joints": {"*": {"noise": 0.3}}}
    assert "body" not in words["objects"]["cab"]
    assert words["objects"]["cab"]["joints"] == {
        "left": {"noise": 0.47},
        "right": {"noise": 0.47},
        "knob": {"noise": 0.3},
    }
    compiled = compile_on_cpu({**words, "model": str(path)}, bank=2)
    drawn = np.degrees(make_table(compiled, 50, 0).qpos[:, [compiled.mjm.joint(end[0]).qposadr[0] for end in ends]])
    low, high = drawn.min(0), drawn.max(0)
    assert (low >= [-27, 0, -18, 0]).all()
    assert (high <= [0, 27, 18, 2.7]).all()
    assert (high - low > [20, 20, 25, 2]).all()
