"""The layouts of the shipped scenes keep their bits from one version to the next."""

from __future__ import annotations

import json

import pytest

from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from tests.layout.layout_hashes import FILE, layout_hashes, processor
from tests.versions import since_4

KEPT = json.loads(FILE.read_text())


@since_4("its compiler rounds otherwise, and bits are promised per version")
@pytest.mark.parametrize("scene", shipped("envs", ".yaml"))
def test_the_layouts_of_a_shipped_scene_keep_their_bits(scene: str):
    """In both splits. Where a change is meant, write the file anew and say in CHANGELOG.md what changed, and why."""
    if processor() != KEPT["processor"]:
        pytest.skip(f"the hashes were made on '{KEPT['processor']}', and bits differ on '{processor()}'")
    assert layout_hashes(scene) == KEPT["scenes"][scene]


@pytest.mark.oldest
@pytest.mark.parametrize("scene", shipped("envs", ".yaml"))
def test_a_shipped_scene_has_the_same_id_with_every_version_of_mujoco(scene: str):
    """So that layouts go by the same names, on any processor too."""
    assert build_model(SceneConfig.load(scene)).hash == KEPT["scenes"][scene]["scene"]


def test_every_shipped_scene_has_its_hashes():
    """A new scene gets a line, and one that is gone has none."""
    assert set(KEPT["scenes"]) == set(shipped("envs", ".yaml"))
