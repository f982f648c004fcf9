"""The shipped scenes hold what they promise: which objects, on what, and how much of a table they cover."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import shapely

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel


def free_objects(config: SceneConfig) -> list[str]:
    """Names of the objects that are not furniture."""
    return [name for name, part in config.objects.items() if part.kind == "free"]


def footprint(scene: SceneModel, data: mujoco.MjData, name: str) -> shapely.Geometry:
    """The union of the shadows [m] of an object's convex pieces."""
    shadows = []
    for geom in np.flatnonzero(np.isin(scene.mjm.geom_bodyid, scene.subtree(name))):
        if not scene.mjm.geom_contype[geom]:
            continue
        if scene.mjm.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            corners = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
            points = corners * scene.mjm.geom_size[geom]
        else:
            mesh = scene.mjm.geom_dataid[geom]
            start, count = scene.mjm.mesh_vertadr[mesh], scene.mjm.mesh_vertnum[mesh]
            points = scene.mjm.mesh_vert[start : start + count]
        world = points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        shadows.append(shapely.MultiPoint(world[:, :2]).convex_hull)
    return shapely.union_all(shadows)


@pytest.mark.parametrize(
    ("scene", "objects"),
    [
        ("hard", ["cabinet", "apple", "banana", "orange"]),
        ("hard_plus", ["cabinet", "apple", "banana", "mug", "orange"]),
        ("table_top", ["table", "chair", "cabinet", "mug", "banana"]),
    ],
)
def test_scenes_of_the_paper_have_its_objects(scene, objects):
    """Named as there, in the order of the file."""
    assert list(SceneConfig.load(scene).objects) == objects


def test_the_kitchen_has_twelve_things_on_six_supports_of_which_two_are_covered():
    """Twelve free objects; worktop, sink, lid and the top of the shelf are open, shelf and cupboard covered."""
    config = SceneConfig.load("kitchen")
    names = free_objects(config)
    words = [config.objects[name].support for name in names]
    supports = {(support.word, support.parent) for support in words if support is not None}
    assert len(names) == 12
    assert supports == {
        ("on", "counter"),
        ("on", "counter/sink"),
        ("on", "chest/lid"),
        ("on", "shelf"),
        ("inside", "shelf"),
        ("inside", "cupboard"),
    }


def test_the_clutter_covers_three_tenths_of_its_table():
    """Twenty free objects, all on the table, whose footprints have 30% of the area of its top."""
    config = SceneConfig.load("clutter")
    scene = build_model(config)
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_kinematics(scene.mjm, data)
    names = free_objects(config)
    assert len(names) == 20
    assert {config.objects[name].on for name in names} == {"table"}
    covered = sum(shapely.area(footprint(scene, data, name)) for name in names)
    assert covered / shapely.area(footprint(scene, data, "table")) > 0.30


@pytest.mark.parametrize(
    "name",
    [
        "tabletop_reach",
        "tabletop_lift",
        "tabletop_lift_any",
        "clutter_push",
        "clutter_extract",
        "drawer_pick",
        "drawer_open_pick",
        "kitchen_reset",
    ],
)
def test_no_robot_turns_its_back_on_the_camera(name):
    """Seen from above, the camera is within 135 degrees of where the robot looks, so that it sees its work."""
    scene = build_model(SceneConfig.load(name))
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_kinematics(scene.mjm, data)
    mujoco.mj_camlight(scene.mjm, data)
    facing = data.body("panda").xmat.reshape(3, 3)[:2, 0]
    camera = data.camera("overview").xmat.reshape(3, 3)[:2, 2]  # a camera looks along its -z
    assert facing @ camera / np.linalg.norm(camera) > np.cos(np.radians(135.0))
