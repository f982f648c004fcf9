"""Scenes as they are simulated: one body for all variants, with room for their geoms, and files that are left out."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ModelWarning, SceneFileError, SceneKeyError, UnknownNameError
from sceniris_gym.scene import assemble
from sceniris_gym.scene.build import build_model, build_variants
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.variants import geom_classes
from tests.config.scenes import TABLE
from tests.versions import since_4

THINGS = ("can", "mug", "book")
GEOM = '<geom type="box" size=".02 .02 .02" pos="0 0 .02"/>'
SOUND = f"<mujoco><worldbody><body>{GEOM}</body></worldbody></mujoco>"
BROKEN = {
    "cut": "<mujoco><worldbody>",
    "jointed": f"<mujoco><worldbody><body>{GEOM}<body><joint/>{GEOM}</body></body></worldbody></mujoco>",
    "without_mesh": '<mujoco><asset><mesh name="m" file="m.obj"/></asset><worldbody><body><geom type="mesh" mesh="m"/>'
    "</body></worldbody></mujoco>",
}


def built() -> SceneModel:
    """A table with apple and bowl on it, and an object with three variants."""
    words = {"asset": list(THINGS), "on": "table", "gap": 0.001}
    return build_model(SceneConfig.load(TABLE, {"objects.target": words}))


def classes(mjm: mujoco.MjModel, body: int) -> Counter:
    """Count the geoms of a body by class."""
    kinds = geom_classes(mjm)
    return Counter(kinds[geom] for geom in np.flatnonzero(mjm.geom_bodyid == body))


def test_a_shared_body_has_room_for_every_variant():
    """As many geoms of each class as the variant with most of it, a freejoint, and no body of its own for a variant."""
    scene = built()
    sim = scene.sim
    shared = classes(sim.mjm, sim.bodies["target"])
    own = [classes(scene.mjm, scene.bodies[f"target/{name}"]) for name in THINGS]
    assert shared == own[0] | own[1] | own[2]
    assert sim.mjm.jnt_type[sim.mjm.body_jntadr[sim.bodies["target"]]] == mujoco.mjtJoint.mjJNT_FREE
    assert [*sim.bodies] == [*TABLE["objects"], "target"]
    assert sim.hash == scene.hash
    assert not sim.config.groups
    assert sim.mjm.body_simple[sim.bodies["target"]] == 0


DEEPER = '<body pos="0 0.02 0.01" quat="1 0 1 0"><geom type="box" size=".02 .01 .01" pos="0 0 .01"/></body>'


@pytest.mark.parametrize("deeper", ["", pytest.param(DEEPER, marks=since_4("frames in frames are written wrongly"))])
def test_nested_bodies_without_joints_are_one_rigid_body(tmp_path: Path, deeper: str):
    """With the mass, the centre of mass and the geoms that MuJoCo finds in the nested bodies, at any level."""
    inner = f'<body pos="0.01 0.02 0.03" quat="1 1 0 0">{GEOM}{deeper}</body>'
    inner += '<body pos="-0.03 0 0"><geom size=".01"/></body>'
    path = tmp_path / "nested.xml"
    path.write_text(f"<mujoco><worldbody><body>{inner}</body></worldbody></mujoco>")
    words = {"variants": {"nested": {"asset": str(path)}, "can": {"asset": "can"}}, "on": "table"}
    built = build_model(SceneConfig.load(TABLE, {"objects.target": words}))
    mjm, body = built.mjm, built.bodies["target/nested"]
    alone = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(alone)
    mujoco.mj_forward(alone, data)
    assert mjm.body_mass[body] == pytest.approx(alone.body_subtreemass[1])
    np.testing.assert_allclose(mjm.body_ipos[body], data.subtree_com[1], atol=1e-9)
    np.testing.assert_allclose(mjm.geom_pos[mjm.geom_bodyid == body], data.geom_xpos, atol=1e-9)
    assert built.sim.mjm.body("target").id


def test_models_do_not_depend_on_how_many_variants_are_attached_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Not even with files of one name, and the model can be written and read again; `paths` are not simulated."""
    for i in range(5):
        (tmp_path / f"thing_{i}").mkdir()
        trimesh.creation.box([0.02, 0.03, 0.01 * (i + 2)]).export(tmp_path / f"thing_{i}" / "part.stl")
        mesh = f'<mesh name="part" file="thing_{i}/part.stl"/>'
        body = '<body name="thing"><geom class="part"/></body>'
        words = f'<default><default class="part"><geom type="mesh" mesh="part" mass="{i + 1}"/></default></default>'
        words += f"<asset>{mesh}</asset><worldbody>{body}</worldbody>"
        (tmp_path / f"thing_{i}.xml").write_text(f"<mujoco>{words}</mujoco>")
    config = SceneConfig.load(TABLE, {"objects.target": {"asset": str(tmp_path / "thing_*"), "on": "table"}})
    one_by_one, by_twos = [], []
    for count, found in ((1, one_by_one), (2, by_twos)):
        monkeypatch.setattr(assemble, "_AT_ONCE", count)
        scene = build_model(config)
        assert scene.spec is not None
        again = mujoco.MjSpec.from_string(scene.spec.to_xml(), assets=scene.spec.assets).compile()
        found += [arrays_of(scene.mjm), arrays_of(scene.sim.mjm), again.body_mass, again.mesh_vert]
    np.testing.assert_equal(by_twos, one_by_one)


def arrays_of(mjm: mujoco.MjModel) -> dict[str, np.ndarray]:
    """The arrays of a model, and its names."""
    names = [name for name in dir(mjm) if not name.startswith("_") and "path" not in name]
    arrays = {name: getattr(mjm, name) for name in names}
    return {name: array for name, array in arrays.items() if isinstance(array, np.ndarray)} | {"names": mjm.names}


def test_all_meshes_keep_their_hulls():
    """Those that no geom of the shared body names, too: without a hull, contacts of several points would be lost."""
    check_meshes(built())


def test_no_geom_is_simulated_for_a_name_alone(tmp_path: Path):
    """Unless a model of the user's discards meshes that no geom names; they keep their hulls then, too."""
    scene = built()
    assert scene.sim.mjm.nbody == scene.mjm.nbody - len(THINGS) + 1
    ground = '<worldbody><geom name="ground" type="plane" size="1 1 .1"/></worldbody>'
    (tmp_path / "model.xml").write_text(f'<mujoco><compiler discardvisual="true"/>{ground}</mujoco>')
    thing = {"asset": list(THINGS), "on": "ground"}
    check_meshes(build_model(SceneConfig.load({"model": str(tmp_path / "model.xml"), "objects": {"target": thing}})))


def check_meshes(scene: SceneModel) -> None:
    """Check that meshes are the same with all variants and as they are simulated, with their hulls."""
    for field in ("mesh_graphadr", "mesh_graph", "mesh_polynum", "mesh_vertadr", "mesh_pos", "mesh_quat"):
        np.testing.assert_array_equal(getattr(scene.mjm, field), getattr(scene.sim.mjm, field))


def test_nothing_is_parked_unless_a_group_needs_it():
    """The ground far away, which a scene without a floor has, is there for members of groups alone."""
    air = {"region": {"box": [[0, 0, 1], [1, 1, 2]]}}
    words = {"objects": {"target": {"asset": list(THINGS), **air}, "apple": {"asset": "apple", **air}}}
    for groups, parks in (({}, False), ({"some": {"of": ["apple"], "count": [0, 1]}}, True)):
        scene = build_model(SceneConfig.load({**words, "groups": groups}))
        full, sim = (mujoco.mj_name2id(m.mjm, mujoco.mjtObj.mjOBJ_GEOM, "parking_ground") for m in (scene, scene.sim))
        assert full >= 0
        assert (sim >= 0) == parks


def test_other_objects_are_where_they_were():
    """Bodies find those that they are simulated as, and start in the same pose; a scene without variants is itself."""
    scene = built()
    found = {scene.mjm.body(b).name: scene.sim.mjm.body(int(scene.sim_bodies[b])).name for b in range(scene.mjm.nbody)}
    assert {found.pop(f"target/{name}") for name in THINGS} == {"target"}
    assert all(name == other for name, other in found.items())
    plain = build_model(SceneConfig.load(TABLE))
    assert plain.sim is plain
    assert (plain.sim_bodies == np.arange(plain.mjm.nbody)).all()


def on_a_table(*names: str) -> mujoco.MjSpec:
    """Return a model with the ground, a table and free spheres."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.1])
    for name in names:
        body = spec.worldbody.add_body(name=name)
        body.add_freejoint()
        body.add_geom(size=[0.02, 0, 0])
    return spec


@pytest.mark.parametrize("compiled", [False, True])
def test_bodies_of_a_model_are_no_variants(compiled: bool):
    """One body has to be all of them, and a model of the user's own is not changed."""
    spec = on_a_table("thing/cube", "thing/brick")
    words = {"thing": {"variants": {"cube": {}, "brick": {}}, "on": "table"}}
    config = SceneConfig.load({"model": spec.compile() if compiled else spec, "objects": words})
    with pytest.raises(
        SceneKeyError, match=r"objects\.thing\.variants: 'cube' has no asset\. Give this variant an 'asset'"
    ):
        build_model(config)


def test_bodies_of_a_model_are_variants_where_another_model_is_simulated():
    """As in environments of mjlab, whose one body has the shape of one variant in each world."""
    words = {"model": on_a_table("thing").compile(), "objects": {"thing": {"on": "table"}}}
    simulated = SceneConfig.load(words)
    words = {"model": on_a_table("thing/cube", "thing/brick").compile()}
    words["objects"] = {"thing": {"variants": {"cube": {}, "brick": {}}, "on": "table"}}
    assert {"thing/cube", "thing/brick"} <= set(build_variants(SceneConfig.load(words), simulated).bodies)


def scene(folder: Path, files: dict[str, str]) -> SceneConfig:
    """Return a scene with a thing whose variants are these files."""
    for name, text in files.items():
        (folder / f"{name}.xml").write_text(text)
    thing = {"asset": str(folder / "*"), "on": "floor", "holdout": 0.5}
    return SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"thing": thing}})


def test_files_that_cannot_be_variants_are_left_out_and_named(tmp_path: Path):
    """The scene is that of the others; an override is applied to the scene as it is written."""
    config = scene(tmp_path, {**BROKEN, "a": SOUND, "b": SOUND})
    with pytest.warns(ModelWarning, match=r"objects\.thing\.asset: 3 of 5 files") as told:
        found = build_model(config)
    message = str(told[0].message)
    assert all(f"objects.thing/{name}" in message for name in BROKEN)
    assert found.config.variants == {"thing": ("thing/a", "thing/b")}
    assert set(found.config.groups["thing"].splits) == {"thing/a", "thing/b"}
    assert found.mjm.body("thing/b").id > 0
    assert found.sim.mjm.nbody == found.mjm.nbody - 1
    assert SceneConfig.load(found.config, {"objects.thing.gap": 0.001}).variants == config.variants


def test_an_override_of_one_file_leaves_the_folder_a_folder(tmp_path: Path):
    """Files that are broken are still left out, and a share is held out of what is left."""
    overrides = {"objects.thing/a.gap": 0.002, "objects.thing/a.weight": 2, "objects.thing/cut.weight": 3}
    config = SceneConfig.load(scene(tmp_path, {**BROKEN, "a": SOUND, "b": SOUND}), overrides)
    with pytest.warns(ModelWarning, match="3 of 5 files"):
        found = build_model(config).config
    assert {name: part.gap for name, part in found.objects.items()} == {"thing/a": 0.002, "thing/b": 0.0005}
    assert set(found.groups["thing"].splits) == {"thing/a", "thing/b"}
    assert found.groups["thing"].weights == {"thing/a": 2.0}
    assert len(SceneConfig.load(found, {"objects.thing.holdout": 0.7}).variants["thing"]) == 5


def test_a_file_is_left_out_for_the_reason_that_a_variant_is_refused_for(tmp_path: Path):
    """A soft one is told to be soft, and one whose kind drops the joint of its motor to have that."""
    cloth = '<flexcomp type="grid" count="3 3 3" spacing=".02 .02 .02" name="f" dim="3" mass=".1"/>'
    motor = '<actuator><motor joint="j"/></actuator>'
    files = {
        "a": SOUND,
        "b": SOUND,
        "soft": f'<mujoco><worldbody><body name="soft">{cloth}</body></worldbody></mujoco>',
        "driven": f'<mujoco><worldbody><body><freejoint name="j"/>{GEOM}</body></worldbody>{motor}</mujoco>',
    }
    config = SceneConfig.load(scene(tmp_path, files), {"objects.thing.kind": "fixture"})
    with pytest.warns(ModelWarning, match="2 of 4 files") as told:
        found = build_model(config)
    assert found.config.variants == {"thing": ("thing/a", "thing/b")}
    assert "objects.thing/soft: is soft" in str(told[0].message)
    assert "actuators refer to root joints of variants, but variants lose these joints" in str(told[0].message)


def test_files_of_each_folder_are_left_out(tmp_path: Path):
    """Of two folders that both have one: neither brings back that of the other."""
    objects = {}
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        for file, text in {"cut": BROKEN["cut"], "a": SOUND, "b": SOUND}.items():
            (tmp_path / name / f"{file}.xml").write_text(text)
        objects[name] = {"asset": str(tmp_path / name / "*"), "on": "floor"}
    with pytest.warns(ModelWarning, match="1 of 3 files"):
        found = build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects}))
    assert found.config.variants == {"first": ("first/a", "first/b"), "second": ("second/a", "second/b")}


def test_a_folder_without_a_sound_file_is_refused(tmp_path: Path):
    """With the first reason."""
    with pytest.raises(SceneFileError, match=r"no file of the folder can be a variant\. First error: .*thing/cut"):
        build_model(scene(tmp_path, BROKEN))


@pytest.mark.parametrize("broken", ["b5", "b9"])
def test_files_that_are_left_out_are_not_held_out(tmp_path: Path, broken: str):
    """A share of the others is, as without the broken file: the first by hash, and the last."""
    with pytest.warns(ModelWarning, match="1 of 3 files"):
        found = build_model(scene(tmp_path, {"a": SOUND, "b": SOUND, broken: BROKEN["cut"]})).config
    (tmp_path / f"{broken}.xml").unlink()
    assert found.groups["thing"].splits == scene(tmp_path, {}).groups["thing"].splits


def test_an_error_of_something_else_is_told(tmp_path: Path):
    """As it is, if all files of the folder are sound."""
    config = SceneConfig.load(
        scene(tmp_path, {"a": SOUND, "b": SOUND}), {"objects.other": {"asset": "none", "on": "floor"}}
    )
    with pytest.raises(UnknownNameError, match=r"objects\.other\.asset"):
        build_model(config)


def test_a_folder_without_a_star_is_told_to_need_one(tmp_path: Path):
    """An asset is a file; the pattern of all files of the folder is named."""
    config = SceneConfig.load(
        {"floor": {"size": [1, 1]}, "objects": {"thing": {"asset": str(tmp_path), "on": "floor"}}}
    )
    with pytest.raises(SceneFileError, match=rf"objects\.thing\.asset: .* is a folder .*'{tmp_path}/\*'"):
        build_model(config)
