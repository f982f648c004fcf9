"""The randomizer: masked resets, and what the worlds are afterwards."""

from dataclasses import replace
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, ContactBudgetError, SceneMismatchError
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.sim.stepping import DERIVED, STATE, snapshot, step
from tests.versions import since_4


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


def test_a_randomizer_of_a_batch_needs_a_batch(small_scene: CompiledScene):
    """Instead of an AttributeError."""
    with pytest.raises(ArgumentTypeError, match="of_batch: batch should be a Batch, got"):
        ResetRandomizer.of_batch(None, small_scene)  # pyrefly: ignore[bad-argument-type]


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


@pytest.mark.usefixtures("recorded")
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


@pytest.mark.parametrize(
    ("mask", "error", "match"),
    [
        ("half", ArgumentTypeError, "booleans or ids"),
        (np.array([1, 1]), ArgumentError, "look like a mask"),
        (torch.tensor([1.0, 0.0]), ArgumentTypeError, "float32"),
        (np.array([True]), ArgumentError, r"shape \(2,\)"),
        (torch.ones(2, 1, dtype=torch.bool), ArgumentError, r"shape \(2,\)"),
    ],
)
def test_wrong_masks_say_what_is_wrong(make_randomizer, mask, error, match):
    """Type, dtype and shape are checked at the door, and nothing has changed by then."""
    randomizer = make_randomizer(2)
    with pytest.raises(error, match=match):
        randomizer.reset(mask)
    assert (randomizer.layouts.episode.numpy() == -1).all()


def test_what_does_not_belong_to_the_scene_is_refused(make_randomizer, small_scene, rows):
    """Model, data and generator of another scene or size are named in the error."""
    randomizer = make_randomizer(2)
    other = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body mocap='true'/></worldbody></mujoco>")
    stored = StoredLayouts(small_scene, rows, 2)
    with pytest.raises(SceneMismatchError, match=r"model\.nq is 0, but should be 12"):
        ResetRandomizer(small_scene, mjw.put_model(other), mjw.make_data(other, 2), layout_source=stored)
    with pytest.raises(SceneMismatchError, match=r"data's nq is 0, but should be 12"):
        ResetRandomizer(small_scene, randomizer.model, mjw.make_data(other, 2), layout_source=stored)
    three = StoredLayouts(small_scene, rows, 3)
    with pytest.raises(SceneMismatchError, match="layouts for 3 worlds, but should make them for 2"):
        ResetRandomizer(small_scene, randomizer.model, randomizer.data, layout_source=three)


@pytest.mark.parametrize("needs", [["contacts"], "contacts"])
def test_contacts_are_current_where_a_task_needs_them(needs, make_randomizer, small_scene, rows):
    """With the need "contacts" the block that was just put on the floor is in contact, as plain MuJoCo finds it."""
    low = replace(rows, qpos=rows.qpos.copy())
    low.qpos[:, 3] = 0.0299
    randomizer = make_randomizer(3, needs=needs)
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


def test_seeds_may_be_on_the_device(make_randomizer):
    """As a uint64 Warp array, which is taken as it is; another type is refused."""
    randomizer = make_randomizer(3)
    seed = wp.array([5, 6, 2**63], dtype=wp.uint64, device="cpu")
    randomizer.reseed(np.array([True, False, True]), seed=seed)
    assert randomizer.layouts.seed.numpy().tolist() == [5, 1, -(2**63)]
    with pytest.raises(ArgumentError, match="uint64 array of shape"):
        randomizer.reseed(seed=wp.array([5, 6, 7], dtype=wp.int64, device="cpu"))


def test_arguments_of_another_type_are_told_by_their_names(make_randomizer):
    """They were AttributeErrors."""
    made = make_randomizer(1)
    given: dict[str, Any] = {"compiled": made.compiled, "model": made.model, "data": made.data}
    for name, kind in (("compiled", "CompiledScene"), ("model", "Model"), ("data", "Data")):
        wrong: dict[str, Any] = {**given, name: None}
        with pytest.raises(ArgumentTypeError, match=f"ResetRandomizer: {name} should be a {kind}, got .*NoneType"):
            ResetRandomizer(**wrong)


def test_no_world_takes_no_seed_and_no_layout(make_randomizer):
    """As in a step in which no episode ended."""
    randomizer = make_randomizer(3)
    randomizer.reset()
    before = randomizer.layouts.episode.tolist()
    randomizer.reset([], seed=[])
    randomizer.reset([], layouts=[])
    randomizer.reset(np.zeros(3, bool), layouts={"seed": np.zeros(0, int), "episode": np.zeros(0, int)})
    assert randomizer.layouts.episode.tolist() == before
