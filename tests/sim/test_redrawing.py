"""Objects that get new places in the middle of episodes: they are free there, and nothing else differs by a bit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.variants import fields_of_variants
from sceniris_gym.sim.versions import SLEEPING
from tests.stress.redraws import DEEP, Judge
from tests.versions import since_4

NWORLD = 6
THINGS = ("tin", "bowl"), ("can", "mug", "book")
HALF = np.arange(NWORLD) % 2 == 0


@pytest.fixture(scope="module")
def mid() -> CompiledScene:
    """A cabinet with drawn drawers, a banana in one of them, and an apple."""
    return compile_scene(SceneConfig.load("mid", {"bank": 2}), "cpu")


def randomizer_of(compiled: CompiledScene, options: dict[str, Any] | None = None, **words: Any) -> ResetRandomizer:
    """Return a randomizer after a reset and some steps with random velocities."""
    batch = Batch(compiled.scene, NWORLD, compiled.device, options=options or {})
    randomizer = ResetRandomizer.of_batch(batch, compiled, seed=4, **words)
    randomizer.reset()
    stir(randomizer, 0)
    return randomizer


def with_variants(targets: Sequence[str], stands: Sequence[str]) -> dict[str, Any]:
    """A table with an apple near a thing and a fixture, which are one of these assets each."""
    table = {"asset": "table", "kind": "static"}
    near = {"near": "target", "distance": {"max": 0.3}}
    stand, target = (list(assets) if len(assets) > 1 else assets[0] for assets in (stands, targets))
    objects = {
        "table": table,
        "stand": {"asset": stand, "kind": "fixture", "on": "table"},
        "target": {"asset": target, "on": "table"},
        "apple": {"asset": "apple", "on": "table", "relations": [near]},
    }
    return {"bank": 4, "objects": objects}


def stir(randomizer: ResetRandomizer, seed: int) -> None:
    """Give everything a random velocity, and step."""
    data, random = randomizer.data, np.random.default_rng(seed)
    data.qvel.assign(random.normal(0.0, 0.3, data.qvel.shape).astype(np.float32))
    for _ in range(5):
        mjw.step(randomizer.model, data)


def state(randomizer: ResetRandomizer) -> dict[str, np.ndarray]:
    """Copy the state of all worlds."""
    return {name: getattr(randomizer.data, name).numpy().copy() for name in ResetRandomizer.STATE_FIELDS}


@pytest.mark.oldest
def test_only_the_named_objects_move_and_they_are_free(mid: CompiledScene):
    """In the masked worlds alone; a cabinet moves with its drawers and what is in them."""
    randomizer = randomizer_of(mid)
    for names in (("apple",), ("banana",), ("cabinet", "banana")):
        stir(randomizer, 1)
        judge = Judge(mid.mjm, [body for name in names for body in mid.scene.subtree(name)])
        before = state(randomizer)
        randomizer.redraw(names, HALF)
        after = state(randomizer)
        assert judge.differences(before, after, HALF) == []
        assert (randomizer.redraw_status.cpu().numpy()[HALF] == LayoutStatus.VALID).all()
        assert max(judge.deepest(after, int(world)) for world in np.flatnonzero(HALF)) < DEEP
        for name in ("qpos", "qvel", "mocap_pos"):
            changed = (before[name] != after[name]).reshape((NWORLD, -1)).any(axis=1)
            np.testing.assert_array_equal(changed, HALF & (name != "mocap_pos" or names[0] == "cabinet"))
    np.testing.assert_array_equal(randomizer.redraw_count.cpu().numpy(), 3 * HALF)


@pytest.mark.oldest
def test_what_moves_is_posed_in_space_and_all_bodies_with_needs(mid: CompiledScene):
    """Bodies, geoms and sites of the objects; without needs all others are as the last step left them."""
    mjm, names = mid.mjm, ("cabinet", "banana")
    bodies = np.array([body for name in names for body in mid.scene.subtree(name)])
    moved = {"x": np.isin(np.arange(mjm.nbody), bodies), "xi": np.isin(np.arange(mjm.nbody), bodies)}
    moved |= {f"{kind}_x": np.isin(getattr(mjm, f"{kind}_bodyid"), bodies) for kind in ("geom", "site")}
    for needs in ((), ("velocity",)):
        randomizer = randomizer_of(mid, needs=needs)
        data = randomizer.data
        before = {name: getattr(data, f"{name}pos").numpy().copy() for name in moved}
        randomizer.redraw(names)
        after = {name: getattr(data, f"{name}pos").numpy().copy() for name in moved}
        turned = {name: getattr(data, f"{name}mat").numpy().copy() for name in moved}
        mjw.kinematics(randomizer.model, data)
        for name, chosen in moved.items():
            fresh = chosen | bool(needs)
            np.testing.assert_array_equal(after[name][:, fresh], getattr(data, f"{name}pos").numpy()[:, fresh])
            np.testing.assert_array_equal(turned[name][:, fresh], getattr(data, f"{name}mat").numpy()[:, fresh])
            assert (after[name] != before[name])[:, chosen].any()
        if not needs:
            np.testing.assert_array_equal(after["x"][:, ~moved["x"]], before["x"][:, ~moved["x"]])


@pytest.mark.usefixtures("recorded")
def test_the_same_state_seed_and_number_give_the_same_places(mid: CompiledScene):
    """With a graph and without, and after a reset that begins the count anew; the next number gives another place."""
    found = []
    for graph in (True, False):
        randomizer = randomizer_of(mid, graph=graph)
        for _ in range(2):
            randomizer.redraw("apple")
            found.append(randomizer.data.qpos.numpy().copy())
        randomizer.reset(HALF, seed=np.arange(4, 4 + NWORLD))
        np.testing.assert_array_equal(randomizer.redraw_count.cpu().numpy(), np.where(HALF, 0, 2))
    np.testing.assert_array_equal(found[0], found[2])
    np.testing.assert_array_equal(found[1], found[3])
    assert (found[0] != found[1]).any(axis=1).all()


def test_a_redraw_is_part_of_a_capture(mid: CompiledScene):
    """Once its search is prepared, with a mask that is written to between replays."""
    randomizer, twin = randomizer_of(mid), randomizer_of(mid)
    with pytest.raises(ArgumentError, match="before the capture"), wp.ScopedCapture("cpu"):
        randomizer.redraw("apple")
    for each in (randomizer, twin):
        each.redraw("apple", np.zeros(NWORLD, bool))
    mask = wp.zeros(NWORLD, dtype=bool, device="cpu")
    with wp.ScopedCapture("cpu") as capture:
        randomizer.redraw("apple", mask)
    for turn in range(3):
        mask.assign(np.arange(NWORLD) % 3 == turn)
        wp.capture_launch(capture.graph)
        twin.redraw("apple", mask)
        np.testing.assert_array_equal(randomizer.data.qpos.numpy(), twin.data.qpos.numpy())
    np.testing.assert_array_equal(randomizer.redraw_count.cpu().numpy(), 1)


def test_where_nothing_fits_the_object_stays_and_is_counted(mid: CompiledScene):
    """With the drawers shut, the banana is in the way of no place but has none itself."""
    randomizer = randomizer_of(mid)
    data, mjm = randomizer.data, mid.mjm
    qpos = data.qpos.numpy().copy()
    qpos[:3, mjm.joint("cabinet/upper").qposadr[0]] = 0.0
    data.qpos.assign(qpos)
    before = state(randomizer)
    randomizer.redraw("banana")
    status = randomizer.redraw_status.cpu().numpy()
    np.testing.assert_array_equal(status, [LayoutStatus.KEPT] * 3 + [LayoutStatus.VALID] * 3)
    assert randomizer.redrawer.kept.tolist() == [3]
    after = state(randomizer)
    for name, old in before.items():
        np.testing.assert_array_equal(after[name][:3], old[:3])


@since_4("bodies of batches sleep since 4.0")
def test_what_sleeps_wakes_and_falls(mid: CompiledScene):
    """An apple that slept moves on from its new place, half a millimetre over the floor."""
    randomizer = randomizer_of(mid, SLEEPING)
    randomizer.reset()
    data, tree = randomizer.data, int(mid.mjm.body_treeid[mid.scene.bodies["apple"]])
    asleep, awake = data.tree_asleep.numpy(), data.tree_awake.numpy()
    asleep[:, tree], awake[:, tree] = tree, 0
    data.tree_asleep.assign(asleep)
    data.tree_awake.assign(awake)
    randomizer.redraw("apple", HALF)
    before = data.qpos.numpy().copy()
    for _ in range(5):
        mjw.step(randomizer.model, data)
    height = mid.mjm.jnt_qposadr[mid.mjm.body_jntadr[mid.scene.bodies["apple"]]] + 2
    np.testing.assert_array_equal(data.qpos.numpy()[:, height] < before[:, height], HALF)


def test_wrong_arguments_are_refused(mid: CompiledScene):
    """Unknown objects, and masks of another shape."""
    randomizer = randomizer_of(mid)
    with pytest.raises(UnknownNameError, match="Did you mean 'apple'"):
        randomizer.redraw("apples")
    with pytest.raises(ArgumentError, match="worlds should have shape"):
        randomizer.redraw("apple", np.zeros(2, bool))


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("names", [("target",), ("stand", "apple")])
def test_objects_keep_the_variants_that_they_have(names: tuple[str, ...], device: str):
    """Free where those are, also in worlds that got them from stored layouts; nothing else differs by a bit."""
    compiled = compile_scene(with_variants(*reversed(THINGS)), device)
    sim = compiled.scene.sim
    randomizer = randomizer_of(compiled)
    stored = make_table(compiled, NWORLD, seed=7)
    randomizer.write(stored, np.where(np.arange(NWORLD) < 4, np.arange(NWORLD), -1))
    for turn in range(2):
        stir(randomizer, turn)
        before, variant = state(randomizer), randomizer.variants.cpu().numpy().copy()
        fields = {name: getattr(randomizer.model, name).numpy().copy() for name in fields_of_variants(compiled.scene)}
        randomizer.redraw(names, HALF)
        after = state(randomizer)
        judge = Judge(sim.mjm, [sim.bodies[name] for name in names])
        assert judge.differences(before, after, HALF) == []
        assert all((before["qpos"][world] != after["qpos"][world]).any() for world in np.flatnonzero(HALF))
        np.testing.assert_array_equal(randomizer.variants.cpu().numpy(), variant)
        for name, values in fields.items():
            np.testing.assert_array_equal(getattr(randomizer.model, name).numpy(), values)
        for world in np.flatnonzero(HALF):
            stand, target = (THINGS[i][k] for i, k in enumerate(variant[world]))
            own = build_model(SceneConfig.load(with_variants((target,), (stand,))))
            alone = Judge(own.mjm, [own.bodies[name] for name in names])
            assert alone.deepest(after, int(world)) < DEEP
    np.testing.assert_array_equal(randomizer.redraw_count.cpu().numpy(), 2 * HALF)
    with pytest.raises(UnknownNameError, match=r"placed object 'target/\w+'\. Did you mean 'target'\?"):
        randomizer.redraw(compiled.config.variants["target"][0])  # other worlds have another one
