"""Batches: the control step, graphs and the contact budget."""

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ContactBudgetError, UnknownNameError
from sceniris_gym.scene.model import build_model
from sceniris_gym.sim.batch import LINE_SEARCH, Batch, default_budget
from tests.versions import since_4


def test_a_step_from_a_graph_gives_the_same_bits_and_current_kinematics(small_scene):
    """Recorded and direct control steps agree to the bit, and xpos belongs to qpos after both."""
    batches = [Batch(small_scene.scene, 3, "cpu", substeps=2, graph=graph) for graph in (True, False)]
    for batch in batches:
        for _ in range(4):
            batch.step()
        stepped = batch.data.xpos.numpy().copy()
        batch.update()
        np.testing.assert_array_equal(batch.data.xpos.numpy(), stepped)
        np.testing.assert_allclose(batch.data.time.numpy(), 0.04, rtol=1e-5)
    for name in ("qpos", "qvel", "xpos", "geom_xmat"):
        recorded, direct = (getattr(batch.data, name).numpy() for batch in batches)
        np.testing.assert_array_equal(recorded, direct, err_msg=name)


@since_4("mujoco_warp writes beyond its arrays on a CPU where contacts do not fit")
def test_a_budget_that_is_too_small_is_reported(small_scene):
    """Contacts that did not fit are an error that names the argument to raise; the default budget is enough."""
    small = Batch(small_scene.scene, 2, "cpu", nconmax=1)
    with pytest.raises(ContactBudgetError, match="nconmax=1 is too small"):
        small.check_budget()
    rows = Batch(small_scene.scene, 2, "cpu", njmax=2, graph=False)
    for _ in range(5):  # until the block has come down to the floor
        rows.step()
    with pytest.raises(ContactBudgetError, match="njmax=2 is too small"):
        rows.check_budget()
    enough = Batch(small_scene.scene, 2, "cpu")
    enough.step()
    enough.check_budget()


def test_the_default_budget_counts_what_can_touch(small_scene):
    """Cabinet, drawer, block, two links and two fingers: seven bodies; four rows a contact and five limits."""
    assert default_budget(small_scene.mjm) == (16 + 4 * 7, 4 * (16 + 4 * 7) + 5)


def test_an_unknown_need_names_the_valid_ones(small_scene):
    """A misspelt need is refused with the nearest name."""
    with pytest.raises(UnknownNameError, match="Did you mean 'contacts'"):
        Batch(small_scene.scene, 1, "cpu", needs=["contact"])


def test_a_line_search_is_shorter_in_a_batch_than_in_mujoco(small_scene):
    """One world must not stall the others; a model of the user's own keeps its options."""
    scene = build_model(SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": {}}))
    assert Batch(scene, 1, "cpu").model.opt.ls_iterations == LINE_SEARCH < scene.mjm.opt.ls_iterations
    assert Batch(small_scene.scene, 1, "cpu").model.opt.ls_iterations == small_scene.mjm.opt.ls_iterations
