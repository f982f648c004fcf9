"""Snapshots of an own loop: worlds continue with the same bits, in their own places or in others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.levels import ADR, LevelReplay
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.snapshot import Snapshot
from sceniris_gym.sim.variants import fields_of_variants

NWORLD = 4
REGION = "objects.apple.region"
WIDE, NARROW = [[-0.2, -0.3], [0.2, 0.3]], [[-0.1, -0.1], [0.1, 0.1]]
ANYWHERE = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]


def _scene(**words: Any) -> dict[str, Any]:
    """A table, an apple of drawn mass, and an object with variants."""
    apple = {"asset": "apple", "on": "table", "region": {"box": WIDE}, "randomize": {"mass": {"scale": [0.5, 2.0]}}}
    target = {"asset": ["can", "brick", "mug"], "on": "table", "gap": 0.003}
    table = {"asset": "table", "kind": "static"}
    return {"bank": 4, "objects": {"table": table, "apple": apple, "target": target}, **words}


@pytest.fixture(scope="module", params=ANYWHERE)
def anywhere(request: pytest.FixtureRequest) -> CompiledScene:
    """Return the CompiledScene on a CPU and on a GPU."""
    return compile_scene(SceneConfig.load(_scene()), request.param)


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene on a CPU."""
    return compile_scene(SceneConfig.load(_scene()), "cpu")


def _made(compiled: CompiledScene, nworld: int = NWORLD, **words: Any) -> ResetRandomizer:
    model, data = make_worlds(compiled, nworld)
    # pyrefly: ignore[bad-argument-type]
    return ResetRandomizer(compiled, model, data, **{"params": REGION, "prefetch": False, **words})


def _step(randomizer: ResetRandomizer, steps: int = 3) -> None:
    with wp.ScopedDevice(randomizer.device):  # steps allocate on the present device
        for _ in range(steps):
            mjw.step(randomizer.model, randomizer.data)


def _state(randomizer: ResetRandomizer) -> dict[str, np.ndarray]:
    """Return copies of state, layouts, variants, draws and redraws, a row for each world."""
    d, m, layouts = randomizer.data, randomizer.model, randomizer.layouts
    arrays = {name: getattr(d, name) for name in (*ResetRandomizer.STATE_FIELDS, "xpos")}
    arrays |= {name: getattr(m, name) for name in (*fields_of_variants(randomizer.compiled.scene), "body_subtreemass")}
    found = {name: array.numpy().copy() for name, array in arrays.items()}
    tensors = {name: getattr(randomizer, name) for name in ("variants", "redraw_count", "redraw_status")}
    # without the rows for restarts, of which a GPU has more
    tensors |= {f"layout {name}": getattr(layouts, name) for name in ("seed", "episode", "qpos", "present", "param")}
    return found | {name: tensor.cpu().numpy().copy() for name, tensor in tensors.items()}


def _assert_same(one: dict[str, np.ndarray], other: dict[str, np.ndarray], rows: Any = slice(None), to: Any = None):
    for name, values in one.items():
        found = other[name][rows if to is None else to]
        assert values[rows].tobytes() == found.tobytes(), name


def _loop(randomizer: ResetRandomizer) -> list[dict[str, np.ndarray]]:
    """Return the states of a loop with a redraw and with resets of some and of all worlds."""
    found = []
    for worlds in ([1, 3], None):
        _step(randomizer)
        found.append(_state(randomizer))
        randomizer.redraw("apple", [0, 1])
        _step(randomizer)
        found.append(_state(randomizer))
        randomizer.reset(worlds)
        found.append(_state(randomizer))
    return found


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("words", [{}, {"prefetch": True}, {"graph": False}, {"needs": ["contacts"]}], ids=str)
def test_a_loop_continues_with_the_same_bits(compiled: CompiledScene, words: dict[str, Any]):
    """Physics, variants, drawn masses, redraws, and the layouts that follow, with params that were set since."""
    randomizer = _made(compiled, seed=7, **words)
    randomizer.reset()
    randomizer.reset([2])
    randomizer.redraw("apple", [0])
    randomizer.set_param(REGION, NARROW, [1])
    _step(randomizer)
    kept = randomizer.snapshot()
    first = _loop(randomizer)
    randomizer.set_param(REGION, NARROW)
    randomizer.restore(kept)
    for one, other in zip(first, _loop(randomizer), strict=True):
        _assert_same(one, other)
    masses = first[-1]["body_subtreemass"][:, compiled.scene.sim.bodies["apple"]]
    assert len({*first[-1]["variants"].ravel()}) > 1
    assert len({*masses}) == NWORLD
    assert first[1]["redraw_count"].tolist() == [2, 1, 0, 0]


@pytest.mark.parametrize("prefetch", [False, True])
def test_another_randomizer_continues_from_a_snapshot(compiled: CompiledScene, prefetch: bool):
    """Also as its first call, with layouts prefetched for other seeds. Later steps do not change the snapshot."""
    first, second = _made(compiled, seed=7), _made(compiled, seed=90, prefetch=prefetch)
    first.reset()
    _step(first)
    kept = first.snapshot()
    assert "tensor" not in repr(kept)
    wanted = _loop(first)
    second.restore(kept)
    for one, other in zip(wanted, _loop(second), strict=True):
        _assert_same(one, other)


@pytest.mark.cuda
@pytest.mark.parametrize(("source", "target"), [("cpu", "cuda:0"), ("cuda:0", "cpu")])
def test_a_snapshot_of_one_device_is_restored_on_another(source: str, target: str):
    """State, variants, drawn masses and redraws have the same bits, and so have the layouts that follow."""
    first, second = (
        _made(compile_scene(SceneConfig.load(_scene()), device), seed=seed, prefetch=None)
        for device, seed in ((source, 7), (target, 90))
    )
    for randomizer in (first, second):
        randomizer.reset()
    first.redraw("apple", [0])
    first.pipeline.set_params({REGION: NARROW}, [1])
    _step(first)
    kept, wanted = first.snapshot(), _state(first)
    assert {str(rows.device) for rows in (kept.worlds, *kept.rows.values())} == {source}
    wanted.pop("xpos")  # each device rounds world poses
    second.restore(kept[[2, 0]], [1, 3])
    _assert_same(wanted, _state(second), [2, 0], [1, 3])
    second.restore(kept)
    _assert_same(wanted, _state(second))
    for randomizer in (first, second):
        randomizer.reset()
    names = ("layout seed", "layout episode", "layout qpos", "layout present", "layout param", "variants")
    one, other = _state(first), _state(second)
    _assert_same({name: one[name] for name in names}, other)


@pytest.mark.parametrize("kind", ["ids", "booleans", "a slice"])
def test_rows_go_to_the_chosen_worlds_in_order(anywhere: CompiledScene, kind: str):
    """Ids keep their order, and the other worlds keep their bits."""
    randomizer = _made(anywhere, seed=3)
    randomizer.reset()
    _step(randomizer)
    kept, before = randomizer.snapshot([3, 0]), _state(randomizer)
    assert kept.worlds.tolist() == [3, 0]
    randomizer.reset()
    randomizer.redraw("apple")
    _step(randomizer)
    others = _state(randomizer)
    worlds: dict[str, tuple[Any, list[int]]] = {
        "ids": (torch.tensor([2, 1]), [2, 1]),
        "booleans": (np.array([False, True, True, False]), [1, 2]),
        "a slice": (slice(1, 3), [1, 2]),
    }
    chosen, to = worlds[kind]
    randomizer.restore(kept, chosen)
    after = _state(randomizer)
    for state in (before, others, after):
        state.pop("xpos")  # bare steps leave it behind
    _assert_same(before, after, [3, 0], to)
    _assert_same(others, after, [0, 3])
    randomizer.restore(kept)
    after = _state(randomizer)
    after.pop("xpos")
    _assert_same(before, after, [0, 3])
    randomizer.restore(randomizer.snapshot([]), [])
    _assert_same(after, _state(randomizer))


def test_a_world_that_broke_continues_from_its_snapshot(anywhere: CompiledScene):
    """With NaNs in its state and in what the solver reads; it lists no contacts until its next step."""
    randomizer = _made(anywhere, seed=3)
    randomizer.reset()
    _step(randomizer)
    kept, d = randomizer.snapshot(), randomizer.data
    _step(randomizer)
    wanted = _state(randomizer)
    for array in (d.qpos, d.qvel, d.qacc, d.qacc_warmstart, d.efc.J, d.efc.D):
        wp.to_torch(array)[1] = float("nan")
    _step(randomizer, 1)
    wp.to_torch(d.efc.J)[1] = float("nan")
    randomizer.restore(kept)
    assert d.nacon.numpy()[0] == 0
    _step(randomizer)
    if str(randomizer.device) == "cpu":
        _assert_same(wanted, _state(randomizer))
    assert np.isfinite(d.qpos.numpy()).all()


def test_stored_layouts_that_were_written_come_back(compiled: CompiledScene):
    """Their variants differ from those of the layouts that the generator made last."""
    table, randomizer = make_table(compiled, 8, seed=50), _made(compiled, seed=3, params=())
    randomizer.reset()
    randomizer.write(table, [5, 6, 7, 4])
    _step(randomizer)
    kept, before = randomizer.snapshot(), _state(randomizer)
    drawn = randomizer.layouts.view.present.numpy()
    assert (table.present[[5, 6, 7, 4]] != drawn).any()
    _step(randomizer)
    after = _state(randomizer)
    randomizer.write(table, [1, 2, 3, 0])
    randomizer.restore(kept)
    assert randomizer.variants.tolist() == before["variants"].tolist()
    _step(randomizer)
    _assert_same(after, _state(randomizer))


def test_fields_that_were_written_come_back(compiled: CompiledScene):
    """Of a model with a row for each world, with all that follows from them."""
    model, data = make_worlds(compiled, NWORLD, fields=("body_mass", "geom_friction"))
    randomizer = ResetRandomizer(compiled, model, data)
    friction = randomizer.model_field("geom_friction", "apple")
    randomizer.reset()
    randomizer.scale_field("body_mass", "target", np.arange(1, 5, dtype=np.float32))
    friction.mul_(0.5)
    randomizer.refresh()
    kept, names = randomizer.snapshot(), ("body_mass", "body_inertia", "body_invweight0", "geom_friction")
    before = {name: getattr(model, name).numpy().copy() for name in names}
    randomizer.reset()
    randomizer.restore(kept, [1, 2, 3, 0])
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(model, name).numpy()[[1, 2, 3, 0]], values, err_msg=name)


def _play(randomizer: ResetRandomizer, episodes: int) -> list[list[int]]:
    """Return seeds, episodes and levels of layouts that were played, each episode won by worlds of an even seed."""
    levels, found = randomizer.levels, []
    assert levels is not None
    ended = wp.array(np.ones(NWORLD, bool), dtype=wp.bool, device=randomizer.device)
    for _ in range(episodes):
        layouts = randomizer.layouts
        found += [layouts.seed.tolist(), layouts.episode.tolist(), levels.level.tolist(), levels.boundary.tolist()]
        won = (layouts.seed + layouts.episode) % 2 == 0
        randomizer.pipeline.launch_finish(wp.from_torch(won.float()), ended)
        randomizer.reset()
    return found


@pytest.mark.parametrize("prefetch", [False, True])
def test_a_curriculum_continues_with_the_levels_of_the_snapshot(compiled: CompiledScene, prefetch: bool):
    """The episodes that follow, too, once the sampler was restored."""
    words = LevelReplay(
        replay_prob=0.5, refresh_interval=1, capacity=64, adr=ADR({REGION: NARROW}, boundary_fraction=0.5)
    )
    randomizer = _made(compiled, seed=1, curriculum=words, prefetch=prefetch)
    randomizer.reset()
    _play(randomizer, 8)
    assert randomizer.levels is not None
    kept, levels, runs = randomizer.snapshot(), randomizer.levels.state(), []
    assert {name for name in kept.rows if name.startswith("chooser")} == {"chooser.level", "chooser.boundary"}
    for _ in range(2):
        randomizer.levels.restore(levels)
        randomizer.restore(kept)
        runs.append(_play(randomizer, 6))
    assert runs[0] == runs[1]
    assert max(max(row) for row in runs[0][2::4]) >= 0
    plain = _made(compiled)
    plain.reset()
    with pytest.raises(SceneMismatchError, match=r"have the scene, split and params of .*, got rows of other names"):
        plain.restore(kept)


def _with(kept: Snapshot, name: str, value: float) -> Snapshot:
    rows = kept.rows[name].clone()
    rows[1] = value
    return replace(kept, rows={**kept.rows, name: rows})


def test_wrong_snapshots_are_refused_by_the_name_of_the_method(compiled: CompiledScene):
    """Of another scene, split, type, params or curriculum, with other numbers of rows, or NaN; nothing changes."""
    randomizer = _made(compiled, seed=3)
    randomizer.reset()
    _step(randomizer)
    kept, before = randomizer.snapshot(), _state(randomizer)
    other = compile_scene(_scene(attempts=11), "cpu")
    beyond = torch.tensor([0, 9, 2, 3])
    foreign = [_made(other), _made(compiled, split="eval"), _made(compiled, params=())]
    for each in foreign:
        each.reset()
    wrong: list[tuple[str, tuple[Any, ...]]] = [
        ("should be a Snapshot, got <class 'dict'>", ({},)),
        *(("should have the scene, split and params of the worlds", (each.snapshot(),)) for each in foreign),
        ("should have 2 rows, one per chosen world, got 4", (kept, [0, 1])),
        (r"should go into different worlds with ids below 4, got \[2, 2\]", (kept[[0, 1]], [2, 2])),
        (r"should go into different worlds with ids below 4, got \[0, 0\]", (kept[[0, 0]],)),
        (r"should go into different worlds with ids below 4, got \[0, 9, 2, 3\]", (replace(kept, worlds=beyond),)),
        ("should have finite numbers, got NaN or inf", (_with(kept, "data.qpos", np.nan),)),
        ("should have finite numbers, got NaN or inf", (_with(kept, "model.body_mass", np.nan),)),
        (r"variant should be from \[0\] to \[2\], got 9 in row 1", (_with(kept, "variant", 9),)),
        (r"episode should be from -1 to 2147483646, got -5 in row 1", (_with(kept, "layout.episode", -5),)),
        ("present: each row should have exactly one variant of 'target'", (_with(kept, "layout.present", 1),)),
    ]
    for text, given in wrong:
        with pytest.raises((ArgumentError, ArgumentTypeError, SceneMismatchError), match=text) as error:
            randomizer.restore(*given)
        assert str(error.value).startswith("ResetRandomizer.restore: snapshot")
    with pytest.raises(ArgumentError, match=r"worlds\[1\] should be from 0 to 3, got 7"):
        randomizer.restore(kept[[0, 1]], [0, 7])
    with pytest.raises(ArgumentError, match=r"worlds\[0\] should be from 0 to 3, got 4"):
        randomizer.snapshot([4])
    _assert_same(before, _state(randomizer))


def test_an_arm_keeps_its_controls_and_activations(make_randomizer: Callable[..., ResetRandomizer]):
    """Over a gear and a tendon, with stored layouts that follow."""
    randomizer = make_randomizer(3, seed=2)
    randomizer.reset()
    _step(randomizer)
    kept, runs = randomizer.snapshot(), []
    for _ in range(2):
        runs.append([])
        for worlds in ([0, 2], None):
            _step(randomizer)
            arrays = [getattr(randomizer.data, name).numpy().tobytes() for name in ResetRandomizer.STATE_FIELDS]
            runs[-1] += [*arrays, randomizer.layouts.seed.tolist(), randomizer.layouts.qpos.tolist()]
            randomizer.reset(worlds)
        randomizer.restore(kept)
    assert runs[0] == runs[1]
