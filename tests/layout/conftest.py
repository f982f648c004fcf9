"""A crane with two cubes, for all tests that are about reach."""

from __future__ import annotations

import pytest

from sceniris_gym.program.compiled import CompiledScene
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.param_scenes import scene_with_params
from tests.layout.scenes import box_mjcf, compile_on_cpu


@pytest.fixture(scope="session")
def crane(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A crane that is to reach a cube, with another one that may lie anywhere."""
    folder = tmp_path_factory.mktemp("crane")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    scene = crane_scene(asset, cube)
    scene["objects"]["other"] = {"asset": cube, "on": "floor"}
    return compile_on_cpu(scene, bank=4)


@pytest.fixture(scope="session")
def param_scene(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A scene of which all that can be a param of layouts is one."""
    return compile_on_cpu(scene_with_params(tmp_path_factory.mktemp("params")))
