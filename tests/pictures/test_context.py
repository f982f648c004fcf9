"""Geoms that are drawn, and the order of rays."""

from types import SimpleNamespace

import mujoco
import numpy as np

from sceniris_gym.pictures.context import Shot, drawn_once, may_be_inside, tile_rays


def test_nothing_is_drawn_twice():
    """Shapes for collisions are hidden where a body has looks in another group, but not otherwise, nor in the world."""
    looks = 'contype="0" conaffinity="0" size=".1"'
    mjm = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody>
        <geom name="ground" type="plane" size="1 1 1"/><geom name="rug" {looks} group="1"/>
        <body><geom name="hull" size=".1"/><geom name="skin" {looks} group="1"/></body>
        <body><geom name="ball" size=".1"/><geom name="dot" {looks}/><geom name="core" size=".1" group="3"/></body>
        <body><geom name="bare" size=".1"/><geom name="glass" {looks} group="1" rgba="1 1 1 0"/></body>
        </worldbody></mujoco>"""
    )
    drawn = drawn_once(mjm)
    shown = {mjm.geom(i).name for i in range(mjm.ngeom) if drawn.geom_group[i] in (0, 1, 2)}
    assert shown == {"ground", "rug", "skin", "ball", "dot", "bare", "glass"}
    assert mjm.geom("hull").group == 0


def test_cameras_inside_of_what_carries_them_are_known():
    """Those in the box or ball of their own hand are; those beside it, in other bodies or in hidden geoms are not."""
    mjm = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody>
        <geom type="plane" size="1 1 1"/><camera name="above" pos="0 0 2"/><camera name="floor" pos="0 0 0"/>
        <body pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .2"/><camera name="in box" pos="0 .05 .15"/>
          <camera name="on box" pos="0 .15 0"/>
          <body euler="0 0 45" pos=".5 0 0"><geom size=".1"/><camera name="in ball" pos=".05 0 0"/>
            <camera name="in hull" pos=".3 0 0"/><geom pos=".3 0 0" size=".1" group="3"/></body>
          <body pos="0 0 0"><joint/><geom size=".01" pos="1 0 0"/><camera name="apart"/></body></body>
        </worldbody></mujoco>"""
    )
    assert [mjm.camera(i).name for i in range(mjm.ncam) if may_be_inside(mjm, i)] == ["in box", "in ball"]


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
