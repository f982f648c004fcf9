"""A small arm with stored layouts: no scene file and no search, so that these tests are about the write alone."""

from pathlib import Path

import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import default_budget
from sceniris_gym.sim.randomizer import ResetRandomizer

SMALL_ARM = Path(__file__).parents[1] / "data" / "small_arm.xml"
NROW = 7


def quaternions(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Return random unit quaternions wxyz about z, shape (*shape, 4)."""
    half = rng.uniform(-np.pi / 2, np.pi / 2, shape)
    return np.stack([np.cos(half), np.zeros(shape), np.zeros(shape), np.sin(half)], axis=-1)


@pytest.fixture(scope="session")
def small_scene() -> CompiledScene:
    """Return the scene of the small arm, in which nothing is placed."""
    return compile_scene(SceneConfig.load({"model": str(SMALL_ARM)}, {"bank": 1}), "cpu")


@pytest.fixture(scope="session")
def rows(small_scene: CompiledScene) -> LayoutTable:
    """Return seven different stored layouts of the small arm."""
    rng = np.random.default_rng(1)
    qpos = np.tile(small_scene.scene.home_qpos, (NROW, 1)).astype(np.float32)
    qpos[:, 0] = rng.uniform(0.05, 0.19, NROW)
    qpos[:, 1:3] = rng.uniform(-0.15, 0.05, (NROW, 2))
    qpos[:, 3] = 0.03
    qpos[:, 4:8] = quaternions(rng, NROW)
    qpos[:, 8:10] = rng.uniform(-0.3, 0.3, (NROW, 2))
    qpos[:, 10:12] = rng.uniform(0.0, 0.04, (NROW, 1))
    mocap_pos = rng.uniform([0.3, 0.3, 0.0], [0.4, 0.4, 0.0], (NROW, 1, 3)).astype(np.float32)
    mocap_quat = quaternions(rng, NROW, 1).astype(np.float32)
    return LayoutTable.from_states(qpos, mocap_pos, mocap_quat, present=np.ones((NROW, 0), bool))


@pytest.fixture
def make_randomizer(small_scene, rows):
    """Return a function that makes a randomizer over fresh data of the small arm."""
    with wp.ScopedDevice("cpu"):
        model = mjw.put_model(small_scene.mjm)

    def make(nworld: int = 4, *, seed=0, graph: bool = True, needs=(), room=(32, 128)) -> ResetRandomizer:
        nconmax, njmax = room or default_budget(small_scene.mjm)
        with wp.ScopedDevice("cpu"):
            data = mjw.make_data(small_scene.mjm, nworld, nconmax=nconmax, njmax=njmax)
        stored = StoredLayouts(small_scene, rows, nworld, seed=seed)
        return ResetRandomizer(small_scene, model, data, layout_source=stored, graph=graph, needs=needs)

    return make
