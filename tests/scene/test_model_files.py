"""Models from files: what they refer to is found, in attached models and packages too, and they fit in a zip file."""

from __future__ import annotations

import importlib.util
import io
import os
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import MissingExtraError, SceneFileError, SceneKeyError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model_files import file_of, load_model, zipped
from tests.scene.assets import TETRAHEDRON

LARGE = TETRAHEDRON.replace(".1", ".2")
PART = """
<mujoco><compiler meshdir="meshes"/><asset><mesh name="shape" file="part.obj"/></asset>
  <worldbody><body name="{0}"><geom type="mesh" mesh="shape"/></body></worldbody></mujoco>
"""
WHOLE = """
<mujoco><asset><model name="a" file="arm/arm.xml"/><model name="h" file="hand/hand.xml"/></asset>
  <worldbody><body name="base"><geom size=".1"/>
    <frame pos="0 0 .1"><attach model="a" body="link" prefix="a_"/><attach model="h" body="palm" prefix="h_"/></frame>
  </body></worldbody></mujoco>
"""
LINK = (
    '<link name="{0}"><inertial><mass value="1"/><inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/>'
    '</inertial><collision><geometry><mesh filename="{1}"/></geometry></collision></link>'
)
JOINT = (
    '<joint name="j{0}" type="{1}"><parent link="l{0}"/><child link="l{2}"/><axis xyz="0 0 1"/>'
    '<origin xyz="0 0 .3"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
)
MESH = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def write(path: Path, text: str) -> Path:
    """Write a file and the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def attached(folder: Path) -> Path:
    """Write a model that attaches two others, each with a mesh of the same name in a folder of its own."""
    for name, body, mesh in (("arm", "link", TETRAHEDRON), ("hand", "palm", LARGE)):
        write(folder / name / f"{name}.xml", PART.format(body))
        write(folder / name / "meshes/part.obj", mesh)
    return write(folder / "whole.xml", WHOLE)


def urdf(folder: Path, uri: str, mesh: str = "part.obj") -> Path:
    """Write a URDF of three links, the last of which is fixed to the second, in a package with its mesh."""
    links = "".join(LINK.format(f"l{i}", uri) for i in range(3))
    joints = JOINT.format(0, "revolute", 1) + JOINT.format(1, "fixed", 2)
    write(folder / "my_arm/meshes" / mesh, TETRAHEDRON)
    return write(folder / "my_arm/urdf/arm.urdf", f'<robot name="arm">{links}{joints}</robot>')


def test_models_that_are_attached_bring_their_own_files(tmp_path: Path):
    """MuJoCo itself finds them where the file lies; a scene finds them wherever it is written."""
    path = attached(tmp_path)
    expected = mujoco.MjModel.from_xml_path(str(path))
    scene = build_model(SceneConfig.load({"robot": {"asset": str(path)}, "objects": {}}))
    assert scene.mjm.nmesh == 2
    np.testing.assert_allclose(
        sorted(np.ptp(scene.mjm.mesh_vert, axis=0)), sorted(np.ptp(expected.mesh_vert, axis=0)), atol=1e-6
    )
    assert scene.spec is not None
    spec = mujoco.MjSpec.from_string(scene.spec.to_xml())
    spec.assets.update(scene.spec.assets)
    np.testing.assert_allclose(spec.compile().mesh_vert, scene.mjm.mesh_vert, atol=1e-6)


def test_assets_with_files_of_the_same_name_keep_their_own(tmp_path: Path):
    """Two assets from different folders, each with another mesh `part.obj`."""
    attached(tmp_path)
    objects = {n: {"asset": str(tmp_path / n / f"{n}.xml"), "kind": "static"} for n in ("arm", "hand")}
    mjm = build_model(SceneConfig.load({"objects": objects})).mjm
    volumes = [float(np.prod(mjm.geom_aabb[mjm.body(name).geomadr[0], 3:])) for name in ("arm", "hand")]
    assert volumes[1] == pytest.approx(8.0 * volumes[0], rel=1e-3)


@pytest.mark.parametrize(
    "uri", ["package://my_arm/meshes/part.obj", "package://other/meshes/part.obj", "../meshes/part.obj"]
)
def test_a_urdf_is_a_robot_as_it_is(tmp_path: Path, uri: str):
    """Its meshes are found by package, or by the path within one; links that are fixed keep their names."""
    path = urdf(tmp_path, uri)
    robot = {"asset": str(path), "tcp": "l2", "base": [0, 0, 0.5]}
    scene = build_model(SceneConfig.load({"robot": robot, "objects": {}}))
    assert [scene.mjm.body(b).name for b in scene.subtree("robot")] == ["arm", "arm/l1", "arm/l2"]
    assert list(scene.joints("robot")) == ["j0"]
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_kinematics(scene.mjm, data)
    np.testing.assert_allclose(data.site(scene.tcps["robot"]).xpos, [0, 0, 1.1], atol=1e-9)


def test_the_meshes_of_a_urdf_are_part_of_the_scenes_name(tmp_path: Path):
    """Another mesh is another scene; another folder is not."""
    found = []
    for folder, mesh in (("a", TETRAHEDRON), ("b", TETRAHEDRON), ("c", LARGE)):
        path = urdf(tmp_path / folder, "package://my_arm/meshes/part.obj")
        write(path.parents[1] / "meshes/part.obj", mesh)
        found.append(build_model(SceneConfig.load({"robot": {"asset": str(path)}, "objects": {}})).hash)
    assert found[0] == found[1] != found[2]


def test_a_missing_mesh_is_named(tmp_path: Path):
    """Of a URDF as the URDF has it."""
    path = urdf(tmp_path, "package://my_arm/meshes/none.obj")
    with pytest.raises(SceneFileError, match=r"here: .*arm\.urdf' refers to 'package://my_arm/meshes/none\.obj'"):
        load_model(path, "here")
    assert file_of("file:///nowhere/none.obj", tmp_path) is None


@pytest.mark.skipif(importlib.util.find_spec("collada") is not None, reason="Collada meshes can be read here")
def test_a_collada_mesh_says_what_reads_it(tmp_path: Path):
    """MuJoCo does not; an extra does."""
    path = urdf(tmp_path, "package://my_arm/meshes/part.dae", "part.dae")
    with pytest.raises(MissingExtraError, match=r"pycollada is not installed.*\.\[import\]"):
        load_model(path, "here")


@pytest.mark.parametrize("name", ["cube.obj", "cube.GLB"])
def test_a_mesh_is_no_model(tmp_path: Path, name: str):
    """MuJoCo reads some of them as models without bodies; the error has a command that makes an asset of one."""
    path = write(tmp_path / "my meshes" / name, TETRAHEDRON)
    says = rf"here: .* MJCF or URDF file\. `sceniris-gym import '{path}' -o cube\.xml`"
    with pytest.raises(SceneFileError, match=says):
        load_model(path, "here")


def test_files_that_are_missing_are_told_with_where_they_would_be_found(tmp_path: Path):
    """One of them by name, and how many others there are; a package's below a folder of its name."""
    links = LINK.format("l0", "package://arm/a.stl") + LINK.format("l1", "b.stl") + JOINT.format(0, "revolute", 1)
    path = write(tmp_path / "arm.urdf", f'<robot name="arm">{links}</robot>')
    says = r"'package://arm/a\.stl', which does not exist \(2 files are missing in all\)\. Put the file into"
    with pytest.raises(SceneFileError, match=says):
        load_model(path, "here")
    write(path, f'<robot name="arm">{LINK.format("l0", "b.stl")}</robot>')
    with pytest.raises(SceneFileError, match=r"b\.stl', which does not exist\. Put the file there, or correct"):
        load_model(path, "here")


def test_a_model_that_contains_itself_is_refused(tmp_path: Path):
    """Directly, by another way to its folder, by a second model, or without being attached: MuJoCo would overflow."""
    (tmp_path / "sub").mkdir()
    part = '<mujoco><asset><model name="x" file="{}"/></asset><worldbody><body>{}</body></worldbody></mujoco>'
    attach = '<attach model="x" prefix="p"/>'
    for file, other in (("a.xml", attach), ("sub/../a.xml", attach), ("a.xml", ""), ("b.xml", attach)):
        write(tmp_path / "a.xml", part.format(file, other))
        write(tmp_path / "b.xml", part.format("a.xml", attach))
        with pytest.raises(SceneKeyError, match=r"models contain each other: .*a\.xml -> "):
            load_model(tmp_path / "a.xml", "scene: model")


def test_a_pipe_is_no_part_of_a_model(tmp_path: Path):
    """MuJoCo would wait for it, or read for ever: included, attached or not, or in any attribute for a file."""
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "zero.xml").symlink_to("/dev/zero")
    write(tmp_path / "sub/more.xml", '<mujoco><include file="pipe.xml"/></mujoco>')
    os.mkfifo(tmp_path / "sub/pipe.obj")
    for inside in (
        '<include file="pipe.xml"/>',
        '<include file="zero.xml"/>',
        '<include file="sub/more.xml"/>',
        '<asset><model name="x" file="zero.xml"/></asset>',
        '<worldbody><flexcomp name="f" type="mesh" file="pipe.xml" dim="2"/></worldbody>',
        '<compiler meshdir="sub"/><worldbody><flexcomp name="f" type="mesh" file="pipe.obj" dim="2"/></worldbody>',
        '<asset><mesh name="m" file="zero.xml"/></asset>',
        '<asset><texture name="t" type="cube" fileright="pipe.xml"/></asset>',
    ):
        model = write(tmp_path / "model.xml", f"<mujoco>{inside}</mujoco>")
        with pytest.raises(SceneFileError, match=r"model\.xml' cannot be read: .*a pipe or a device, not a file"):
            load_model(model, "scene: model")
    with pytest.raises(SceneFileError, match=r"pipe\.xml': it is a folder, a pipe or a device, not a file"):
        load_model(tmp_path / "pipe.xml", "scene: model")
    links = LINK.format("l0", "package://arm/pipe.stl") + LINK.format("l1", "pipe.stl") + JOINT.format(0, "fixed", 1)
    (tmp_path / "arm").mkdir()
    os.mkfifo(tmp_path / "arm/pipe.stl")
    with pytest.raises(SceneFileError, match=r"cannot be read: .*a pipe or a device, not a file.*pipe\.stl"):
        load_model(write(tmp_path / "arm.urdf", f'<robot name="arm">{links}</robot>'), "here")


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        ('<worldbody><replicate count="100000000"><geom size="1"/></replicate></worldbody>', "makes 200,000,000 parts"),
        (
            '<worldbody><replicate count="9000"><replicate count="9000"><site/></replicate></replicate></worldbody>',
            "makes 162,009,000 parts",
        ),
        ('<asset><hfield name="h" nrow="50000" ncol="50000" size="1 1 1 1"/></asset>', "makes 2,500,000,000 parts"),
        ('<asset><texture name="t" builtin="flat" width="60000" height="60000"/></asset>', "makes 3,600,000,000 parts"),
        (
            '<worldbody><replicate count=" +100000000"><geom size="1"/></replicate></worldbody>',
            "makes 200,000,000 parts",
        ),
        ('<asset><hfield name="h" nrow="+50000" ncol="50000" size="1 1 1 1"/></asset>', "makes 2,500,000,000 parts"),
        (
            "<asset>" + 40 * '<hfield nrow="8000" ncol="8000" size="1 1 1 1"/>' + "</asset>",
            "<asset> makes 2,560,000,000 parts",
        ),
        (
            "<worldbody>" + 9 * '<replicate count="9000"><site/></replicate>' + "</worldbody>",
            "<worldbody> makes 162,000 parts",
        ),
        ("<worldbody>" + 3000 * "<body>" + 3000 * "</body>" + "</worldbody>", "recursion"),
    ],
)
def test_a_model_that_is_larger_than_its_text_by_far_is_refused(tmp_path: Path, inside: str, said: str):
    """With its size, before MuJoCo makes it for minutes."""
    model = write(tmp_path / "model.xml", f"<mujoco>{inside}</mujoco>")
    with pytest.raises(SceneFileError, match=said):
        load_model(model, "scene: model")


def test_a_model_that_is_repeated_a_little_is_read(tmp_path: Path):
    """Rows of rows, a field of heights of a megabyte, and a file that is included twice by files that are attached."""
    rows = '<replicate count="10" offset="1 0 0"><replicate count="20" offset="0 1 0"><geom size=".1"/></replicate>'
    field = '<asset><hfield name="h" nrow="500" ncol="500" size="1 1 1 1"/></asset>'
    write(tmp_path / "row.xml", f"<mujoco>{field}<worldbody>{rows}</replicate></worldbody></mujoco>")
    model = write(tmp_path / "model.xml", '<mujoco><include file="row.xml"/></mujoco>')
    assert load_model(model, "scene: model").compile().ngeom == 200


@pytest.mark.parametrize("attached", ["l", "none"])
def test_models_that_attach_each_other_many_times_are_refused(tmp_path: Path, attached: str):
    """Each of seven attaches the next a dozen times, or names it as a dozen models that it does not attach."""
    for i in range(7):
        models = "".join(f'<model name="{n}l" file="l{i + 1}.xml"/>' for n in range(12))
        bodies = "".join(f'<body><attach model="{n}{attached}" body="r" prefix="p{n}"/></body>' for n in range(12))
        write(
            tmp_path / f"l{i}.xml",
            f'<mujoco><asset>{models}</asset><worldbody><body name="r">{bodies}</body></worldbody></mujoco>',
        )
    write(tmp_path / "l7.xml", '<mujoco><worldbody><body name="r"/></worldbody></mujoco>')
    with pytest.raises(
        SceneFileError, match=r"l\d\.xml: (<body> makes .* at most 20,000|is one of over 1000 attached models)"
    ):
        load_model(tmp_path / "l0.xml", "scene: model")


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        ('<mujoco model="&nbsp;">', "</mujoco>"),
        ("<!DOCTYPE mujoco [<?x > <mujoco>", "</mujoco> ?> ]><mujoco/>"),
        ('<!DOCTYPE mujoco SYSTEM "><mujoco>', '</mujoco>"><mujoco/>'),
        ('<mujoco model="<!--">', '<custom/><!-- --><custom><text name="a" data="-->"/></custom></mujoco>'),
        ('<mujoco x:y="z">', "</mujoco>"),
        ("<mujoco>", "</mujoco><mujoco/>"),
    ],
)
def test_a_model_that_is_no_xml_is_refused(tmp_path: Path, begin: str, end: str):
    """MuJoCo reads it, and would find what no check saw: here that it attaches itself."""
    inside = '<asset><model name="x" file="{}"/></asset><worldbody><body name="a"/></worldbody>'
    part = write(tmp_path / "part.xml", f"<mujoco>{inside.format('part.xml')}</mujoco>")
    other = write(tmp_path / "other.xml", "<mujoco/>")
    assert mujoco.MjSpec.from_string(begin + inside.format(other) + end) is not None
    model = write(tmp_path / "model.xml", "\n".join((begin, inside.format(part), end)))
    with pytest.raises(SceneFileError, match=r"model\.xml: should be MJCF or URDF in well-formed XML.*(line|DOCTYPE)"):
        load_model(model, "scene: model")


def test_comments_and_marks_of_other_editors_are_read(tmp_path: Path):
    """Dashes and bytes of another encoding in comments, a mark of byte order, a line before the declaration."""
    text = b'<mujoco><!-- -- a <b> \xe9 ---><custom><text name="t" data="--"/></custom><worldbody><geom size="1"/>'
    for before in (b"\xef\xbb\xbf", b'\n<?xml version="1.0"?><!DOCTYPE mujoco>', b""):
        (tmp_path / "model.xml").write_bytes(before + text + b"</worldbody></mujoco>")
        assert load_model(tmp_path / "model.xml", "scene: model").compile().ngeom == 1
        robot = {"asset": str(tmp_path / "model.xml")}
        build_model(SceneConfig.load({"robot": robot, "objects": {}}))


def test_a_file_that_is_included_twice_is_refused(tmp_path: Path):
    """Under two names, which MuJoCo takes for two files, or by itself."""
    write(tmp_path / "part.xml", "<mujoco/>")
    (tmp_path / "sub").mkdir()
    for inside in (
        '<include file="part.xml"/><include file="sub/../part.xml"/>',
        '<include file="sub/../model.xml"/>',
    ):
        model = write(tmp_path / "model.xml", f"<mujoco>{inside}</mujoco>")
        with pytest.raises(SceneFileError, match="is included twice"):
            load_model(model, "scene: model")


@pytest.mark.parametrize("form", ["part.obj", "../part.obj", "{folder}/part.obj", "../other/part.obj"])
def test_members_have_names_of_their_own(tmp_path: Path, form: str):
    """Whatever the user's MJCF calls its meshes, and they stay what they are."""
    home = tmp_path / "home"
    file = form.format(folder=tmp_path)
    for folder in (home, tmp_path / "other"):
        folder.mkdir()
    (home / file).resolve().write_text(MESH)
    (home / "thing.xml").write_text(
        f'<mujoco><asset><mesh name="part" file="{file}"/></asset><worldbody><body name="thing">'
        '<geom type="mesh" mesh="part"/></body></worldbody></mujoco>'
    )
    objects = {"thing": {"asset": str(home / "thing.xml"), "on": "floor"}}
    scene = build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects}))
    written = io.BytesIO(zipped(scene.spec))
    for name in zipfile.ZipFile(written).namelist():
        assert ".." not in name.split("/")
        assert not name.startswith("/")
    written.seek(0)
    again = mujoco.MjSpec.from_zip(written).compile()
    np.testing.assert_allclose(again.mesh_vert, scene.mjm.mesh_vert, atol=1e-7)
