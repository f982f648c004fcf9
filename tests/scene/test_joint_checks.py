"""Joints that cannot be drawn as a scene file says."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from tests.scene.assets import BALL, build


def test_noise_around_a_start_pose_beyond_the_limits_is_refused(folder: Path):
    """It would be cut off at limits that the joint has left already; a rounded keyframe is fine."""
    lid = '<joint name="lid" type="slide" range="0 .2"/><geom size=".1"/>'
    for start, fits in ((0.3, False), (-0.1, False), (0.2, True), (0.2 + 1e-7, True)):
        key = f'<keyframe><key name="home" qpos="{start}"/></keyframe>'
        (folder / "pot.xml").write_text(
            f'<mujoco><worldbody><body name="pot"><body>{lid}</body></body></worldbody>{key}</mujoco>'
        )
        pot = {"asset": "pot", "kind": "fixture", "joints": {"*": {"noise": 0.15}}}
        if fits:
            build(folder, {"pot": dict(pot)})
        else:
            with pytest.raises(
                SceneKeyError, match=r"pot\.joints\.\*\.noise: 'pot/lid' starts at .* limits \[0, 0\.2\]"
            ):
                build(folder, {"pot": dict(pot)})
        build(folder, {"pot": {**pot, "joints": {"lid": {"range": [0, 0.1]}}}})


def test_a_ball_joint_cannot_be_drawn_yet(folder: Path):
    """Joints are sliders and hinges."""
    (folder / "joystick.xml").write_text(
        BALL.replace("</body>", "<body name='s'><joint type='ball'/><geom size='.1'/></body></body>")
    )
    with pytest.raises(NotSupportedError, match="'a/joint0' is a ball joint"):
        build(folder, {"a": {"asset": "joystick", "kind": "fixture", "joints": {"*": {"value": 0}}}})
