"""What a scene stands in: solver options, the floor, light, and the camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.scene.backdrop import OVERVIEW, add_camera
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


def _camera(center: tuple[float, float, float], extent: float, yaw: float | None = None) -> tuple[Any, ...]:
    """A scene's camera as MuJoCo places it: position, axes as columns, and the angle of its view [rad]."""
    spec = mujoco.MjSpec()
    add_camera(spec, np.array(center), extent, None if yaw is None else np.radians(yaw))
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    mujoco.mj_forward(mjm, data)
    camera = data.camera(OVERVIEW)
    return camera.xpos.copy(), camera.xmat.reshape(3, 3).copy(), np.radians(mjm.camera(OVERVIEW).fovy[0])


@pytest.mark.parametrize("yaw", [None, 0, 100, -60])
@pytest.mark.parametrize(("center", "extent"), [((0, 0, 0.25), 2.0), ((1.0, -3.0, 0.5), 0.4)])
def test_the_camera_looks_down_on_the_middle_and_sees_the_extent(center: tuple, extent: float, yaw: float | None):
    """Level, the middle in its middle, and what is `extent` wide there within its view. It looks along its -z."""
    at, axes, view = _camera(center, extent, yaw)
    to_center = axes.T @ (np.array(center) - at)
    assert to_center[:2] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert to_center[2] < 0.0
    assert axes[2, 0] == pytest.approx(0.0, abs=1e-9)
    assert axes[2, 1] > 0.0
    assert at[2] > center[2] + extent
    for across in (axes[:, 0], axes[:, 1]):
        for side in (-0.5, 0.5):
            point = axes.T @ (np.array(center) + side * extent * across - at)
            assert np.linalg.norm(point[:2]) < -point[2] * np.tan(view / 2)


def test_the_camera_never_looks_at_the_back_of_a_robot():
    """Its view and the robot's differ by more than 45 degrees, seen from above; without a robot it is in front."""
    for yaw in range(-180, 180, 5):
        looks = -_camera((0, 0, 0), 1.0, yaw)[1][:2, 2]
        faces = np.array([np.cos(np.radians(yaw)), np.sin(np.radians(yaw))])
        assert looks @ faces < np.cos(np.radians(45.0)) * np.linalg.norm(looks) + 1e-9
    assert _camera((0, 0, 0), 1.0)[0][1] < 0.0


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
