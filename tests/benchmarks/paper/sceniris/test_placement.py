"""Places of objects of the original package's configurations: on parents, cropped, or at fixed positions."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy import stats

from benchmarks.paper.sceniris.keys import KeysLeftOutWarning
from benchmarks.paper.sceniris.reader import read_sceniris
from sceniris_gym import compile_scene
from sceniris_gym.config.objects import RegionConfig, SupportConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.benchmarks.paper.sceniris.configurations import mug, read


@pytest.mark.parametrize(
    ("keys", "support"),
    [
        ({}, SupportConfig("on", "floor")),
        ({"parent_id": None, "relation_to_parent": None}, SupportConfig("on", "floor")),
        ({"parent_id": "_plane", "relation_to_parent": "top"}, SupportConfig("on", "floor")),
        ({"parent_id": "drawer"}, SupportConfig("on", "drawer")),
        ({"parent_id": "drawer", "relation_to_parent": "inside"}, SupportConfig("inside", "drawer")),
        (
            {"parent_id": "drawer/lower_drawer", "relation_to_parent": "in"},
            SupportConfig("inside", "drawer/lower_drawer"),
        ),
    ],
)
def test_a_parent_becomes_the_support(keys: dict, support: SupportConfig):
    """The top is open above and the inside covered; the ground is the default."""
    config, left_out = read(mug(**keys))
    assert left_out == []
    assert config.objects["mug"].support == support
    assert config.objects["drawer"].kind == ("free" if support.parent == "floor" else "fixture")


def test_a_crop_is_a_fraction_of_the_support():
    """Corners in any order, cut off at the support's bounds; the ratio too is cut off."""
    config, _ = read(mug(position={"xy_limit": [[0.9, -0.5], [0.2, 0.5]]}, ratio_on_support=1.5))
    region = config.objects["mug"].region
    assert region is not None
    assert region.fraction == ((0.2, 0.0), (0.9, 0.5))
    assert config.objects["mug"].ratio_on_support == 1.0
    assert read(mug(ratio_on_support=None))[0].objects["mug"].ratio_on_support == 0.0


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"ratio_on_support": 3}, {"objects.mug.ratio_on_support": "3 is clipped to 1"}),
        ({"ratio_on_support": -2}, {"objects.mug.ratio_on_support": "-2 is clipped to 0"}),
        (
            {"position": {"xy_limit": [[0.9, 0.9], [-1, 2]]}},
            {"objects.mug.position.xy_limit": "[[0.0, 0.9], [0.9, 1.0]] here"},
        ),
        ({"position": {"xy_limit": [[0.2, 0.6], [0.1, 0.9]]}}, {"objects.mug.position.xy_limit": "[[0.1, 0.6], [0.2"}),
        ({"position": {"xy_limit": [[0, 0.2], [0.4, 1]]}, "ratio_on_support": 1}, {}),
    ],
    ids=str,
)
def test_values_that_are_cut_off_are_told_by_their_keys(keys: dict, said: dict[str, str]):
    """The warning gives the new values; a value that is kept is not mentioned."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_sceniris(mug(**keys))
    changed = dict(item for warning in caught for item in getattr(warning.message, "changed", {}).items())
    assert changed.keys() == said.keys()
    assert all(text in changed[key] for key, text in said.items())


def test_the_limits_of_the_workspace_hold_for_all_that_is_on_the_floor():
    """The floor is centred at the origin: it reaches over the limits, and regions keep objects inside of them."""
    cfg = mug(position={"xy_limit": [[0.5, 0.0], [1.0, 1.0]]})
    cfg["objects"][2]["parent_id"] = "drawer"
    config, left_out = read(cfg | {"env": {"env_size": 9.0, "workspace_limits": [[0.0, -1.0], [2.0, 3.0]]}})
    assert left_out == []
    assert config.floor is not None
    assert config.floor.size == (4.0, 6.0)
    regions = {name: part.region and part.region.box for name, part in config.objects.items()}
    assert regions == {"mug": ((1.0, -1.0), (2.0, 3.0)), "drawer": ((0.0, -1.0), (2.0, 3.0)), "apple": None}


def test_a_fixed_position_overrules_the_rest():
    """In the air as on the floor: the one point."""
    keys = {"parent_id": "drawer", "constraints": [{"anchor_object_ids": ["apple"], "direction": "left"}]}
    config, left_out = read(mug(fixed_world_positions=[np.array([1.0, 0.5, 1.8])], **keys))
    mounted = config.objects["mug"]
    assert left_out == []
    assert (mounted.kind, mounted.support, mounted.relations) == ("fixture", None, ())
    assert mounted.region is not None
    assert mounted.region.points == ((1.0, 0.5, 1.8),)
    standing = read(mug(fixed_world_positions=[(0.2, 0.1, 0.0)]))[0].objects["mug"]
    assert standing.support == SupportConfig("on", "floor")
    assert standing.region is not None
    assert standing.region.points == ((0.2, 0.1),)


AIR = [[0.3, 0.2, 0.9], [-0.3, 0.2, 0.6], [0.0, -0.4, 0.7]]
GROUND = [[0.3, 0.2, 0.0], [-0.3, 0.2, 0.0], [0.0, -0.4, 0.0], [0.3, -0.3, 0.0]]


@pytest.mark.parametrize("positions", [AIR, GROUND], ids=["in the air", "on the floor"])
def test_an_object_is_put_at_one_of_its_fixed_positions(positions: list):
    """At each as often as at any other, by chi-square; and no warning is given."""
    at, left_out = _blocks_at(positions)
    assert left_out == []
    apart = np.linalg.norm(at[:, None] - np.array(positions), axis=2)
    assert apart.min(axis=1).max() < 0.0006  # on the floor there is a gap of half a millimetre below it
    assert stats.chisquare(np.bincount(apart.argmin(axis=1), minlength=len(positions))).pvalue > 0.001


def test_of_fixed_positions_on_the_floor_and_in_the_air_those_on_the_floor_are_lifted_and_told():
    """Nothing carries the object then, and it keeps its clearance from the floor."""
    cfg = {"objects": [{"id": "block", "asset_path": "block", "fixed_world_positions": [GROUND[0], AIR[1]]}]}
    with pytest.warns(KeysLeftOutWarning, match=r"objects\.block\.fixed_world_positions \(.*1.1 mm over it"):
        read_sceniris(cfg)
    at, _ = _blocks_at([GROUND[0], AIR[1]])
    assert sorted({round(z, 4) for z in at[:, 2].tolist()}) == [0.0011, 0.6]


def _blocks_at(positions: list) -> tuple[np.ndarray, list[str]]:
    """Return the positions of a block, by its pivot, in 2,000 layouts, shape (2000, 3), and the keys left out."""
    config, left_out = read({"objects": [{"id": "block", "asset_path": "block", "fixed_world_positions": positions}]})
    compiled = compile_scene(config, "cpu")
    table = make_table(compiled, 2000, 5)
    assert table.valid.all()
    return table.mocap_pos[:, int(compiled.mjm.body("block").mocapid[0])], left_out


def test_positions_at_the_height_of_the_ground_are_on_it_and_those_below_are_told():
    """Rounding lifts or sinks none; an object that would be in the ground is never put there."""
    config, _ = read(mug(fixed_world_positions=[(0.1, 0.2, 1e-17), (0.3, 0.3, 0.0)]))
    assert config.objects["mug"].support == SupportConfig("on", "floor")
    assert config.objects["mug"].region == RegionConfig(points=((0.1, 0.2), (0.3, 0.3)))
    with pytest.warns(KeysLeftOutWarning, match=r"never used: \[\[0\.1, 0\.2, -0\.3\]\]"):
        read_sceniris(mug(fixed_world_positions=[(0.1, 0.2, -0.3), (0.3, 0.3, 0.5)]))


@pytest.mark.parametrize("limits", [None, [[-0.5, -0.5], [0.5, 0.5]]], ids=str)
def test_a_fixed_position_may_be_beyond_the_workspace(limits: list | None):
    """The floor is made to hold it; what is drawn on it keeps to the workspace, and layouts can be made."""
    env = {"env_size": 1.0, "workspace_limits": limits}
    cfg = mug(fixed_world_positions=[[0.8, -0.3, 0.0]])
    cfg["env"] = env
    cfg["objects"][2]["position"] = {"xy_limit": [[0.5, 0.0], [1.0, 1.0]]}
    config, left_out = read(cfg)
    assert left_out == []
    assert config.floor is not None
    assert config.floor.size == pytest.approx((1.6, 1.0))
    regions = {name: part.region and part.region.box for name, part in config.objects.items()}
    assert config.objects["mug"].region == RegionConfig(points=((0.8, -0.3),))
    assert regions["drawer"] == ((-0.5, -0.5), (0.5, 0.5))
    assert regions["apple"] == ((0.0, -0.5), (0.5, 0.5))
    build_plan(build_model(config))  # which refuses regions that leave nothing of the floor


@pytest.mark.parametrize("far", [[200.0, 0.0, 0.0], [0.0, -150.0, 0.0], [0.0, 0.0, 120.0]], ids=str)
def test_a_fixed_position_that_is_too_far_is_refused_by_its_key(far: list[float]):
    """Positions are kept within 100 m of the origin, on the floor as in the air."""
    with pytest.raises(SceneKeyError, match=r"original configuration: objects\.mug\.fixed_world_positions: .*100 m"):
        read(mug(fixed_world_positions=[far]))


LEFT_OUT: dict[str, tuple] = {
    "a limit of height": ({"position": {"z_limit": [0, 1]}}, ["objects.mug.position.z_limit"]),
    "no fixed positions": ({"fixed_world_positions": []}, ["objects.mug.fixed_world_positions"]),
}


@pytest.mark.parametrize(("keys", "left_out"), LEFT_OUT.values(), ids=LEFT_OUT.keys())
def test_a_place_that_cannot_be_carried_over_is_listed_by_its_key(keys: dict, left_out: list[str]):
    """The object is placed by the keys that are left."""
    config, found = read(mug(**keys))
    assert found == left_out
    assert list(config.objects) == ["mug", "drawer", "apple"]


WRONG: dict[str, tuple] = {
    "an unknown parent": (mug(parent_id="drawr/x"), UnknownNameError, r"mug\.parent_id: .*mean 'drawer'"),
    "an unknown relation": (
        mug(parent_id="drawer", relation_to_parent="insid"),
        UnknownNameError,
        r"mug\.relation_to_parent: .*mean 'inside'",
    ),
}


@pytest.mark.parametrize(("cfg", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_place_is_refused_by_its_key(cfg: dict, error: type[ScenirisError], says: str):
    """With the nearest name that there is."""
    with pytest.raises(error, match=says):
        read_sceniris(cfg)
