"""Origins of worlds, and resets that write what is in the scene alone."""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, ModelWarning, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.scene.memory import NEAR, cubes_on, spec_of

NWORLD = 3


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return a scene with two of three cubes and a mocap cabinet; the post and the third cube are somebody else's."""
    spec = spec_of()
    spec.body("cab/cabinet").mocap = True
    joints = {"slide": {"fraction": [0.2, 1]}}
    objects = {
        **cubes_on("ground", 2, region=NEAR),
        "cabinet": {"body": "cab/cabinet", "kind": "fixture", "on": "ledge", "joints": joints},
    }
    return compile_scene({"model": spec, "objects": objects, "home": "init_state", "bank": 2}, "cpu")


def make(compiled: CompiledScene, **words: Any) -> ResetRandomizer:
    """Return a randomizer over data in which every number is another one."""
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(compiled.mjm), mjw.make_data(compiled.mjm, NWORLD)
    rng = np.random.default_rng(0)
    for name in ResetRandomizer.STATE_FIELDS:
        array = getattr(d, name, None)
        if array is not None and array.dtype is wp.float32 and array.size:
            array.assign(rng.uniform(1.0, 2.0, array.shape).astype(np.float32))
    return ResetRandomizer(compiled, m, d, **words)


def expected_layouts(compiled: CompiledScene) -> LayoutGenerator:
    """Return the generator of the same layouts, after the first of them."""
    generator = LayoutGenerator(compiled, NWORLD)
    generator.generate()
    return generator


@pytest.mark.usefixtures("recorded")
@pytest.mark.oldest
@pytest.mark.parametrize("graph", [False, True])
def test_what_is_not_in_the_scene_is_left_alone(compiled: CompiledScene, graph: bool):
    """Only joints of the scene's objects, their speeds, and the control that holds one of them are written."""
    randomizer = make(compiled, scope="scene", graph=graph)
    d, mjm = randomizer.data, compiled.mjm
    before = {name: getattr(d, name).numpy().copy() for name in ResetRandomizer.STATE_FIELDS if hasattr(d, name)}
    randomizer.reset(np.array([True, False, True]))
    layouts = expected_layouts(compiled).layouts
    own = np.zeros(mjm.nq, bool)
    own[[0, *range(2, 16)]] = True  # the drawer and two cubes, not the post and not the third cube
    dofs = np.zeros(mjm.nv, bool)
    dofs[[0, *range(2, 14)]] = True
    pull = mjm.actuator("pull").id
    for name, values in before.items():
        found, wanted = getattr(d, name).numpy(), values.copy()
        for world in (0, 2):
            match name:
                case "qpos":
                    wanted[world, own] = layouts.qpos.numpy()[world, own]
                case "qvel" | "qacc_warmstart":
                    wanted[world, dofs] = 0.0
                case "ctrl":
                    wanted[world, pull] = layouts.qpos.numpy()[world, 0]
                case "mocap_pos" | "mocap_quat":
                    wanted[world] = getattr(layouts, name).numpy()[world]
        np.testing.assert_array_equal(found, wanted, err_msg=name)


@pytest.mark.parametrize("scope", ["world", "scene"])
def test_origins_are_added_to_what_is_written(compiled: CompiledScene, scope: str):
    """To free bodies and to mocap bodies; a tensor is read anew at every reset, and other worlds stay."""
    origins = torch.tensor([[10.0, 0, 0], [0, 20, 0], [0, 0, 30]])
    randomizer = make(compiled, scope=scope, origins=origins)
    d = randomizer.data
    free = [2, 9] if scope == "scene" else [2, 9, 16]
    for mask in ([True, True, True], [False, True, False]):
        before = d.qpos.numpy().copy()
        randomizer.reset(np.array(mask))
        layouts, qpos = randomizer.layouts, d.qpos.numpy()
        for world in np.flatnonzero(mask):
            for adr in free:
                expected = layouts.qpos.numpy()[world, adr : adr + 3] + origins[world].numpy()
                np.testing.assert_allclose(qpos[world, adr : adr + 3], expected, rtol=1e-6)
                np.testing.assert_array_equal(
                    qpos[world, adr + 3 : adr + 7], layouts.qpos.numpy()[world, adr + 3 : adr + 7]
                )
            expected = layouts.mocap_pos.numpy()[world] + origins[world].numpy()
            np.testing.assert_allclose(d.mocap_pos.numpy()[world], expected, rtol=1e-6)
        np.testing.assert_array_equal(qpos[~np.array(mask)], before[~np.array(mask)])
        origins[1, 2] = 5.0
    assert qpos[1, 4] > 5.0


def test_what_is_fixed_to_the_world_is_warned_of_where_origins_differ(
    compiled: CompiledScene, recwarn: pytest.WarningsRecorder
):
    """It stays where it is, while layouts are moved; planes and mocap bodies are no matter, nor are origins of 0."""
    fixed = r"ResetRandomizer: origins: .* geoms 'ledge' of 'world', 'roof' of 'world', '[^']*' of 'post'\. Layouts do"
    with pytest.warns(ModelWarning, match=fixed):
        make(compiled, origins=np.eye(3), scope="scene")
    recwarn.clear()
    make(compiled, origins=np.zeros((3, 3)))
    spec = spec_of()
    for name in ("ledge", "roof"):
        spec.delete(spec.geom(name))
    spec.body("post").joints[0].type = mujoco.mjtJoint.mjJNT_FREE
    spec.body("cab/cabinet").mocap = True
    spec.delete(spec.keys[0])
    spec.delete(spec.actuators[0])
    objects = cubes_on("ground", 2, region=NEAR)
    make(compile_scene({"model": spec, "objects": objects, "bank": 2}, "cpu"), origins=np.eye(3))
    assert not [w for w in recwarn if "origins" in str(w.message)]


def test_wrong_words_and_origins_are_refused(compiled: CompiledScene):
    """Of another shape, of another kind, and a way to write that there is not."""
    with pytest.raises(ArgumentError, match=r"origins should be floats of shape \(3, 3\), one per world"):
        make(compiled, origins=np.zeros((2, 3)))
    for origins in ([0, 0, 0], [0.0] * 9, np.zeros((3, 4)), torch.zeros(3), 0.0):
        with pytest.raises(ArgumentError, match=r"origins should be floats of shape \(3, 3\), one per world, got \("):
            make(compiled, origins=origins)
    with pytest.raises(ArgumentTypeError, match="origins should be floats"):
        make(compiled, origins="here")
    with pytest.raises(UnknownNameError, match=r"scope: unknown scope 'scen'\. Did you mean 'scene'"):
        make(compiled, scope="scen")


def test_worlds_go_by_their_numbers_as_well(compiled: CompiledScene):
    """As a list, a slice, a numpy array or a tensor, in any order; none is none."""
    for ids in (
        [2, 0],
        slice(0, 3, 2),
        np.array([0, 2]),
        torch.tensor([2, 0, 2, 0]),
        wp.array([0, 2], dtype=int, device="cpu"),
    ):
        randomizer = make(compiled)
        randomizer.reset(ids)
        np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [0, -1, 0])
    randomizer.reset([])
    randomizer.reset(torch.zeros(0, dtype=torch.long))
    np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [0, -1, 0])
    randomizer.reset(slice(None))
    np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [1, 0, 1])
