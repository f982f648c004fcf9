"""The scenes of the suite: as fine as the paper's, with its attempts, and with something to reach."""

from __future__ import annotations

import pytest

from benchmarks.paper import scenes
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model


@pytest.mark.parametrize("scene", [scenes.MID, scenes.HARD, scenes.HARD_PLUS, scenes.ARM], ids=lambda s: s[0])
def test_meshes_are_as_fine_as_those_of_the_paper(scene: scenes.Scene):
    """Rendered meshes are tested, and what stands beside the cabinet has 16,000 faces or more."""
    config = SceneConfig.load(*scene)
    assert config.geometry == "visual"
    assert config.attempts == 10
    mjm = build_model(config).mjm
    for name in set(config.objects) - {"cabinet"}:
        body = mjm.body(name).id
        drawn = [g for g in range(mjm.ngeom) if mjm.geom_bodyid[g] == body and mjm.geom_group[g] == 2]
        assert sum(mjm.mesh_facenum[mjm.geom_dataid[g]] for g in drawn) > 16000, name


def test_levels_are_those_of_the_paper():
    """Hard has the orange between cabinet and apple, Hard+ the mug as well."""
    hard, plus = (SceneConfig.load(*scene) for scene in scenes.LEVELS.values())
    assert list(scenes.LEVELS) == ["Hard", "Hard+"]
    assert set(hard.objects) == {"cabinet", "apple", "banana", "orange"}
    assert set(plus.objects) == {*hard.objects, "mug"}


def test_without_restarts_a_layout_can_fail():
    """Ten attempts an object, as in the paper."""
    config = SceneConfig.load(*scenes.without_restarts(scenes.MID))
    assert (config.attempts, config.restarts) == (10, 0)


def test_apple_and_cabinet_are_to_be_reached():
    """Both, and nothing else; the arm is there with and without."""
    compiled = scenes.compiled_scene(scenes.ARM_REACHES, "cpu")
    assert compiled.reaching is not None
    assert set(compiled.reaching.names) == {"apple", "cabinet"}
    assert SceneConfig.load(*scenes.ARM).robot == compiled.config.robot
