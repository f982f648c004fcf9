"""Batches: the control step, graphs and the contact budget."""

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import FixedError, MemoryLimitError, NotSupportedError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim import batch as batch_module
from sceniris_gym.sim.batch import LINE_SEARCH, Batch, with_options
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.task import FRICTION_PYRAMIDS
from tests.device.loads import found, loaded
from tests.versions import since_4


@pytest.mark.usefixtures("recorded")
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


def test_all_kernels_of_a_step_are_compiled_together_and_none_is_launched_for_this(small_scene):
    """MuJoCo-Warp's included, before the first update; no array of the worlds changes."""
    batch = Batch(small_scene.scene, 2, "cpu", needs=["contacts"])
    batch.step()
    arrays = {name: value.numpy() for name, value in vars(batch.data).items() if isinstance(value, wp.array)}
    before = {name: values.copy() for name, values in arrays.items()}
    together = found(batch.update.__self__.ahead)  # pyrefly: ignore[missing-attribute]
    for name, values in arrays.items():
        np.testing.assert_array_equal(values, before[name], err_msg=name)
    assert together == loaded(batch._launch_step) > loaded(batch._update)


@pytest.mark.parametrize("name", ["scene", "model", "data", "substeps", "options", "graph"])
def test_a_batch_keeps_what_its_graph_was_captured_with(small_scene, name: str):
    """Those of another batch are refused, and steps go on as those of a batch that nobody touched."""
    batch, untouched, other = (Batch(small_scene.scene, 2, "cpu") for _ in range(3))
    for each in (batch, untouched):
        each.step()
    with pytest.raises(FixedError, match=rf"Batch\.{name} cannot be changed.*Make a new Batch with the new '{name}'"):
        setattr(batch, name, getattr(other, name, None))
    for each in (batch, untouched):
        each.step()
    np.testing.assert_array_equal(batch.data.qpos.numpy(), untouched.data.qpos.numpy())


def test_more_worlds_than_memory_are_refused(small_scene):
    """With their size, before anything is allocated."""
    with pytest.raises(MemoryLimitError, match=r"1,000,000,000 worlds: takes \d+\.\d GiB or more"):
        Batch(small_scene.scene, 10**9, "cpu")


def test_options_that_cannot_be_simulated_are_refused(small_scene):
    """Those of a batch, which the scene does not have."""
    with pytest.raises(NotSupportedError, match=r"MuJoCo-Warp cannot simulate the model: mjSOL_PGS"):
        Batch(small_scene.scene, 1, "cpu", options={"solver": 0})


def test_many_pairs_of_geoms_are_sorted_and_give_the_same_contacts(monkeypatch: pytest.MonkeyPatch):
    """Contacts of objects that have fallen, by both broad phases of MuJoCo-Warp."""
    compiled, contacts = compile_scene("mid", "cpu"), []
    for most in (batch_module.MANY_PAIRS, 0):
        monkeypatch.setattr(batch_module, "MANY_PAIRS", most)
        batch = Batch(compiled.scene, 3, "cpu", needs=["contacts"])
        randomizer = ResetRandomizer(compiled, batch.model, batch.data)
        randomizer.reset(seed=0)
        for _ in range(25):
            batch.step()
        batch.update()
        num, found = int(batch.data.nacon.numpy()[0]), batch.data.contact
        rows = np.column_stack([found.worldid.numpy()[:num], found.geom.numpy()[:num], found.dist.numpy()[:num]])
        contacts.append((int(batch.model.opt.broadphase), rows[np.lexsort(rows.T[::-1])]))
    (pairwise, ours), (sorting, theirs) = contacts
    assert (pairwise, sorting) == (mjw.BroadphaseType.NXN, mjw.BroadphaseType.SAP_TILE)
    assert len(ours) > 10
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_an_unknown_need_names_the_valid_ones(small_scene):
    """A misspelt need is refused with the nearest name."""
    with pytest.raises(UnknownNameError, match="Did you mean 'contacts'"):
        Batch(small_scene.scene, 1, "cpu", needs=["contact"])


def test_a_line_search_is_shorter_in_a_batch_than_in_mujoco(small_scene):
    """One world must not stall the others; a model of the user's own keeps its options."""
    scene = build_model(SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": {}}))
    assert Batch(scene, 1, "cpu").model.opt.ls_iterations == LINE_SEARCH < scene.mjm.opt.ls_iterations
    assert Batch(small_scene.scene, 1, "cpu").model.opt.ls_iterations == small_scene.mjm.opt.ls_iterations


def test_options_change_the_physics_of_a_batch_alone(small_scene):
    """The scene's model keeps its own, and there are as many rows as these options need; a misspelt one is refused."""
    batch = Batch(small_scene.scene, 2, "cpu", options={"cone": mujoco.mjtCone.mjCONE_ELLIPTIC})
    assert batch.model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert small_scene.mjm.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    assert batch.data.njmax < Batch(small_scene.scene, 2, "cpu").data.njmax
    with pytest.raises(UnknownNameError, match="Did you mean 'cone'"):
        Batch(small_scene.scene, 1, "cpu", options={"cones": 0})


@since_4("a tin gets 5 mm away on elliptic cones, also in the layouts of 4.0")
def test_objects_stand_as_still_on_friction_pyramids():
    """In 0.5 s of MuJoCo C no object of the tasks that use them gets a millimetre further than on elliptic cones."""
    for name in ("tabletop_reach", "kitchen_reset"):
        compiled = compile_scene(name, "cpu")
        generator = LayoutGenerator(compiled, 4, seed=1)
        generator.generate()
        table = generator.table()
        far = [_moved(with_options(compiled.mjm, change), compiled, table) for change in ({}, FRICTION_PYRAMIDS)]
        assert far[1] < far[0] + 1e-3
        assert far[0] < 2e-3


def _moved(mjm: mujoco.MjModel, compiled: CompiledScene, table: LayoutTable) -> float:
    """Return how far free bodies get at most in 0.5 s from where layouts put them [m]."""
    data, worst = mujoco.MjData(mjm), 0.0
    free = [adr for kind, adr in zip(mjm.jnt_type, mjm.jnt_qposadr, strict=True) if kind == mujoco.mjtJoint.mjJNT_FREE]
    for row in range(len(table)):
        mujoco.mj_resetData(mjm, data)
        data.qpos[:], data.ctrl[:] = table.qpos[row], compiled.scene.home_ctrl
        if mjm.nmocap:
            data.mocap_pos[:], data.mocap_quat[:] = table.mocap_pos[row], table.mocap_quat[row]
        for _ in range(100):
            mujoco.mj_step(mjm, data)
        present = [adr for adr in free if table.qpos[row, adr + 2] > -1.0]
        worst = max(worst, *(float(np.linalg.norm(data.qpos[a : a + 3] - table.qpos[row, a : a + 3])) for a in present))
    return worst
