"""The layouts of the shipped scenes keep their bits from one version to the next."""

from __future__ import annotations

import json
import warnings

import pytest

from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import FallbackWarning, ScenirisWarning
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.layout.layout_hashes import FILE, layout_hashes, processor
from tests.versions import since_4

KEPT = json.loads(FILE.read_text())


@pytest.fixture(scope="module", params=shipped("envs", ".yaml"))
def built(request: pytest.FixtureRequest) -> tuple[str, SceneModel]:
    """Return the name and the model of a shipped scene. The tests of a scene follow each other, so it is built once."""
    return request.param, build_model(SceneConfig.load(request.param))


@pytest.fixture(scope="module")
def compiled(built: tuple[str, SceneModel]) -> tuple[CompiledScene, list[warnings.WarningMessage]]:
    """Return the scene and the warnings about it, which a scene that an earlier test compiled repeats."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        return compile_scene(built[1], "cpu"), caught


@pytest.mark.oldest
def test_a_shipped_scene_has_the_same_id_with_every_version_of_mujoco(built: tuple[str, SceneModel]):
    """So that layouts go by the same names, on any processor too."""
    assert built[1].hash == KEPT["scenes"][built[0]]["scene"]


def test_shipped_scenes_give_no_warning(compiled: tuple[CompiledScene, list[warnings.WarningMessage]]):
    """Nor do the assets in them. Only worlds without a layout are allowed."""
    told = [w for w in compiled[1] if issubclass(w.category, ScenirisWarning)]
    assert [str(w.message) for w in told if not issubclass(w.category, FallbackWarning)] == []


@since_4("its compiler rounds otherwise, and bits are promised per version")
def test_the_layouts_of_a_shipped_scene_keep_their_bits(
    built: tuple[str, SceneModel], compiled: tuple[CompiledScene, list[warnings.WarningMessage]]
):
    """In both splits. Where a change is meant, write the file anew and say in CHANGELOG.md what changed, and why."""
    if processor() != KEPT["processor"]:
        pytest.skip(f"the hashes were made on '{KEPT['processor']}', and bits differ on '{processor()}'")
    assert layout_hashes(compiled[0]) == KEPT["scenes"][built[0]]


def test_every_shipped_scene_has_its_hashes():
    """A new scene gets a line, and one that is gone has none."""
    assert set(KEPT["scenes"]) == set(shipped("envs", ".yaml"))
