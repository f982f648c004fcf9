"""Starts: what is held stays in the hand, touches nothing else, and does not depend on the search's size."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.reaching.search import IN_HAND
from sceniris_gym.layout.reaching.start import TRIALS, launch_queue_starts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.device import Program, copied
from tests.layout.crane import HEIGHT, crane_mjcf, crane_scene
from tests.layout.scenes import bank_rows, box_mjcf
from tests.layout.starting import (
    HANDLE,
    HELD,
    HOME,
    LIFT,
    LIFTED,
    PLACED,
    PREGRASP,
    SCENE,
    STANDING,
    reset_worlds,
    starting,
    stepped,
)


def test_what_is_held_stays_in_the_hand():
    """MuJoCo C, half a second without an action: no thing moves by 2 mm in the hand, or touches anything else."""
    data, layouts = reset_worlds(starting(), 64)
    found = stepped(starting(), data, layouts)
    assert {held.kind for held in found} == {STANDING, LIFTED, HELD, HANDLE}
    assert max(held.drift for held in found) < 2e-3
    assert min(held.fingers for held in found) == 2
    assert sum(held.others for held in found) == 0


def test_any_variant_of_a_target_is_held():
    """Whichever is there, in the model that has all of them."""
    target = {"variants": {name: {"asset": name} for name in ("can", "lemon")}, "on": "floor", "reachable": "map"}
    objects = {"target": {**target, "region": {"box": [[0.0, -0.2], [0.3, 0.1]]}}}
    kinds = [{"robot": "grasp", "of": "target"}, {"robot": "grasp", "of": "target", "lift": LIFT}]
    compiled = compile_scene({**SCENE, "objects": objects, "start": kinds}, "cpu")
    found = stepped(compiled, *reset_worlds(compiled, 24))
    assert {held.kind for held in found} == {0, 1}
    assert max(held.drift for held in found) < 2e-3
    assert sum(held.others for held in found) == 0


def test_the_arm_is_where_its_kind_says():
    """At home within the noise, at the joints of the pre-grasp, or of the grasp. Only these starts ask for joints."""
    generator = LayoutGenerator(starting(), 128, seed=5)
    rounds = []
    for _ in range(3):  # so that arms have been away in the rows before
        generator.generate()
        rounds.append(_rows(generator))
    compiled = starting()
    assert compiled.reaching is not None
    one = compiled.reaching.arms[0]
    block, cabinet = compiled.reaching.names.index("block"), compiled.reaching.names.index("cabinet")
    free = int(compiled.mjm.joint("block/free").qposadr[0])
    for rows in rounds:
        arm, kind = rows["qpos"][:, one.arm.qposadr], rows["start"]
        home = compiled.home_qpos[one.arm.qposadr]
        assert np.abs(arm[kind == HOME] - home).max() <= 0.02 + 1e-6
        asked = np.isin(kind, (PREGRASP, STANDING, LIFTED, HELD))
        assert (np.isnan(rows["grasp_qpos"][:, block, 0]) == ~asked).all()
        assert (np.isnan(rows["pregrasp_qpos"][:, block, 0]) == ~np.isin(kind, (PREGRASP, STANDING))).all()
        np.testing.assert_array_equal(arm[kind == PREGRASP], rows["pregrasp_qpos"][kind == PREGRASP, block, :7])
        np.testing.assert_allclose(arm[kind == HANDLE], rows["grasp_qpos"][kind == HANDLE, cabinet, :7], atol=5e-3)
        for held in (LIFTED, HELD):
            np.testing.assert_array_equal(arm[kind == held], rows["grasp_qpos"][kind == held, block, :7])
        height = rows["qpos"][:, free + 2]
        assert np.ptp(height[kind == HOME]) < 1e-6
        lift = height[kind == LIFTED] - height[kind == HOME].max()
        assert ((lift > LIFT[0] - 1e-3) & (lift < LIFT[1] + 1e-3)).all()
        names = [compiled.reaching.targets[cabinet].grasp_set.grasps[g].name for g in rows["grasp"][:, cabinet]]
        assert all("upper_handle" in name for name, k in zip(names, kind, strict=True) if k == HANDLE)


def test_worlds_that_start_at_home_are_not_queued():
    """All other worlds are, once each, at the target of their kind; those that try heights or joints are held."""
    generator, compiled = LayoutGenerator(starting(), 40, seed=1), starting()
    generator.generate()
    work, stage = generator._work, generator._stage
    assert stage is not None
    assert compiled.reaching is not None
    work.search.pending.fill_(True)
    wp.copy(work.search.restart, work.search.best)  # as at the end of the round that made them
    launch_queue_starts(work, work.reaches[0], stage.search)
    search, kinds = stage.search, generator.layouts.start.cpu().numpy()
    num = int(search.rows_left.numpy()[0])
    queued = search.queue.numpy()[1 - int(search.source.numpy()[0]), :num]
    np.testing.assert_array_equal(np.sort(queued), np.flatnonzero(~np.isin(kinds, (HOME, PLACED))))
    names = [compiled.reaching.names[column] for column in search.column.numpy()[queued]]
    assert names == ["cabinet" if kind == HANDLE else "block" for kind in kinds[queued]]
    air = np.isin(kinds[queued], (LIFTED, HELD))
    np.testing.assert_array_equal(search.total.numpy()[queued], np.where(air, TRIALS, 1))
    tiers = search.tier.numpy()[queued, search.column.numpy()[queued]]
    np.testing.assert_array_equal(tiers, np.where(air, IN_HAND, Tier.CLEAR))


@pytest.mark.parametrize("change", [{"rows": 40}, {"grasps": 7}, {"candidates": 5, "busy": 5}], ids=str)
def test_starts_do_not_depend_on_the_size_of_the_search(change: dict[str, int]):
    """More restarts or more trials at once give the same bits."""
    usual = LayoutGenerator(starting(), 24, seed=9)
    other = LayoutGenerator(starting(), 24, seed=9, size=replace(default_size("cpu"), **change))
    for generator in (usual, other):
        generator.generate()
        generator.generate(np.arange(24) % 3 == 0)
    for name, values in _rows(usual).items():
        np.testing.assert_array_equal(values, _rows(other)[name])


def test_starts_do_not_depend_on_those_before():
    """Arms that were elsewhere begin again at home: the same bits as in a generator that begins with this episode."""
    usual, other = (LayoutGenerator(starting(), 24, seed=9) for _ in range(2))
    usual.generate()
    usual.generate()
    other.reseed(layouts={"seed": np.arange(9, 9 + 24), "episode": 1})
    other.generate()
    for name, values in _rows(usual).items():
        np.testing.assert_array_equal(values, _rows(other)[name])


def test_worlds_without_restarts_get_the_kind_of_their_bank():
    """A fallback has the state of an entry of the bank, and its kind: that of the world, if the bank has one."""
    program = copied(Program, starting().program)
    program.restarts, program.attempts = 0, 1
    compiled = replace(starting(), program=program)
    generator = LayoutGenerator(compiled, 1000, seed=2)
    generator.generate()
    rows, bank = _rows(generator), bank_rows(compiled, "train")
    fell = np.flatnonzero(rows["status"] == LayoutStatus.FALLBACK)
    assert len(fell) > 5
    assert compiled.starts is not None
    states, kinds = compiled.bank.qpos.numpy()[bank], compiled.bank.start.numpy()[bank]
    for i in fell:
        (entry,) = np.flatnonzero((states == rows["qpos"][i]).all(axis=1))
        assert kinds[entry] == rows["start"][i]
    usual = LayoutGenerator(starting(), 1000, seed=2)
    usual.generate()
    drawn = usual.layouts.start.cpu().numpy()[fell]
    known = np.isin(drawn, kinds)
    assert known.any()
    np.testing.assert_array_equal(rows["start"][fell][known], drawn[known])


def test_a_kind_of_start_that_is_never_made_is_refused():
    """By its number and the cause, as all its episodes would begin as another kind from the bank."""
    start = [{"weight": 2}, {"robot": "grasp", "of": "block", "lift": [2.0, 3.0]}]
    with pytest.raises(InfeasibleSceneError, match=r": start\.1: no valid layout .*'block' .* because of blocked"):
        compile_scene({**SCENE, "start": start}, "cpu", cache=False)


def test_objects_are_redrawn_beside_an_arm_that_holds_something():
    """A redraw begins no episode, so the arm and what it holds stay where they are."""
    generator = LayoutGenerator(starting(), 40, seed=6)
    generator.generate()
    before = _rows(generator)
    extended = generator.redraw(generator.layouts, ["apple"])
    adr = starting().mjm.joint("apple/free").qposadr[0]
    after, kept = extended.qpos.numpy(), np.ones(before["qpos"].shape[1], bool)
    kept[adr : adr + 7] = False
    np.testing.assert_array_equal(after[:, kept], before["qpos"][:, kept])
    assert (after[:, adr] != before["qpos"][:, adr]).mean() > 0.9
    np.testing.assert_array_equal(extended.start.numpy(), before["start"])


@pytest.mark.cuda
def test_what_is_held_stays_in_the_hand_on_a_gpu():
    """Layouts of a GPU, stepped by MuJoCo C; a CPU, a graph and other sizes of the search give the same bits."""
    compiled = compile_scene(SCENE, "cuda:0")
    data, layouts = reset_worlds(compiled, 256)
    found = stepped(compiled, data, layouts)
    assert {held.kind for held in found} == {STANDING, LIFTED, HELD, HANDLE}
    assert max(held.drift for held in found) < 2e-3
    assert sum(held.others for held in found) == 0
    generator = LayoutGenerator(compiled, 256, size=replace(default_size("cuda:0"), rows=64, grasps=300, busy=500))
    generator.generate()
    on_cpu = LayoutGenerator(starting(), 256)
    on_cpu.generate()
    assert (layouts.status.cpu().numpy() == LayoutStatus.VALID).all()
    for other in (generator, on_cpu):
        for name, values in _rows(other).items():
            np.testing.assert_array_equal(values, getattr(layouts, name).cpu().numpy())


def _rows(generator: LayoutGenerator) -> dict[str, np.ndarray]:
    names = ("qpos", "mocap_pos", "status", "attempts", "start", "grasp", "grasp_qpos", "pregrasp_qpos")
    return {name: getattr(generator.layouts, name).cpu().numpy().copy() for name in names}


def test_fingers_are_at_the_thing_on_both_sides():
    """Each is a fraction of a millimetre inside, so that it presses from the first step on."""
    compiled, table = starting(), make_table(starting(), 200, 7)
    data, mjm = mujoco.MjData(compiled.mjm), compiled.mjm
    fingers = [
        [g for g in range(mjm.ngeom) if f"{side}_finger" in mjm.body(mjm.geom_bodyid[g]).name]
        for side in ("left", "right")
    ]
    things = {STANDING: "block", LIFTED: "block", HELD: "block", HANDLE: "cabinet"}
    for row in np.flatnonzero(np.isin(table.start, list(things))):
        table.put(data, int(row))
        mujoco.mj_kinematics(mjm, data)
        own = compiled.scene.subtree(things[int(table.start[row])])
        geoms = [g for g in range(mjm.ngeom) if mjm.geom_bodyid[g] in own and mjm.geom_contype[g]]
        for side in fingers:
            near = min(
                mujoco.mj_geomDistance(mjm, data, f, g, 0.1, None) for f in side if mjm.geom_contype[f] for g in geoms
            )
            assert -6e-4 < near < -1e-4


def test_fingers_stay_out_at_the_limit_of_a_joint():
    """Near the base, where inverse kinematics ends up to a millimetre away in one of 240 grasps."""
    orange = {"asset": "orange", "on": "floor", "reachable": "ik", "region": {"box": [[0.1, -0.3], [0.32, 0.3]]}}
    scene = {"floor": {"size": [1.5, 1.5]}, "robot": {"asset": "heron"}, "objects": {"orange": orange}, "bank": 2}
    compiled = compile_scene({**scene, "start": [{"robot": "grasp", "of": "orange"}]}, "cpu")
    table, data, mjm = make_table(compiled, 1000, 0), mujoco.MjData(compiled.mjm), compiled.mjm
    pads, deepest = {mjm.geom(f"heron/{side}_pad").id for side in ("left", "right")}, 0.0
    for row in range(len(table.start)):
        table.put(data, row)
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_collision(mjm, data)
        deepest = min([deepest, *(c.dist for c in data.contact if pads.intersection(c.geom.tolist()))])
    assert -5e-4 < deepest < -1e-4


def test_things_in_the_air_are_held_by_all_grasps():
    """The hand is anywhere, so no grasp is more likely than another."""
    compiled, table = starting(), make_table(starting(), 800, 11)
    assert compiled.reaching is not None
    column = compiled.reaching.names.index("block")
    held = table.grasp[table.start == HELD, column]
    assert set(held.tolist()) == set(range(len(compiled.reaching.targets[column].grasp_set.grasps)))


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.FallbackWarning")
def test_a_hand_that_cannot_turn_holds_round_things_everywhere(tmp_path: Path):
    """A crane without its last joint: a cylinder at any heading, but a block only where its heading fits."""
    file = Path(crane_mjcf(tmp_path, solid=True))
    text = file.read_text().replace('<joint name="roll" axis="0 0 1" range="-3.2 3.2"/>', "")
    file.write_text(text.replace("0.3 0 0.04", "0.3 0.04"))
    shares = []
    for name, geom in (("can", 'type="cylinder" size="0.01 0.02"'), ("block", 'type="box" size="0.01 0.01 0.02"')):
        thing = tmp_path / f"{name}.xml"
        thing.write_text(f'<mujoco><worldbody><body name="{name}"><geom {geom}/></body></worldbody></mujoco>')
        within = {"region": {"box": [[0.55, -0.3], [0.7, 0.1]]}}
        scene = {**crane_scene(str(file), str(thing), reachable="ik", **within), "restarts": 16, "bank": 2}
        shares.append(make_table(compile_scene(scene, "cpu"), 50, 0).valid.mean())
    assert shares[0] > 0.95
    assert shares[1] < 0.5


@pytest.mark.parametrize("lift", [None, (0.005, 0.03)])
def test_an_arm_of_few_joints_holds_where_it_cannot_back_off(tmp_path: Path, lift: tuple[float, float] | None):
    """The crane rises by 7 cm, and no pre-grasp is within reach. MuJoCo C keeps what is held."""
    file, joints = Path(crane_mjcf(tmp_path, solid=True)), ("turn", "out", "up", "roll", "left", "right")
    drives = "".join(f'<position joint="{joint}" kp="400" kv="40"/>' for joint in joints)
    drives = f"<actuator>{drives}</actuator></mujoco>"
    home = ' 0.3 0 0.04 0.04"', ' 0.07 0 0.04 0.04"'
    text = file.read_text().replace(f'{HEIGHT[1]}"', '0.075"').replace(*home).replace("</mujoco>", drives)
    file.write_text(text)
    block = box_mjcf(tmp_path, "block", 0.03, 0.03, 0.04, 'mass="0.03"')
    start = {"robot": "grasp", "of": "thing"} | ({} if lift is None else {"lift": lift})
    compiled = compile_scene({**crane_scene(str(file), block, reachable="ik"), "restarts": 60, "start": [start]}, "cpu")
    table = make_table(compiled, 64, 0)
    assert table.valid.mean() > 0.9
    assert len(np.unique(table.qpos, axis=0)) > 58
    assert np.isnan(table.pregrasp_qpos).all()
    found = stepped(compiled, *reset_worlds(compiled, 24))
    assert max(held.drift for held in found) < 2e-3
    assert {held.fingers for held in found} == {2}
    assert not sum(held.others for held in found)
