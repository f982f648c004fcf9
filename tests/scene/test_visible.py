"""Geoms that pictures show."""

import mujoco

from sceniris_gym.scene.visible import picture_groups


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
    groups = picture_groups(mjm)
    shown = {mjm.geom(i).name for i in range(mjm.ngeom) if groups[i] in (0, 1, 2)}
    assert shown == {"ground", "rug", "skin", "ball", "dot", "bare", "glass"}
