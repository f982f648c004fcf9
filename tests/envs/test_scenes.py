"""The shipped scenes hold what they promise: which objects, on what, and how much of a table they cover."""

from __future__ import annotations

from collections import Counter

import mujoco
import numpy as np
import pytest
import shapely
from ruamel.yaml import YAML
from scipy import stats

from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import compile_on_cpu
from tests.oracle.presence import outcomes


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


def test_the_dinner_is_laid_for_one_to_four():
    """As often as the enumerator has it; each guest has cutlery and a glass, and a bowl if there is soup."""
    written = YAML(typ="safe", pure=True).load(shipped("envs", ".yaml")["dinner"].read_text())
    objects, stack = written["objects"], written["stacks"]["served"]
    for name, below in zip(stack["of"], [stack["on"], *stack["of"]], strict=False):
        objects[name] = {**objects[name], "on": below}
    expected: dict[frozenset[str], float] = {}
    for items, chance in outcomes(written).items():
        key = frozenset(name for name, _, _ in items)
        expected[key] = expected.get(key, 0.0) + float(chance)
    compiled = compile_on_cpu("dinner")
    names, table = np.array(compiled.object_names), make_table(compiled, 2000, 5000)
    found = Counter(frozenset(name.partition("/")[0] for name in names[row]) for row in table.present)
    assert table.valid.all()
    assert not found.keys() - expected.keys()
    likely = sorted((key for key in expected if 2000 * expected[key] >= 5), key=sorted)
    numbers = [2000 * expected[key] for key in likely]
    counts = [found[key] for key in likely]
    chosen = np.append(numbers, 2000 - sum(numbers))[: len(numbers) + (sum(numbers) < 1999)]
    assert stats.chisquare([*counts, 2000 - sum(counts)][: len(chosen)], chosen).pvalue > 0.001
    for laid in found:
        guests = {name[-1] for name in laid if name.startswith("plate")}
        assert 1 <= len(guests) <= 4
        spoons, glasses, bowls = ({n[-1] for n in laid if n.startswith(kind)} for kind in ("spoon", "glass", "bowl"))
        assert guests == spoons == glasses
        assert bowls in (set(), guests)


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
