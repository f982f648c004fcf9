"""Budgets of contacts and constraint rows: the default of a scene, and the check."""

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ContactBudgetError
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene.build import build_model
from sceniris_gym.sim.batch import Batch, check_budget, default_budget
from tests.layout.scenes import compile_on_cpu
from tests.versions import since_4

WAYS: dict[str, tuple[dict, bool]] = {
    "upright": ({"on": "floor"}, False),
    "in a stable pose": ({"on": "floor", "orientation": "stable"}, True),
    "in any orientation": ({"on": "floor", "orientation": "any"}, True),
    "in space": ({"region": {"box": [[-0.1, -0.1, 0.3], [0.1, 0.1, 0.4]]}}, True),
    "meant to fall": ({"on": "floor", "stands": False}, True),
}


@since_4("mujoco_warp writes beyond its arrays on a CPU where contacts do not fit")
def test_a_budget_that_is_too_small_is_reported(small_scene):
    """Contacts that did not fit are an error that names the argument to raise; the default budget is enough."""
    small = Batch(small_scene.scene, 2, "cpu", nconmax=1)
    with pytest.raises(ContactBudgetError, match="nconmax=1 is too small"):
        check_budget(small.model, small.data)
    rows = Batch(small_scene.scene, 2, "cpu", njmax=2, graph=False)
    for _ in range(5):  # until the block has come down to the floor
        rows.step()
    with pytest.raises(ContactBudgetError, match="njmax=2 is too small"):
        check_budget(rows.model, rows.data)
    enough = Batch(small_scene.scene, 2, "cpu")
    enough.step()
    check_budget(enough.model, enough.data)


def test_the_default_budget_counts_what_can_touch(small_scene):
    """Cabinet, drawer, block, two links and two fingers: seven bodies; four rows a contact and five limits."""
    contacts, rows = default_budget(small_scene.mjm)
    assert rows == 4 * contacts + 5
    assert contacts == 16 + 4 * (7 + 3)


@pytest.mark.parametrize("scene", ["mid", "kitchen", "clutter"])
def test_things_that_come_to_rest_fit_into_the_default_budget(scene: str):
    """Plates and pans stand on a dozen geoms each: contacts and rows of MuJoCo C while fresh layouts settle."""
    compiled = compile_on_cpu(scene)
    contacts, rows = default_budget(compiled.mjm)
    data, table = mujoco.MjData(compiled.mjm), make_table(compiled, 3, 0)
    for i in range(3):
        mujoco.mj_resetData(compiled.mjm, data)
        table.put(data, i)
        for _ in range(25):
            mujoco.mj_step(compiled.mjm, data)
            assert data.ncon <= contacts
            assert data.nefc <= rows


@pytest.mark.parametrize(("words", "turns"), WAYS.values(), ids=WAYS)
def test_the_default_budget_counts_the_sides_that_things_may_lie_on(words: dict, turns: bool):
    """A mug upside down stands on 16 walls: contacts and rows of MuJoCo C fit if, and only if, it may lie like that."""
    objects = {"can": {"asset": "can", "on": "floor"}, "mug": {"asset": "mug", **words}}
    scene = build_model(SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": objects}))
    mjm, data = scene.mjm, mujoco.MjData(scene.mjm)
    for name, pose in (("can", [0.3, 0, 0.0, 1, 0, 0, 0]), ("mug", [0, 0, 0.096, 0, 1, 0, 0])):
        adr = mjm.jnt_qposadr[mjm.body_jntadr[scene.bodies[name]]]
        data.qpos[adr : adr + 7] = pose
    for _ in range(25):
        mujoco.mj_step(mjm, data)
    assert data.ncon >= 68
    contacts, rows = default_budget(mjm, scene)
    assert (data.ncon <= contacts, data.nefc <= rows) == (turns, turns)


def test_the_default_budget_counts_geoms_that_lie_across_others():
    """Three plates of 13 geoms on each other, nested as they rest: contacts and rows of MuJoCo C fit.

    They would not with four for each geom that a plate stands on.
    """
    plates = {"low": "floor", "middle": "low", "high": "middle"}
    objects = {name: {"asset": "plate", "on": below} for name, below in plates.items()}
    scene = build_model(SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": objects}))
    mjm, data, rng, most = scene.mjm, mujoco.MjData(scene.mjm), np.random.default_rng(0), 0
    contacts, rows = default_budget(mjm, scene)
    for _ in range(15):
        mujoco.mj_resetData(mjm, data)
        for i, name in enumerate(plates):
            adr, turn = mjm.jnt_qposadr[mjm.body_jntadr[scene.bodies[name]]], rng.uniform(0.0, np.pi)
            offset = rng.uniform(-0.004, 0.004, 2) * (i > 0)
            data.qpos[adr : adr + 7] = [*offset, 0.004 * i, np.cos(turn), 0.0, 0.0, np.sin(turn)]
        for _ in range(15):
            mujoco.mj_step(mjm, data)
            assert data.ncon <= contacts
            assert data.nefc <= rows
            most = max(most, data.ncon)
    assert most > default_budget(mjm)[0]
