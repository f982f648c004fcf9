"""Stored layouts served in place of fresh ones: which row comes when, and that nothing of it is lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError, ScenirisError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutKeys, Layouts, LayoutStatus
from sceniris_gym.layout.pipeline import LayoutPipeline
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.levels import LevelReplay
from sceniris_gym.levels.sampler import LevelSampler
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.vector.state import State
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu

NROW = 7
REGION = "objects.thing.region"
BOX = np.tile(np.array([-0.2, -0.2, 0.2, 0.2], np.float32), (NROW, 1))
SERVED = ("qpos", "mocap_pos", "mocap_quat", "present", "grasp", "grasp_qpos", "pregrasp_qpos")


@pytest.fixture(scope="module")
def crane(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A crane that is to reach a cube clear of all else, a stand that is placed, and a cube that is there or not."""
    folder = tmp_path_factory.mktemp("crane")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    scene = crane_scene(asset, cube, reachable="clear")
    scene["objects"]["other"] = {"asset": cube, "on": "floor", "reachable": "map"}
    scene["objects"]["stand"] = {"asset": box_mjcf(folder, "stand", 0.1, 0.1, 0.02), "kind": "fixture", "on": "floor"}
    scene["groups"] = {"some": {"of": ["other"], "count": [0, 1]}}
    return compile_on_cpu(scene, bank=4)


@pytest.fixture(scope="module")
def table(crane: CompiledScene) -> LayoutTable:
    """Seven layouts of it, in some of which the second cube is absent."""
    made = make_table(crane, NROW, 20)
    assert 0 < made.present[:, 1].sum() < NROW
    return made


def _randomizer(compiled: CompiledScene) -> ResetRandomizer:
    batch = Batch(compiled.scene, NROW, "cpu")
    return ResetRandomizer.of_batch(batch, compiled)


def columns(layouts: Layouts) -> dict[str, np.ndarray]:
    """Copy what is served to the host, joints of grasps without the room for longer arms."""
    assert layouts.reaching is not None
    found = {name: getattr(layouts, name).numpy().copy() for name in SERVED}
    njoint = len(layouts.reaching.arms[0].arm.joints)
    for name in ("grasp_qpos", "pregrasp_qpos"):
        assert np.isnan(found[name][:, :, njoint:]).all()
        found[name] = found[name][:, :, :njoint]
    return found


def assert_rows(layouts: Layouts, table: LayoutTable, rows: list[int]) -> None:
    """Check that world i holds row rows[i], to the bit."""
    for name, values in columns(layouts).items():
        np.testing.assert_array_equal(values, getattr(table, name)[rows], err_msg=name)


@pytest.mark.parametrize(
    ("seed", "first"),
    [
        (0, [0, 1, 2, 3]),
        (5, [5, 6, 0, 1]),
        (np.uint32(7), [0, 1, 2, 3]),
        ([3, 3, 10, 0], [3, 3, 3, 0]),
        ([2**64 - 1, 2**63, 2**32, 1], [1, 1, 4, 1]),  # 2^3 is 1 modulo 7
        (np.array([9, 8, 7, 6], np.int16), [2, 1, 0, 6]),
    ],
    ids=str,
)
def test_the_row_is_seed_and_episode_modulo_the_number_of_rows(
    crane: CompiledScene, table: LayoutTable, seed: Any, first: list[int]
):
    """Three episodes; modulo 2^64 too, behind which seeds start at 0 again."""
    stored = StoredLayouts(crane, table, 4, seed=seed)
    assert (stored.layouts.status.numpy() == LayoutStatus.NONE).all()
    given = [int(s) for s in seed] if np.ndim(seed) else [int(seed) + i for i in range(4)]
    for episode in range(3):
        stored.generate()
        rows = [(s + episode) % 2**64 % NROW for s in given]
        assert episode > 0 or rows == first
        assert_rows(stored.layouts, table, rows)
        assert stored.layouts.episode.numpy().tolist() == [episode] * 4
    assert stored.layouts.view.seed.numpy().tolist() == given
    assert (stored.layouts.status.numpy() == LayoutStatus.VALID).all()


@pytest.mark.parametrize("name", ["qpos", "mocap_pos", "mocap_quat", "present", "grasp", "grasp_qpos", "pregrasp_qpos"])
def test_columns_of_another_width_are_refused(crane: CompiledScene, table: LayoutTable, name: str):
    """Also those that no pose depends on: the kernel would read, or write, beyond their ends."""
    values = getattr(table, name)
    wider = (
        np.concatenate([values, values[:, :1]], axis=1) if values.shape[1] else np.zeros((NROW, 1, *values.shape[2:]))
    )
    for other in (wider, values[1:]):
        with pytest.raises(SceneMismatchError, match=r"table\.\w+ should have shape .* got"):
            StoredLayouts(crane, replace(table, **{name: other}), 2)  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("grasp", 10**6, r"table\.grasp should be from -1 to \[\d+ \d+\], got 1000000 in row 2"),
        ("grasp", -7, r"table\.grasp should be .* got -7 in row 2"),
        ("start", 0, r"table\.start should be from -1 to -1, got 0 in row 2"),
        ("present", 2, r"table\.present should be from 0 to 1, got 2 in row 2"),
        ("present", -1, r"table\.present should be"),
        ("qpos", np.nan, r"table: row 2 has a non-finite"),
    ],
)
def test_rows_with_numbers_that_no_layout_has_are_refused(
    crane: CompiledScene, table: LayoutTable, name: str, value: float, match: str
):
    """Tasks and kernels use them as indices; the error has the row and what there is."""
    values = getattr(table, name).astype(float if name == "qpos" else np.int64)
    values[2] = value
    with pytest.raises(SceneMismatchError, match=match):
        StoredLayouts(crane, replace(table, **{name: values}), 2)


def test_a_row_has_one_variant_of_each_object(tmp_path: Path):
    """Rather than none or two, of which a world would keep the body of whichever it had before."""
    boxes = [box_mjcf(tmp_path, name, 0.04, 0.04, 0.04) for name in ("cube", "brick")]
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"thing": {"asset": boxes, "on": "floor"}}}, bank=2)
    table = make_table(compiled, 3, 0)
    for present in (np.zeros_like(table.present), np.ones_like(table.present)):
        with pytest.raises(SceneMismatchError, match="each row should have exactly one variant of 'thing'"):
            StoredLayouts(compiled, replace(table, present=present), 2)


def test_worlds_that_are_left_out_keep_their_rows(crane: CompiledScene, table: LayoutTable):
    """Under a mask; one that is false everywhere changes nothing, and before its first row a world is at home."""
    stored = StoredLayouts(crane, table, 3, seed=2)
    home = columns(stored.layouts)
    stored.launch_generate(wp.array([False, True, False], dtype=wp.bool, device="cpu"))
    found = columns(stored.layouts)
    for name, values in home.items():
        np.testing.assert_array_equal(found[name][[0, 2]], values[[0, 2]], err_msg=name)
        np.testing.assert_array_equal(found[name][1], getattr(table, name)[3], err_msg=name)
    assert stored.layouts.status.numpy().tolist() == [LayoutStatus.NONE, LayoutStatus.VALID, LayoutStatus.NONE]
    stored.launch_generate(wp.array([False] * 3, dtype=wp.bool, device="cpu"))
    assert stored.layouts.episode.numpy().tolist() == [-1, 0, -1]
    stored.launch_generate(wp.array([True, True, False], dtype=wp.bool, device="cpu"))
    assert stored.layouts.episode.numpy().tolist() == [0, 1, -1]
    stored.generate()
    assert_rows(stored.layouts, table, [3, 5, 4])


def test_new_seeds_start_at_episode_zero(crane: CompiledScene, table: LayoutTable):
    """Those of the masked worlds, or of all; the layouts that are there stay until the next reset."""
    stored = StoredLayouts(crane, table, 3, seed=0)
    for _ in range(2):
        stored.generate()
    stored.reseed(wp.array([False, True, True], dtype=wp.bool, device="cpu"), seed=[4, 5, 6])
    assert stored.layouts.seed.numpy().tolist() == [0, 1, 2]
    assert stored.layouts.episode.numpy().tolist() == [1, 1, 1]
    assert_rows(stored.layouts, table, [1, 2, 3])
    stored.generate()
    assert stored.layouts.seed.numpy().tolist() == [0, 5, 6]
    assert stored.layouts.episode.numpy().tolist() == [2, 0, 0]
    assert_rows(stored.layouts, table, [2, 5, 6])
    stored.reseed(seed=1)
    stored.generate()
    assert_rows(stored.layouts, table, [1, 2, 3])


def test_wrong_seeds_are_refused(crane: CompiledScene, table: LayoutTable):
    """As those of a generator are."""
    for seed in (-1, 2**64, 1.5, [1, 2]):
        with pytest.raises(ArgumentError, match=r"^seeds?(=| should)"):
            StoredLayouts(crane, table, 3, seed=seed)  # pyrefly: ignore[bad-argument-type]


def test_a_table_of_a_generator_gives_the_generators_layouts(crane: CompiledScene):
    """Everything that a reset writes and a task sees, grasps and their joints among it."""
    generator = LayoutGenerator(crane, 5, seed=3)
    generator.generate()
    stored = StoredLayouts(crane, generator.table(), 5)
    stored.generate()
    for name in SERVED:
        np.testing.assert_array_equal(
            getattr(stored.layouts, name).numpy(), getattr(generator.layouts, name).numpy(), err_msg=name
        )
    seen = []
    for source in (LayoutGenerator(crane, 5, seed=3), StoredLayouts(crane, generator.table(), 5)):
        batch = Batch(crane.scene, 5, "cpu")
        randomizer = ResetRandomizer(crane, batch.model, batch.data, layout_source=source)
        randomizer.reset()
        s = State(batch, randomizer.layouts)
        seen.append([*(s.grasp(n) for n in ("thing", "other")), s.grasp_qpos("thing"), s.pregrasp_qpos("thing")])
        seen[-1] += [s.pose(name) for name in ("thing", "other", "stand")]
    for fresh, again in zip(*seen, strict=True):
        assert torch.equal(fresh.nan_to_num(), again.nan_to_num())
        assert torch.equal(fresh.isnan(), again.isnan())
    assert seen[1][0].isfinite().all()
    assert seen[1][2].isfinite().all()


def test_states_alone_have_no_grasps(crane: CompiledScene, table: LayoutTable):
    """Of a table without them a task sees nan, and where things are as ever."""
    states = LayoutTable.from_states(table.qpos, table.mocap_pos, table.mocap_quat, table.present)
    batch = Batch(crane.scene, NROW, "cpu")
    stored = StoredLayouts(crane, states, NROW)
    ResetRandomizer(crane, batch.model, batch.data, layout_source=stored).reset()
    s = State(batch, stored.layouts)
    assert s.grasp("thing").isnan().all()
    assert s.grasp_qpos("thing").isnan().all()
    np.testing.assert_array_equal(batch.data.qpos.numpy(), table.qpos)
    np.testing.assert_array_equal(stored.layouts.present.numpy(), table.present)


def test_a_scene_without_mocap_bodies_is_served_too(tmp_path: Path):
    """There are no columns of theirs to copy."""
    cube = box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"thing": {"asset": cube, "on": "floor"}}})
    assert compiled.mjm.nmocap == 0
    table = make_table(compiled, 3, 0)
    stored = StoredLayouts(compiled, table, 5, seed=1)
    stored.generate()
    np.testing.assert_array_equal(stored.layouts.qpos.numpy(), table.qpos[[1, 2, 0, 1, 2]])


def test_rows_are_served_from_a_captured_graph(crane: CompiledScene, table: LayoutTable):
    """One episode after the other, as those of a generator are."""
    stored: LayoutSource = StoredLayouts(crane, table, 2, seed=6)
    mask = wp.array([True, False], dtype=wp.bool, device="cpu")
    with wp.ScopedCapture(device="cpu") as capture:
        stored.launch_generate(mask)
    stored.launch_reseed(wp.array([6, 7], dtype=wp.uint64, device="cpu"), None)
    for row in (6, 0, 1):
        wp.capture_launch(capture.graph)
        np.testing.assert_array_equal(stored.layouts.qpos.numpy()[0], table.qpos[row])
    assert stored.layouts.episode.numpy().tolist() == [2, -1]


def test_what_is_stored_was_not_searched_for(crane: CompiledScene, table: LayoutTable):
    """Nothing was rejected, and later changes of the table are not seen."""
    own = replace(table, qpos=table.qpos.copy())
    stored = StoredLayouts(crane, own, 2)
    own.qpos[:] = 0.0
    stored.generate()
    assert_rows(stored.layouts, table, [0, 1])
    assert stored.rejection_counts() == {}


@pytest.mark.parametrize("name", ["qpos", "mocap_pos", "present"])
def test_a_table_of_another_scene_is_refused(crane: CompiledScene, table: LayoutTable, name: str):
    """One column too many or too few; the message has the shape that it should have."""
    values = getattr(table, name)
    wanted = str(tuple(values.shape[1:]))[1:-1].rstrip(",")
    for other in (values[:, :-1], np.concatenate([values, values[:, :1]], axis=1)):
        with pytest.raises(SceneMismatchError, match=rf"table\.{name} should have shape \(nrow, {wanted}"):
            StoredLayouts(crane, replace(table, **{name: other}), 2)  # pyrefly: ignore[bad-argument-type]


def test_a_table_without_rows_is_refused(crane: CompiledScene, table: LayoutTable):
    """There would be nothing to serve."""
    for nothing in (table[slice(0, 0)], replace(table, qpos=np.float32(1.0))):  # pyrefly: ignore[bad-argument-type]
        with pytest.raises(SceneMismatchError, match="nrow >= 1"):
            StoredLayouts(crane, nothing, 2)


def test_a_table_of_a_scene_with_equal_shapes_is_refused(crane: CompiledScene, table: LayoutTable):
    """By its hash; tables of bare states have none."""
    with pytest.raises(SceneMismatchError, match="StoredLayouts: table belongs to scene 0123"):
        StoredLayouts(crane, replace(table, scene="0123"), 4)
    StoredLayouts(crane, replace(table, scene=""), 4)
    with pytest.raises(SceneMismatchError, match="should have the same scene, split, params"):
        LayoutTable.concatenate([table, replace(table, split="eval")])


def test_ids_name_the_rows_that_are_served(crane: CompiledScene, table: LayoutTable):
    """Whatever seeds and episodes the worlds have; a state alone has no id."""
    stored = StoredLayouts(crane, replace(table, split="eval"), 3, seed=5)
    stored.generate()
    stored.generate()
    assert stored.ids("train") == [crane.layout_id(table.seed[row], 0, "eval") for row in (6, 0, 1)]
    keys = np.array([2, 9], np.uint64), np.array([1, 0]), np.zeros((2, 0), np.float32)
    assert stored.ids("train", keys) == [crane.layout_id(table.seed[row], 0, "eval") for row in (3, 2)]
    bare = StoredLayouts(crane, replace(table, episode=np.full(NROW, -1, np.int32)), 3)
    bare.generate()
    with pytest.raises(ArgumentError, match="episode=-1"):
        bare.ids("train")


@pytest.mark.parametrize("value", [np.nan, np.inf, 2.0])
@pytest.mark.parametrize("column", ["qpos", "mocap_quat"])
def test_a_row_that_no_scene_can_be_in_is_refused(crane: CompiledScene, table: LayoutTable, column: str, value: float):
    """A number that is not finite, or a quaternion that is not of length one, by the row."""
    values = getattr(table, column).copy()
    values[3].flat[-1] = value
    with pytest.raises(SceneMismatchError, match="table: row 3 has"):
        StoredLayouts(crane, replace(table, **{column: values}), 2)


def test_rows_that_are_no_layouts_are_refused(crane: CompiledScene):
    """Rows that were never made, joints far beyond their limits, things far away, and keys that are no integers."""
    generator = LayoutGenerator(crane, 3)
    with pytest.raises(SceneMismatchError, match=r"row 0 has no layout yet\. Generate before you store the table"):
        StoredLayouts(crane, generator.table(), 2)
    generator.generate()
    made = generator.table()
    far = {"mocap_pos": np.full_like(made.mocap_pos, 1e30), "qpos": made.qpos + 50.0 * (np.arange(crane.mjm.nq) == 0)}
    wrong = [({name: values}, "row 0 has a non-finite or out-of-bounds value") for name, values in far.items()]
    for name in ("seed", "episode", "draw_seed", "draw_episode", "draw_stream", "present"):
        wrong.append(({name: getattr(made, name) + 0.5}, rf"\.{name} should have shape .*, integers"))
    for name in ("episode", "draw_episode", "draw_stream"):
        wrong.append(({name: np.full(3, -5, np.int32)}, rf"\.{name} should be from .* got -5 in row 0"))
    for columns, match in wrong:
        with pytest.raises(SceneMismatchError, match=match):
            StoredLayouts(crane, replace(made, **columns), 2)  # pyrefly: ignore[bad-argument-type]


def test_arguments_of_another_type_are_told_by_their_names(crane: CompiledScene, table: LayoutTable):
    """One after the other; they were AttributeErrors."""
    nothing: Any = None
    with pytest.raises(ArgumentTypeError, match=r"StoredLayouts: compiled should be a CompiledScene, got .*NoneType"):
        StoredLayouts(nothing, nothing, nothing)
    with pytest.raises(ArgumentTypeError, match=r"StoredLayouts: table should be a LayoutTable, got .*NoneType"):
        StoredLayouts(crane, nothing, nothing)
    with pytest.raises(ArgumentError, match="StoredLayouts: nworld should be an integer"):
        StoredLayouts(crane, table, nothing)


@pytest.mark.parametrize(
    ("words", "match"),
    [
        ({"params": ("nope",)}, "unknown param 'nope'"),
        ({"params": (REGION,)}, r"params should have shape \(7, 4\), got"),
        ({"params": 3}, "params should be one name or several names"),
        (
            {"params": ("objects.thing.reg*",), "param": BOX},
            rf"params should be .*'{REGION}',\).* got 'train' and \('objects",
        ),
        ({"params": (REGION,), "param": 9.0 * BOX}, rf"{REGION} should be"),
        ({"split": "test"}, "split should be 'train' or 'eval' .* got 'test' and"),
        ({"split": ["eval"]}, "split should be 'train' or 'eval'"),
    ],
)
def test_a_table_that_no_generator_makes_is_refused_by_all_that_take_one(
    crane: CompiledScene, table: LayoutTable, words: dict[str, Any], match: str
):
    """Params that the scene does not have, that have no columns or other numbers, and another split."""
    randomizer, wrong = _randomizer(crane), replace(table, **words)
    before = randomizer.data.qpos.numpy().copy()
    for take in (lambda: randomizer.write(wrong, range(NROW)), lambda: StoredLayouts(crane, wrong, 2)):
        with pytest.raises(ScenirisError, match=match):
            take()
    np.testing.assert_array_equal(randomizer.data.qpos.numpy(), before)
    fine = replace(table, params=(REGION,), param=BOX)
    randomizer.write(fine, range(NROW))
    StoredLayouts(crane, fine, 2)


class Wrapped(LayoutSource):
    """A source of somebody's own around another one."""

    def __init__(self, source: LayoutSource) -> None:
        self.source, self.layouts = source, source.layouts

    def launch_generate(self, mask: wp.array | None) -> None:
        """Serve its layouts."""
        self.source.launch_generate(mask)

    def served(self, split: str, keys: LayoutKeys) -> tuple[str, LayoutKeys]:
        """Serve its rows."""
        return self.source.served(split, keys)


def _levels(source: LayoutSource) -> LayoutPipeline:
    """The layouts of a source, as levels."""
    return LayoutPipeline(source, chooser=LevelSampler(LevelReplay(capacity=4), source.layouts))


@pytest.mark.parametrize("wrap", [lambda s: s, _levels, Wrapped])
def test_stored_layouts_keep_their_params_in_every_wrapper(crane: CompiledScene, table: LayoutTable, wrap: Any):
    """Other numbers are refused before anything is launched, and launches never raise."""
    source = wrap(StoredLayouts(crane, replace(table, params=(REGION,), param=BOX), 2))
    box = [[-0.1, -0.1], [0.1, 0.1]]
    for change in (
        lambda: source.set_params({REGION: box}),
        lambda: source.reseed(layouts={"seed": 5, "episode": 0, "params": {REGION: box}}),
    ):
        with pytest.raises(ArgumentError, match="stored"):
            change()
    assert (source.layouts.view.next_episode.numpy() == 0).all()
    assert source.layouts.view.next_seed.numpy().tolist() == [0, 1]
    with wp.ScopedDevice("cpu"):
        source.launch_set_params(wp.array([0], dtype=int), wp.array([[0.1]], dtype=float), None)
    source.generate()
    np.testing.assert_array_equal(source.layouts.param.numpy(), BOX[:2])
