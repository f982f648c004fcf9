"""Furniture that differs between worlds of one model moves as in its own model."""

from __future__ import annotations

import json

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest

from benchmarks.slots_cost import ASSETS, BACK, VARIANTS, Options, Worlds, arrangement, main
from tests.versions import since_3_12

pytestmark = since_3_12("meshes lose the names by which slots choose them, and objects at rest creep")
SPEED = {mujoco.mjtJoint.mjJNT_SLIDE: (0.6, 0.4), mujoco.mjtJoint.mjJNT_HINGE: (8.0,)}
"""Initial velocities of the first joint of a type, the second, and so on [m/s or rad/s]."""
STEPS = 60


def alone(name: str, option: mujoco.MjOption) -> tuple[np.ndarray, np.ndarray]:
    """Return qpos and qvel of a variant in its own model, shape (STEPS, nv), with joints in order of their types."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / f"{name}.xml"))
    spec.body(name).mocap, spec.body(name).pos = True, [0.0, BACK, 0.0]
    mjm = spec.compile()
    for field in ("timestep", "integrator", "cone", "impratio", "iterations"):
        setattr(mjm.opt, field, getattr(option, field))
    m, d = mjw.put_model(mjm), mjw.make_data(mjm)
    m.opt.ls_iterations = 20
    order = np.argsort(mjm.jnt_type, kind="stable")
    qvel = np.zeros((1, mjm.nv), np.float32)
    qvel[0, order] = SPEED[mujoco.mjtJoint(int(mjm.jnt_type[0]))][: mjm.nv]
    d.qvel.assign(qvel)
    found = []
    for _ in range(STEPS):
        mjw.step(m, d)
        found.append((d.qpos.numpy()[0, order], d.qvel.numpy()[0, order]))
    qpos, qvel = zip(*found, strict=True)
    return np.array(qpos), np.array(qvel)


@pytest.mark.slow
def test_a_slot_moves_as_each_variant_in_its_own_model():
    """All bits of three variants in three worlds without contacts. Unused joints stay at exactly 0."""
    options = Options(slots=1, worlds=3, awake=True, device="cpu")
    worlds = Worlds("slots", options, np.array([[0], [1], [2]]), filled=False)
    mjm, d, used = worlds.mjm, worlds.data, ~worlds.unused
    assert used.sum(axis=1).tolist() == [2, 1, 1]
    qvel = np.zeros(used.shape, np.float32)
    order = np.argsort(mjm.jnt_type, kind="stable")
    for world in range(3):
        joints = order[used[world, order]]
        qvel[world, joints] = SPEED[mujoco.mjtJoint(int(mjm.jnt_type[joints[0]]))][: len(joints)]
    d.qvel.assign(qvel)
    found = []
    for _ in range(STEPS):
        mjw.step(worlds.model, d)
        found.append((d.qpos.numpy().copy(), d.qvel.numpy().copy()))
    assert d.nacon.numpy()[0] == 0
    for world, name in enumerate(VARIANTS):
        joints = order[used[world, order]]
        for mine, own in zip(zip(*found, strict=True), alone(name, mjm.opt), strict=True):
            ours = np.array(mine)[:, world]
            np.testing.assert_array_equal(ours[:, joints], own, err_msg=name)
            assert not ours[:, ~used[world]].any()
        assert np.abs(np.array(found)[:, 0, world, joints]).max(axis=0).min() > 0.01  # all joints moved


@pytest.mark.slow
def test_objects_rest_on_slots_as_on_separate_pieces():
    """Objects in six worlds come to rest within 0.02 mm of their poses on the same furniture with its own bodies."""
    options, variant = Options(slots=6, worlds=6, awake=True, device="cpu"), arrangement(6, 6)
    slots, parked = (Worlds(kind, options, variant).things() for kind in ("slots", "parked"))
    assert np.ptp(slots[:, 0, 2]) > 0.3  # the same object is on pieces of different heights
    np.testing.assert_allclose(slots, parked, rtol=0.0, atol=2e-5)


@pytest.mark.slow
def test_three_models_take_turns(capsys: pytest.CaptureFixture):
    """A line for each model, without failures. All have the contacts of the same objects at rest."""
    with pytest.raises(SystemExit) as ended:
        main(Options(slots=3, worlds=3, rounds=1, steps=1, awake=True, json=True, device="cpu"))
    assert ended.value.code == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines() if line.startswith('{"kind"')]
    assert [line["kind"] for line in lines] == ["fixed", "slots", "parked"]
    for line in lines:
        assert line["failure"] is None
        assert line["nacon"] == lines[0]["nacon"] > 12
        assert line["unused"] == 0.0
        assert line["moved"] < 1e-3
