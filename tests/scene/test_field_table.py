"""Fields that worlds can differ in, and their rows of a name."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import mujoco_warp as mjw
import pytest

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.scene.field_table import FIELDS, OPTIONS, check_field, field_rows
from tests.versions import since_4

SMALL_ARM = Path(__file__).parents[1] / "data" / "small_arm.xml"


@pytest.fixture(scope="module")
def small_arm() -> mujoco.MjModel:
    """Return the model of the small arm."""
    return mujoco.MjModel.from_xml_path(str(SMALL_ARM))


@since_4("fewer fields")
def test_all_fields_are_batched_by_mujoco_warp():
    """Each has a first axis of any length in the installed version."""
    classes = {field: mjw.Option if field in OPTIONS else mjw.Model for field in FIELDS}
    for field, of in classes.items():
        shapes = {f.name: getattr(f.type, "shape", None) for f in dataclasses.fields(of)}
        assert "*" in (shapes[field] or ()), field


@pytest.mark.parametrize(
    ("field", "name", "rows"),
    [
        ("body_mass", "block", "block"),
        ("body_mass", "cabinet/drawer", "cabinet/drawer"),
        ("geom_friction", "block", ["block"]),
        ("geom_friction", "cabinet", ["cabinet", "cabinet/drawer"]),
        ("geom_friction", "floor", "floor"),
        ("dof_damping", "cabinet/slide", "cabinet/slide"),
        ("dof_armature", "arm", ["arm/pan", "arm/lift", "arm/left", "arm/right"]),
        ("actuator_gainprm", "arm/lift", "arm/lift"),
        ("actuator_gainprm", "arm", ["arm/pan", "arm/lift", "arm/grip", "arm/slow"]),
        ("cam_fovy", "overview", "overview"),
        ("tendon_armature", "arm/split", "arm/split"),
    ],
)
def test_names_have_the_rows_of_their_elements(small_arm, field: str, name: str, rows: str | list[str]):
    """A body, geom, joint, actuator, tendon or camera by its name; those inside an object by the name of the object."""
    mjm, found = small_arm, field_rows(small_arm, {}, field, name, "test")
    kind = field.partition("_")[0]
    names = {
        "body": [mjm.body(i).name for i in range(mjm.nbody)],
        "geom": [mjm.geom(i).name or mjm.body(b).name for i, b in enumerate(mjm.geom_bodyid)],
        "dof": [mjm.joint(j).name for j in mjm.dof_jntid],
        "actuator": [mjm.actuator(i).name for i in range(mjm.nu)],
        "cam": [mjm.camera(i).name for i in range(mjm.ncam)],
        "tendon": [mjm.tendon(i).name for i in range(mjm.ntendon)],
    }[kind]
    assert names[found] == rows


@pytest.mark.parametrize(
    ("field", "name", "nearest"),
    [
        ("body_mass", "blok", "block"),
        ("actuator_gainprm", "arm/lifts", "arm/lift"),
        ("geom_friction", "cabinets", "cabinet"),
    ],
)
def test_unknown_names_are_told_with_the_nearest(small_arm, field: str, name: str, nearest: str):
    """Of the kind that the field is of, or of objects."""
    with pytest.raises(UnknownNameError, match=f"'{name}'. Did you mean '{nearest}'"):
        field_rows(small_arm, {}, field, name, "test")


def test_a_name_that_is_no_string_is_unknown(small_arm):
    """MuJoCo would read memory that is not there."""
    with pytest.raises(UnknownNameError, match="unknown body 'None'"):
        field_rows(small_arm, {}, "body_mass", None, "test")  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("field", ["body_pos", "geom_size", "body_subtreemass", "body_mas", "jnt_range", "ngeom"])
def test_other_fields_are_refused(small_arm, field: str):
    """Places, shapes, what follows from other fields, and what is no field."""
    with pytest.raises(UnknownNameError, match=f"test: unknown model field '{field}'"):
        check_field(field, small_arm, "test")


@pytest.mark.parametrize("field", ["tendon_damping", "wind", "actuator_armature"])
def test_fields_that_steps_leave_out_are_refused(small_arm, field: str):
    """As steps would not read what is written to them."""
    if not hasattr(small_arm, field) and not hasattr(small_arm.opt, field):
        pytest.skip("not in this version")
    with pytest.raises(ArgumentError, match="0 in the whole model"):
        check_field(field, small_arm, "test")


def test_a_simple_body_keeps_its_centre_of_mass(small_arm):
    """Its mass matrix is diagonal, and would stay so."""
    with pytest.raises(ArgumentError, match='simple="false"'):
        field_rows(small_arm, {}, "body_ipos", "block", "test")
    assert field_rows(small_arm, {}, "body_ipos", "arm/fore", "test") == small_arm.body("arm/fore").id


def test_elements_that_do_not_follow_each_other_are_refused():
    """As no view has them all."""
    mjm = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body name="a"><joint name="a"/><geom size=".1"/></body><body name="b"><joint name="b"/><geom size=".1"/></body>
  </worldbody>
  <actuator><motor joint="a"/><motor joint="b"/><motor joint="a"/></actuator>
</mujoco>""")
    assert field_rows(mjm, {"a": 1, "b": 2}, "actuator_gainprm", "b", "test") == slice(1, 2)
    with pytest.raises(ArgumentError, match="are not consecutive"):
        field_rows(mjm, {"a": 1, "b": 2}, "actuator_gainprm", "a", "test")
