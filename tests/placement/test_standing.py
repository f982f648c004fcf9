"""Statics of one world: patches by shapely, weights by MuJoCo C, and what makes a load fall."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import shapely
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.device.transforms import pose_of
from sceniris_gym.placement.standing import Level, find_patch, loads_stand, weigh
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_statics import DIRECTIONS, LawVector, Statics
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import box_mjcf
from tests.placement.supports import PLATE, TILES, tiles_mjcf

_COUNT = 200


@wp.kernel(enable_backward=False, module="unique")
def _find(
    statics: Statics,
    heading: wp.array[float],
    ground: wp.array[wp.vec3],
    # Out:
    corners: wp.array2d[wp.vec2],
    found: wp.array[bool],
):
    i = wp.tid()
    frame = pose_of(ground[i], wp.vec4(1.0, 0.0, 0.0, 0.0))
    patch, is_on = find_patch(statics, 1, wp.vec2(0.0), heading[i], 1, frame)
    found[i] = is_on
    for k in range(DIRECTIONS):
        corners[i, k] = wp.vec2(patch.x[k], patch.y[k])


@wp.kernel(enable_backward=False, module="unique")
def _weigh(
    program: Program,
    statics: Statics,
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
    # Out:
    total: wp.array[wp.vec4],
):
    total[0] = weigh(program, statics, 1, 0, body_pos, body_quat, wp.vec3(0.1, 0.2, 0.3))


@wp.kernel(enable_backward=False, module="unique")
def _load(
    off: wp.array[float],
    softness: float,
    law: LawVector,
    reach: wp.vec2,
    # Out:
    stands: wp.array[bool],
):
    """A load of 1 kg on a square patch of 10 cm, 5 cm high, which falls by 1 mm."""
    i = wp.tid()
    levels = wp.zeros(shape=(1,), dtype=Level)
    level = Level()  # pyrefly: ignore[missing-argument]
    level.own = wp.vec4(1.0, off[i], 0.0, 0.05)
    level.load = level.own
    level.margin = 0.05 - off[i]
    level.gap = 0.0005
    level.sink = 0.0005
    level.inner = 0.05
    level.softness = wp.mat22(softness, 0.0, 0.0, softness)
    level.law = law
    level.axis = wp.vec2(0.6, 0.8)
    level.reach = reach
    levels[0] = level
    stands[i] = loads_stand(levels, 1)


def crate_on(folder: Path, tiles: list) -> CompiledScene:
    """Upload the scene of a crate of 20 cm x 12 cm on a slab."""
    crate = box_mjcf(folder, "crate", 0.2, 0.12, 0.1)
    objects = {
        "slab": {"asset": tiles_mjcf(folder, tiles), "kind": "fixture", "on": "floor"},
        "crate": {"asset": crate, "on": "slab"},
    }
    return upload_scene(build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects})), "cpu")


@pytest.mark.parametrize("tiles", [TILES, PLATE], ids=["hollow", "convex"])
def test_a_patch_is_the_hull_of_the_foot_cut_with_the_support(tmp_path: Path, tiles: list):
    """In 200 places it is inside of what shapely finds, and has 95% of its area."""
    compiled, rng = crate_on(tmp_path, tiles), np.random.default_rng(0)
    outline = compiled.plan.objects[1].surfaces[0][0].outline
    low, high = np.reshape(outline.bounds, (2, 2))
    heading, at = rng.uniform(-3, 3, _COUNT), rng.uniform(low, high, (_COUNT, 2))
    corners = wp.zeros((_COUNT, DIRECTIONS), dtype=wp.vec2)
    found = wp.zeros(_COUNT, dtype=bool)
    ground = wp.array(np.hstack([-at, np.zeros((_COUNT, 1))]), dtype=wp.vec3)
    wp.launch(_find, _COUNT, [compiled.statics, wp.array(heading, dtype=float), ground], [corners, found], device="cpu")
    foot = shapely.box(-0.1, -0.06, 0.1, 0.06)
    for i in range(_COUNT):
        own = shapely.affinity.rotate(foot, heading[i], (0, 0), use_radians=True)
        expected = own.intersection(shapely.affinity.translate(outline, *-at[i])).convex_hull
        assert found.numpy()[i] == (expected.area > 0.0)
        if not found.numpy()[i]:
            continue
        patch = shapely.MultiPoint(corners.numpy()[i]).convex_hull
        assert expected.buffer(1e-6).covers(patch)
        assert patch.area >= 0.95 * expected.area


def test_a_foot_off_its_support_has_no_patch(tmp_path: Path):
    """A metre beside it."""
    compiled, found = crate_on(tmp_path, PLATE), wp.zeros(1, dtype=bool)
    ground, heading = wp.array([[1.0, 0.0, 0.0]], dtype=wp.vec3), wp.zeros(1, dtype=float)
    corners = wp.zeros((1, DIRECTIONS), dtype=wp.vec2)
    wp.launch(_find, 1, [compiled.statics, heading, ground], [corners, found], device="cpu")
    assert not found.numpy()[0]


def test_weight_and_centre_are_those_of_mujoco(tmp_path: Path):
    """Of an object with joints, in a state of its own; `gravcomp` takes weight away."""
    inner = '<body name="in" pos="0 0 .1" gravcomp=".5"><joint name="j"/><geom type="box" size=".02 .03 .04"/></body>'
    text = f'<mujoco><worldbody><body name="b"><geom type="box" size=".1 .05 .05"/>{inner}</body></worldbody></mujoco>'
    (tmp_path / "b.xml").write_text(text)
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.06, 0.05)
    objects = {"crate": {"asset": crate, "on": "floor"}, "b": {"asset": str(tmp_path / "b.xml"), "on": "crate"}}
    compiled = upload_scene(build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects})), "cpu")
    data = mujoco.MjData(compiled.mjm)
    data.qpos[:] = np.random.default_rng(1).normal(size=compiled.mjm.nq)
    mujoco.mj_kinematics(compiled.mjm, data)
    mujoco.mj_comPos(compiled.mjm, data)
    total = wp.zeros(1, dtype=wp.vec4)
    poses = wp.array(data.xpos, dtype=wp.vec3), wp.array(data.xquat, dtype=wp.vec4)
    wp.launch(_weigh, 1, [compiled.program, compiled.statics, *poses], [total], device="cpu")
    bodies = compiled.scene.subtree("b")
    mass = compiled.mjm.body_mass[bodies] * [1.0, 0.5]
    moments = mass @ (data.xipos[bodies] - [0.1, 0.2, 0.3])
    np.testing.assert_allclose(total.numpy()[0], [mass.sum(), *moments], rtol=1e-5)


@pytest.mark.parametrize(
    ("softness", "law", "limit"),
    [
        (0.0, (0.0, 0.0, 1.0), 0.05),
        (0.0, (0.5, 0.0, 1.0), 0.05 - 0.5 * (0.001 * 0.05) ** 0.5),
        (0.1, (0.0, 0.0, 1.0), 0.05 * (1 - 0.1 * 0.05)),
        (21.0, (0.0, 0.0, 1.0), 0.0),
        (3.0, (0.0, 0.0, 1.0), 0.0133),
        (0.0, (0.0, 0.0, 1.0, 1e3, 2.0, 0.0), 0.05 - 2.0 * (0.0005 * 0.05) ** 0.5),
        (0.0, (0.0, 0.0, 1.0, 1e3, 0.0, 0.3), 6.5e-3 * (0.05 - 0.05 / 3.0) / (2.0 * 0.05 / 3.0)),
        (0.0, (0.0, 0.0, 1.0, 1e3, 0.0, 0.9 * 0.9999), 6.5e-3 * 0.05 / 2.2),
        (0.0, (0.0, 0.0, 1.0, 1e3, 0.0, 0.9 * 0.85, 0.2), 0.0),
    ],
    ids=["rigid", "shaken", "soft", "top-heavy", "moves", "four of many contacts", "rolls", "a ball", "unsteady"],
)
def test_a_load_stands_up_to_a_distance_from_the_middle(softness: float, law: tuple[float, ...], limit: float):
    """By margin, fall, leaning, leaning ever further, the motion of its top, contacts that change, and rolling."""
    off = np.linspace(0.0001, 0.06, 600)
    stands = wp.zeros(len(off), dtype=bool)
    numbers = LawVector(*law, *(1e3, 0.0, 0.0, 0.0)[len(law) - 3 :])
    wp.launch(_load, len(off), [wp.array(off, dtype=float), softness, numbers, wp.vec2(0.05)], [stands], device="cpu")
    last = off[stands.numpy()].max(initial=0.0)
    assert last == pytest.approx(limit, abs=0.0008)
