"""Masses and centres of mass that a scene draws: the layouts of their episodes stand with them, in MuJoCo C."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

from sceniris_gym.commands.replay import drawn, replay
from sceniris_gym.errors import ArgumentError, SceneKeyError, SceneMismatchError
from sceniris_gym.layout.generate import LayoutGenerator, make_redraw
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.layouts import Layouts, LayoutStatus
from sceniris_gym.layout.redraw import RedrawCounts
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.layout.scenes import box_mjcf, compile_on_cpu, make, read
from tests.oracle.stack_judge import STILL, StackJudge

NWORLD = 48
MASSES = {"mass": {"scale": [0.125, 8.0], "distribution": "log_uniform"}}
HEIGHTS = {"low": 0.03, "tall": 0.06}
CENTERS = {"ipos": {"add": [[-0.04, -0.01, 0.0], [0.04, 0.01, 0.0]]}}


def seesaw(folder: Path, plank: Any, load: Any, **words: Any) -> CompiledScene:
    """Compile the scene of a plank on a narrow block, with a cube on the plank."""
    objects = {
        "block": {"asset": box_mjcf(folder, "block", 0.08, 0.08, 0.05), "kind": "fixture", "on": "floor"},
        "plank": {"asset": box_mjcf(folder, "plank", 0.3, 0.06, 0.02), "on": "block", "randomize": plank},
        "load": {"asset": box_mjcf(folder, "load", 0.04, 0.04, 0.04), "on": "plank", "randomize": load},
    }
    yaw = {"orientation": {"yaw": [0, 0]}}
    objects = {name: {**part, **yaw} for name, part in objects.items()}
    return compile_on_cpu({"floor": {"size": [1, 1]}, "attempts": 200, "objects": objects} | words, bank=8)


def reset(compiled: CompiledScene, nworld: int = NWORLD, **words: Any) -> ResetRandomizer:
    """Return a randomizer that has made a layout of each world."""
    randomizer = ResetRandomizer(compiled, *make_worlds(compiled, nworld), seed=5, **words)
    randomizer.reset()
    return randomizer


def moving(compiled: CompiledScene, layouts: Layouts, fields: dict[str, np.ndarray]) -> np.ndarray:
    """Return which layouts have something that moves in MuJoCo C with these fields, shape (nworld,)."""
    rows, nmocap, far = read(layouts), compiled.mjm.nmocap, []
    for world in range(layouts.nworld):
        mjm = copy.copy(compiled.mjm)
        for name, values in fields.items():
            getattr(mjm, name)[:] = values[world]
        mujoco.mj_setConst(mjm, mujoco.MjData(mjm))
        poses = rows.qpos[world], rows.mocap_pos[world][:nmocap], rows.mocap_quat[world][:nmocap]
        far.append(StackJudge(mjm).moves(*poses).max())
    return np.array(far) > STILL


@pytest.mark.parametrize("words", [(MASSES, MASSES), (CENTERS, {})], ids=["masses", "centres"])
def test_layouts_stand_by_what_their_world_draws(tmp_path: Path, words: Any):
    """None moves by 1 cm with its own masses; many do with those of another world."""
    compiled = seesaw(tmp_path, *words)
    randomizer = reset(compiled)
    rows = randomizer.fields.rows
    fields = {name: rows[name].numpy() for name in ("body_mass", "body_inertia", "body_ipos") if name in rows}
    assert not moving(compiled, randomizer.layouts, fields).any()
    others = {name: np.roll(values, 1, axis=0) for name, values in fields.items()}
    assert moving(compiled, randomizer.layouts, others).mean() > 0.05


@pytest.mark.parametrize("prefetch", [False, True], ids=["in place", "ahead"])
@pytest.mark.parametrize("words", [(MASSES, MASSES), (CENTERS, {})], ids=["masses", "centres"])
def test_fallbacks_stand_by_what_their_stored_layout_was_proven_with(tmp_path: Path, words: Any, prefetch: bool):
    """Most worlds run out of candidates; each gets the masses of the layout that it falls back on."""
    compiled = seesaw(tmp_path, *words, attempts=1, restarts=0)
    randomizer = reset(compiled, prefetch=prefetch)
    rows, status = randomizer.fields.rows, randomizer.layouts.status.numpy()
    fields = {name: rows[name].numpy() for name in ("body_mass", "body_inertia", "body_ipos") if name in rows}
    assert (status == LayoutStatus.FALLBACK).sum() >= 10
    assert not moving(compiled, randomizer.layouts, fields).any()


def test_a_fallback_has_the_physics_of_its_own_in_every_door(tmp_path: Path):
    """`replay` of its id, and a table that is written or served, have the masses of its world, also with params."""
    compiled = seesaw(tmp_path, MASSES, MASSES, attempts=1, restarts=0)
    param = "objects.load.randomize.mass"
    randomizer = reset(compiled, 8, prefetch=False, params=param)
    randomizer.pipeline.set_params({param: [2.0, 4.0]})
    randomizer.reset()
    status, masses = randomizer.layouts.status.numpy(), randomizer.model.body_mass.numpy().copy()
    assert len(set(status)) == 2
    for told, mass in zip(randomizer.layout_ids(), masses, strict=True):
        np.testing.assert_array_equal(drawn(compiled, replay(compiled, LayoutId.parse(told)))[0].body_mass, mass)
    assert isinstance(randomizer.pipeline.maker, LayoutGenerator)
    table = randomizer.pipeline.maker.table()
    stored = reset(compiled, 8, layout_source=StoredLayouts(compiled, table, 8))
    np.testing.assert_array_equal(stored.model.body_mass.numpy(), masses)
    assert stored.layout_ids() == randomizer.pipeline.ids("train")
    other = reset(compiled, 8, split="eval", params=param, prefetch=False)
    other.write(table, np.arange(8)[::-1].copy())
    np.testing.assert_array_equal(other.model.body_mass.numpy(), masses[::-1])
    with pytest.raises(SceneMismatchError, match="Make the randomizer with params="):
        reset(compiled, 8).write(table, np.arange(8))
    with pytest.raises(ArgumentError, match="stored layouts keep the params"):
        stored.pipeline.set_params({param: [1.0, 2.0]})


def test_a_redraw_takes_the_masses_that_the_worlds_have(tmp_path: Path):
    """Also where a param or a task changed them: those of the Model, of every body."""
    randomizer = reset(seesaw(tmp_path, MASSES, MASSES))
    randomizer.scale_field("body_mass", "load", np.full(NWORLD, 2.0, np.float32))
    model = randomizer.model
    redraw = make_redraw(randomizer.compiled, ("load",), NWORLD, "train", masses=(model.body_mass, model.body_ipos))
    mask = wp.ones(NWORLD, dtype=bool, device="cpu")
    redraw.launch(randomizer.layouts.view, mask, RedrawCounts.zeros(NWORLD, "cpu"))
    generator = redraw._make.__self__  # pyrefly: ignore[missing-attribute]
    np.testing.assert_array_equal(generator._work.statics.body_weight.numpy(), model.body_mass.numpy())


def test_a_redraw_tips_nothing_that_carries_it(tmp_path: Path):
    """The plank stays where it is, and keeps standing under the load's new place with its own centre of mass."""
    randomizer = reset(seesaw(tmp_path, CENTERS, {}))
    fields = {"body_ipos": randomizer.fields.rows["body_ipos"].numpy()}
    randomizer.redraw("load")
    placed = randomizer.redraw_status.numpy() == LayoutStatus.VALID
    assert placed.sum() > NWORLD // 2
    randomizer.data.qpos.assign(randomizer.layouts.qpos.numpy())
    assert not moving(randomizer.compiled, randomizer.layouts, fields)[placed].any()


def test_layouts_are_those_of_seed_and_episode(tmp_path: Path):
    """Also where masses decide: for one world alone, and with layouts made ahead; equal bits."""
    compiled = seesaw(tmp_path, MASSES, MASSES)
    one, many = make(compiled, 1, seed=7), make(compiled, 16, seed=0)
    np.testing.assert_array_equal(one.qpos[0], many.qpos[7])
    ahead, in_place = (reset(compiled, 6, prefetch=prefetch) for prefetch in (True, False))
    for randomizer in (ahead, in_place):
        randomizer.reset(np.arange(6) % 2 == 0)
        randomizer.reset()
    np.testing.assert_array_equal(ahead.data.qpos.numpy(), in_place.data.qpos.numpy())
    np.testing.assert_array_equal(ahead.model.body_mass.numpy(), in_place.model.body_mass.numpy())


def test_gravity_is_drawn_within_the_tilt_at_which_things_stand(tmp_path: Path):
    """An angle of one degree, as of the gravity of a model."""
    reset(seesaw(tmp_path, {}, {}, randomize={"gravity": {"add": [[-0.1, -0.1, -0.5], [0.1, 0.1, 0.5]]}}), 2)
    with pytest.raises(SceneKeyError, match=r"as \[0\.2, 0\.15, -9\.78\], .*point within 1 degree of straight down"):
        seesaw(tmp_path, {}, {}, randomize={"gravity": {"add": [[-0.2, -0.15, -0.03], [0.2, 0.15, 0.03]]}})


def test_masses_of_variants_are_those_that_resets_write(tmp_path: Path):
    """They are drawn by the name of the object, relative to the variant that is present, as a param narrows them."""
    load = {"variants": {name: {"asset": box_mjcf(tmp_path, name, 0.04, 0.04, z)} for name, z in HEIGHTS.items()}}
    words = {"orientation": {"yaw": [0, 0]}}
    objects = {
        "plank": {"asset": box_mjcf(tmp_path, "plank", 0.3, 0.06, 0.02), "on": "floor", **words},
        "load": {**load, "on": "plank", "randomize": MASSES, **words},
    }
    compiled = compile_on_cpu({"floor": {"size": [1, 1]}, "attempts": 200, "objects": objects}, bank=8)
    param = "objects.load.randomize.mass"
    randomizer = reset(compiled, prefetch=False, params=param)
    randomizer.pipeline.set_params({param: [2.0, 4.0]})
    randomizer.reset()
    generator, slot = randomizer.pipeline.maker, compiled.scene.sim.bodies["load"]
    assert isinstance(generator, LayoutGenerator)
    assert generator._work.statics is not None
    variant, rows = randomizer.variants.numpy()[:, 0], np.arange(NWORLD)
    members = np.array([compiled.scene.bodies[f"load/{name}"] for name in HEIGHTS])[variant]
    weights = generator._work.statics.body_weight.numpy()[rows, members]
    np.testing.assert_allclose(weights, randomizer.model.body_mass.numpy()[:, slot], rtol=1e-6)
    assert len(set(variant)) == 2
    assert len(np.unique(weights)) == NWORLD
