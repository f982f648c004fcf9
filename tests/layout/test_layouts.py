"""Layouts as users see them: documented arrays, and views of poses and joints by name."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts, LayoutStatus, LayoutsView, layout_width, view_of
from sceniris_gym.layout.seeds import launch_open
from sceniris_gym.layout.stored import _make
from tests.layout.scenes import compiled_from
from tests.scene.memory import NEAR, cubes_on, spec_of


def test_poses_and_joints_are_views_by_name():
    """Zero-copy: a tensor shows the layouts that are made after it."""
    spec = spec_of()
    spec.body("cab/cabinet").mocap = True
    objects = {
        **cubes_on("ground", 1, region=NEAR),
        "cabinet": {
            "body": "cab/cabinet",
            "kind": "fixture",
            "on": "ledge",
            "joints": {"slide": {"fraction": [0, 1]}},
        },
        "terrain": {"kind": "static"},
    }
    compiled = compiled_from(spec, objects)
    generator = LayoutGenerator(compiled, 40)
    layouts = generator.layouts
    cube, cabinet, ground, slide = (
        *(layouts.pose(name) for name in ("cube_0", "cabinet", "terrain")),
        layouts.joint("cabinet/slide"),
    )
    for _ in range(2):
        generator.generate()
        qpos, mjm = layouts.qpos.numpy(), compiled.mjm
        data = mujoco.MjData(mjm)
        for i in range(40):
            data.qpos[:] = qpos[i]
            data.mocap_pos[:], data.mocap_quat[:] = layouts.mocap_pos.numpy()[i], layouts.mocap_quat.numpy()[i]
            mujoco.mj_kinematics(mjm, data)
            for pose, body in ((cube, "cube_0/cube"), (cabinet, "cab/cabinet"), (ground, "terrain")):
                expected = np.concatenate([data.body(body).xpos, data.body(body).xquat])
                np.testing.assert_allclose(pose[i].numpy(), expected, atol=1e-6)
            assert slide[i] == pytest.approx(data.joint("cab/slide").qpos[0], abs=1e-6)
    assert (cube.shape, cabinet.shape, ground.shape, slide.shape) == ((40, 7), (40, 7), (40, 7), (40,))
    assert cube.data_ptr() == layouts.view.qpos.ptr + 4 * 2
    assert cabinet.data_ptr() == layouts.view.mocap_pos.ptr


def test_rows_of_restarts_are_hidden():
    """Rows beyond those of the worlds belong to restarts: public arrays end before them, whatever their shape."""
    compiled = compiled_from(spec_of(), cubes_on("ground", 2, region=NEAR))
    layouts = Layouts.create(compiled, 3, rows=5)
    for name in ("qpos", "mocap_pos", "mocap_quat", "present"):
        assert getattr(layouts.view, name).shape[0] == 8
        assert getattr(layouts, name).shape[0] == layouts.nworld == 3
        assert getattr(layouts, name).data_ptr() == getattr(layouts.view, name).ptr
    assert layouts.grasp.shape == (3, 0)


def test_columns_are_torch_tensors_in_the_memory_of_the_view():
    """All that are documented: made once, never copied, and written to from both sides."""
    layouts = Layouts.create(compiled_from(spec_of(), cubes_on("ground", 2, region=NEAR)), 3, rows=5)
    for name in (*columns(), "rejections"):
        tensor, array = getattr(layouts, name), getattr(layouts.view, name)
        assert isinstance(tensor, torch.Tensor), name
        assert tensor is getattr(layouts, name)
        assert f"        {name}: " in str(Layouts.__doc__)
        if array.size:
            tensor[-1] = 2
            assert (array.numpy()[len(tensor) - 1] == 2).all(), name
            array.fill_(1)
            assert (tensor == 1).all(), name
        with pytest.raises(AttributeError):
            setattr(layouts, name, tensor)
    types = [getattr(layouts, name).dtype for name in ("seed", "draw_seed", "episode", "qpos", "rejections")]
    assert types == [torch.int64, torch.int64, torch.int32, torch.float32, torch.int64]
    assert (layouts.mocap_pos.shape, layouts.mocap_quat.shape) == ((3, 1, 3), (3, 1, 4))


def test_the_largest_seed_is_read_in_twos_complement():
    """It has the id of 2^64 - 1, and is a seed of worlds and of layouts again."""
    generator = LayoutGenerator(compiled_from(spec_of(), cubes_on("ground", 1, region=NEAR)), 2, seed=2**64 - 1)
    layouts = generator.layouts
    for _ in range(2):
        generator.generate()
        assert layouts.seed.tolist() == [-1, 0]
        assert layouts.ids("train")[0] == layouts.compiled.layout_id(2**64 - 1, 0) == layouts.compiled.layout_id(-1, 0)
        generator.reseed(seed=layouts.seed)
    generator.reseed(layouts={"seed": layouts.seed, "episode": layouts.episode})
    generator.generate()
    assert (layouts.view.seed.numpy().tolist(), layouts.episode.tolist()) == ([2**64 - 1, 0], [0, 0])


def test_a_new_batch_holds_no_layout():
    """Every world is before its first episode, and at home."""
    compiled = compiled_from(spec_of(), cubes_on("ground", 2, region=NEAR))
    layouts = Layouts.create(compiled, 3)
    assert (layouts.episode.numpy() == -1).all()
    assert (layouts.status.numpy() == LayoutStatus.NONE).all()
    assert (layouts.present.numpy() == 1).all()
    np.testing.assert_array_equal(layouts.qpos.numpy(), np.tile(compiled.home_qpos, (3, 1)).astype(np.float32))
    data = mujoco.MjData(compiled.mjm)
    data.qpos[:] = compiled.home_qpos
    mujoco.mj_kinematics(compiled.mjm, data)
    np.testing.assert_allclose(layouts.view.body_pos.numpy(), np.tile(data.xpos, (3, 1, 1)), atol=1e-6)


def test_a_printed_scene_and_its_layouts_are_one_short_line():
    """And so is a method of either."""
    compiled = compiled_from(spec_of(), cubes_on("ground", 2, region=NEAR))
    layouts = Layouts.create(compiled, 3)
    assert repr(layouts) == f"<Layouts of 3 worlds of <CompiledScene '{compiled.config.name}' on cpu>>"
    assert len(repr(layouts.pose)) < 200


def test_unknown_names_are_refused_with_those_that_are_known():
    """Of objects and of joints."""
    layouts = Layouts.create(compiled_from(spec_of(), cubes_on("ground", 2, region=NEAR)), 1)
    with pytest.raises(UnknownNameError, match="cube_0"):
        layouts.pose("cube_7")
    with pytest.raises(UnknownNameError, match="slide"):
        layouts.joint("hinge")


def test_a_kernel_may_read_what_a_view_was_not_given():
    """Rows without a value are served from a view of two arrays; an array without memory ended the process."""
    compiled = compiled_from(spec_of(), cubes_on("ground", 2, region=NEAR))
    layouts = Layouts.create(compiled, 2)
    given = {"qpos": np.tile(np.arange(compiled.mjm.nq, dtype=np.float32), (3, 1)), "draw_seed": np.array([7, 8, 9])}
    stored = view_of(3, "cpu", given)
    # pyrefly: ignore[missing-attribute]
    arrays = {name: getattr(stored, name) for name, field in LayoutsView.vars.items() if wp.types.is_array(field.type)}
    assert {name for name, array in arrays.items() if array.shape[0] != 3} == {
        name
        for name in LayoutsView.vars  # pyrefly: ignore[missing-attribute]
        if name.startswith("rejected")  # there is no record
    }
    launch_open(layouts.view, None)
    dim = 2, layout_width(layouts.view)
    wp.launch(_make, dim, inputs=[stored, None, 1], outputs=[layouts.view], device="cpu")
    np.testing.assert_array_equal(layouts.qpos.numpy(), given["qpos"][:2])
    assert (layouts.draw_seed.numpy().tolist(), layouts.draw_episode.numpy().tolist()) == ([7, 7], [-1, -1])
    assert (layouts.start.numpy().tolist(), stored.next_episode.numpy().tolist()) == ([-1, -1], [-1, -1, -1])
