"""The backdrop of a scene: solver options, the floor, light, and the camera."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.scene.backdrop import OVERVIEW, add_camera
from sceniris_gym.scene.overview import camera_axes
from tests.scene.assets import build


def test_the_floor_is_as_large_as_the_workspace_and_belongs_to_the_world(folder: Path):
    """The plane's drawn half extents are half of the floor's."""
    floor = build(folder, {}).mjm.geom("floor")
    assert floor.type == mujoco.mjtGeom.mjGEOM_PLANE
    assert floor.bodyid == 0
    np.testing.assert_allclose(floor.size[:2], [0.5, 1.0])


def test_what_leaves_the_workspace_still_lands_on_the_floor(folder: Path):
    """A ball of 3 cm radius that falls ten metres beside it comes to lie on it."""
    mjm = build(folder, {"ball": {"asset": "ball", "on": "floor"}}).mjm
    data = mujoco.MjData(mjm)
    data.qpos[:7] = 10.0, 3.0, 0.1, 1.0, 0.0, 0.0, 0.0
    while data.time < 1.0:
        mujoco.mj_step(mjm, data)
    assert data.qpos[2] == pytest.approx(0.03, abs=1e-3)


def test_all_composed_scenes_have_the_same_solver(folder: Path):
    """Whatever options their assets have: options are built into compiled kernels."""
    one = build(folder, {"a": {"asset": "chest", "kind": "fixture"}}).mjm.opt
    other = build(folder, {"b": {"asset": "ball"}}, robot={"asset": "arm"}).mjm.opt
    for name in ("timestep", "integrator", "cone", "impratio", "iterations", "ls_iterations", "solver", "gravity"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_the_camera_stands_where_it_is_told_to():
    """Position, axes and angle are those that are given; it looks along its -z."""
    axes = camera_axes(np.array([0.3, -1.0, 0.8]))
    spec = mujoco.MjSpec()
    add_camera(spec, np.array([1.0, -2.0, 3.0]), axes, 35.0)
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, data)
    assert data.camera(OVERVIEW).xpos == pytest.approx([1.0, -2.0, 3.0])
    assert data.camera(OVERVIEW).xmat.reshape(3, 3) == pytest.approx(axes, abs=1e-9)
    assert mjm.camera(OVERVIEW).fovy == 35.0


def test_an_own_model_keeps_its_camera_and_light(folder: Path):
    """One that is called 'overview' is not added again, and a lamp is added only where there is none."""
    own = folder / "own.xml"
    camera = f'<camera name="{OVERVIEW}" pos="1 2 3" fovy="11"/>'
    own.write_text(own.read_text().replace("<light", f"{camera}<light"))
    objects = {"desk": {"kind": "fixture", "on": "floor"}}
    mjm = build(folder, objects, model=str(own)).mjm
    assert (mjm.ncam, mjm.nlight) == (1, 1)
    assert mjm.camera(OVERVIEW).fovy == 11
    assert build(folder, {}).mjm.nlight == 1
