"""The prefilter: grasps that the arm's map accepts, covers over points, and footprints on their supports."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import warp as wp
from scipy import stats

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import GraspError, InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave.prefilter import launch_prefilter, reject_cause
from sceniris_gym.layout.wave.search import Search, default_size
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.scene.build import build_model
from tests.layout.crane import HEIGHT, RADIUS, crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu, read, write_mjcf

SITE = '<site name="grasp_{0}" pos="0 0 {1}" quat="0 1 0 0"/>'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the assets of these tests."""
    return tmp_path_factory.mktemp("reach")


@pytest.fixture(scope="module")
def crane(folder: Path) -> str:
    """An arm with its map."""
    asset = crane_mjcf(folder)
    crane_map(asset)
    return asset


@pytest.fixture(scope="module")
def cube(folder: Path) -> str:
    """A cube of 4 cm, which is grasped at half its height."""
    return box_mjcf(folder, "cube", 0.04, 0.04, 0.04)


@pytest.fixture(scope="module")
def ring(crane: str, cube: str) -> CompiledScene:
    """The crane, and a cube anywhere on the floor where it reaches."""
    return compile_on_cpu(crane_scene(crane, cube), bank=8)


def tcps(compiled: CompiledScene, generator: LayoutGenerator, name: str = "thing") -> np.ndarray:
    """Return poses of the accepted grasps in the frame of the arm's base by MuJoCo C, (nworld, 4, 4); nan for none."""
    layouts, mjm, data = generator.layouts, compiled.mjm, mujoco.MjData(compiled.mjm)
    assert compiled.reaching is not None
    column = compiled.reaching.names.index(name)
    grasp, poses = layouts.grasp.numpy()[:, column], np.full((generator.nworld, 4, 4), np.nan)
    for i, qpos in enumerate(layouts.qpos.numpy()):
        data.qpos[:] = qpos
        if mjm.nmocap:
            data.mocap_pos[:], data.mocap_quat[:] = layouts.mocap_pos.numpy()[i], layouts.mocap_quat.numpy()[i]
        mujoco.mj_kinematics(mjm, data)
        if grasp[i] >= 0:
            g = compiled.reaching.targets[column].grasp_set.grasps[grasp[i]]
            body, base = _frame(data, g.body), _frame(data, compiled.scene.bodies["robot"])
            own, mat = np.eye(4), np.zeros(9)
            mujoco.mju_quat2Mat(mat, g.quat)
            own[:3, :3], own[:3, 3] = mat.reshape(3, 3), g.pos
            poses[i] = np.linalg.inv(base) @ body @ own
    return poses


def _frame(data: mujoco.MjData, body: int) -> np.ndarray:
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return frame


def reached(poses: np.ndarray, slack: float = 1e-4) -> np.ndarray:
    """Return True where a crane can be, by its joint limits alone."""
    r, z = np.hypot(poses[:, 0, 3], poses[:, 1, 3]), poses[:, 2, 3]
    down = poses[:, 2, 2] < -np.cos(np.radians(0.1))
    near = (r > RADIUS[0] - slack) & (r < RADIUS[1] + slack)
    return down & near & (z > HEIGHT[0] - slack) & (z < HEIGHT[1] + slack)


def test_everything_accepted_is_reached_and_everything_reached_is_accepted(ring: CompiledScene):
    """Off the origin and turned: the grasps fill the ring of the crane evenly, to its edges and nothing else."""
    generator = LayoutGenerator(ring, 3000)
    generator.generate()
    assert (generator.layouts.status.numpy() == LayoutStatus.VALID).all()
    poses = tcps(ring, generator)
    assert reached(poses).all()
    r = np.hypot(poses[:, 0, 3], poses[:, 1, 3])
    share = (r**2 - RADIUS[0] ** 2) / (RADIUS[1] ** 2 - RADIUS[0] ** 2)
    assert stats.kstest(share, "uniform").pvalue > 1e-3
    assert stats.kstest(np.arctan2(poses[:, 1, 3], poses[:, 0, 3]), "uniform", (-np.pi, 2 * np.pi)).pvalue > 1e-3


def test_rejections_are_counted(ring: CompiledScene):
    """All candidates that were rejected were out of reach, as often as the ring is smaller than the floor."""
    generator = LayoutGenerator(ring, 3000, seed=7)
    generator.generate()
    counts = generator.rejection_counts()["thing"]
    assert sum(counts.values()) == counts["unreachable"]
    kept = 3000 / (3000 + counts["unreachable"])
    assert kept == pytest.approx(np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) / 4.0, abs=0.015)


def test_a_scene_without_reach_counts_none(cube: str):
    """The causes of reach are named only where something is to be reachable."""
    compiled = compile_on_cpu({"floor": {"size": [1.0, 1.0]}, "objects": {"thing": {"asset": cube, "on": "floor"}}})
    assert compiled.reaching is None
    generator = LayoutGenerator(compiled, 4)
    assert not {"unreachable", "no_ik", "blocked"} & set(generator.rejection_counts()["thing"])
    assert generator.layouts.grasp.shape == (4, 0)


def test_a_layout_and_its_grasp_are_the_same_in_any_batch(folder: Path, crane: str):
    """Alone, in another order and under a mask: the same bits, the grasp's among them."""
    sites = SITE.format("high", 0.6) + SITE.format("low", 0.02)
    thing = write_mjcf(folder, "two_sites", '<geom type="box" size="0.02 0.02 0.02" pos="0 0 0.02"/>' + sites)
    compiled = compile_on_cpu(crane_scene(crane, thing), bank=4)
    many = LayoutGenerator(compiled, 20, seed=30)
    many.generate()
    rows, grasps = read(many.layouts), many.layouts.grasp.numpy().copy()
    back = LayoutGenerator(compiled, 20, seed=list(range(49, 29, -1)))
    mask = wp.array(np.arange(20) % 2 == 0, dtype=bool, device="cpu")
    back.generate(mask)
    for i in range(0, 20, 2):
        assert read(back.layouts)[i : i + 1].bits() == rows[19 - i : 20 - i].bits()
        assert (back.layouts.grasp.numpy()[i] == grasps[19 - i]).all()


def test_the_first_grasp_that_is_reached_is_taken(folder: Path, crane: str):
    """Two sites in reach give the first; one that is too high leaves the second."""
    box = '<geom type="box" size="0.02 0.02 0.02" pos="0 0 0.02"/>'
    both = write_mjcf(folder, "both", box + SITE.format("a", 0.03) + SITE.format("b", 0.02))
    second = write_mjcf(folder, "second", box + SITE.format("a", HEIGHT[1] + 0.01) + SITE.format("b", 0.02))
    for asset, expected in ((both, 0), (second, 1)):
        compiled = compile_on_cpu(crane_scene(crane, asset), bank=4)
        generator = LayoutGenerator(compiled, 50)
        generator.generate()
        assert (generator.layouts.grasp.numpy() == expected).all()
        assert reached(tcps(compiled, generator)).all()
        assert np.isnan(generator.layouts.grasp_qpos.numpy()).all()


def test_a_handle_is_reached_where_its_drawer_is(folder: Path, crane: str):
    """The site is in a child body, whose joint is drawn: the grasp goes with it."""
    box = '<geom type="box" size="0.02 0.02 0.02" pos="0 0 0.02"/>'
    slide = '<joint name="slide" type="slide" axis="1 0 0" range="0 0.3"/>'
    drawer = f'<body name="drawer" pos="0 0 0.05">{slide}{box}{SITE.format("handle", 0.02)}</body>'
    asset = write_mjcf(folder, "chest", box + drawer)
    words = {"kind": "fixture", "joints": {"slide": {"fraction": [0.0, 1.0]}}}
    compiled = compile_on_cpu(crane_scene(crane, asset, **words), bank=4)
    generator = LayoutGenerator(compiled, 300)
    generator.generate()
    drawn = generator.layouts.qpos.numpy()[:, compiled.mjm.jnt_qposadr[compiled.mjm.joint("thing/slide").id]]
    assert drawn.min() < 0.05
    assert drawn.max() > 0.25
    assert reached(tcps(compiled, generator)).all()


def test_strict_takes_less_than_the_majority(crane: str, cube: str, ring: CompiledScene):
    """`map_strict` stays a cell away from the edges of the ring."""
    compiled = compile_on_cpu(crane_scene(crane, cube, reachable="map_strict"), bank=4)
    generator = LayoutGenerator(compiled, 2000)
    generator.generate()
    r = np.hypot(*tcps(compiled, generator)[:, :2, 3].T)
    assert RADIUS[0] + 0.005 <= r.min() < RADIUS[0] + 0.01
    assert RADIUS[1] - 0.01 < r.max() <= RADIUS[1] - 0.005
    # pyrefly: ignore[missing-attribute]
    assert [c.tier for w in (ring, compiled) for c in w.reaching.targets] == [Tier.MAP, Tier.MAP_STRICT]


def test_nothing_is_taken_from_below(folder: Path, cube: str):
    """A site whose approach points up is not asked for where the object stands on something, and is in free space."""
    asset = crane_mjcf(folder, "upward")
    crane_map(asset, upwards=True)
    rising = write_mjcf(folder, "rising", '<geom type="sphere" size="0.02" pos="0 0 0.02"/><site name="grasp_up"/>')
    with pytest.raises(InfeasibleSceneError, match=r"because of unreachable.*Place the object closer to the robot"):
        compile_on_cpu(crane_scene(asset, rising), bank=1)
    scene = crane_scene(asset, rising)
    del scene["objects"]["thing"]["on"]
    scene["objects"]["thing"]["region"] = {"box": [[-0.5, -0.5, 0.1], [0.5, 0.5, 0.3]]}
    compiled = compile_on_cpu(scene, bank=4)
    generator = LayoutGenerator(compiled, 100)
    generator.generate()
    assert (tcps(compiled, generator)[:, 2, 2] > 0.99).all()


def test_absent_objects_have_no_grasp_and_the_bank_has_one(crane: str, cube: str):
    """One of two things is there: the other one's grasp is -1, also in layouts of the bank."""
    scene = crane_scene(crane, cube)
    scene["objects"]["other"] = dict(scene["objects"]["thing"])
    scene |= {"groups": {"one": {"of": ["thing", "other"], "count": 1}}, "attempts": 1, "restarts": 0}
    compiled = compile_on_cpu(scene, bank=16)
    generator = LayoutGenerator(compiled, 300)
    generator.generate()
    status, grasp = generator.layouts.status.numpy(), generator.layouts.grasp.numpy()
    present = generator.layouts.present.numpy()[:, :2]
    assert {int(s) for s in status} == {LayoutStatus.VALID, LayoutStatus.FALLBACK}
    assert ((grasp >= 0) == (present != 0)).all()
    for name in ("thing", "other"):
        poses = tcps(compiled, generator, name)
        there = present[:, compiled.slots.index(name)] != 0
        assert reached(poses[there]).all()


def test_the_map_is_part_of_the_scenes_name(folder: Path, cube: str):
    """Another map of the same arm is another hash, so a layout id never names two layouts; without reach it is not."""
    asset = crane_mjcf(folder, "renamed")
    crane_map(asset)
    config = SceneConfig.load(crane_scene(asset, cube))
    plain = SceneConfig.load(config, {"objects.thing.reachable": False})
    hashes = [build_model(c).hash for c in (config, plain)]
    crane_map(asset, step=0.02)
    again = [build_model(c).hash for c in (config, plain)]
    assert hashes[0] != again[0]
    assert hashes[1] == again[1]


def test_what_is_wider_than_the_gripper_fails_before_anything_is_made(folder: Path, crane: str):
    """The message names the scene's key."""
    wide = box_mjcf(folder, "wide", 0.1, 0.1, 0.1)
    with pytest.raises(GraspError, match=r"objects\.thing\.reachable: .*an opening of 0\.1 m"):
        compile_on_cpu(crane_scene(crane, wide))


@wp.kernel(enable_backward=False)
def _reject(program: Program, reach: Reach, search: Search, cause_out: wp.array[int]):
    c = wp.tid()
    cause_out[c] = reject_cause(program, reach, search, c, search.obj[c])


@pytest.mark.parametrize(("lanes", "parts"), [(1, 1), (3, 8), (200, 2)])
def test_covers_and_overhangs_are_found_by_any_number_of_lanes(tmp_path: Path, lanes: int, parts: int):
    """A crate on a slab below a board that is drawn out: by the places of its middle and of its corners."""
    board = '<body name="board" pos="-.3 0 .5"><joint name="slide" type="slide" axis="1 0 0" range="0 .6"/>'
    board += '<geom type="box" size=".3 .7 .01"/></body>'
    shelf = {"asset": write_mjcf(tmp_path, "shelf", f'<geom type="box" size=".6 .6 .01"/>{board}'), "kind": "static"}
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.2, 0.1, 0.05), "on": "shelf", "ratio_on_support": 1.0}
    objects = {"shelf": {**shelf, "joints": {"slide": {"fraction": [0, 1]}}}, "crate": crate}
    compiled, n = compile_on_cpu({"attempts": 1, "restarts": 0, "objects": objects}, bank=1), 400
    generator = LayoutGenerator(compiled, n, size=replace(default_size("cpu"), candidates=n))
    generator.generate()
    search, reach, body = generator._work.search, generator._work.reaches[0], compiled.mjm.body("crate").id
    search.candidates.fill_(n)  # the end of a wave sets it to 0
    for array in (search.cause, search.covered, search.overhanging):
        array.zero_()
    size = replace(generator.size, lanes=lanes, parts=parts)
    launch_prefilter(replace(generator._work, size=size))
    found = wp.zeros(n, dtype=int, device="cpu")
    wp.launch(_reject, dim=n, inputs=[compiled.program, reach, search], outputs=[found], device="cpu")
    at, turn = search.body_pos.numpy()[:, body, :2], search.heading.numpy()
    axes = np.stack([np.cos(turn), np.sin(turn)], axis=1), np.stack([-np.sin(turn), np.cos(turn)], axis=1)
    corners = at[:, None] + np.stack([x * 0.1 * axes[0] + y * 0.05 * axes[1] for x in (-1, 1) for y in (-1, 1)], axis=1)
    board_x = generator.layouts.view.body_pos.numpy()[search.row.numpy(), compiled.mjm.body("shelf/board").id, 0]
    covered, over = np.abs(at[:, 0] - board_x) < 0.3, np.abs(corners).max(axis=(1, 2)) > 0.6
    expected = np.where(covered, Cause.OVERHEAD, np.where(over, Cause.FOOTPRINT, Cause.NONE))
    np.testing.assert_array_equal(found.numpy(), expected)
    assert min(np.bincount(expected, minlength=3)[:3]) > 20
