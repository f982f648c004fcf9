"""Geoms that are drawn, meshes with fewer faces of the same shape, and the order of rays."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import trimesh

from sceniris_gym.pictures.context import Shot, drawn_once, may_be_inside, thin, tile_rays

WHOLE = {
    "ball": trimesh.creation.icosphere(subdivisions=4),
    "ring": trimesh.creation.torus(1.0, 0.2, major_sections=64, minor_sections=32),
    "rod": trimesh.creation.cylinder(0.02, 1.0, sections=600),
}


def test_a_model_keeps_its_groups():
    """Shapes below a skin are hidden in the model that is drawn alone."""
    geoms = '<geom size=".1"/><geom size=".1" group="1" contype="0" conaffinity="0"/>'
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body>{geoms}</body></worldbody></mujoco>")
    assert drawn_once(mjm).geom_group.tolist() == [5, 1]
    assert mjm.geom_group.tolist() == [0, 1]


def test_a_model_whose_objects_overlap_is_drawn_without_contacts():
    """Their contacts would exhaust the memory of the model."""
    body = '<body><freejoint/><geom size=".1"/></body>'
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{9 * body}</worldbody></mujoco>")
    found = []
    for each in (mjm, drawn_once(mjm)):
        data = mujoco.MjData(each)
        mujoco.mj_forward(each, data)
        found.append(data.ncon)
    assert found[0] > 9
    assert found[1] == 0


def test_cameras_inside_of_what_carries_them_are_known():
    """Those in the box or ball of their own hand or of a link before it are; those beside it, or in hidden geoms not.

    Objects that are placed by mocap bodies carry theirs, too, and a camera that tracks a ball's centre is in the ball.
    """
    mjm = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <geom type="plane" size="1 1 1"/><camera name="above" pos="0 0 2"/><camera name="floor" pos="0 0 0"/>
        <body pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .2"/><camera name="in box" pos="0 .05 .15"/>
          <camera name="on box" pos="0 .15 0"/>
          <body euler="0 0 45" pos=".5 0 0"><geom size=".1"/><camera name="in ball" pos=".05 0 0"/>
            <camera name="in hull" pos=".3 0 0"/><geom pos=".3 0 0" size=".1" group="3"/></body>
          <body pos="0 0 0"><joint/><geom size=".01" pos="1 0 0"/><camera name="in link before"/></body></body>
        <body pos="0 0 1"><freejoint/><geom size=".01" pos="1 0 0"/><camera name="apart"/></body>
        <body mocap="true" pos="0 3 1"><geom size=".1"/><camera name="in mocap"/>
          <body pos="1 0 0"><camera name="on mocap"/></body></body>
        <body pos="3 3 1"><geom size=".1"/><camera name="tracks" mode="trackcom" pos="0 0 .05"/></body>
        </worldbody></mujoco>"""
    )
    inside = [mjm.camera(i).name for i in range(mjm.ncam) if may_be_inside(mjm, i)]
    assert inside == ["in box", "in ball", "in link before", "in mocap", "tracks"]


def test_cameras_that_may_get_inside_are_known():
    """Those on bodies whose place is drawn, and those on an object with variants, alone in its tree, if it is seen."""
    mjm = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <geom type="box" size="1 1 .1"/><camera name="above" pos="0 0 2"/>
        <body pos="0 0 1"><freejoint/><geom size=".1"/><camera name="on thing" pos="0 0 .15"/></body>
        <body pos="0 3 1"><geom size=".1"/>
          <body><joint/><geom size=".1"/><camera name="on arm" pos="0 0 .2"/></body></body>
        <body pos="0 3 1"><camera name="on stand" pos="0 0 .2"/></body>
        </worldbody></mujoco>"""
    )
    found = {
        field: [mjm.camera(i).name for i in range(mjm.ncam) if may_be_inside(mjm, i, differ)]
        for field, differ in (("", ()), ("cam_pos", ("cam_pos",)), ("geom_size", ("geom_size", "body_mass")))
    }
    assert found == {"": [], "cam_pos": ["on thing", "on arm"], "geom_size": ["on thing"]}


def test_rays_of_a_tile_follow_each_other():
    """Each ray is that of its pixel, also in a picture that is no multiple of a tile; the cameras stay apart."""
    width, height = 20, 10
    shots = {"a": Shot((width, height)), "b": Shot((4, 4))}
    number = np.arange(width * height + 16, dtype=np.float32)
    rays = np.stack([number, number, number], axis=1)
    context = SimpleNamespace(ray=_Rays(rays), ray_offset=_Rays(rays))
    first, second = tile_rays(context, shots)
    np.testing.assert_array_equal(context.ray.values[:, 0], [*first, *(width * height + second)])
    assert sorted(first) == list(range(width * height))
    assert np.ptp(first[:32] % width) == 7
    assert np.ptp(first[:32] // width) == 3


class _Rays:
    """Stands in for a Warp array."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values.copy()

    def numpy(self) -> np.ndarray:
        return self.values.copy()

    def assign(self, values: np.ndarray) -> None:
        self.values = values


@pytest.mark.parametrize("name", ["ball", "ring"])
def test_a_mesh_has_fewer_faces_and_nearly_the_same_surface(name: str):
    """Its vertices are within a cell of the whole mesh, its volume is nearly the same, and its faces look outwards."""
    whole = WHOLE[name]
    found = thin(np.array(whole.vertices), np.array(whole.faces))
    assert found is not None
    vertices, faces = found
    assert len(faces) < 0.5 * len(whole.faces)
    _, distance, _ = trimesh.proximity.closest_point_naive(whole, vertices)
    assert distance.max() < np.ptp(whole.vertices, axis=0).max() / 8.0
    volume = trimesh.Trimesh(vertices, faces, process=False).volume
    assert volume == pytest.approx(whole.volume, rel=0.15)


def test_what_would_lose_its_shape_is_left_alone():
    """A thin rod would become a line; and a box has too few faces."""
    for mesh in (WHOLE["rod"], trimesh.creation.box()):
        assert thin(np.array(mesh.vertices), np.array(mesh.faces)) is None
