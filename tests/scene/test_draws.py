"""Draws as numbers of the model's fields: their elements and components, ranges, and errors."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.randomize import WORDS
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.draws import LEAST, FieldDraw, at_ends, corners, mean_colours
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.derived import FOLLOWS
from tests.versions import since_4

MODEL = """
<mujoco>
  <option timestep="0.01"/>
  <asset>
    <texture name="wood" type="2d" builtin="flat" rgb1="0.5 0.3 0.1" width="8" height="8"/>
    <texture name="steel" type="2d" builtin="flat" rgb1="0.5 0.5 0.6" width="8" height="8"/>
    <material name="grain" texture="wood" rgba="0.2 0.4 0.6 1"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0 0 3"/><light name="spot" pos="1 0 3"/>
    <camera name="eye" pos="0 -1 1"/>
    <camera name="lens" pos="0 -1 1" sensorsize=".004 .003" resolution="64 48" focal=".004 .004"/>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="shelf" pos="-1 0 .1"><geom type="box" size=".1 .1 .1"/></body>
    <body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".05 .05 .05" material="grain"/>
      <geom type="box" size=".01 .01 .01" pos="0 0 .06" rgba="1 0 0 1" mass="0"/></body>
    <body name="arm" pos="1 0 0"><geom size=".05"/>
      <body name="upper" pos="0 0 .1"><joint name="one" axis="0 1 0" damping="2" frictionloss="0.1"/>
        <geom type="capsule" size=".02 .1" pos="0 0 .1" mass="1"/>
        <body name="fore" pos="0 0 .2"><joint name="two" axis="0 1 0" damping="4"/>
          <geom type="capsule" size=".02 .1" pos="0 0 .1" mass="0.5"/></body></body></body>
  </worldbody>
  <actuator>
    <position name="one" joint="one" kp="10" kv="1"/>
    <position name="two" joint="two" kp="20" kv="2" forcerange="-5 5" delay="0.02" nsample="3"/>
  </actuator>
</mujoco>
"""


@pytest.fixture
def build(tmp_path: Path):
    """Return a function that builds the scene with some draws."""
    path = tmp_path / "model.xml"
    path.write_text(MODEL if hasattr(mujoco.MjModel, "nhistory") else MODEL.replace(' delay="0.02" nsample="3"', ""))

    def make(box: dict | None = None, arm: dict | None = None, **scene: Any) -> SceneModel:
        parts = {"objects": {"box": {"on": "floor", "randomize": box or {}}}}
        robot = {"robot": {"in_model": "arm", "tcp": {"body": "fore"}, "randomize": arm or {}}}
        return build_model(SceneConfig.load({"model": str(path)} | parts | robot | scene))

    return make


def only(scene: SceneModel) -> FieldDraw:
    """Return the draw of a scene with a single one."""
    (draw,) = scene.draws
    return draw


@pytest.mark.parametrize(
    ("part", "words", "name", "elements", "components", "width"),
    [
        ("box", {"mass": {"scale": [0.5, 2]}}, "box.mass", ["box"], [0], 1),
        ("arm", {"mass": {"scale": [0.5, 2]}}, "robot.mass", ["arm", "upper", "fore"], [0], 1),
        ("arm", {"mass": {"scale": [0.5, 2], "each": True}}, "robot.mass", ["arm", "upper", "fore"], [0], 3),
        ("arm", {"damping": {"scale": [0.5, 2], "each": True}}, "robot.damping", ["one", "two"], [0], 2),
        ("arm", {"frictionloss": {"add": [0, 1]}}, "robot.frictionloss", ["one"], [0], 1),
        ("arm", {"gains": {"scale": [0.5, 2]}}, "robot.gains", ["one", "two"], [0], 1),
        ("arm", {"ipos": {"add": [[0, 0, 0], [0.01, 0.01, 0]]}}, "robot.ipos", ["arm", "upper", "fore"], [0, 1, 2], 3),
        ("box", {"friction": {"scale": [0.5, 2]}}, "box.friction", ["", ""], [0], 1),
        ("box", {"friction": {"scale": [[0.5] * 3, [2] * 3]}}, "box.friction", ["", ""], [0, 1, 2], 3),
        ("box", {"rgba": {"scale": [0.5, 1]}}, "box.rgba", ["", ""], [0, 1, 2], 1),
        ("box", {"rgba": {"abs": [[0] * 4, [1] * 4]}}, "box.rgba", ["", ""], [0, 1, 2, 3], 4),
        ("box", {"rgba": {"choice": [[1, 0, 0], [0, 1, 0]], "each": True}}, "box.rgba", ["", ""], [0, 1, 2], 2),
    ],
)
def test_a_word_has_its_elements_and_components(build, part, words, name, elements, components, width):
    """One number is drawn for all elements, or one for each; a list of numbers is for the components."""
    scene = build(**{part: words})
    draw, kind = only(scene), only(scene).word.field.partition("_")[0]
    of: dict[str, Any] = {"dof": lambda i: scene.mjm.joint(scene.mjm.dof_jntid[i]), "jnt": scene.mjm.joint}
    names = [(of.get(kind) or getattr(scene.mjm, kind))(int(i)).name for i in draw.rows]
    assert (draw.name, names, draw.components.tolist(), draw.width) == (name, elements, components, width)


@pytest.mark.parametrize(
    ("words", "low", "high"),
    [
        ({"scale": [0.5, 2]}, [0.5, 0.005, 1e-4], [2.0, 0.005, 1e-4]),
        ({"abs": [[0, 0.1, 0.1], [1, 0.2, 0.3]]}, [0.0, 0.1, 0.1], [1.0, 0.2, 0.3]),
        ({"add": [0.0, 0.1], "distribution": "normal"}, [0.7, 0.005, 1e-4], [1.3, 0.005, 1e-4]),
        ({"choice": [0.4, 0.9, 0.8]}, [0.4, 0.005, 1e-4], [0.9, 0.005, 1e-4]),
    ],
)
def test_bounds_are_the_least_and_greatest_values(build, words: dict, low: list[float], high: list[float]):
    """Of a normal distribution they are three standard deviations from the mean; of 1, 0.005 and 0.0001 here."""
    scene = build(box={"friction": words})
    geom = scene.mjm.body_geomadr[scene.bodies["box"]]
    found = [mjm.geom_friction[geom] for mjm in (scene.least, scene.most)]
    np.testing.assert_allclose(found, [low, high], rtol=1e-6)


def test_the_whole_scene_lights_and_materials(build):
    """Lights by a pattern, textures by their names."""
    lights = {"*": {"castshadow": {"choice": [True, False]}}, "lamp": {"pos": {"add": [[-1, -1, 0], [1, 1, 0]]}}}
    materials = {"grain": {"texid": {"choice": ["steel", "wood"]}}}
    words = {"gravity": {"add": [[0, 0, -1], [0, 0, 1]]}, "lights": lights, "materials": materials}
    draws = {draw.name: draw for draw in build(randomize=words).draws}
    assert list(draws) == ["gravity", "lights.*.castshadow", "lights.lamp.pos", "materials.grain.texid"]
    assert draws["lights.*.castshadow"].rows.tolist() == [0, 1]
    assert draws["lights.lamp.pos"].rows.tolist() == [0]
    np.testing.assert_array_equal(draws["materials.grain.texid"].choice, [[1.0], [0.0]])


@pytest.mark.parametrize(
    ("scene", "error", "message"),
    [
        (
            {"box": {"mass": {"add": [-5, 1]}}},
            SceneKeyError,
            "mass.add: cannot be .* from -4.* should be from 1e-06",
        ),
        ({"box": {"rgba": {"scale": [1, 5]}}}, SceneKeyError, "rgba.scale: .* should be from 0 to 1"),
        (
            {"arm": {"forcerange": {"abs": [4, 6]}}},
            SceneKeyError,
            "forcerange.abs: .* lower limits should be below upper limits",
        ),
        ({"box": {"rgba": {"abs": [[0, 0], [1, 1]]}}}, SceneKeyError, "should have 1 or 3 or 4 numbers, got 2"),
        (
            {"box": {"damping": {"scale": [1, 2]}}},
            SceneKeyError,
            "box.randomize.damping: cannot be .*: its value is 0 in the model",
        ),
        ({"box": {"gains": {"scale": [1, 2]}}}, SceneKeyError, "no selected element has or uses"),
        (
            {"box": {"mass": {"choice": ["heavy"]}}},
            SceneKeyError,
            "choice: .* its values should be numbers, got 'heavy'",
        ),
        (
            {"box": {"solref": {"abs": [[-100, -1], [0.02, 1]]}}},
            SceneKeyError,
            "solref.abs: .* should be all above 0, or all at most 0",
        ),
        (
            {"box": {"solimp": {"abs": [[0.9, 0.95, 0.001, 0.5, 2], [0.9, 1.5, 0.001, 0.5, 2]]}}},
            SceneKeyError,
            "solimp.abs: .* from 0.95 to 1.5, but should be from 0 to 1",
        ),
        (
            {"box": {"solimp": {"abs": [[0.9, 0.95, 0.001, 0.5, 0.5], [0.9, 0.95, 0.001, 0.5, 2]]}}},
            SceneKeyError,
            "solimp.abs: .* its values of component 5 would be from 0.5 to 2, but should be from 1 to inf",
        ),
        ({"randomize": {"lights": {"lam": {"pos": {"add": [0, 1]}}}}}, UnknownNameError, "Did you mean 'lamp'"),
        (
            {"randomize": {"materials": {"grain": {"texid": {"choice": ["steal"]}}}}},
            UnknownNameError,
            "texid.choice: unknown texture 'steal'. Did you mean 'steel'",
        ),
        (
            {"randomize": {"materials": {"grain": {"texid": {"choice": [99]}}}}},
            UnknownNameError,
            "texid.choice: unknown texture .*99.* Valid:",
        ),
        ({"box": {"frictionloss": {"abs": [0, 1]}}}, SceneKeyError, r"0 in the model. Change it there\.$"),
    ],
)
def test_draws_that_the_model_cannot_have_are_refused(build, scene: dict, error: type, message: str):
    """Out of range, without effect, or of names that are not there."""
    with pytest.raises(error, match=message):
        build(**scene)


@pytest.mark.parametrize(
    "scene",
    [
        {"box": {"stiffness": {"abs": [1, 2]}}},  # would pull it to its place in the model
        {"objects": {"shelf": {"kind": "static", "randomize": {"mass": {"scale": [1, 2]}}}}},
        {"randomize": {"cameras": {"lens": {"fovy": {"scale": [0.9, 1.1]}}}}},  # has a focal length
    ],
)
def test_draws_that_nothing_reads_are_refused(build, scene: dict):
    """Of free bodies, of those that never move, and of cameras with a lens."""
    with pytest.raises(SceneKeyError, match=r"cannot be .*: no selected element has or uses this value"):
        build(**scene)


def test_both_formats_of_solref_can_be_chosen_from(build):
    """Each value has one of them."""
    assert only(build(box={"solref": {"choice": [[0.02, 1], [-100, -1]]}})).choice.shape == (2, 2)
    with pytest.raises(SceneKeyError, match="should be all above 0, or all at most 0"):
        build(box={"solref": {"choice": [[0.02, 1], [-100, 1]]}})


def test_elements_that_do_not_read_a_field_are_left_out(build):
    """Actuators without limits, cameras with a lens."""
    limits = only(build(arm={"forcerange": {"abs": [[-3, 3], [-3, 3]]}}))
    assert limits.rows.tolist() == [1]
    scene = build(randomize={"cameras": {"*": {"fovy": {"scale": [0.9, 1.1]}}}})
    assert scene.mjm.camera("lens").id not in only(scene).rows.tolist()


@pytest.mark.parametrize(
    ("randomize", "form"),
    [
        ({"cameras": {"eye": {"quat": {"scale": [0.5, 2]}}}}, "add"),
        ({"cameras": {"eye": {"quat": {"choice": [[10, 0, 0], [0, 10, 0]]}}}}, "add"),
        ({"lights": {"lamp": {"castshadow": {"abs": [0, 1]}}}}, "choice"),
        ({"materials": {"grain": {"texid": {"abs": [0, 1000]}}}}, "choice"),
    ],
)
def test_forms_without_a_meaning_are_refused(build, randomize: dict, form: str):
    """Cameras turn by terms; flags and textures are chosen."""
    with pytest.raises(SceneKeyError, match=f"it should be given by '{form}'"):
        build(randomize=randomize)


def test_two_draws_of_the_same_values_are_refused(build):
    """As chance would decide between them on a GPU."""
    draw = {"pos": {"add": [-1, 1]}}
    with pytest.raises(SceneKeyError, match=r"lights.\*.pos: cannot be .* 'lights.lamp.pos' draws some of the same"):
        build(randomize={"lights": {"lamp": draw, "*": draw}})
    assert len(build(randomize={"lights": {"lamp": draw, "spot": draw}}).draws) == 2


@since_4("no delays")
def test_a_delay_lasts_as_long_as_the_memory_of_the_actuator(build):
    """As long as the file makes it; actuators without one have no delay to draw."""
    assert only(build(arm={"delay": {"abs": [0, 0.03]}})).rows.tolist() == [1]
    with pytest.raises(SceneKeyError, match=r"delay.abs: .* from 0 to 0.05, but should be from 0 to 0.03"):
        build(arm={"delay": {"abs": [0, 0.05]}})


@since_4("no such attribute")
def test_a_body_with_a_drawn_centre_of_mass_has_a_full_mass_matrix(build):
    """It would be diagonal otherwise, as the box is symmetric."""
    assert build().mjm.body("box").simple[0]
    plain = build(box={"ipos": {"add": [-0.01, 0.01]}})
    assert not plain.mjm.body_simple[only(plain).rows].any()


def test_scenes_with_draws_have_hashes_of_their_own(build, tmp_path: Path):
    """They depend on lights and materials of the model, which other scenes do not see."""
    mass = {"mass": {"scale": [0.5, 2]}}
    before = [build().hash, build(box=mass).hash]
    assert build(box={"mass": {"scale": [0.5, 3]}}).hash not in before
    path = tmp_path / "model.xml"
    path.write_text(path.read_text().replace('pos="1 0 3"', 'pos="2 0 3"'))
    after = [build().hash, build(box=mass).hash]
    assert before[0] == after[0]
    assert before[1] != after[1]


ENDS = """<mujoco><worldbody><geom name="floor" type="plane" size="2 2 .1"/>
  <body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".05 .05 .05" mass="2" friction=".8 .01 .001"/></body>
  <body name="arm" pos="1 0 0"><geom size=".05"/><body name="fore" pos="0 0 .1"><joint name="one" axis="0 1 0"/>
    <geom type="capsule" size=".02 .1" pos="0 0 .1" mass="1"/></body></body></worldbody>
  <actuator><position name="one" joint="one" kp="10" kv="1" forcerange="-5 5"/></actuator></mujoco>"""
ROOT = Path(__file__).parents[2] / "sceniris_gym"
# Expressions that may name a model of their own: one at such ends, or what gets a row for each world.
ENDLESS = {"ipos", "rgba", "bias", "delay", "wind"}
LISTED = {
    "program/checks/oddities.py": {
        "mjm.body_mass",
        "mjm.body_inertia",
        "scene.mjm.body_subtreemass",
    },  # only a warning about what the file has
    "program/checks/standing.py": {"model.opt.gravity"},
    "program/dropping.py": {"model.dof_armature"},
    # where a control range ends: drawn gains scale both, and a drawn bias or spring shifts the ends of fingers by its
    # share, while grasps keep the opening of the model
    "grasping/gripper.py": {"mjm.actuator_gainprm", "mjm.actuator_biasprm", "mjm.jnt_stiffness"},
    "grasping/linkage.py": {"mjm.jnt_stiffness"},  # only chooses among positions that close a loop
    "program/loads.py": {"windy.opt.wind", "windy.body_mass", "mjm.body_invweight0", "mjm.weights"},
    "program/pack/program.py": {"mjm.body_ipos", "mjm.weights"},
    "grasping/grip.py": {"alone.opt.gravity", "mjm.actuator_gainprm", "mjm.actuator_biasprm"},
}


def scene_with(box: dict[str, Any], arm: dict[str, Any], **scene: Any) -> SceneModel:
    """Build the scene of a box and an arm with these draws."""
    robot = {"in_model": "arm", "tcp": {"body": "fore"}, "randomize": arm}
    objects = {"box": {"on": "floor", "randomize": box}}
    model = mujoco.MjSpec.from_string(ENDS)
    return build_model(SceneConfig.load({"model": model, "objects": objects, "robot": robot, "randomize": scene}))


def test_fields_are_at_their_ends_with_all_that_follows():
    """Masses with inertias and inverse weights, gains with those of the bias, ranges of forces, choices, gravity."""
    box = {"mass": {"scale": [0.5, 3.0]}, "friction": {"choice": [0.4, 1.1, 0.7]}}
    arm = {"gains": {"scale": [0.5, 1.5]}, "bias": {"add": [-2, 1]}, "forcerange": {"abs": [[-6, 2], [-3, 4]]}}
    scene = scene_with(box, arm, gravity={"add": [[-0.1, 0, -1], [0.05, 0, 1]]})
    nominal, body = scene.mjm, scene.mjm.body("box").id
    for mjm, mass, friction, gain in ((scene.least, 1.0, 0.4, 5.0), (scene.most, 6.0, 1.1, 15.0)):
        assert mjm.body_mass[body] == pytest.approx(mass)
        np.testing.assert_allclose(mjm.body_inertia[body], nominal.body_inertia[body] * mass / 2.0)
        assert mjm.body_invweight0[body, 0] == pytest.approx(1.0 / mass)
        np.testing.assert_allclose(mjm.geom_friction[mjm.body_geomadr[body]], [friction, 0.01, 0.001])
        assert mjm.actuator_gainprm[0, 0] == pytest.approx(gain)
        np.testing.assert_allclose(mjm.actuator_biasprm[0, 1:3], [-gain, -gain / 10.0])
    weak = at_ends(nominal, scene.draws, actuator_forcerange=("most", "least"), gravity="least")
    np.testing.assert_allclose(weak.actuator_forcerange[0], [-3, 2])
    np.testing.assert_allclose(weak.opt.gravity, [-0.1, 0, -10.81])
    assert weak.body_mass[body] == 2.0
    assert corners(scene.draws, "actuator_biasprm") == [("least",), ("most",)]
    assert corners(scene.draws, "body_ipos") == [()]
    assert nominal.body_mass[body] == 2.0


def test_a_scene_without_draws_has_one_model():
    """No copy is made, and looks change nothing."""
    scene = scene_with({"rgba": {"abs": [0, 1]}}, {})
    assert scene.least is scene.most is scene.mjm


def test_proofs_read_no_number_that_may_be_drawn_from_the_model_alone():
    """Names of such fields in `program/` and `grasping/` follow `least`, `most`, or an expression that is listed."""
    fields = {*LEAST} | {name for word in WORDS["object"].values() for name, _, _ in word.follow}
    fields |= {name for name, of in FOLLOWS.items() if fields.intersection(of) and name[:3] not in ("cam", "lig")}
    found: dict[str, set[str]] = {}
    for path in [*(ROOT / "program").rglob("*.py"), *(ROOT / "grasping").rglob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr in fields:
                of, name = node.value, ast.unparse(node)
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "weights":
                of, name = node.args[0], f"{ast.unparse(node.args[0])}.weights"
            else:
                continue
            if ast.unparse(of).removesuffix(".opt").rpartition(".")[2] not in {"least", "most"}:
                found.setdefault(path.relative_to(ROOT).as_posix(), set()).add(name)
    assert found == LISTED


def test_each_word_of_physics_says_at_which_end_proofs_read_it():
    """But for those of which no end is the worst: proofs take all corners of these, or do not depend on them."""
    words = {**WORDS["object"], **WORDS["scene"]}
    assert {name for name, word in words.items() if not word.weak and not word.loose} == ENDLESS


def test_the_mean_colour_of_a_geom_has_its_texture():
    """Times the colour of the geom, or of its material where the geom has none."""
    mjm = mujoco.MjModel.from_xml_string(
        "<mujoco><asset>"
        "<texture name='t' type='2d' builtin='checker' width='4' height='4' rgb1='1 0 0' rgb2='0 0 1'/>"
        "<material name='tiles' texture='t' rgba='.5 1 1 .8'/><material name='plain' rgba='0 1 0 1'/>"
        "</asset><worldbody>"
        "<geom size='.1' material='tiles'/><geom size='.1' material='tiles' rgba='1 1 .2 1'/>"
        "<geom size='.1' material='plain'/><geom size='.1' rgba='.1 .2 .3 1'/>"
        "</worldbody></mujoco>"
    )
    colours = [[0.25, 0.0, 0.5, 0.8], [0.5, 0.0, 0.1, 1.0], [0.0, 1.0, 0.0, 1.0], [0.1, 0.2, 0.3, 1.0]]
    np.testing.assert_allclose(mean_colours(mjm), colours, atol=1e-6)


def test_an_object_on_several_supports_is_drawn_on_each():
    """Each member has a body of its own in the model of layouts, and all have one name."""
    words = {"asset": "apple", "on": ["counter", "floor"], "randomize": {"mass": {"scale": [0.5, 2.0]}}}
    objects = {"counter": {"asset": "counter", "kind": "fixture", "on": "floor"}, "apple": words}
    scene = build_model({"floor": {"size": [2.0, 2.0]}, "objects": objects})
    bodies = [scene.mjm.body(int(row)).name for draw in scene.draws for row in draw.rows]
    assert bodies == ["apple/@counter", "apple/@floor"]
    assert {draw.name for draw in scene.draws} == {"apple.mass"}
    drawn = [scene.bodies[name] for name in bodies]
    np.testing.assert_allclose(scene.least.body_mass[drawn], 0.5 * scene.mjm.body_mass[drawn])
