"""Models of things: stand-ins, and files of LIBERO's kind; and their places, against the numbers of the file."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import SceneFileError, SceneKeyError, UnknownNameError
from sceniris_gym.importers.libero.kinds import FIXTURES, OBJECTS, Kind
from sceniris_gym.importers.libero.places import load_thing, stand_in
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from tests.importers.libero.problems import STACK, write

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
    low, high = bounds(stand_in(name, kind))
    np.testing.assert_allclose(high - low, kind.size, atol=1e-9, err_msg=name)


def test_stand_ins_move_and_have_the_sites_of_the_models():
    """Drawers, a door and a knob; regions inside of walls lie in free space."""
    joints = {name: [joint.name for joint in stand_in(name, kind).joints] for name, kind in FIXTURES.items()}
    assert joints["white_cabinet"] == ["top_level", "middle_level", "bottom_level"]
    assert (joints["microwave"], joints["flat_stove"]) == (["microjoint"], ["button"])
    sites = {name: [site.name for site in stand_in(name, kind).sites] for name, kind in {**OBJECTS, **FIXTURES}.items()}
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


PAN = """
<mujoco model="plate"><worldbody><body><body name="object" pos="0 0.2 0">
  <geom type="cylinder" size="0.05 0.01"/><geom type="box" size="0.02 0.01 0.005" pos="0.06 0.02 0"/>
</body></body></worldbody></mujoco>
"""
"""A plate with a handle, whose bounds are not about its origin."""


def layouts(compiled: CompiledScene, n: int = 128) -> tuple[LayoutTable, dict[str, np.ndarray]]:
    """Return layouts, and the poses (n, 7) of the bodies that LIBERO places, by MuJoCo C."""
    table, mjm = make_table(compiled, n, 0), compiled.mjm
    data, poses = mujoco.MjData(mjm), {name: np.zeros((n, 7)) for name in compiled.config.objects}
    for i in range(n):
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = table.qpos[i], table.mocap_pos[i], table.mocap_quat[i]
        mujoco.mj_kinematics(mjm, data)
        for name, pose in poses.items():
            body = data.body(f"{name}/object")
            pose[i] = [*body.xpos, *body.xquat]
    return table, poses


def headings(pose: np.ndarray) -> np.ndarray:
    """Return the headings [degrees] of upright poses (n, 7)."""
    return np.degrees(2.0 * np.arctan2(pose[:, 6], pose[:, 3]))


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_origins_are_in_the_rectangles_and_turned_as_libero_turns_them(tmp_path: Path):
    """A model whose bounds are not about its origin too; the layouts fill the rectangles."""
    model = tmp_path / "stable_scanned_objects/plate/plate.xml"
    model.parent.mkdir(parents=True)
    model.write_text(PAN)
    compiled = compile_scene(read_bddl(write(tmp_path), assets=tmp_path).scene, "cpu")
    table, poses = layouts(compiled)
    for name, low, high, heading in (
        ("akita_black_bowl_1", [-0.12, -0.02], [-0.08, 0.02], 90.0),
        ("plate_1", [0.02, 0.1], [0.06, 0.14], 90.0),
        ("wooden_cabinet_1", [0.0, -0.31], [0.02, -0.29], 180.0),
        ("flat_stove_1", [-0.21, 0.29], [-0.19, 0.31], 0.0),
    ):
        xy = poses[name][:, :2]
        np.testing.assert_array_less(np.subtract(low, 1e-6), xy.min(0), err_msg=name)
        np.testing.assert_array_less(xy.max(0), np.add(high, 1e-6), err_msg=name)
        assert ((xy.max(0) - xy.min(0)) > 0.7 * np.subtract(high, low)).all(), name
        np.testing.assert_allclose(np.cos(np.radians(headings(poses[name]) - heading)), 1.0, atol=1e-6)
    assert table.valid.all()


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_things_on_sites_stand_on_them_and_joints_are_drawn(tmp_path: Path):
    """A bowl on a cabinet that is turned round, its drawer open, and a stove that is on."""
    compiled = compile_scene(read_bddl(write(tmp_path)).scene, "cpu")
    table, poses = layouts(compiled)
    mjm = compiled.mjm
    site = mjm.site("wooden_cabinet_1/top_side")
    away = poses["akita_black_bowl_2"][:, :3] - poses["wooden_cabinet_1"][:, :3]
    middle = np.array([-site.pos[0], -site.pos[1]])  # the cabinet's heading is 180 degrees
    assert (np.abs(away[:, :2] - middle) < 0.5 * site.size[:2]).all()
    np.testing.assert_allclose(away[:, 2], 0.114 + 0.109 + 0.0005, atol=1e-4)
    np.testing.assert_allclose(np.cos(np.radians(headings(poses["akita_black_bowl_2"]) - 90.0)), 1.0, atol=1e-6)
    for joint, low, high in (("wooden_cabinet_1/top_level", -0.16, -0.14), ("flat_stove_1/button", 0.5, 2.1)):
        drawn = table.qpos[:, mjm.joint(joint).qposadr[0]]
        assert low <= drawn.min() < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < drawn.max() <= high
    closed = mjm.joint("wooden_cabinet_1/bottom_level").qposadr[0]
    assert (table.qpos[:, closed] == 0.0).all()


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_rectangle_may_be_a_point(tmp_path: Path):
    """Its thing is there in all layouts, to 0.05 mm."""
    path = write(tmp_path, **{"(0.02 0.1 0.06 0.14)": "(0.04 0.12 0.04 0.12)"})
    _, poses = layouts(compile_scene(read_bddl(path).scene, "cpu"), 16)
    np.testing.assert_allclose(poses["plate_1"][:, :2], np.tile([0.04, 0.12], (16, 1)), atol=6e-5)


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_thing_on_another_one_is_over_its_middle(tmp_path: Path):
    """On the floor, wherever the other one is."""
    _, poses = layouts(compile_scene(read_bddl(write(tmp_path, STACK)).scene, "cpu"))
    away = poses["akita_black_bowl_1"][:, :3] - poses["cookies_1"][:, :3]
    np.testing.assert_allclose(away, np.tile([0.0, 0.0, 0.0185], (len(away), 1)), atol=1e-4)
    assert np.ptp(poses["cookies_1"][:, 0]) > 0.08


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_thing_over_a_hollow_one_starts_above_its_rim(tmp_path: Path):
    """A bowl that does not fit into a small basket."""
    text = STACK.replace("basket_1 - basket)", "tray_1 - wooden_tray)").replace("basket_1", "tray_1")
    text = text.replace("(On akita_black_bowl_1 cookies_1)", "(On akita_black_bowl_1 tray_1)")
    _, poses = layouts(compile_scene(read_bddl(write(tmp_path, text)).scene, "cpu"), 16)
    away = poses["akita_black_bowl_1"][:, :3] - poses["tray_1"][:, :3]
    np.testing.assert_allclose(away[:, 2], 0.082 + 0.0005, atol=1e-4)
    np.testing.assert_allclose(away[:, :2], 0.0, atol=1e-6)


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_regions_widen_about_their_middles(tmp_path: Path):
    """By the factor, up to the edge of the table."""
    path = write(tmp_path)
    for factor, corners in ((3.0, [[-0.16, -0.06], [-0.04, 0.06]]), (100.0, [[-0.5, -0.6], [0.5, 0.6]])):
        region = read_bddl(path, widen=factor).scene.objects["akita_black_bowl_1"].region
        assert region is not None
        assert region.box is not None
        np.testing.assert_allclose(np.array(region.box), corners, atol=1e-6)


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_clutter_may_stand_anywhere_if_there_are_no_rectangles(tmp_path: Path):
    """On the floor, where things also stand without one."""
    text = STACK.replace("cookies_1 floor_box_region", "cookies_1 floor")
    text = text.replace("(On basket_1 floor_basket_region)", "(On basket_1 floor)")
    text = text.replace("(box_region (:target floor) (:ranges ((-0.05 -0.05 0.05 0.05))))", "")
    text = text.replace("(basket_region (:target floor) (:ranges ((0.2 -0.01 0.22 0.01))))", "")
    objects = read_bddl(write(tmp_path, text), clutter=1).scene.objects
    assert objects["cookies_1"].region is None
    region = objects["clutter_alphabet_soup"].region
    assert region is not None
    assert region.box is not None
    np.testing.assert_allclose(np.array(region.box), [[-1.5, -1.5], [1.5, 1.5]], atol=1e-6)


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_clutter_is_drawn_anew_for_each_layout(tmp_path: Path):
    """Two further things of four, near the rectangles of the file."""
    task = read_bddl(write(tmp_path), clutter=2, widen=1.5)  # which does not widen the region of clutter
    table, poses = layouts(compile_scene(task.scene, "cpu"), 64)
    added = [i for i, name in enumerate(task.scene.objects) if name.startswith("clutter_")]
    assert len(added) == 4
    assert (table.present[:, added].sum(1) == 2).all()
    assert len({tuple(row) for row in table.present[:, added]}) > 1
    for i in added:
        here = poses[list(task.scene.objects)[i]][table.present[:, i]]
        assert (here[:, :2].min(0) > [-0.31 - 1e-6, -0.41 - 1e-6]).all()
        assert (here[:, :2].max(0) < [0.16 + 1e-6, 0.41 + 1e-6]).all()


WRONG = [
    ("plate_1 - plate", "plate_1 - plat", "unknown class of object 'plat'. Did you mean 'plate'?"),
    (
        "flat_stove_1 - flat_stove",
        "flat_stove_1 - stove",
        "unknown class of fixture 'stove'. Did you mean 'flat_stove'?",
    ),
    ("(top_side (:target wooden_cabinet_1))", "(top_side (:target flat_stove_1))", "unknown"),
    ("(On akita_black_bowl_2 wooden_cabinet_1_top_side)", "(On akita_black_bowl_2 flat_stove_1_knob)", "unknown site"),
    ("(On plate_1 kitchen_table_plate_region)", "(On plate_1 flat_stove_1)", "unknown object or region 'flat_stove_1'"),
    ("(Turnon flat_stove_1)", "(Turnon wooden_cabinet_1)", "unknown fixture for Turnon 'wooden_cabinet_1'"),
    ("(Turnon flat_stove_1)", "(Open plate_1)", "unknown fixture for Open 'plate_1'"),
]


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
@pytest.mark.parametrize(("before", "after", "message"), WRONG, ids=[w[1][:30] for w in WRONG])
def test_names_that_the_models_lack_are_errors(before: str, after: str, message: str, tmp_path: Path):
    """A class, a site, and a thing that cannot be opened; each with the line and the nearest name."""
    more = {"(cook_region": "(knob (:target flat_stove_1)) (cook_region"}
    with pytest.raises(UnknownNameError) as raised:
        read_bddl(write(tmp_path, **more, **{before: after}))
    assert message in str(raised.value)
    assert "problem.bddl:" in str(raised.value)


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_fixtures_stand_on_the_work_surface(tmp_path: Path):
    """On nothing else, as in LIBERO."""
    place = "(On flat_stove_1 kitchen_table_stove_region)"
    with pytest.raises(SceneKeyError, match=r"a fixture should be on a rectangle of the work surface 'kitchen_table'"):
        read_bddl(write(tmp_path, **{place: "(On flat_stove_1 plate_1)"}))


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_part_that_does_not_move_cannot_be_opened(tmp_path: Path):
    """The top of a cabinet has no joint."""
    with pytest.raises(SceneKeyError, match=r"bddl:\d+: \(Open .*side\): '.*side' is fixed\. Name"):
        read_bddl(write(tmp_path, **{"(Open wooden_cabinet_1_top_region)": "(Open wooden_cabinet_1_top_side)"}))


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_thing_without_one_place_is_an_error(tmp_path: Path):
    """With the predicate that would give it one; a region of the table needs a rectangle."""
    place = "(On plate_1 kitchen_table_plate_region)"
    for places, count in (("", 0), (f"{place} (On plate_1 akita_black_bowl_1)", 2)):
        wanted = rf"'plate_1' should have one place in ':init', such as \(On plate_1 REGION\), has {count}\."
        with pytest.raises(SceneKeyError, match=wanted):
            read_bddl(write(tmp_path, **{place: places}))
    with pytest.raises(SceneKeyError, match=r"region 'plate_region' .* should have one rectangle .* has 0"):
        read_bddl(write(tmp_path, **{"(:ranges ((0.02 0.1 0.06 0.14)))": ""}))
    with pytest.raises(SceneKeyError, match=r"region 'plate_region' .* should have one rectangle .* has 2"):
        read_bddl(write(tmp_path, **{"(0.02 0.1 0.06 0.14)": "(0.02 0.1 0.06 0.14) (0 0 0.1 0.1)"}))
