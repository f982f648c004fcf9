"""Compiled scenes as arrays; `tests/layout/test_scene_cache.py` compares whole scenes, and their layouts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.program.archive import from_arrays, to_arrays
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.scene.build import build_model


def _uploaded(name: str) -> CompiledScene:
    return upload_scene(build_model(SceneConfig.load(name)), "cpu")


@pytest.mark.parametrize("name", ["mid_16k", "tabletop_lift"])
def test_every_field_of_the_device_comes_back(name: str):
    """By the declarations of the structs, which this test reads by itself."""
    compiled = _uploaded(name)
    again = from_arrays(compiled.scene, "cpu", to_arrays(compiled))
    structs = [(Program, compiled.program, again.program)]
    if compiled.reaching is not None and again.reaching is not None:
        structs.append((Reach, compiled.reaching.arms[0].view, again.reaching.arms[0].view))
    assert len(structs) == (2 if name == "tabletop_lift" else 1)
    for declared, before, after in structs:
        compared = 0
        for field in set(declared.vars) - {"collider_mesh", "map", "arm"}:
            first, second = getattr(before, field), getattr(after, field)
            if isinstance(first, wp.array):
                assert (second.dtype, second.shape) == (first.dtype, first.shape), field
                first, second = first.numpy(), second.numpy()
            assert np.array_equal(first, second), field
            compared += 1
        assert compared > 30


def test_meshes_are_made_anew():
    """Each from the same triangles, and the program points to the new ones, in their order."""
    compiled = _uploaded("mid_16k")
    again = from_arrays(compiled.scene, "cpu", to_arrays(compiled))
    old, new = (c.program.collider_mesh.numpy() for c in (compiled, again))
    assert ((old > 0) == (new > 0)).all()
    assert not set(old[old > 0]) & set(new[new > 0])
    assert [mesh.id for mesh in again.meshes] == new[new > 0].tolist()
    for first, second in zip(compiled.meshes, again.meshes, strict=True):
        assert (first.points.numpy() == second.points.numpy()).all()


def test_a_tool_without_fingers_comes_back():
    """Its lists of joints are empty, and still lists of addresses."""
    compiled = _uploaded("tabletop_lift")
    assert compiled.reaching is not None
    nothing = np.zeros(0)
    tool = Gripper(1e3, 0.0, 0.0, 0.1, 0.01, 0.0, np.zeros(0, int), nothing, nothing)
    (arm,) = compiled.reaching.arms
    bare = replace(compiled, reaching=replace(compiled.reaching, arms=(replace(arm, gripper=tool),)))
    again = from_arrays(bare.scene, "cpu", to_arrays(bare)).reaching
    assert again is not None
    assert again.arms[0].gripper.qposadr.dtype == int
    assert [values.size for values in again.arms[0].gripper.poses(np.linspace(0.0, 1.0, 3))] == [0, 0]


@pytest.mark.parametrize("name", ["words", "program.vert", "program.nobject", "home_qpos"])
def test_what_is_missing_is_an_error(name: str):
    """No field is left at what Warp would put there."""
    compiled = _uploaded("mid")
    arrays = to_arrays(compiled)
    del arrays[name]
    with pytest.raises(KeyError):
        from_arrays(compiled.scene, "cpu", arrays)
