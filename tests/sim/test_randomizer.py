"""The randomizer: masked resets that leave the other worlds alone, and stored layouts put back."""

from dataclasses import replace
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import (
    ArgumentTypeError,
    ContactBudgetError,
    MaskError,
    MaskTypeError,
    SceneMismatchError,
    SeedError,
)
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.prepared import PreparedLayouts
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.sim.randomizer import PROMISED, ResetRandomizer
from tests.sim.conftest import SMALL_ARM
from tests.versions import since_4

STATE = ("time", "qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat", "qacc_warmstart", "xfrc_applied", "M")
DERIVED = ("xpos", "xquat", "geom_xpos", "geom_xmat", "site_xpos", "site_xmat")


def snapshot(d: mjw.Data, names: tuple[str, ...] = STATE + DERIVED) -> dict[str, np.ndarray]:
    """Copy arrays of `d` to the host."""
    return {name: getattr(d, name).numpy().copy() for name in names}


def step(randomizer: ResetRandomizer, n: int = 5) -> None:
    """Step all worlds and make kinematics current, as an environment does."""
    for _ in range(n):
        mjw.step(randomizer.model, randomizer.data)
    mjw.kinematics(randomizer.model, randomizer.data)


@pytest.mark.oldest
def test_a_reset_writes_the_rows_of_the_generator(make_randomizer, rows):
    """World i gets row (seed + episode) mod nrow: positions, mocap poses and kinematics that belong to them."""
    randomizer = make_randomizer(4, seed=2)
    randomizer.reset()
    randomizer.reset(np.array([True, False, False, True]))
    d, expected = randomizer.data, np.array([3, 3, 4, 6])
    np.testing.assert_array_equal(d.qpos.numpy(), rows.qpos[expected])
    np.testing.assert_array_equal(d.mocap_pos.numpy(), rows.mocap_pos[expected])
    np.testing.assert_array_equal(d.mocap_quat.numpy(), rows.mocap_quat[expected])
    np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [1, 0, 0, 1])

    mjm = randomizer.compiled.mjm
    mjd = mujoco.MjData(mjm)
    for world, row in enumerate(expected):
        mjd.qpos[:], mjd.mocap_pos[:], mjd.mocap_quat[:] = rows.qpos[row], rows.mocap_pos[row], rows.mocap_quat[row]
        mujoco.mj_kinematics(mjm, mjd)
        np.testing.assert_allclose(d.xpos.numpy()[world], mjd.xpos, atol=1e-6)
        np.testing.assert_allclose(d.geom_xpos.numpy()[world], mjd.geom_xpos, atol=1e-6)


@since_4("mujoco_warp writes beyond its arrays on a CPU where contacts do not fit")
def test_an_own_loop_learns_when_contacts_do_not_fit(make_randomizer):
    """After a reset the randomizer compares the data's room with the contacts; the default budget is enough."""
    enough, small = (make_randomizer(2, room=room) for room in (None, (1, 128)))
    for randomizer in (enough, small):
        randomizer.reset()
    before = snapshot(enough.data)
    enough.check_budget()
    for name, values in snapshot(enough.data).items():
        np.testing.assert_array_equal(values, before[name], err_msg=name)
    with pytest.raises(ContactBudgetError, match="nconmax=1 is too small"):
        small.check_budget()


@pytest.mark.oldest
def test_other_worlds_stay_the_same_to_the_bit(make_randomizer):
    """A masked reset changes nothing in the worlds that are not masked."""
    randomizer = make_randomizer(4)
    randomizer.reset()
    step(randomizer)
    before = snapshot(randomizer.data)
    randomizer.reset(np.array([True, False, True, False]))
    after = snapshot(randomizer.data)
    for name in STATE + DERIVED:
        np.testing.assert_array_equal(after[name][[1, 3]], before[name][[1, 3]], err_msg=name)
    assert not np.array_equal(after["qpos"][[0, 2]], before["qpos"][[0, 2]])


def contacts_of(d: mjw.Data, world: int) -> set[bytes]:
    """Return the listed contacts of a world as the bytes of what describes them."""
    number, fields = int(d.nacon.numpy()[0]), ("dist", "pos", "frame", "friction", "geom", "type", "efc_address")
    columns = [getattr(d.contact, name).numpy()[:number] for name in fields]
    listed = np.flatnonzero(d.contact.worldid.numpy()[:number] == world)
    return {b"".join(column[i].tobytes() for column in columns) for i in listed}


@pytest.mark.parametrize("graph", [True, False])
@pytest.mark.parametrize("mask", [[1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 1, 0], [1, 0, 1, 1]])
def test_a_reset_leaves_no_ghost_contacts(make_randomizer, mask, graph):
    """Contacts of reset worlds are gone, those of the others are the same ones, and the count counts nothing else."""
    randomizer = make_randomizer(4, graph=graph)
    randomizer.reset()
    step(randomizer)
    before = [contacts_of(randomizer.data, world) for world in range(4)]
    assert all(before)
    randomizer.reset(np.array(mask, bool))
    for world in range(4):
        assert contacts_of(randomizer.data, world) == (set() if mask[world] else before[world])
    assert int(randomizer.data.nacon.numpy()[0]) == sum(len(before[world]) for world in range(4) if not mask[world])


def test_after_a_reset_of_all_worlds_there_are_no_contacts(make_randomizer):
    """The count is 0 until something collides; with needs=["contacts"] it is the number that collide now."""
    plain, current = make_randomizer(3), make_randomizer(3, needs=["contacts"])
    for randomizer in (plain, current):
        randomizer.reset()
        step(randomizer)
        assert int(randomizer.data.nacon.numpy()[0]) > 0
        randomizer.reset()
    assert int(plain.data.nacon.numpy()[0]) == 0
    mjw.kinematics(plain.model, plain.data)
    mjw.com_pos(plain.model, plain.data)
    mjw.collision(plain.model, plain.data)
    for world in range(3):
        assert contacts_of(current.data, world) == contacts_of(plain.data, world)


def test_other_worlds_go_on_as_if_nothing_had_been_reset(make_randomizer):
    """After resets of some worlds the others step to the same bits as in a batch without resets, contacts included."""
    disturbed, quiet = make_randomizer(4), make_randomizer(4)
    for randomizer in (disturbed, quiet):
        randomizer.reset()
    for mask in ([1, 0, 0, 0], [1, 0, 1, 0], [0, 0, 1, 0]):
        for randomizer in (disturbed, quiet):
            for _ in range(3):  # a bare loop: kinematics lag a step behind
                mjw.step(randomizer.model, randomizer.data)
        disturbed.reset(np.array(mask, bool))
        for name in PROMISED:
            found, expected = (getattr(r.data, name).numpy()[[1, 3]] for r in (disturbed, quiet))
            np.testing.assert_array_equal(found, expected, err_msg=name)


def test_derived_arrays_are_made_current_in_all_worlds(make_randomizer):
    """In a bare loop xpos is a step older than qpos; after a reset it belongs to qpos in the other worlds too."""
    randomizer = make_randomizer(2)
    randomizer.reset()
    randomizer.data.qvel.fill_(0.5)
    mjw.step(randomizer.model, randomizer.data)
    before = randomizer.data.xpos.numpy()[1].copy()
    randomizer.reset(np.array([True, False]))
    mjm = randomizer.compiled.mjm
    data = mujoco.MjData(mjm)
    data.qpos[:] = randomizer.data.qpos.numpy()[1]
    data.mocap_pos[:] = randomizer.data.mocap_pos.numpy()[1]
    data.mocap_quat[:] = randomizer.data.mocap_quat.numpy()[1]
    mujoco.mj_kinematics(mjm, data)
    np.testing.assert_allclose(randomizer.data.xpos.numpy()[1], data.xpos, atol=1e-6)
    assert np.abs(before - data.xpos).max() > 1e-4


def test_an_all_false_mask_changes_nothing(make_randomizer):
    """No world asked: every array keeps its bits, the episodes too."""
    randomizer = make_randomizer(3)
    randomizer.reset()
    step(randomizer)
    before = snapshot(randomizer.data)
    randomizer.reset(torch.zeros(3, dtype=torch.bool))
    after = snapshot(randomizer.data)
    for name in STATE + DERIVED:
        np.testing.assert_array_equal(after[name], before[name], err_msg=name)
    np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [0, 0, 0])


@pytest.mark.parametrize("graph", [True, False])
def test_state_depends_on_seed_and_episode_alone(make_randomizer, graph):
    """Other numbers of worlds, masks, orders and graphs give the same bits of reset state."""
    reference = make_randomizer(3, seed=[5, 9, 7])
    for _ in range(3):
        reference.reset()
    other = make_randomizer(6, seed=[1, 7, 5, 2, 3, 9], graph=graph)
    order = [[1, 2], [2], [5, 0], [1, 5], [2, 5], [1, 3]]
    for worlds in order:
        mask = np.zeros(6, bool)
        mask[worlds] = True
        other.reset(wp.array(mask, dtype=wp.bool, device="cpu"))
    for name in ("qpos", "qvel", "ctrl", "act", "mocap_pos", "mocap_quat", "xpos", "site_xmat"):
        np.testing.assert_array_equal(
            getattr(other.data, name).numpy()[[2, 5, 1]], getattr(reference.data, name).numpy(), err_msg=name
        )


def test_a_world_with_nans_is_cured(make_randomizer, rows):
    """After its reset a broken world steps exactly as a sound one does."""
    sick, sound = make_randomizer(2, seed=[4, 4]), make_randomizer(2, seed=[4, 4])
    for randomizer in (sick, sound):
        randomizer.reset()
        step(randomizer)
    d = sick.data
    for name in ("qpos", "qvel", "act", "ctrl", "qacc_warmstart", "qacc", "qfrc_applied", "M", "xfrc_applied"):
        values = getattr(d, name).numpy()
        values[1] = np.nan
        getattr(d, name).assign(values)
    step(sick)
    assert np.isnan(d.qpos.numpy()[1]).any()
    for randomizer in (sick, sound):
        randomizer.reset()
        step(randomizer)
    assert np.isfinite(sick.data.qpos.numpy()).all()
    np.testing.assert_array_equal(sick.data.qpos.numpy(), sound.data.qpos.numpy())


def test_the_arm_stays_where_it_was_placed(make_randomizer, rows):
    """Position actuators hold the sampled pose, over a gear and a tendon too: half a second later nothing moved."""
    randomizer = make_randomizer(7)
    randomizer.reset()
    placed = randomizer.data.qpos.numpy()[:, 8:12].copy()
    step(randomizer, 100)
    np.testing.assert_allclose(randomizer.data.qpos.numpy()[:, 8:12], placed, atol=2e-3)
    np.testing.assert_allclose(placed, rows.qpos[:, 8:12])


def test_stored_layouts_are_put_back(make_randomizer, rows):
    """World i gets row rows[i], -1 leaves it untouched; numpy arrays and kept layouts do."""
    randomizer = make_randomizer(4)
    randomizer.reset()
    step(randomizer)
    before = snapshot(randomizer.data)
    randomizer.write(rows, [5, -1, 5, 0])
    after = snapshot(randomizer.data)
    np.testing.assert_array_equal(after["qpos"][[0, 2, 3]], rows.qpos[[5, 5, 0]])
    np.testing.assert_array_equal(after["mocap_quat"][[0, 2, 3]], rows.mocap_quat[[5, 5, 0]])
    assert (after["time"][[0, 2, 3]] == 0).all()
    for name in STATE + DERIVED:
        np.testing.assert_array_equal(after[name][1], before[name][1], err_msg=name)

    randomizer.write(randomizer.layouts, torch.tensor([-1, 3, -1, -1]))
    np.testing.assert_array_equal(randomizer.data.qpos.numpy()[1], rows.qpos[3])


@pytest.mark.parametrize(
    ("mask", "error", "match"),
    [
        ([True, False], MaskTypeError, "boolean numpy array"),
        (np.array([1, 0]), MaskTypeError, "int64"),
        (torch.tensor([1.0, 0.0]), MaskTypeError, "float32"),
        (np.array([True]), MaskError, r"shape \(2,\)"),
        (torch.ones(2, 1, dtype=torch.bool), MaskError, r"shape \(2,\)"),
    ],
)
def test_wrong_masks_say_what_is_wrong(make_randomizer, mask, error, match):
    """Type, dtype and shape are checked at the door, and nothing has changed by then."""
    randomizer = make_randomizer(2)
    with pytest.raises(error, match=match):
        randomizer.reset(mask)
    assert (randomizer.layouts.episode.numpy() == -1).all()


@pytest.mark.parametrize(
    ("which", "error", "match"),
    [
        ([0, 7], MaskError, r"rows\[1\] should be from 0 to 6.* got 7"),
        ([0, -2], MaskError, r"rows\[1\] should be .* got -2"),
        ([0], MaskError, r"shape \(2,\)"),
        ([0.5, 1.0], MaskTypeError, "float64"),
    ],
)
def test_wrong_rows_say_what_is_wrong(make_randomizer, rows, which, error, match):
    """Rows that do not exist are refused, not written as something else."""
    with pytest.raises(error, match=match):
        make_randomizer(2).write(rows, which)


def test_what_does_not_belong_to_the_scene_is_refused(make_randomizer, small_scene, rows):
    """Model, data, generator and stored layouts of another scene or size are named in the error."""
    randomizer = make_randomizer(2)
    other = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body mocap='true'/></worldbody></mujoco>")
    stored = StoredLayouts(small_scene, rows, 2)
    with pytest.raises(SceneMismatchError, match=r"model\.nq is 0 and should be 12"):
        ResetRandomizer(small_scene, mjw.put_model(other), mjw.make_data(other, 2), layout_source=stored)
    with pytest.raises(SceneMismatchError, match=r"data's nq is 0 and should be 12"):
        ResetRandomizer(small_scene, randomizer.model, mjw.make_data(other, 2), layout_source=stored)
    three = StoredLayouts(small_scene, rows, 3)
    with pytest.raises(SceneMismatchError, match="layouts for 3 worlds and should make them for 2"):
        ResetRandomizer(small_scene, randomizer.model, randomizer.data, layout_source=three)
    short = replace(rows, qpos=rows.qpos[:, :5])
    with pytest.raises(SceneMismatchError, match=r"layouts\.qpos has shape \(7, 5\)"):
        randomizer.write(short, [0, 1])
    with pytest.raises(SceneMismatchError, match="is of scene 0123456789abcdef, and this one is"):
        randomizer.write(replace(rows, scene="0123456789abcdef"), [0, 1])  # in which places may mean something else
    flat = replace(rows, mocap_quat=rows.mocap_quat[:, :, :3])
    with pytest.raises(SceneMismatchError, match=r"layouts\.mocap_quat has shape \(7, \d, 3\) and .* \(7, \d, 4\)"):
        randomizer.write(flat, [0, 1])


def test_contacts_are_current_where_a_task_needs_them(make_randomizer, small_scene, rows):
    """With needs=["contacts"] the block that was just put on the floor is in contact, as plain MuJoCo finds it."""
    low = replace(rows, qpos=rows.qpos.copy())
    low.qpos[:, 3] = 0.0299
    randomizer = make_randomizer(3, needs=["contacts"])
    randomizer.write(low, [0, 1, 2])
    count = int(randomizer.data.nacon.numpy()[0])
    data = mujoco.MjData(small_scene.mjm)
    for world in range(3):
        data.qpos[:], data.mocap_pos[:] = low.qpos[world], low.mocap_pos[world]
        data.mocap_quat[:] = low.mocap_quat[world]
        mujoco.mj_fwdPosition(small_scene.mjm, data)
        assert (randomizer.data.contact.worldid.numpy()[:count] == world).sum() == data.ncon > 0


def test_velocities_are_current_where_a_task_needs_them(make_randomizer):
    """With needs=["velocity"] the bodies of a reset world are at rest, those of the others still move."""
    randomizer = make_randomizer(2, needs=["velocity"])
    randomizer.reset()
    randomizer.data.qvel.fill_(0.5)
    randomizer.reset(np.array([False, True]))
    cvel = np.abs(randomizer.data.cvel.numpy()).max(axis=(1, 2))
    assert cvel[0] > 0.4
    assert cvel[1] == 0.0


@pytest.mark.parametrize("prefetch", [False, True])
def test_it_makes_its_own_layouts_of_a_scene(prefetch: bool):
    """Without a generator the layouts are those of a LayoutGenerator of the same seed and split, made ahead or not."""
    scene = {
        "model": str(SMALL_ARM),
        "floor": {"size": [1.6, 1.6]},
        "objects": {"block": {"on": "floor", "region": {"box": [[-0.3, -0.6], [0.3, 0.6]]}}},
    }
    compiled = compile_scene(SceneConfig.load(scene, {"bank": 4}), "cpu")
    with wp.ScopedDevice("cpu"):
        model, data = mjw.put_model(compiled.mjm), mjw.make_data(compiled.mjm, 3)
    randomizer = ResetRandomizer(compiled, model, data, seed=5, split="eval", prefetch=prefetch)
    twin = LayoutGenerator(compiled, 3, seed=5, split="eval")
    for _ in range(2):
        randomizer.reset()
        twin.generate()
        np.testing.assert_array_equal(data.qpos.numpy(), twin.layouts.qpos.numpy())
    randomizer.reseed([9, 9, 5], np.array([False, False, True]))
    randomizer.reset(torch.tensor([False, False, True]))
    np.testing.assert_array_equal(randomizer.layouts.seed.numpy(), [5, 6, 5])
    np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [1, 1, 0])
    assert set(randomizer.rejection_counts()) == {"block"}
    assert isinstance(randomizer.layout_source, PreparedLayouts) == prefetch
    if prefetch:
        with pytest.raises(ValueError, match="Give either them or a layout_source"):
            ResetRandomizer(compiled, model, data, layout_source=twin, prefetch=True)
        with pytest.raises(TypeError, match=r"prefetch should be a boolean, a wp\.Stream or None, got <class 'str'>"):
            ResetRandomizer(compiled, model, data, prefetch="no")  # type: ignore[arg-type]


def test_seeds_may_be_on_the_device(make_randomizer):
    """As a uint64 Warp array, which is taken as it is; another type is refused."""
    randomizer = make_randomizer(3)
    randomizer.reseed(wp.array([5, 6, 2**63], dtype=wp.uint64, device="cpu"), np.array([True, False, True]))
    assert randomizer.layouts.seed.numpy().tolist() == [5, 1, 2**63]
    with pytest.raises(SeedError, match="uint64 array of shape"):
        randomizer.reseed(wp.array([5, 6, 7], dtype=wp.int64, device="cpu"))


def test_layouts_of_another_scene_are_refused(make_randomizer, small_scene):
    """Also where all sizes agree."""
    randomizer = make_randomizer(2)
    other = compile_scene({"model": str(SMALL_ARM), "attempts": 11}, "cpu")
    source = LayoutGenerator(other, 2)
    with pytest.raises(SceneMismatchError, match="layout_source makes layouts of scene"):
        ResetRandomizer(small_scene, randomizer.model, randomizer.data, layout_source=source)


def test_arguments_of_another_type_are_told_by_their_names(make_randomizer):
    """They were AttributeErrors."""
    made = make_randomizer(1)
    given: dict[str, Any] = {"compiled": made.compiled, "model": made.model, "data": made.data}
    for name, kind in (("compiled", "CompiledScene"), ("model", "Model"), ("data", "Data")):
        wrong: dict[str, Any] = {**given, name: None}
        with pytest.raises(ArgumentTypeError, match=f"ResetRandomizer: {name} should be a {kind}, got .*NoneType"):
            ResetRandomizer(**wrong)
