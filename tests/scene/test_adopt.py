"""A model in memory is taken as it is: what it must have, what is refused, and what `edit_spec` changes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.scene.adopt import edit_spec
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.scene.memory import NEAR, cubes_on, model_text, spec_of

PLACED = {"objects": cubes_on("ground", region=NEAR), "home": "init_state"}
AXES = ("1 0 0", "0 1 0", "0 0 1")
ARRAYS = ("body_pos", "body_parentid", "body_mocapid", "jnt_type", "jnt_qposadr", "geom_type", "geom_size", "geom_pos")


def built(model: Any, scene: dict[str, Any] = PLACED) -> SceneModel:
    """Build the scene of a model in memory."""
    return build_model(SceneConfig.load({"model": model, **scene}))


@pytest.mark.parametrize("form", ["spec", "model", "file"])
def test_a_model_that_needs_nothing_is_taken_as_it_is(form: str, tmp_path: Path):
    """From a MjSpec, a MjModel or a file: the same bodies, joints and geoms, and the given one does not change."""
    spec = spec_of()
    given = spec.compile()
    before = {name: getattr(given, name).copy() for name in ARRAYS}
    (tmp_path / "model.xml").write_text(model_text())
    text = spec.to_xml()
    scene = built({"spec": spec, "model": given, "file": tmp_path / "model.xml"}[form])
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(scene.mjm, name), values, err_msg=name)
        np.testing.assert_array_equal(getattr(given, name), values, err_msg=name)
    assert spec.to_xml() == text
    assert list((tmp_path).iterdir()) == [tmp_path / "model.xml"]
    assert scene.bodies == {f"cube_{i}": given.body(f"cube_{i}/cube").id for i in range(3)}
    np.testing.assert_array_equal(scene.home_qpos, given.key("init_state").qpos)
    np.testing.assert_array_equal(scene.home_ctrl, [0.0, 0.3])
    assert scene.mjm.key(scene.keyframe).name == "init_state"
    assert (scene.spec is None) == (form == "model")


def test_without_a_keyframe_the_start_pose_is_that_of_the_model():
    """`home` names a keyframe of the model; without it, and without one called 'home', qpos0 is the start pose."""
    model = spec_of().compile()
    scene = built(model, {"objects": PLACED["objects"]})
    assert scene.keyframe == -1
    np.testing.assert_array_equal(scene.home_qpos, model.qpos0)
    with pytest.raises(UnknownNameError, match=r"home: unknown keyframe of the model 'init'\. Did you mean 'init_st"):
        built(model, {**PLACED, "home": "init"})
    with pytest.raises(SceneKeyError, match=r"'home', .*, only together with 'model'. .* robot's 'keyframe'"):
        SceneConfig.load({"home": "init_state", "objects": {}})


def test_parts_of_an_attached_body_go_by_their_names_without_its_prefix():
    """`cab/drawer` and `cab/slide` are 'drawer' and 'slide' of the object that `cab/cabinet` is."""
    objects = {"cabinet": {"body": "cab/cabinet", "kind": "static", "joints": {"slide": {"fraction": [0, 1]}}}}
    scene = built(spec_of().compile(), {"objects": objects})
    assert list(scene.parts("cabinet")) == ["drawer"]
    assert list(scene.joints("cabinet")) == ["slide"]
    assert scene.support("cabinet/drawer", "here").body == scene.mjm.body("cab/drawer").id


SLIDES = "".join(f'<joint name="{t}{i}" type="{t}" axis="{i}"/>' for t in ("slide", "hinge") for i in AXES)
LOOSE = f"""<mujoco><default><joint armature="0.01"/></default><worldbody>
<geom name="bench" type="box" size=".5 .5 .02"/>
<body name="block" pos="0.1 0 0.05">{SLIDES}<geom type="box" size=".03 .02 .03"/></body>
<body name="lid" pos="0.3 0 0.1"><joint axis="1 0 0"/><geom size=".02" pos="0 0.03 0"/></body></worldbody>
<keyframe><key name="home" qpos="0.1 -0.2 0.03 0.3 0.4 0.5 0.6"/></keyframe></mujoco>"""


def test_three_slides_and_three_hinges_are_a_freejoint(tmp_path: Path):
    """All bodies keep the poses that MuJoCo finds in the keyframe, but joints that something refers to stay."""
    given = mujoco.MjModel.from_xml_string(LOOSE)
    data = mujoco.MjData(given)
    mujoco.mj_resetDataKeyframe(given, data, 0)
    mujoco.mj_kinematics(given, data)
    path = tmp_path / "loose.xml"
    path.write_text(LOOSE)
    scene = built(path, {"objects": {"block": {"on": "bench"}}})
    assert scene.mjm.jnt_type.tolist() == [mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE]
    np.testing.assert_allclose(scene.home.xpos, data.xpos, atol=1e-12)
    np.testing.assert_allclose(scene.home.xmat, data.xmat, atol=1e-12)
    for old, new in (
        ("</mujoco>", '<actuator><motor joint="slide1 0 0"/></actuator></mujoco>'),
        ("</mujoco>", '<sensor><jointpos joint="hinge0 0 1"/></sensor></mujoco>'),
        ('"slide0 0 1"', '"slide0 0 1" range="0 1" limited="true"'),
        ('"slide0 0 1" type="slide" axis="0 0 1"', '"slide0 0 1" type="slide" axis="0 1 0"'),
    ):
        path.write_text(LOOSE.replace(old, new))
        with pytest.raises(SceneKeyError, match="'block' should have a freejoint and no other joint"):
            built(path, {"objects": {"block": {"on": "bench"}}})


WRONG: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "no such body": (
        {"a": {"body": "cube_0/cub", "on": "ground"}},
        UnknownNameError,
        r"objects\.a: unknown body of the model 'cube_0/cub'\. Did you mean 'cube_0/cube'",
    ),
    "not free": ({"a": {"body": "post", "on": "ground"}}, SceneKeyError, r"'post' should have a freejoint"),
    "a part": ({"a": {"body": "cab/drawer", "kind": "static"}}, SceneKeyError, "should be a child of the world"),
    "no mocap": (
        {"a": {"body": "cab/cabinet", "kind": "fixture", "on": "ground", "region": NEAR}},
        SceneKeyError,
        r"objects\.a\.kind: body 'cab/cabinet' should be a mocap body .* Call edit_spec\(spec, scene\)",
    ),
    "twice": (
        {"a": {"body": "cube_0/cube", "on": "ground"}, "b": {"body": "cube_0/cube"}},
        SceneKeyError,
        "body 'cube_0/cube' is already used by object 'a'",
    ),
    "asset and body": ({"a": {"body": "x", "asset": "apple"}}, SceneKeyError, "an 'asset' or a 'body'"),
}


@pytest.mark.parametrize(("objects", "error", "says"), WRONG.values(), ids=WRONG.keys())
@pytest.mark.parametrize("form", ["spec", "model"])
def test_a_body_that_does_not_fit_is_refused(objects: dict, error: type[ScenirisError], says: str, form: str):
    """By the name of the object and of the body, with what would be right."""
    model = spec_of() if form == "spec" else spec_of().compile()
    with pytest.raises(error, match=says):
        built(model, {"objects": objects})


def test_a_body_without_a_model_is_refused():
    """An object that names a body needs a model that has it."""
    for kind in ("free", "marker"):
        with pytest.raises(
            SceneKeyError, match=r"objects\.a\.asset: is missing\. .* the scene a 'model' with a body 'x'"
        ):
            SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"a": {"body": "x", "on": "floor", "kind": kind}}})
    with pytest.raises(SceneKeyError, match=r"model: .* should be the path of an MJCF file, a mujoco\.MjSpec or a"):
        SceneConfig.load({"model": 7, "objects": {}})


ADDED: dict[str, tuple[dict[str, Any], str]] = {
    "asset": ({"objects": {"apple": {"asset": "apple", "on": "ledge"}}}, r"objects\.apple\.asset"),
    "robot": ({"robot": {"asset": "panda"}}, "robot"),
    "floor": ({"floor": {"size": [1, 1]}}, "floor"),
    "marker": (
        {"objects": {"goal": {"kind": "marker", "region": {"box": [[0, 0, 1], [0.1, 0.1, 1.1]]}}}},
        r"objects\.goal",
    ),
}


@pytest.mark.parametrize(("scene", "key"), ADDED.values(), ids=ADDED.keys())
def test_what_is_added_needs_a_spec_or_a_path(scene: dict[str, Any], key: str):
    """MuJoCo cannot turn a MjModel back; a copy of a MjSpec gets what the scene adds."""
    spec = spec_of()
    with pytest.raises(SceneKeyError, match=rf"scene: {key}: would be added .* as a mujoco\.MjSpec or as the path"):
        built(spec.compile(), scene)
    made = built(spec, scene)
    assert made.mjm.nbody + made.mjm.ngeom > spec.compile().nbody + spec.compile().ngeom
    assert spec.compile().nbody == spec_of().compile().nbody


def test_place_on_makes_what_a_scene_needs_and_nothing_else():
    """A fixture becomes a mocap body where it stands, a marker is added; then the MjModel is taken as it is."""
    scene = {
        "objects": {
            **cubes_on("ground", 1, region=NEAR),
            "cabinet": {"body": "cab/cabinet", "kind": "fixture", "on": "ground", "region": NEAR},
            "goal": {"kind": "marker", "region": {"box": [[0, 0, 1], [0.1, 0.1, 1.1]]}},
        },
        "home": "init_state",
    }
    spec, plain = spec_of(), spec_of().compile()
    assert edit_spec(spec, scene) is None
    model = spec.compile()
    assert (model.nmocap, model.nbody, model.nq) == (2, plain.nbody + 1, plain.nq)
    assert model.body("cab/cabinet").mocapid[0] >= 0
    np.testing.assert_array_equal(model.body("cab/cabinet").pos, plain.body("cab/cabinet").pos)
    assert build_model(SceneConfig.load({"model": model, **scene})).bodies.keys() == scene["objects"].keys()
    with pytest.raises(SceneKeyError, match=r"objects\.apple\.asset: edit_spec changes bodies"):
        edit_spec(spec_of(), {"objects": {"apple": {"asset": "apple", "on": "ground", "region": NEAR}}})


def test_members_that_are_parked_need_a_ground():
    """An endless plane at z = 0 is one. A model without it is refused until `edit_spec` has added a slab."""
    scene = {**PLACED, "groups": {"some": {"of": ["cube_0", "cube_1"], "count": [0, 2]}}}
    assert built(spec_of().compile(), scene).mjm.ngeom == spec_of().compile().ngeom
    spec = spec_of()
    spec.geom("ground").type, spec.geom("ground").size = mujoco.mjtGeom.mjGEOM_BOX, [2, 2, 0.01]
    for model in (spec, spec.compile()):
        with pytest.raises(SceneKeyError, match=r"groups: the model has no ground .* Call edit_spec\(spec, scene\)"):
            built(model, scene)
    edit_spec(spec, scene)
    assert built(spec.compile(), scene).mjm.geom("parking_ground").id > 0


def test_a_model_without_ground_gets_a_floor_for_variants():
    """`edit_spec`, which attaches no assets, is no cure for them; the one that is told works."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.1])
    scene = {"objects": {"thing": {"asset": ["can", "mug"], "on": "table"}}}
    with pytest.raises(SceneKeyError, match=r"groups: the model has no ground .* Give the scene a 'floor', or"):
        built(spec, scene)
    assert built(spec, {**scene, "floor": {"size": [1, 1]}}).sim.mjm.nbody == 2


def test_mocap_bodies_stand_where_the_keyframe_has_them():
    """In a MjModel as in one from a file; the given model keeps its own."""
    text = '<mujoco><worldbody><body name="m" mocap="true" pos="1 0 0"><geom size=".1"/></body></worldbody>{}</mujoco>'
    key = '<keyframe><key name="home" mpos="0 2 0" mquat="0 1 0 0"/></keyframe>'
    model = mujoco.MjModel.from_xml_string(text.format(key))
    for given in (model, mujoco.MjSpec.from_string(text.format(key))):
        scene = built(given, {"objects": {}})
        np.testing.assert_allclose(scene.mjm.body("m").pos, [0, 2, 0])
        np.testing.assert_allclose(scene.mjm.body("m").quat, [0, 1, 0, 0])
    np.testing.assert_allclose(model.body("m").pos, [1, 0, 0])
