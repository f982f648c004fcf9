"""The size of a search decides how much is tried at once, and never what comes out."""

import ctypes
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.collide.boxes import collides_without_stack
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus, LayoutsView
from sceniris_gym.layout.reaching.search import ReachSearch
from sceniris_gym.layout.wave.ahead import count_ahead
from sceniris_gym.layout.wave.search import MANY_ROWS, Search, SearchSize, create_search, default_size
from sceniris_gym.layout.wave.sides import Regions, create_regions
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause, Program, copied
from sceniris_gym.program.device_reach import Reach
from tests.layout.grasped import cluttered
from tests.layout.scenes import FLOOR, box_mjcf
from tests.layout.sizes import made, sizes

N = 100
SIZES = sizes("cpu")


def _compile(words: dict[str, Any] | str, device: str, **others: Any) -> CompiledScene:
    return compile_scene(SceneConfig.load(words, others), device)


def _groups(folder: Path, device: str) -> CompiledScene:
    """Up to four crates of five on a small floor, one of them beside another, with restarts."""
    crate = {"asset": box_mjcf(folder, "crate", 0.1, 0.08, 0.05), "on": "floor"}
    objects: dict[str, Any] = {f"crate_{i}": crate for i in range(5)}
    objects["crate_3"] = {**crate, "relations": [{"right_of": "crate_1", "distance": {"max": 0.25}}]}
    groups = {"some": {"of": list(objects), "count": [1, 4], "missing": "drop"}}
    words = {"floor": {"size": [0.35, 0.35]}, "objects": objects, "groups": groups, "attempts": 3, "restarts": 30}
    return _compile(words, device, bank=8)


def _tray(folder: Path, device: str) -> CompiledScene:
    """A tray so full that most worlds run out of restarts."""
    crate = box_mjcf(folder, "crate", 0.1, 0.1, 0.05)
    objects = {f"crate_{i}": {"asset": crate, "on": "floor", "orientation": "fixed"} for i in range(3)}
    words = {"floor": {"size": [0.4, 0.4]}, "attempts": 1, "restarts": 2, "objects": objects}
    return _compile(words, device, bank=16)


SCENES: dict[str, Callable[[Path, str], CompiledScene]] = {
    "clutter": lambda _, device: _compile("clutter", device),
    "hard_plus": lambda _, device: _compile("hard_plus", device),
    "kitchen": lambda _, device: _compile("kitchen", device),
    "mid as seen": lambda _, device: _compile("mid", device, geometry="visual"),
    "tabletop_lift": lambda _, device: _compile("tabletop_lift", device),
    "clear": lambda folder, device: cluttered(folder, "clear", device),
    "groups": _groups,
    "tray": _tray,
}
RESTARTING = {"clutter", "hard_plus", "tabletop_lift", "clear", "groups", "tray"}


@pytest.fixture(scope="module", params=SCENES)
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """Scenes with many restarts, relations, groups, faces, an arm's reach, and one that falls back."""
    return SCENES[request.param](tmp_path_factory.mktemp("scene"), "cpu")


@pytest.fixture(scope="module")
def expected(compiled: CompiledScene) -> list[bytes]:
    """The result of one trial of one restart at a time."""
    return made(compiled, None, N)


def test_the_scenes_are_as_hard_as_they_should_be(compiled: CompiledScene, request: pytest.FixtureRequest):
    """Many worlds of some start anew, and many of one fall back."""
    name = request.node.callspec.params["compiled"]
    generator = LayoutGenerator(compiled, N, seed=21)
    generator.generate()
    fresh = generator.layouts.status.cpu().numpy() == LayoutStatus.VALID
    assert (fresh.mean() < 0.9) == (name == "tray")
    assert fresh.mean() > 0.2
    assert (generator.layouts.first_pass_valid.cpu().numpy().mean() < 0.95) == (name in RESTARTING)


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("size", SIZES)
def test_the_size_changes_no_bit(size: str, compiled: CompiledScene, expected: list[bytes]):
    """Layouts, attempts, status, grasps and counts of three episodes, one of them of every third world.

    Searches of three candidates are recorded, since their many waves take six times as long as direct launches.
    """
    assert made(compiled, SIZES[size], N, graph=SIZES[size].candidates == 3) == expected


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("size", [None, "7-3-100-1", "4096-4096-100-3"])
def test_a_captured_graph_changes_no_bit(size: str | None, compiled: CompiledScene, expected: list[bytes]):
    """Replayed for each episode with another mask."""
    assert made(compiled, SIZES[size] if size else None, N, graph=True) == expected


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("rarely", [False, True])
def test_waves_without_regions_need_no_launch_for_them(
    rarely: bool, compiled: CompiledScene, expected: list[bytes], monkeypatch: pytest.MonkeyPatch
):
    """The launches for regions take place in all waves, or only in waves that have a region to cut."""
    create = LayoutGenerator.__init__

    def created(generator: LayoutGenerator, *given: Any, **words: Any) -> None:
        create(generator, *given, **words)
        generator._cuts_rarely = rarely and compiled.related

    monkeypatch.setattr(LayoutGenerator, "__init__", created)
    for graph in (False, True):
        assert made(compiled, SIZES["64-512-100-3"], N, graph=graph) == expected


@pytest.mark.parametrize("pairs", [0, 1, 5, 1 << 14])
def test_the_room_for_narrow_pairs_changes_no_bit(pairs: int, compiled: CompiledScene, expected: list[bytes]):
    """Leaves that wait for lanes of their own, here a single one; a candidate without room for all is tested whole."""
    for size in ("1-64-5-3", "64-512-100-3"):
        assert made(compiled, replace(SIZES[size], narrow_pairs=pairs, block_dim=2), N) == expected


@pytest.mark.usefixtures("recorded")
def test_objects_drawn_ahead_that_fail_change_no_bit(compiled: CompiledScene, expected: list[bytes]):
    """All that may be are drawn ahead, though most have candidates that fail, and some are absent."""
    program = copied(Program, compiled.program)
    program.obj_effort = wp.ones_like(program.obj_effort)
    hopeful = replace(compiled, program=program)
    for size in ("7-3-100-1", "64-512-100-3", "4096-64-0-3"):
        assert count_ahead(hopeful, SIZES[size]) > 0
        assert made(hopeful, SIZES[size], N, graph=SIZES[size].candidates == 3) == expected


def test_splits_differ_and_keep_their_bits(compiled: CompiledScene, expected: list[bytes]):
    """Those of an evaluation too."""
    others = made(compiled, None, N, split="eval")
    assert others != expected
    assert made(compiled, SIZES["64-512-100-3"], N, split="eval") == others


def test_a_record_of_candidates_is_that_of_one_restart_at_a_time(compiled: CompiledScene):
    """Whatever was drawn at once: what collided is recorded, and what later restarts drew in vain is not."""
    found = []
    for size in (None, SIZES["64-512-100-3"]):
        generator = LayoutGenerator._recording(compiled, N, seed=21, size=size, rejected=50_000)
        generator.generate()
        view = generator.layouts.view
        count = int(view.rejected_count.numpy()[0])
        assert count <= 50_000
        states = np.concatenate([view.rejected_object.numpy()[:count, None], view.rejected_qpos.numpy()[:count]], 1)
        found.append(states[np.lexsort(states.T)])
    assert (found[0] == found[1]).all()


def test_candidates_of_many_relations_fit_in_memory(tmp_path: Path):
    """The half-planes of all candidates are bounded: beyond that, fewer candidates are drawn at once."""
    compiled = _groups(tmp_path, "cpu")
    assert compiled.related
    search = create_search(compiled, 4, replace(default_size("cpu"), candidates=1 << 24))
    regions: Any = create_regions(compiled, search.cause.shape[0])
    arrays = (regions.sides, regions.piece, regions.piece_area)
    assert sum(a.capacity for a in arrays) <= 1 << 29
    assert 0 < search.cause.shape[0] < 1 << 24


def test_only_scenes_with_relations_have_regions(compiled: CompiledScene):
    """Generators of all others allocate none."""
    assert (LayoutGenerator(compiled, 2)._regions.cut is not None) == compiled.related


def test_the_counts_of_a_search_are_back_at_zero_after_it(compiled: CompiledScene):
    """Nothing is pending or waiting, and no row is left in a queue."""
    generator = LayoutGenerator(compiled, N, size=SIZES["64-64-100-1"])
    generator.generate()
    search = generator._work.search
    assert not search.pending.numpy().any()
    assert not search.waiting.numpy().any()
    assert search.worlds_left.numpy()[0] == search.rows_left.numpy()[0] == 0


def _comb(folder: Path, name: str) -> str:
    """1,024 pegs on a grid of 2 cm, each a geom of one body: nearly all boxes of two such trees overlap."""
    pegs = [(0.02 * (i % 32) - 0.31, 0.02 * (i // 32) - 0.31) for i in range(1024)]
    geoms = "".join(f'<geom type="box" size=".002 .002 .1" pos="{x} {y} .1"/>' for x, y in pegs)
    path = folder / f"{name}.xml"
    path.write_text(f'<mujoco><worldbody><body name="{name}">{geoms}</body></worldbody></mujoco>')
    return str(path)


def _combs(folder: Path, device: str, geometry: str) -> CompiledScene:
    """Two combs, one somewhere within the other: more pairs of boxes at once than a block's stack has room for."""
    near = {"box": [[-0.011, -0.011, 0.0], [0.011, 0.011, 0.02]]}
    objects = {
        "fixed": {"asset": _comb(folder, "fixed"), "kind": "static"},
        "free": {"asset": _comb(folder, "loose"), "region": near, "orientation": "fixed", "clearance": 0.001},
    }
    words = {"geometry": geometry, "attempts": 4, "restarts": 0, "objects": objects}
    return _compile(words, device, bank=4)


@pytest.fixture(scope="module", params=["physics", "visual"])
def combs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """Two combs, by their collision shapes and as they look."""
    return _combs(tmp_path_factory.mktemp("combs"), "cpu", request.param)


def test_combs_within_each_other_keep_their_distance(combs: CompiledScene):
    """Pegs of 4 mm on a grid of 20 mm and 1 mm between them: the offset in x or in y is at least 5 mm."""
    generator = LayoutGenerator(combs, 50)
    generator.generate()
    fresh = generator.layouts.status.cpu().numpy() == LayoutStatus.VALID
    offset = np.abs(generator.layouts.qpos.cpu().numpy()[fresh, :2])
    apart = np.minimum(offset, 0.02 - offset).max(axis=1)
    assert 10 < fresh.sum() <= 50
    assert 0.005 - 1e-6 <= apart.min() < 0.006
    assert generator.rejection_counts()["free"]["collision"] > 4


def test_an_object_of_great_effort_does_not_overflow_the_count_of_candidates():
    """Rows that ask for 6.5 billion trials together get as many as there is room for, and the same layouts."""
    compiled = _compile("mid", "cpu")
    program = copied(Program, compiled.program)
    program.obj_effort = wp.full_like(program.obj_effort, 1e5)
    program.attempts = 1 << 24
    hard = replace(compiled, program=program)
    size = replace(SIZES["64-512-100-3"], busy=1 << 16)
    assert made(hard, size, N) == made(hard, None, N)


CUDA = [pytest.param("cuda:0", marks=pytest.mark.cuda)]


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("device", CUDA)
@pytest.mark.parametrize("name", SCENES)
def test_the_size_changes_no_bit_on_a_gpu(name: str, device: str, tmp_path: Path):
    """With a block for each candidate, room for all narrow-phase pairs, few or none, and in a captured graph."""
    compiled = SCENES[name](tmp_path, device)
    expected = made(compiled, None, N)
    for size in sizes(device, blocks=64, block_dim=32).values():
        assert made(compiled, size, N) == expected
    for pairs in (0, 5):
        assert made(compiled, replace(default_size(device), narrow_pairs=pairs), N) == expected
    for lanes in (1, 64):
        assert made(compiled, replace(default_size(device), block_dim=lanes), N) == expected
    assert made(compiled, None, N, graph=True) == expected


@pytest.mark.parametrize("device", CUDA)
@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_full_stack_changes_no_bit_on_a_gpu(geometry: str, device: str, tmp_path: Path):
    """A candidate whose test overflows a block's stack is tested by a single lane, which needs no shared stack."""
    compiled = _combs(tmp_path, device, geometry)
    alone = made(compiled, replace(default_size(device), block_dim=1), 64)
    assert made(compiled, None, 64) == alone
    assert made(compiled, replace(default_size(device), narrow_pairs=0), 64) == alone


def test_the_worst_case_of_waves_is_enough(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Without conditional graphs everything is launched as often as the worst case needs: the same bits."""
    compiled = _combs(tmp_path, "cpu", "physics")
    size = replace(default_size("cpu"), candidates=3, rows=2)
    expected = made(compiled, size, 8)

    def most_often(left: wp.array, launches: Callable[[], None], most: int) -> None:
        for _ in range(most):
            launches()
        assert left.numpy()[0] == 0

    monkeypatch.setattr("sceniris_gym.layout.generate.repeat_launches", most_often)
    assert made(compiled, size, 8) == expected


@wp.kernel(enable_backward=False)
def _test_all(program: Program, layouts: LayoutsView, search: Search, hit: wp.array[bool]):
    c = wp.tid()
    row = search.row[c]
    obj = search.obj[c]
    hit[c] = collides_without_stack(
        program,
        program.obj_broadadr[obj],
        program.obj_broadnum[obj],
        0,
        search.body_pos[c],
        search.body_quat[c],
        layouts.body_pos[row],
        layouts.body_quat[row],
    )


def test_a_lane_by_itself_finds_the_same_collisions(combs: CompiledScene, monkeypatch: pytest.MonkeyPatch):
    """All candidates of a wave again, as where the stacks of a block have no room."""
    # no peg encloses another, and asking it of a million pairs for each candidate takes 19 s
    monkeypatch.setattr("sceniris_gym.layout.wave.collision.launch_test_containment", lambda _: None)
    generator = LayoutGenerator(combs, 100, size=replace(default_size("cpu"), candidates=400, busy=400))
    generator.generate()
    search = generator._work.search
    wave = search.queue.numpy()[search.source.numpy()[0], : search.rows.numpy()[0]]
    num = int(search.row_trials.numpy()[wave].sum())
    hit = wp.zeros(num, dtype=bool, device="cpu")
    inputs = [combs.program, generator.layouts.view, search, hit]
    wp.launch(_test_all, dim=num, inputs=inputs, device="cpu")
    causes = search.cause.numpy()[:num]
    assert ((causes == Cause.COLLISION) == hit.numpy()).all()
    assert 0 < hit.numpy().sum() < num


def test_waves_of_many_rows_and_their_lanes_change_no_bit():
    """Lanes and blocks that only waves of many rows have, in the first round of a large batch."""
    compiled = _compile("mid", "cpu")
    nworld = int(MANY_ROWS) + 100
    expected = made(compiled, None, nworld)
    size = replace(default_size("cpu"), busy=4096, candidates=1 << 16, lanes=1 << 17, blocks=1 << 14)
    for graph in (False, True):
        assert made(compiled, size, nworld, graph=graph) == expected


def test_floors_without_objects_need_no_candidates():
    """Nothing is to be placed: every world has a layout at once."""
    generator = LayoutGenerator(_compile({"floor": FLOOR}, "cpu"), 5, size=SIZES["64-3-5-3"])
    generator.generate()
    assert (generator.layouts.status.cpu().numpy() == LayoutStatus.VALID).all()
    assert (generator.layouts.attempts.cpu().numpy() == 0).all()


@pytest.mark.parametrize("name", [field.name for field in fields(SearchSize)])
def test_a_size_that_would_never_end_is_refused(name: str):
    """By its name; the least one is accepted: 0 for what is only room for more at once."""
    least = 0 if name in ("rows", "narrow_pairs") else 1
    replace(default_size("cpu"), **{name: least})
    with pytest.raises(ArgumentError, match=f"{name} should be at least {least}, got {least - 1}"):
        replace(default_size("cpu"), **{name: least - 1})


@pytest.mark.parametrize("struct", [Program, Reach, Search, Regions, ReachSearch, LayoutsView])
def test_structs_are_small_enough_to_stay_where_kernels_get_them(struct: Any):
    """A larger one is copied into a lane's local memory wherever it is handed on: stack frames of 98 KB were seen."""
    assert ctypes.sizeof(struct.ctype) <= 8192
