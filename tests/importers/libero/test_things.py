"""Models of things: stand-ins of the stated sizes, and files of LIBERO's kind, upright."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import SceneFileError
from sceniris_gym.importers.libero.kinds import FIXTURES, OBJECTS, Kind
from sceniris_gym.importers.libero.things import load_thing, stand_in

BOTTLE = """
<mujoco model="ketchup">
  <asset>
    <texture name="skin" type="2d" builtin="flat" width="8" height="8" rgb1="1 0 0"/>
    <material name="skin" texture="skin"/>
    <texture name="skin" type="2d" builtin="flat" width="8" height="8" rgb1="0 1 0"/>
  </asset>
  <worldbody><body><body name="object" pos="0 -0.1 0.3">
    <geom type="box" size="0.02 0.07 0.01" pos="0 0.01 0" group="0"/>
    <geom type="box" size="0.3 0.3 0.3" group="1" contype="0" conaffinity="0"/>
  </body></body></worldbody>
</mujoco>
"""
"""A model whose y axis points up, with two textures of one name."""


def bounds(spec: mujoco.MjSpec) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the bounds of all boxes that collide [m]."""
    mjm = spec.compile()
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    solid = mjm.geom_contype > 0
    half = np.einsum("nij,nj->ni", np.abs(data.geom_xmat.reshape(-1, 3, 3)), mjm.geom_size)[solid]
    return (data.geom_xpos[solid] - half).min(0), (data.geom_xpos[solid] + half).max(0)


def models(folder: Path, text: str = BOTTLE) -> Path:
    """Write a folder of models with one of the class 'ketchup'."""
    file = folder / "stable_hope_objects/ketchup/ketchup.xml"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    return folder


@pytest.mark.parametrize(("name", "kind"), {**OBJECTS, **FIXTURES}.items(), ids=lambda each: str(each)[:20])
def test_stand_ins_have_the_stated_sizes(name: str, kind: Kind):
    """With all their parts, doors and drawers closed."""
    low, high = bounds(stand_in(kind))
    np.testing.assert_allclose(high - low, kind.size, atol=1e-9, err_msg=name)


def test_stand_ins_move_and_have_the_sites_of_the_models():
    """Drawers, a door and a knob; regions inside of walls lie in free space."""
    joints = {name: [joint.name for joint in stand_in(kind).joints] for name, kind in FIXTURES.items()}
    assert joints["white_cabinet"] == ["top_level", "middle_level", "bottom_level"]
    assert (joints["microwave"], joints["flat_stove"]) == (["microjoint"], ["button"])
    sites = {name: [site.name for site in stand_in(kind).sites] for name, kind in {**OBJECTS, **FIXTURES}.items()}
    assert sites["wooden_two_layer_shelf"] == ["bottom_region", "top_region", "top_side"]
    assert sites["basket"] == sites["wooden_tray"] == ["contain_region"]
    assert sites["plate"] == []


def test_models_stand_upright_on_their_own_axes(tmp_path: Path):
    """Its y axis points up, and its origin is that of the body that LIBERO places, wherever the file has it."""
    spec = load_thing("ketchup", OBJECTS["ketchup"], models(tmp_path), "here")
    assert spec is not None
    low, high = bounds(spec)
    np.testing.assert_allclose(low, [-0.02, -0.01, -0.06], atol=1e-9)
    np.testing.assert_allclose(high, [0.02, 0.01, 0.08], atol=1e-9)
    mjm = spec.compile()
    assert mjm.geom_group.tolist() == [3, 1]
    np.testing.assert_allclose(mjm.body_mass.sum(), 1000.0 * 0.04 * 0.14 * 0.02)  # of what collides


def test_a_class_without_a_file_has_no_model(tmp_path: Path):
    """The reader then takes a stand-in."""
    assert load_thing("milk", OBJECTS["milk"], models(tmp_path), "here") is None


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path):
    """With what MuJoCo says."""
    with pytest.raises(SceneFileError, match=r"here: MuJoCo cannot read '.*ketchup.xml'"):
        load_thing("ketchup", OBJECTS["ketchup"], models(tmp_path, BOTTLE.replace("worldbody", "word")), "here")
