"""Variants in the simulation: a world is, to the last bit, what a model of its own variants would be.

Read as a row of layouts it is the layout that it was reset to.
"""

from __future__ import annotations

import hashlib
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, NotSupportedError, SceneKeyError, SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.pictures.camera import Cameras
from sceniris_gym.pictures.context import Looks, Shot
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from sceniris_gym.sim.batch import Batch, default_budget
from sceniris_gym.sim.fit import check_model, make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.variants import VariantReader, fields_of_variants
from tests.layout.scenes import write_mjcf
from tests.versions import OLDEST, since_3_12

THINGS = ("can", "mug", "book", "brick")
STANDS = ("tin", "bowl")
NWORLD = 24
BITS = "4024381cb35ab202"
NREAD = 6
HALF = np.arange(NREAD) % 2 == 0


def words(target: dict[str, Any], stand: dict[str, Any]) -> dict[str, Any]:
    """A scene of a table with a thing and a fixture on it, each of which may have variants."""
    table = {"asset": "table", "kind": "static"}
    stand = {**stand, "kind": "fixture", "on": "table", "region": {"fraction": [[0, 0], [0.4, 1]]}}
    objects = {"table": table, "apple": {"asset": "apple", "on": "table"}, "stand": stand}
    return {"bank": 4, "objects": {**objects, "target": {**target, "on": "table", "gap": 0.003}}}


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """A free object with four variants, of convex parts and boxes, and a fixture with two."""
    return compile_scene(words({"asset": list(THINGS)}, {"asset": list(STANDS)}), "cpu")


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def anywhere(request: pytest.FixtureRequest) -> CompiledScene:
    """The same scene on a CPU and on a GPU."""
    if request.param == "cpu":
        return request.getfixturevalue("compiled")
    return compile_scene(words({"asset": list(THINGS)}, {"asset": list(STANDS)}), request.param)


def simulated(compiled: CompiledScene, nworld: int = NWORLD) -> tuple[Batch, ResetRandomizer]:
    """Worlds on fresh layouts."""
    batch = Batch(compiled.scene, nworld, compiled.device)
    randomizer = ResetRandomizer(compiled, batch.model, batch.data, prefetch=False)
    randomizer.reset()
    return batch, randomizer


def state(batch: Batch) -> dict[str, np.ndarray]:
    """Return what a step reads and makes, by name, one row a world."""
    return {name: getattr(batch.data, name).numpy().copy() for name in (*ResetRandomizer.STATE_FIELDS, "qacc")}


def stepped(batch: Batch, steps: int) -> list[np.ndarray]:
    """Return positions, velocities and accelerations after each of some steps."""
    found = []
    for _ in range(steps):
        batch.step()
        found.append(np.hstack([getattr(batch.data, name).numpy() for name in ("qpos", "qvel", "qacc")]))
    return found


def test_a_world_moves_as_a_model_of_its_own_variants(compiled: CompiledScene):
    """Positions, velocities and accelerations in 30 steps, with the fall onto the table: no bit differs."""
    batch, randomizer = simulated(compiled)
    start = [getattr(batch.data, name).numpy().copy() for name in ("qpos", "mocap_pos", "mocap_quat")]
    drawn = randomizer.variants.cpu().numpy()
    ours = stepped(batch, 30)
    assert batch.data.nacon.numpy()[0] > NWORLD
    assert set(drawn[:, 1]) == set(range(len(THINGS)))
    for pair in sorted(set(map(tuple, drawn))):
        own = SceneConfig.load(words({"asset": THINGS[pair[1]]}, {"asset": STANDS[pair[0]]}))
        alone = Batch(build_model(own), NWORLD, "cpu")
        for name, values in zip(("qpos", "mocap_pos", "mocap_quat"), start, strict=True):
            getattr(alone.data, name).assign(values)
        if OLDEST:  # its solver rounds by this scale, which all worlds of a model share
            models: tuple[Any, Any] = alone.model, batch.model
            models[0].stat.meaninertia = models[1].stat.meaninertia
        rows = (drawn == pair).all(axis=1)
        for one, other in zip(ours, stepped(alone, 30), strict=True):
            assert one[rows].tobytes() == other[rows].tobytes()


def test_masked_resets_change_nothing_else(anywhere: CompiledScene):
    """State and model of the other worlds keep their bits; the masked ones get their next variants."""
    batch, randomizer = simulated(anywhere)
    stepped(batch, 3)
    mask = np.arange(NWORLD) % 3 == 0
    names = fields_of_variants(anywhere.scene)
    before = state(batch) | {name: getattr(batch.model, name).numpy().copy() for name in names}
    drawn = randomizer.variants.cpu().numpy().copy()
    randomizer.reset(mask)
    after = state(batch) | {name: getattr(batch.model, name).numpy() for name in names}
    for name, values in before.items():
        assert values[~mask].tobytes() == after[name][~mask].tobytes(), name
    assert (drawn[~mask] == randomizer.variants.cpu().numpy()[~mask]).all()
    assert (drawn[mask] != randomizer.variants.cpu().numpy()[mask]).any()
    assert (before["geom_dataid"][mask] != after["geom_dataid"][mask]).any()


def test_rows_of_the_model_are_those_that_mujoco_compiles_of_a_variant_alone(anywhere: CompiledScene):
    """Masses, inverse weights and the geoms of each class in their order; of all else nothing has a mass of its own."""
    batch, randomizer = simulated(anywhere)
    drawn, m, sim = randomizer.variants.cpu().numpy(), batch.model, anywhere.sim_mjm
    body = anywhere.scene.sim.bodies["target"]
    own = {name: build_model(SceneConfig.load(words({"asset": name}, {"asset": "tin"}))) for name in THINGS}
    geoms = np.flatnonzero(sim.geom_bodyid == body)
    for world in range(NWORLD):
        scene = own[THINGS[drawn[world, 1]]]
        alone, theirs = scene.mjm, np.flatnonzero(scene.mjm.geom_bodyid == scene.bodies["target"])
        for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_invweight0", "body_subtreemass"):
            mine = getattr(m, name).numpy()[world, body]
            np.testing.assert_array_equal(mine, getattr(alone, name)[scene.bodies["target"]].astype(np.float32))
        used = m.geom_margin.numpy()[world, geoms] > -1.0
        assert used.sum() == len(theirs)
        for name in ("geom_size", "geom_pos", "geom_quat", "geom_rbound", "geom_friction", "geom_rgba"):
            mine, wanted = getattr(m, name).numpy()[world, geoms[used]], getattr(alone, name)[theirs].astype(np.float32)
            np.testing.assert_array_equal(np.unique(mine, axis=0), np.unique(wanted, axis=0))
    total = m.body_subtreemass.numpy()[:, 0]
    np.testing.assert_allclose(total, m.body_mass.numpy().sum(axis=1), rtol=1e-6)


def test_stored_layouts_bring_their_variants(anywhere: CompiledScene):
    """Rows of a table, in another order, are simulated with the things that they were made with."""
    table = make_table(anywhere, 12, 5)
    batch, randomizer = simulated(anywhere, 4)
    rows = np.array([7, -1, 3, 11])
    before = state(batch)
    randomizer.write(table, rows)
    columns = [anywhere.slots.index(name) for name in anywhere.config.variants["target"]]
    assert (
        randomizer.variants.cpu().numpy()[[0, 2, 3], 1] == table.present[rows[[0, 2, 3]]][:, columns].argmax(1)
    ).all()
    data = mujoco.MjData(anywhere.mjm)
    for world in (0, 2, 3):
        table.put(data, rows[world])
        mujoco.mj_kinematics(anywhere.mjm, data)
        for slot in np.flatnonzero(table.present[rows[world]]):
            name = anywhere.slots[slot]
            body = anywhere.scene.bodies[name]
            simulated_as = batch.data.xpos.numpy()[world, anywhere.scene.sim_bodies[body]]
            np.testing.assert_allclose(simulated_as, data.xpos[body], atol=1e-6)
    assert all(before[name][1].tobytes() == values[1].tobytes() for name, values in state(batch).items())


def test_layouts_have_the_pose_of_the_variant_that_is_there(compiled: CompiledScene):
    """By the name of the object, free or fixture: where its body is simulated."""
    batch, randomizer = simulated(compiled)
    for name in ("target", "stand"):
        pose, body = randomizer.layouts.pose(name).numpy(), compiled.scene.sim.bodies[name]
        np.testing.assert_allclose(pose[:, :3], batch.data.xpos.numpy()[:, body], atol=1e-6)
        np.testing.assert_allclose(
            np.abs((pose[:, 3:] * batch.data.xquat.numpy()[:, body]).sum(axis=1)), 1.0, atol=1e-6
        )


def test_rejections_are_told_by_variant(compiled: CompiledScene):
    """Each of them has counts of its own."""
    _, randomizer = simulated(compiled)
    counts = randomizer.rejection_counts()
    assert set(counts) >= {f"target/{name}" for name in THINGS} | {f"stand/{name}" for name in STANDS}


@since_3_12("round objects rock for seconds before they rest")
def test_one_world_has_one_variant_at_a_time(compiled: CompiledScene):
    """A single world, whose model has one row anyway, rests on the table with whatever it gets."""
    batch, randomizer = simulated(compiled, 1)
    seen = set()
    for _ in range(6):
        randomizer.reset()
        stepped(batch, 60)
        seen.add(int(randomizer.variants.cpu().numpy()[0, 1]))
        assert np.abs(batch.data.qvel.numpy()).max() < 0.05
    assert len(seen) > 1


def test_fixtures_have_variants_where_nothing_moves():
    """A model without degrees of freedom, whose worlds show one thing or the other."""
    stand = {"asset": list(STANDS), "kind": "fixture", "on": "floor"}
    compiled = compile_scene({"floor": {"size": [1, 1]}, "objects": {"stand": stand}, "bank": 4}, "cpu")
    batch, randomizer = simulated(compiled)
    assert compiled.sim_mjm.nv == 0
    drawn = randomizer.variants.cpu().numpy()[:, 0]
    assert {*drawn.tolist()} == {0, 1}
    body = compiled.scene.sim.bodies["stand"]
    mass = [compiled.mjm.body(f"stand/{name}").mass.item() for name in STANDS]
    np.testing.assert_allclose(batch.model.body_mass.numpy()[:, body], np.array(mass)[drawn], rtol=1e-6)


def test_a_model_with_one_row_for_all_worlds_is_refused(compiled: CompiledScene):
    """With the function that makes a better one."""
    with wp.ScopedDevice("cpu"):
        data = mjw.make_data(compiled.sim_mjm, nworld=2)
        with pytest.raises(SceneMismatchError, match="make_worlds"):
            ResetRandomizer(compiled, mjw.put_model(compiled.sim_mjm), data)
        with pytest.raises(SceneMismatchError, match=r"model\.nq"):
            ResetRandomizer(compiled, mjw.put_model(compiled.mjm), mjw.make_data(compiled.mjm, nworld=2))
    for nworld in (-1, 2.0):
        with pytest.raises(ArgumentError, match=r"make_worlds: nworld should be an integer of at least 1, got"):
            make_worlds(compiled, nworld)  # pyrefly: ignore[bad-argument-type]
    variant = ResetRandomizer(compiled, *make_worlds(compiled, 2)).variants
    assert variant.shape == (2, len(compiled.config.variants))


def test_what_cannot_share_a_body_is_refused(tmp_path):
    """Several bodies, sensors or actuators of its own, and a model whose geoms use every contact bit."""
    own = words({"variants": {"a": {"asset": "can"}, "b": {"asset": "cabinet"}}}, {"asset": "tin"})
    with pytest.raises(NotSupportedError, match="target/b: has several bodies"):
        build_model(SceneConfig.load(own))
    several = {"floor": {"size": [2, 2]}, "objects": {"cabinet": {"asset": "cabinet", "on": {"floor": 1}}}}
    with pytest.raises(
        NotSupportedError, match=r"objects\.cabinet: has several bodies, but an object with .* several sup"
    ):
        build_model(SceneConfig.load(several))
    sensor = '<sensor><framepos objtype="body" objname="thing"/></sensor>'
    geom = '<geom type="box" size=".02 .02 .02" conaffinity="-1"/>'
    own["objects"]["target"]["variants"]["b"]["asset"] = write_mjcf(tmp_path, "thing", geom, sensor)
    with pytest.raises(NotSupportedError, match=r"is named as 'target/b/?' by one of the model's sensors"):
        build_model(SceneConfig.load(own))
    cloth = '<flexcomp name="f" type="grid" count="3 3 1" spacing=".02 .02 .02" dim="2" rigid="true"/>'
    hill = '<asset><hfield name="h" nrow="2" ncol="2" size="1 1 1 .1" elevation="0 1 1 0"/></asset>'
    for name, body, rest in (("is soft", cloth, ""), ("height fields", '<geom type="hfield" hfield="h"/>', hill)):
        own["objects"]["target"]["variants"]["b"]["asset"] = write_mjcf(tmp_path, "odd", body, rest)
        with pytest.raises(NotSupportedError, match=rf"objects\.target/b: .*{name}"):
            build_model(SceneConfig.load(own))
    slide, key = '<joint name="slide" type="slide"/>', '<keyframe><key name="home" qpos="0.1" ctrl="0.2"/></keyframe>'
    motor = f'<actuator><motor joint="slide"/></actuator>{key}'
    stand = {"variants": {"a": {"asset": "tin"}, "b": {"asset": write_mjcf(tmp_path, "driven", slide + geom, motor)}}}
    with pytest.raises(NotSupportedError, match=r"objects\.stand: actuators refer to root joints"):
        build_model(SceneConfig.load(words({"asset": "can"}, stand)))
    own["objects"]["target"]["variants"]["b"]["asset"] = write_mjcf(tmp_path, "plain", geom)
    own["objects"]["target"]["variants"]["c"] = {"asset": "mug"}
    with pytest.raises(SceneKeyError, match="need a contact bit"):
        build_model(SceneConfig.load(own))
    taken = words({"asset": ["can", "mug"]}, {"asset": "tin"})
    refused = {
        "target": r"objects\.target: the model has a body of this name",
        "hulls_of_variants": "is reserved for scenes with",
    }
    for name, says in refused.items():
        text = f'<mujoco><worldbody><body name="{name}"/></worldbody></mujoco>'
        (tmp_path / "model.xml").write_text(text)
        with pytest.raises(SceneKeyError, match=says):
            build_model(SceneConfig.load({**taken, "model": str(tmp_path / "model.xml")}))


def test_pictures_show_the_variants(compiled: CompiledScene):
    """Every pixel is that of a model with all variants, of which the absent ones are out of sight."""
    batch, randomizer = simulated(compiled, 4)
    shots = {"overview": Shot((64, 48))}
    ours = Cameras(compiled.scene.sim, batch.model, batch.data, shots, Looks())
    with wp.ScopedDevice("cpu"):
        full, d = mjw.put_model(compiled.mjm), mjw.make_data(compiled.mjm, 4, nconmax=1, njmax=1)
        for name in ("qpos", "mocap_pos", "mocap_quat"):
            getattr(d, name).assign(getattr(randomizer.layouts, name).cpu().numpy())
        mjw.kinematics(full, d)
    theirs = Cameras(compiled.scene, full, d, shots, Looks())
    pictures = []
    for cameras in (ours, theirs):
        cameras.launch()
        pictures.append(cameras.images["overview"]["rgb"].numpy())
    assert len({picture.tobytes() for picture in pictures[0]}) == 4
    np.testing.assert_array_equal(*pictures)


def test_a_variant_is_seen_that_looks_like_the_hull_of_another(tmp_path):
    """A ball is drawn, and one that collides inside of a green ball is not."""
    ball = '<geom size=".04" pos="0 0 .05" rgba="1 0 0 1"/>'
    skin = '<geom size=".05" pos="0 0 .05" rgba="0 1 0 1" group="1" contype="0" conaffinity="0"/>'
    files = {"ball": write_mjcf(tmp_path, "ball", ball), "clad": write_mjcf(tmp_path, "clad", ball + skin)}
    thing = {"variants": {name: {"asset": file} for name, file in files.items()}}
    above = {"body": "target", "pos": [0, 0, 0.4], "look_at": [0, 0, 0]}
    scene = {**words(thing, {"asset": "tin"}), "cameras": {"above": above}}
    compiled = compile_scene(scene, "cpu")
    batch, randomizer = simulated(compiled, 8)
    cameras = Cameras(compiled.scene.sim, batch.model, batch.data, {"above": Shot((8, 8))}, Looks())
    cameras.launch()
    middle = cameras.images["above"]["rgb"].numpy()[:, 4, 4].astype(int)
    drawn = randomizer.variants.cpu().numpy()[:, 0]
    assert {0, 1} == set(drawn)
    assert (middle[drawn == 0, 0] > 2 * middle[drawn == 0, 1]).all()
    assert (middle[drawn == 1, 1] > 2 * middle[drawn == 1, 0]).all()


def test_there_is_room_for_the_contacts_of_every_variant(compiled: CompiledScene):
    """The default budget is at least that of each thing alone: a bowl stands on many geoms."""
    room = np.array(default_budget(compiled.sim_mjm, compiled.scene))
    for thing in THINGS:
        for stand in STANDS:
            own = build_model(SceneConfig.load(words({"asset": thing}, {"asset": stand})))
            assert (room >= default_budget(own.mjm)).all()


def test_draws_of_physics_are_relative_to_the_variant():
    """Masses, frictions and colours are those of the variant that a world has, times what was drawn for it."""
    drawn = {"mass": {"scale": [0.5, 2.0]}, "friction": {"scale": [0.5, 1.0]}, "rgba": {"scale": [0.5, 0.9]}}
    compiled = compile_scene(words({"asset": list(THINGS), "randomize": drawn}, {"asset": list(STANDS)}), "cpu")
    batch = Batch(compiled.scene, NWORLD, "cpu")
    randomizer = ResetRandomizer.of_batch(batch, compiled, prefetch=False)
    for mask in (None, np.arange(NWORLD) % 2 == 0):
        randomizer.reset(mask)
    m, full, body = batch.model, compiled.mjm, compiled.scene.sim.bodies["target"]
    scale = batch.fields.parameter("target.mass", "here").numpy()[:, 0]
    assert np.unique(scale).size == NWORLD
    own = [compiled.scene.bodies[f"target/{name}"] for name in THINGS]
    bodies = np.array(own)[randomizer.variants.cpu().numpy()[:, 1]]
    np.testing.assert_allclose(m.body_mass.numpy()[:, body], full.body_mass[bodies] * scale, rtol=1e-5)
    np.testing.assert_allclose(m.body_inertia.numpy()[:, body], full.body_inertia[bodies] * scale[:, None], rtol=1e-5)
    weight = full.body_invweight0[bodies] / scale[:, None]
    np.testing.assert_allclose(m.body_invweight0.numpy()[:, body], weight, rtol=1e-3)
    sim = compiled.sim_mjm
    slots = np.flatnonzero(sim.geom_bodyid == body)
    for world in range(NWORLD):
        used = slots[m.geom_margin.numpy()[world, slots] > -1.0]
        theirs = np.flatnonzero(full.geom_bodyid == bodies[world])
        ratio = m.geom_friction.numpy()[world, used, 0].max() / full.geom_friction[theirs, 0].max()
        assert 0.49 < ratio < 1.01


def test_colours_of_others_are_relative_to_those_that_are_seen():
    """A table with a material, beside things with variants: nothing is added to its colour."""
    scene = words({"asset": list(THINGS)}, {"asset": list(STANDS)})
    scene["objects"]["table"]["randomize"] = {"rgba": {"add": [0.0, 0.0]}}
    compiled = compile_scene(scene, "cpu")
    batch, _ = simulated(compiled, 2)
    mjm, body = compiled.sim_mjm, compiled.scene.sim.bodies["table"]
    geoms = np.flatnonzero((mjm.geom_bodyid == body) & (mjm.geom_matid >= 0))
    wanted = np.broadcast_to(mjm.mat_rgba[mjm.geom_matid[geoms]], (2, len(geoms), 4))
    np.testing.assert_allclose(batch.model.geom_rgba.numpy()[:, geoms], wanted, rtol=1e-6)


def test_a_loop_with_one_model_for_all_worlds_is_refused(compiled: CompiledScene):
    """By adapters whose libraries write no fields of the model; a group of bodies does the same there."""
    group = r"groups: {stand: {of: \[tin, bowl\], count: 1}}\. Call edit_spec\(spec, scene\)"
    with pytest.raises(SceneMismatchError, match=rf"loop: objects\.stand has variants.*{group}"):
        check_model(compiled, compiled.sim_mjm, "loop", "")


@since_3_12("its compiler rounds otherwise, and bits are promised per version")
def test_variants_and_poses_have_the_same_bits_on_a_cpu_and_a_gpu(anywhere: CompiledScene):
    """After resets of all worlds and of some, in layouts and in the simulation: `BITS`, found on a CPU."""
    batch = Batch(anywhere.scene, NWORLD, anywhere.device)
    randomizer = ResetRandomizer(anywhere, batch.model, batch.data)
    digest = hashlib.sha256()
    for mask in (None, np.arange(NWORLD) % 3 == 0, np.arange(NWORLD) % 2 == 0):
        randomizer.reset(mask)
        simulated = map(wp.to_torch, (batch.data.qpos, batch.data.mocap_pos))
        for array in (randomizer.variants, randomizer.layouts.qpos, *simulated):
            digest.update(array.cpu().numpy().tobytes())
    assert digest.hexdigest()[:16] == BITS


@pytest.mark.cuda
def test_worlds_on_a_gpu_move_as_models_of_their_own_variants():
    """As far apart as two runs of one and the same model, whose contacts come in another order."""
    scene = compile_scene(words({"asset": list(THINGS)}, {"asset": list(STANDS)}), "cuda:0")
    batch = Batch(scene.scene, NWORLD, "cuda:0")
    randomizer = ResetRandomizer(scene, batch.model, batch.data)
    randomizer.reset()
    start = [getattr(batch.data, name).numpy().copy() for name in ("qpos", "mocap_pos", "mocap_quat")]
    drawn, nq = randomizer.variants.cpu().numpy(), scene.sim_mjm.nq
    ours = np.hstack([values[:, :nq] for values in stepped(batch, 30)])
    for pair in sorted(set(map(tuple, drawn))):
        own = SceneConfig.load(words({"asset": THINGS[pair[1]]}, {"asset": STANDS[pair[0]]}))
        runs = []
        for _ in range(2):
            alone = Batch(build_model(own), NWORLD, "cuda:0")
            for name, values in zip(("qpos", "mocap_pos", "mocap_quat"), start, strict=True):
                getattr(alone.data, name).assign(values)
            runs.append(np.hstack([values[:, :nq] for values in stepped(alone, 30)]))
        rows = (drawn == pair).all(axis=1)
        spread = np.abs(runs[0][rows] - runs[1][rows]).max()
        assert np.abs(ours[rows] - runs[0][rows]).max() <= 4.0 * spread + 1e-6


@pytest.fixture(scope="module")
def mixed() -> CompiledScene:
    """Things and fixtures with variants, between a fixture with drawers and a free object that may be absent."""
    objects = {
        "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0.1, 0.4]}}},
        "target": {"asset": ["can", "mug", "book"], "on": "floor"},
        "stand": {"asset": ["tin", "bowl"], "kind": "fixture", "on": "floor"},
        "apple": {"asset": "apple", "on": "floor"},
    }
    groups = {"some": {"of": ["apple"], "count": [0, 1]}}
    return compile_scene({"floor": {"size": [1.5, 1.5]}, "objects": objects, "groups": groups, "bank": 4}, "cpu")


@pytest.mark.parametrize("stored", [False, True])
def test_worlds_are_read_as_the_layouts_that_were_written(mixed: CompiledScene, stored: bool):
    """Presence and poses; absent variants are far away, and other worlds are not read."""
    batch = Batch(mixed.scene, NREAD, "cpu")
    randomizer = ResetRandomizer(mixed, batch.model, batch.data, seed=3)
    randomizer.reset()
    wanted = randomizer.layouts.present.numpy(), randomizer.layouts.qpos.numpy(), randomizer.layouts.mocap_pos.numpy()
    apple = mixed.slots.index("apple")
    if stored:  # presence of others than variants is that of the reset
        table = make_table(mixed, NREAD, seed=40)
        randomizer.write(table, np.arange(NREAD))
        present = np.where(np.arange(len(mixed.slots)) == apple, wanted[0], table.present)
        wanted = present, table.qpos.astype(np.float32), table.mocap_pos.astype(np.float32)
    variants = randomizer._writer.variants
    assert variants is not None
    reader = VariantReader(batch.data, variants, randomizer.layouts.view)
    reader.launch(wp.array(HALF, dtype=bool, device="cpu"))
    found = [getattr(reader.state, name).numpy() for name in ("present", "qpos", "mocap_pos")]
    assert not any(values[~HALF].any() for values in found)
    np.testing.assert_array_equal(found[0][HALF], wanted[0][HALF])
    mjm, members = mixed.mjm, [m for of in mixed.config.variants.values() for m in of]
    for world in np.flatnonzero(HALF):
        for body in range(1, mjm.nbody):
            name, mocap = mjm.body(body).name, int(mjm.body_mocapid[body])
            qpos = np.repeat(mjm.jnt_bodyid, np.diff([*mjm.jnt_qposadr, mjm.nq])) == body
            read, layout = (
                np.append(of[1][world, qpos], of[2][world, [mocap] * (mocap >= 0)]) for of in (found, wanted)
            )
            if name in members and not wanted[0][world, mixed.slots.index(name)]:
                assert (read > 1e3).all()
            else:
                np.testing.assert_array_equal(read, layout)


@pytest.fixture(scope="module")
def optional() -> CompiledScene:
    """A thing and a fixture with variants that are absent from some layouts, and a load of the fixture."""
    objects = {
        "lamp": {"asset": "tin", "on": "floor"},
        "target": {"asset": ["can", "mug", "book"], "on": "floor", "if": "lamp"},
        "stand": {"asset": ["tin", "bowl"], "kind": "fixture", "on": "floor", "unless": "target/mug"},
        "apple": {"asset": "apple", "on": "stand"},
    }
    groups = {"some": {"of": ["lamp"], "count": [0, 1]}}
    return compile_scene({"floor": {"size": [1.5, 1.5]}, "objects": objects, "groups": groups, "bank": 4}, "cpu")


def test_an_absent_object_with_variants_is_parked(optional: CompiledScene):
    """It has the number -1 and lies at rest where layouts park its first variant, and it comes back with a reset."""
    batch = Batch(optional.scene, NWORLD, "cpu")
    randomizer = ResetRandomizer(optional, batch.model, batch.data, prefetch=False)
    there = {}
    for _ in range(3):
        randomizer.reset()
        present = randomizer.layouts.present.numpy()
        for column, (name, members) in enumerate(optional.config.variants.items()):
            slots = present[:, [optional.slots.index(member) for member in members]]
            expected = np.where(slots.any(axis=1), slots.argmax(axis=1), -1)
            np.testing.assert_array_equal(randomizer.variants.numpy()[:, column], expected)
            if name != "stand":
                adr = optional.sim_mjm.joint(f"{name}/free").qposadr[0]
                poses = batch.data.qpos.numpy()[:, adr : adr + 3]
            else:
                poses = batch.data.mocap_pos.numpy()[:, optional.sim_mjm.body(name).mocapid[0]]
            np.testing.assert_array_equal(poses, randomizer.layouts.pose(name).numpy()[:, :3])
            assert ((poses[:, :2].min(axis=1) > 38.0) == (expected < 0)).all()
            there.setdefault(name, set()).update(expected.tolist())
    assert there == {"target": {-1, 0, 1, 2}, "stand": {-1, 0, 1}, "apple": {-1, 0, 1}}
    before = batch.data.qpos.numpy().copy()
    stepped(batch, 50)
    absent = randomizer.variants.numpy()[:, [*optional.config.variants].index("target")] < 0
    adr = optional.sim_mjm.joint("target/free").qposadr[0]
    assert np.abs(batch.data.qpos.numpy() - before)[absent, adr : adr + 3].max() < 0.002


def test_worlds_without_an_object_with_variants_are_read_as_their_layouts(optional: CompiledScene):
    """Its variants are all absent, and stored layouts with and without it are written."""
    batch = Batch(optional.scene, NREAD, "cpu")
    randomizer = ResetRandomizer(optional, batch.model, batch.data)
    table = make_table(optional, NREAD, seed=9)
    assert (table.present.sum(axis=1) < 3).any()
    randomizer.reset()
    variants = randomizer._writer.variants
    assert variants is not None
    reader = VariantReader(batch.data, variants, randomizer.layouts.view)
    reader.launch(wp.ones(NREAD, dtype=bool, device="cpu"))
    np.testing.assert_array_equal(reader.state.present.numpy(), randomizer.layouts.present.numpy())
    randomizer.write(table, np.arange(NREAD))
    for column, members in enumerate(optional.config.variants.values()):
        slots = table.present[:, [optional.slots.index(member) for member in members]]
        assert (randomizer.variants.numpy()[:, column] == np.where(slots.any(axis=1), slots.argmax(axis=1), -1)).all()
    table.present[0] = True
    with pytest.raises(SceneMismatchError, match="each row should have at most one variant of 'target'"):
        randomizer.write(table, np.arange(NREAD))
