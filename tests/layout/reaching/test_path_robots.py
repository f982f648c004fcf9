"""Paths of several arms, of arms whose joints turn without end, and of hands whose fingers slide without limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import InfeasibleSceneError, ModelWarning, SceneKeyError, ScenirisError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from tests.layout.crane import crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.layout.walked import walked

NWORLD = 12
FLOOR = {"size": [2.4, 2.4]}
ROBOTS = {
    "left": {"asset": "panda", "base": [-0.1, 0.6, 0.0], "yaw": -90.0, "joints": {"joint*": {"noise": 0.05}}},
    "right": {"asset": "panda", "base": [0.1, -0.6, 0.0], "yaw": 90.0, "joints": {"joint*": {"noise": 0.05}}},
}
BETWEEN = {"on": "floor", "region": {"box": [[-0.3, -0.15], [0.3, 0.15]]}}


def two_arms(**words: Any) -> dict[str, Any]:
    """Return a scene of two arms that face each other, each with its own target between them."""
    objects = {
        "can": {"asset": "can", **BETWEEN, "reachable": {"by": "left", "tier": "path"}},
        "lemon": {"asset": "lemon", **BETWEEN, "reachable": {"by": "right", "tier": "path", "margin": 0.002}},
    }
    return {"floor": FLOOR, "robots": ROBOTS, "objects": objects, "bank": 2, **words}


@pytest.fixture(scope="module")
def made() -> LayoutGenerator:
    """Return layouts of the two arms."""
    generator = LayoutGenerator(compile_scene(two_arms(), "cpu"), NWORLD)
    generator.generate()
    return generator


def test_paths_of_two_arms_are_free_with_the_other_arm_at_its_start(made: LayoutGenerator):
    """Each starts at the drawn pose of its own arm."""
    reaching = made.compiled.reaching
    assert reaching is not None
    assert [reaching.arm_of(target).robot for target in reaching.targets] == ["left", "right"]
    found = walked(made.compiled, made.layouts)
    assert len(found) == 2 * NWORLD
    assert [walk for walk in found if walk.hit] == []


@pytest.mark.parametrize("home", [-2.9, 4.0])
def test_a_joint_without_limits_takes_the_short_way(tmp_path: Path, home: float):
    """Over the angle of half a turn, from where it is; starts on the path are there, too."""
    file = Path(crane_mjcf(tmp_path, solid=True))
    text = file.read_text().replace('name="turn" axis="0 0 1" range="-3.2 3.2"', 'name="turn" axis="0 0 1"')
    file.write_text(text.replace('qpos="0 0.4', f'qpos="{home} 0.4'))
    scene = crane_scene(str(file), box_mjcf(tmp_path, "block", 0.03, 0.03, 0.04), reachable="path")
    scene["robot"]["joints"] = {"turn": {"noise": 0.2}}
    made = []
    for start in ([], [{"robot": "path", "of": "thing", "share": [0.9, 1.0]}]):
        generator = LayoutGenerator(compile_scene({**scene, "restarts": 60, "bank": 2, "start": start}, "cpu"), NWORLD)
        generator.generate()
        assert (generator.layouts.status.numpy() == LayoutStatus.VALID).all()
        made.append(generator)
    found = walked(made[0].compiled, made[0].layouts, 41)
    assert [walk for walk in found if walk.hit] == []
    turned = np.array([walk.corners[:, 0] for walk in found])
    assert (np.abs(turned[:, 3] - turned[:, 0]) <= np.pi + 1e-5).all()
    assert (np.abs(np.diff(turned[:, 3:], axis=1)) < 0.8).all()
    assert np.abs(turned).max() > np.pi
    adr = made[0].compiled.mjm.joint("crane/turn").qposadr[0]
    np.testing.assert_allclose(made[1].layouts.qpos[:, adr].numpy(), turned[:, 4], atol=0.4)


def test_a_robot_that_touches_something_at_the_start_is_refused(tmp_path: Path):
    """A post in its forearm at home; the error has the margin, and a warning the two geoms."""
    post = write_mjcf(tmp_path, "post", '<geom name="pole" type="box" size=".03 .03 .3" pos=".3 0 .3"/>')
    can = {"asset": "can", "on": "floor", "region": {"box": [[0.4, -0.3], [0.6, -0.1]]}, "reachable": "path"}
    objects = {"post": {"asset": post, "kind": "static"}, "can": can}
    scene = {"floor": FLOOR, "robot": {"asset": "panda"}, "objects": objects, "bank": 1, "restarts": 0}
    with (
        pytest.warns(ModelWarning, match="inside geom 'post/pole'"),
        pytest.raises(InfeasibleSceneError, match=r"no_path.* start pose further .* 'margin'"),
    ):
        compile_scene(scene, "cpu")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"objects.lemon.reachable": {"by": "rihgt", "tier": "path"}}, "Did you mean 'right'"),
        ({"objects.lemon.reachable": "path"}, "reachable: {by: left}"),
        ({"objects.lemon.reachable": {"by": "left", "tier": "paht"}}, "Did you mean 'path'"),
        ({"start": [{"robot": "path", "of": "can", "share": [-0.1, 1.0]}]}, "share"),
        ({"start": [{"robot": "path", "of": "melon"}]}, "Did you mean 'lemon'"),
    ],
)
def test_words_that_name_no_path_are_refused(words: dict[str, Any], says: str):
    """By the name of the robot, the tier or the object."""
    with pytest.raises(ScenirisError) as caught:
        compile_scene(SceneConfig.load(two_arms(), words), "cpu")
    assert says in str(caught.value)


def test_a_robot_outside_of_the_scene_has_no_path():
    """By the key of its target."""
    can = {"asset": "can", **BETWEEN, "reachable": "path"}
    with pytest.raises(SceneKeyError, match=r"objects\.can\.reachable: .* 'path' need the robot"):
        compile_scene({"floor": FLOOR, "robot": {"asset": "panda", "in_scene": False}, "objects": {"can": can}}, "cpu")


def test_paths_do_not_depend_on_what_is_drawn_of_physics(made: LayoutGenerator):
    """Masses and friction are drawn after the path; a param that makes objects rarer leaves paths that are free."""
    draws = {"mass": {"scale": [0.5, 2]}, "friction": {"scale": [0.5, 1]}}
    compiled = compile_scene(two_arms(), "cpu", overrides={"objects.can.randomize": draws})
    other = LayoutGenerator(compiled, NWORLD, params=["objects.can.clearance"])
    other.generate()
    for name in ("path", "grasp_qpos", "pregrasp_qpos"):
        ours, theirs = (getattr(generator.layouts, name).numpy() for generator in (made, other))
        np.testing.assert_array_equal(ours, theirs)
    other.set_params({"objects.can.clearance": 0.1})
    other.generate()
    assert [walk for walk in walked(compiled, other.layouts, 41) if walk.hit] == []
