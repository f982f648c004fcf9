"""Redraws: everything else is read from a state, and the new places are pure functions of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.random import named_stream
from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator, make_redraw
from sceniris_gym.layout.layouts import Layouts, LayoutStatus, LayoutsView, view_of
from sceniris_gym.layout.redraw import RedrawCounts
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import box_mjcf, compile_on_cpu, compiled_from
from tests.oracle.stack_judge import STILL, StackJudge

# A lamp on a ball joint, an arm of a hinge and a slide, a tray and three boxes on a table.
MODEL = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 .1"/>
    <body name="lamp" pos="2 0 1" euler="0 20 0"><joint name="ball" type="ball" pos="0 0 .1"/><geom size=".05"/>
      <body name="arm" pos=".2 0 0"><joint name="turn" axis="0 1 1" pos=".05 0 0"/><geom size=".05"/>
        <body name="hand" pos=".2 .1 0"><joint name="slide" type="slide" axis="1 0 0"/><geom size=".05"/></body></body>
    </body>
    <body name="sign" mocap="true" pos="1 1 .5"><geom size=".05" contype="0" conaffinity="0"/></body>
    <body name="tray" pos="0 0 1"><freejoint/><geom type="box" size=".15 .15 .01"/></body>
    <body name="a" pos="0 0 2"><freejoint/><geom type="box" size=".04 .03 .02"/></body>
    <body name="b" pos="0 0 3"><freejoint/><geom type="box" size=".02 .02 .02"/></body>
    <body name="c" pos="0 0 4"><freejoint/><geom type="box" size=".02 .02 .02"/></body>
  </worldbody>
  <keyframe><key name="init_state"/></keyframe>
</mujoco>
"""
ROOM = {"box": [[-0.5, -0.5], [0.5, 0.5]]}
NEAR = {"near": "a", "distance": {"min": 0.1, "max": 0.2}}


@pytest.fixture(scope="module")
def room() -> CompiledScene:
    """A box near another one, and a box on a tray, beside things that are never placed."""
    objects = {
        "tray": {"body": "tray", "on": "ground", "region": ROOM, "orientation": "fixed"},
        "a": {"body": "a", "on": "ground", "region": ROOM},
        "b": {"body": "b", "on": "ground", "region": ROOM, "relations": [NEAR]},
        "c": {"body": "c", "on": "tray", "ratio_on_support": 1},
    }
    return compiled_from(mujoco.MjSpec.from_string(MODEL), objects)


@dataclass
class Worlds:
    """States of worlds on the host."""

    qpos: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray
    present: np.ndarray
    seed: np.ndarray

    def uploaded(self) -> LayoutsView:
        """Return them as a redraw reads them."""
        nworld = len(self.seed)
        key = {"episode": np.full(nworld, 3), "draw_seed": self.seed, "draw_episode": np.full(nworld, 3)}
        key |= {"draw_stream": np.full(nworld, named_stream("train"))}
        return view_of(nworld, "cpu", vars(self) | key)

    def __getitem__(self, rows: np.ndarray) -> Worlds:
        return Worlds(*(getattr(self, name)[rows] for name in vars(self)))


def worlds_of(compiled: CompiledScene, nworld: int = 24) -> Worlds:
    """Return worlds in their first layouts."""
    generator = LayoutGenerator(compiled, nworld, seed=7)
    generator.generate()
    found = generator.layouts
    return Worlds(*(getattr(found, name).numpy() for name in ("qpos", "mocap_pos", "mocap_quat", "present", "seed")))


def redraw(
    compiled: CompiledScene,
    names: tuple[str, ...],
    worlds: Worlds,
    number: wp.array | None = None,
    origins: wp.array | None = None,
) -> Layouts:
    """Return the layouts of a redraw in all worlds."""
    nworld = len(worlds.seed)
    found, mask = make_redraw(compiled, names, nworld, "train"), wp.ones(nworld, dtype=bool, device="cpu")
    counts = RedrawCounts.zeros(nworld, "cpu")
    if number is not None:
        wp.copy(counts.number, number)
    found.launch(worlds.uploaded(), mask, counts, origins)
    assert (counts.number.numpy() == 1 + (0 if number is None else number.numpy())).all()
    np.testing.assert_array_equal(counts.status.numpy(), found.layouts.status.numpy())
    assert counts.kept.numpy()[0] == (counts.status.numpy() == LayoutStatus.KEPT).sum()
    return found.layouts


def address(compiled: CompiledScene, name: str) -> int:
    """Return the address of a free object's pose."""
    mjm = compiled.mjm
    return int(mjm.jnt_qposadr[mjm.body_jntadr[compiled.scene.bodies[name]]])


def turned(random: np.random.Generator, number: int) -> np.ndarray:
    """Return random rotations."""
    quat = random.normal(size=(number, 4))
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)


def test_bodies_are_where_mujoco_has_them(room: CompiledScene):
    """Ball, hinge, slide, free and mocap bodies, from positions alone."""
    worlds, mjm, random = worlds_of(room, 8), room.mjm, np.random.default_rng(0)
    adr = address(room, "a")
    worlds.qpos[:, adr : adr + 7] = np.hstack([random.uniform(2, 3, (8, 3)), turned(random, 8)])
    worlds.qpos[:, mjm.joint("ball").qposadr[0] :][:, :4] = turned(random, 8)
    for joint in ("turn", "slide"):
        worlds.qpos[:, mjm.joint(joint).qposadr[0]] = random.uniform(-1, 1, 8)
    worlds.mocap_pos[:, 0], worlds.mocap_quat[:, 0] = random.uniform(1, 2, (8, 3)), turned(random, 8)
    view = redraw(room, ("c",), worlds).view
    data, others = mujoco.MjData(mjm), np.setdiff1d(np.arange(mjm.nbody), room.scene.subtree("c"))
    for i in range(8):
        data.qpos[:], data.mocap_pos[:] = worlds.qpos[i], worlds.mocap_pos[i]
        data.mocap_quat[:] = worlds.mocap_quat[i]
        mujoco.mj_kinematics(mjm, data)
        np.testing.assert_allclose(view.body_pos.numpy()[i][others], data.xpos[others], atol=2e-6)
        same = np.abs((view.body_quat.numpy()[i] * data.xquat).sum(axis=1))
        np.testing.assert_allclose(same[others], 1.0, atol=1e-6)


def test_relations_hold_to_anchors_as_they_are(room: CompiledScene):
    """The box moves to where the other one has been pushed, upright or toppled; all else keeps its bits."""
    worlds, random = worlds_of(room), np.random.default_rng(1)
    anchor, own = address(room, "a"), address(room, "b")
    worlds.qpos[:, anchor : anchor + 2] = random.uniform(-0.2, 0.2, (24, 2))
    toppled = np.arange(24) % 2 == 1
    worlds.qpos[toppled, anchor + 2 : anchor + 7] = [0.04, np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]
    tray = address(room, "tray")
    worlds.qpos[:, tray : tray + 3] = [2.0, 2.0, 0.5]
    found = redraw(room, ("b",), worlds)
    assert (found.status.numpy() == LayoutStatus.VALID).all()
    qpos = found.qpos.numpy()
    np.testing.assert_array_equal(
        np.delete(qpos, range(own, own + 7), 1), np.delete(worlds.qpos, range(own, own + 7), 1)
    )
    upright = ~toppled
    far = np.linalg.norm(qpos[:, own : own + 2] - worlds.qpos[:, anchor : anchor + 2], axis=1)
    assert ((far > 0.1 - 1e-6) & (far < 0.2 + 1e-6))[upright].all()
    # the pivot of the toppled box is where its bottom has gone
    bottom = np.linalg.norm(qpos[:, own : own + 2] - worlds.qpos[:, anchor : anchor + 2] + [0.02, 0.0], axis=1)
    assert ((bottom > 0.1 - 1e-6) & (bottom < 0.2 + 1e-6))[toppled].all()


def test_a_support_counts_as_it_is_if_it_is_level(room: CompiledScene):
    """The tray was lifted and turned, so its box is on it there; where it leans, the box stays where it was."""
    worlds = worlds_of(room, 12)
    tray, own = address(room, "tray"), address(room, "c")
    leans = np.arange(12) % 3 == 0
    half = np.radians(30.0) / 2
    worlds.qpos[:, tray : tray + 7] = [1.0, -1.0, 0.4, np.cos(half), 0.0, 0.0, np.sin(half)]
    worlds.qpos[leans, tray + 3 : tray + 7] = [np.cos(0.02), np.sin(0.02), 0.0, 0.0]
    found = redraw(room, ("c",), worlds)
    np.testing.assert_array_equal(found.status.numpy(), np.where(leans, LayoutStatus.KEPT, LayoutStatus.VALID))
    qpos = found.qpos.numpy()
    np.testing.assert_array_equal(qpos[leans], worlds.qpos[leans])
    np.testing.assert_allclose(qpos[~leans, own + 2], 0.4 + 0.01 + 0.02 + 0.0005, atol=1e-6)
    off = qpos[~leans, own : own + 2] - [1.0, -1.0]
    along = off @ np.array([[np.cos(2 * half), -np.sin(2 * half)], [np.sin(2 * half), np.cos(2 * half)]])
    assert (np.abs(along) < 0.15).all()
    assert np.unique(along.round(4), axis=0).shape[0] == (~leans).sum()


def test_a_redraw_is_a_pure_function(room: CompiledScene):
    """The same in another batch, and another one for another number or another seed; origins move it along."""
    worlds, names = worlds_of(room), ("a", "b")
    numbers = wp.array(np.arange(24, dtype=np.int32) % 5, device="cpu")
    whole = redraw(room, names, worlds, number=numbers).qpos.numpy()
    some = np.array([3, 20, 8])
    part = redraw(room, names, worlds[some], number=wp.array(numbers.numpy()[some], device="cpu")).qpos.numpy()
    np.testing.assert_array_equal(part, whole[some])
    adr = address(room, "a")
    other = redraw(room, names, worlds, number=wp.array(numbers.numpy() + 1, device="cpu")).qpos.numpy()
    assert (other[:, adr] != whole[:, adr]).all()
    moved, origins = worlds[np.arange(24)], np.tile([0.5, 0.25, 0.0], (24, 1)).astype(np.float32)
    for name in ("tray", "a", "b", "c"):
        moved.qpos[:, address(room, name) :][:, :3] += origins
    moved.mocap_pos += origins[:, None]
    at = wp.array(origins, dtype=wp.vec3, device="cpu")
    np.testing.assert_allclose(
        redraw(room, names, moved, number=numbers, origins=at).qpos.numpy()[:, adr : adr + 7],
        whole[:, adr : adr + 7],
        atol=1e-6,
    )


def test_a_batch_grows_step_by_step():
    """Absent things are added one after the other, free of each other, and nothing that is there moves."""
    names = [f"tin_{i}" for i in range(4)]
    objects = {name: {"asset": "tin", "on": "floor"} for name in names}
    words = {"floor": {"size": [0.6, 0.6]}, "objects": objects, "groups": {"later": {"of": names[1:], "count": 0}}}
    compiled = compile_on_cpu(words, bank=2)
    generator = LayoutGenerator(compiled, 16, seed=2)
    generator.generate()
    layouts = generator.layouts
    for k in range(1, 4):
        before = layouts.qpos.numpy()
        layouts = generator.redraw(layouts, names[k])
        assert layouts.present.numpy()[:, : k + 1].all()
        assert not layouts.present.numpy()[:, k + 1 :].any()
        adr = address(compiled, names[k])
        np.testing.assert_array_equal(
            np.delete(layouts.qpos.numpy(), range(adr, adr + 7), 1), np.delete(before, range(adr, adr + 7), 1)
        )
    data = mujoco.MjData(compiled.mjm)
    for row in layouts.qpos.numpy():
        data.qpos[:] = row
        mujoco.mj_forward(compiled.mjm, data)
        assert data.contact.dist.min(initial=0.0) > -1e-4
        assert (np.abs(data.xpos[:, :2]).max(axis=0) < 0.4).all()


def test_layouts_to_extend_are_of_the_scene_and_keep_what_stands(room: CompiledScene):
    """As many as the generator has; and no object moves from under another one."""
    generator = LayoutGenerator(room, 2)
    generator.generate()
    with pytest.raises(SceneMismatchError, match="should be 2 layouts of scene"):
        generator.redraw(Layouts.create(room, 3), "a")
    with pytest.raises(ArgumentError, match="'tray' carries 'c'"):
        generator.redraw(generator.layouts, "tray")


def test_what_is_kept_leaves_grasps_alone():
    """A redraw has columns for the targets that it redraws, fewer than the state, to which nothing else is written."""
    compiled = compile_scene({"base": "tabletop_lift", "bank": 4}, "cpu")
    generator, redrawn = LayoutGenerator(compiled, 3), make_redraw(compiled, ("can",), 3, "train")
    generator.generate()
    found = redrawn.layouts
    assert found.grasp.shape[1] < generator.layouts.grasp.shape[1]
    found.grasp.fill_(7)
    redrawn._make = lambda mask, launch: found.view.status.zero_()  # nothing fits
    redrawn.launch(generator.layouts.view, wp.ones(3, dtype=bool, device="cpu"), RedrawCounts.zeros(3, "cpu"))
    assert (found.status.numpy() == LayoutStatus.KEPT).all()
    np.testing.assert_array_equal(found.qpos.numpy(), generator.layouts.qpos.numpy())
    assert (found.grasp.numpy() == 7).all()


def test_the_top_of_a_settled_stack_is_redrawn_and_stands():
    """Soft contacts lean what carries it by more than 0.1 degrees; it leans with it, and stays in MuJoCo C."""
    names = ["low", "middle", "top"]
    objects = {name: {"asset": "block"} for name in names}
    stack = {"tower": {"of": names, "on": "floor", "offset": [0, 0.02]}}
    compiled = compile_on_cpu({"floor": {"size": [1.2, 1.0]}, "objects": objects, "stacks": stack}, bank=8)
    worlds, data = worlds_of(compiled), mujoco.MjData(compiled.mjm)
    lean = np.zeros(len(worlds.seed))
    for i, qpos in enumerate(worlds.qpos):
        mujoco.mj_resetData(compiled.mjm, data)
        data.qpos[:] = qpos
        mujoco.mj_step(compiled.mjm, data, 100)
        worlds.qpos[i] = data.qpos
        lean[i] = np.degrees(np.arccos(min(1.0, data.xmat[compiled.scene.bodies["middle"]][8])))
    assert (lean > 0.1).mean() > 0.5
    found, judge = redraw(compiled, ("top",), worlds), StackJudge(compiled.mjm)
    assert (found.status.numpy() == LayoutStatus.VALID).mean() > 0.9
    far = [judge.moves(qpos, np.zeros((0, 3)), np.zeros((0, 4))).max() for qpos in found.qpos.numpy()]
    assert max(far) < STILL


def test_a_carrier_moves_although_what_is_absent_might_stand_on_it(tmp_path: Path):
    """Alone or with what is added to it, on the floor and on a slab; nothing moves in MuJoCo C."""
    slab, tray = box_mjcf(tmp_path, "slab", 0.3, 0.3, 0.04), box_mjcf(tmp_path, "tray", 0.2, 0.2, 0.02)
    carriers = {"slab": {"asset": slab, "on": "floor"}, "tray": {"asset": tray}}
    loads = {name: {"asset": "block", "on": "tray", "ratio_on_support": 1} for name in ("one", "other")}
    words = {"floor": {"size": [1.0, 1.0]}, "groups": {"later": {"of": list(loads), "count": 0}}}
    for support in ("floor", "slab"):
        carriers["tray"]["on"] = support
        compiled = compile_on_cpu({**words, "objects": carriers | loads}, bank=2)
        generator, judge = LayoutGenerator(compiled, 8), StackJudge(compiled.mjm)
        generator.generate()
        adr, away = address(compiled, "tray"), [compiled.scene.bodies["other"]]
        after = generator.redraw(generator.redraw(generator.layouts, "tray"), ["tray", "one"])
        assert (after.status.numpy() == LayoutStatus.VALID).all()
        assert (generator.layouts.qpos.numpy()[:, adr] != after.qpos.numpy()[:, adr]).all()
        assert after.present.numpy()[:, [compiled.slots.index(name) for name in loads]].tolist() == [[1, 0]] * 8
        far = [judge.moves(qpos, np.zeros((0, 3)), np.zeros((0, 4)), away).max() for qpos in after.qpos.numpy()]
        assert max(far) < STILL


def test_an_object_with_variants_keeps_its_variant():
    """It moves, and none of its other variants joins it; one on several supports stays on its support."""
    things = {
        "thing": {"asset": ["can", "mug"], "on": "floor"},
        "table": {"asset": "tin", "kind": "fixture", "on": "floor"},
    }
    objects = {**things, "block": {"asset": "block", "on": {"floor": 1, "table": 1}}}
    generator = LayoutGenerator(compile_on_cpu({"floor": {"size": [2, 2]}, "objects": objects}, bank=4), 32)
    generator.generate()
    present, before = generator.layouts.present.numpy().copy(), generator.layouts.pose("thing").numpy().copy()
    moved = generator.redraw(generator.layouts, ["thing", "block"])
    assert (moved.status.numpy() == LayoutStatus.VALID).all()
    np.testing.assert_array_equal(moved.present.numpy(), present)
    assert (np.abs(moved.pose("thing").numpy() - before)[:, :2].max(axis=1) > 0.0).all()
