"""Relations hold in every layout, as the audit sees it: every word, frame, measure and option."""

from __future__ import annotations

import inspect
import re
from typing import Any

import numpy as np
import pytest
from scipy import stats

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.config.relations import KINDS, RelationType
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.tables import make_table
from sceniris_gym.placement import relations
from tests.layout.related import ONE_ANCHOR, Shapes, judged, near_middle, related, scene, table_of
from tests.versions import since_4

N = 1000


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """The assets."""
    return Shapes(tmp_path_factory.mktemp("shapes"))


def relations_hold(objects: dict[str, Any], words: int, n: int = N) -> None:
    """Make layouts; `words` measures of the object `q` apply to all of them, and nothing that is measured is broken."""
    compiled = scene(objects)
    kept = judged(compiled, table_of(compiled, n))
    broken = [k for k in kept if k.broken]
    assert not broken, broken
    mine = [k for k in kept if k.name == "q" and k.word not in ("yaw", "upright", "present")]
    assert len(mine) == words
    assert all(k.checked == n for k in mine)


@pytest.mark.parametrize("name", ONE_ANCHOR)
def test_a_relation_to_one_anchor_holds(name: str, shapes: Shapes):
    """The anchor is an L that is drawn and turned anew in every world, and so is the object."""
    relation, words = ONE_ANCHOR[name]
    others = {"a": near_middle(shapes.odd), "b": near_middle(shapes.bar, 0.8, 0.8)}
    relations_hold({**others, "q": related(shapes.odd, relation)}, words)


@pytest.mark.parametrize(
    "relation",
    [
        {"near": "a", "measure": "bounds", "distance": {"min": 0.02, "max": 0.1}},
        {"beside": "a", "side": "front"},
        {"beside": "a", "side": "left", "frame": "world"},
    ],
    ids=str,
)
@pytest.mark.parametrize("own", ["bar", "drawer"])
def test_bounds_are_those_of_the_drawn_joints(relation: dict, own: str, shapes: Shapes):
    """A drawer that is open makes its case longer, be it the anchor or the object itself."""
    joints = {"joints": {"*": {"fraction": [0, 1]}}}
    drawn = {"a": near_middle(shapes.drawer, **joints)}
    relations_hold({**drawn, "q": related(getattr(shapes, own), relation, **(joints if own == "drawer" else {}))}, 1)


@pytest.mark.parametrize("kind", ["static", "robot"])
@pytest.mark.parametrize(
    "relation",
    [{"near": "a", "measure": "bounds", "distance": {"min": 0.05, "max": 0.1}}, {"beside": "a", "side": "front"}],
    ids=str,
)
def test_bounds_of_what_stays_where_it_is_follow_its_joints(kind: str, relation: dict, shapes: Shapes):
    """A case that is static, or a robot that is turned, with a drawer that is drawn open anew in every world."""
    joints = {"slide": {"fraction": [0, 1]}}
    if kind == "static":
        relations_hold(
            {"a": {"asset": shapes.drawer, "kind": kind, "joints": joints}, "q": related(shapes.cube, relation)}, 1
        )
        return
    robot = {"asset": shapes.drawer, "base": [0.1, -0.2, 0.0], "yaw": 30, "joints": joints}
    to_robot = {word: "robot" if anchor == "a" else anchor for word, anchor in relation.items()}
    compiled = scene({"q": related(shapes.cube, to_robot)}, robot=robot)
    assert not [k for k in judged(compiled, table_of(compiled, N)) if k.broken]


def test_beside_something_as_wide_as_itself_is_one_place(shapes: Shapes):
    """Two equal bars with one heading: there is one point, and it is found."""
    still = {"orientation": "fixed"}
    objects = {
        "a": near_middle(shapes.bar, **still),
        "q": related(shapes.bar, {"beside": "a", "side": "right"}, **still),
    }
    relations_hold(objects, 1)


@pytest.mark.parametrize(("word", "along"), [("front", 0), ("left", 90), ("back", 180), ("right", -90)])
@pytest.mark.parametrize("yaw", [0.0, -150.0])
def test_directions_turn_with_the_robot(word: str, along: float, yaw: float, shapes: Shapes):
    """In front of a robot is where the x axis of its base points, and to its left where y does, however turned."""
    thing = related(None, {f"{word}_of": "robot", "angle": 10, "distance": {"min": 0.2}}, kind="marker")
    compiled = scene({"q": thing}, robot={"asset": shapes.drawer, "base": [0.1, -0.2, 0.0], "yaw": yaw})
    table = table_of(compiled, 200)
    assert not [k for k in judged(compiled, table) if k.broken]
    x, y = (table.mocap_pos[:, 0, :2] - [0.1, -0.2]).T
    off = np.arctan2(y, x) - np.radians(yaw + along)
    assert np.abs(np.arctan2(np.sin(off), np.cos(off))).max() < np.radians(12)


def _posts(shapes: Shapes, places: list[tuple[float, float]]) -> dict[str, Any]:
    """Cubes that stand at these places to 10 um."""
    return {
        f"p{i}": {
            **{"asset": shapes.cube, "kind": "fixture", "on": "floor"},
            "region": {"box": [[x - 1e-5, y - 1e-5], [x + 1e-5, y + 1e-5]]},
        }
        for i, (x, y) in enumerate(places)
    }


BETWEEN = {
    "two": [(-0.4, 0.0), (0.4, 0.1)],
    "three": [(-0.4, -0.3), (0.5, 0.1), (0.0, 0.6)],
    "three on a line": [(-0.5, -0.3), (0.0, 0.0), (0.5, 0.3)],
    "three nearly on a line": [(-0.5, -0.3), (0.0, 0.0004), (0.5, 0.3)],
    "four, of which three are on a line": [(0.0, -0.4), (-0.5, -0.4), (0.5, -0.4), (0.1, 0.5)],
    "five, of which one is inside": [(-0.5, -0.5), (0.5, -0.5), (0.05, 0.1), (0.5, 0.5), (-0.5, 0.5)],
    "a row of five and one beside it, turned by 216.6 degrees": [
        (x * np.cos(3.7804) - y * np.sin(3.7804), x * np.sin(3.7804) + y * np.cos(3.7804))
        for x, y in [(0.0, 0.0), (0.15, 0.0), (0.3, 0.0), (0.45, 0.0), (0.6, 0.0), (0.1, 0.5)]
    ],
    "eight": [(0.6 * np.cos(t), 0.6 * np.sin(t)) for t in np.arange(8) * 0.75 * np.pi + 0.1],
}


@pytest.mark.parametrize("name", BETWEEN)
@pytest.mark.parametrize("width", [0.2, None], ids=["strip", "own width"])
def test_between_holds(name: str, width: float | None, shapes: Shapes):
    """Two to eight anchors in any order, and anchors on a line, in a strip of a given width or of the object's own."""
    posts = _posts(shapes, BETWEEN[name])
    relations_hold({**posts, "q": related(shapes.bar, {"between": list(posts), "width": width})}, 1)


def test_between_anchors_that_are_drawn_anywhere_holds(shapes: Shapes):
    """Eight cubes all over the floor."""
    cubes = {name: {"asset": shapes.cube, "kind": "fixture", "on": "floor"} for name in "abcdefgh"}
    relations_hold({**cubes, "q": related(shapes.bar, {"between": list("abcdefgh")})}, 1)


def test_between_three_on_a_line_is_the_strip_from_end_to_end(shapes: Shapes):
    """Points reach both ends and both sides of the strip, and nothing beyond."""
    posts = _posts(shapes, BETWEEN["three on a line"])
    compiled = scene({**posts, "q": related(None, {"between": list(posts), "width": 0.2}, kind="marker")})
    at = table_of(compiled, 4000).mocap_pos[:, -1, :2]
    along = np.array([0.5, 0.3]) / np.hypot(0.5, 0.3)
    t, u = at @ along, at @ [-along[1], along[0]]
    assert [t.min(), t.max()] == pytest.approx([-np.hypot(0.5, 0.3), np.hypot(0.5, 0.3)], abs=0.005)
    assert [u.min(), u.max()] == pytest.approx([-0.1, 0.1], abs=0.001)


@pytest.mark.parametrize("apart", [0.0, 4e-4])
def test_between_anchors_at_one_place_is_a_square(apart: float, shapes: Shapes):
    """Two markers at one point, or nearly: the object is in a square of the width around them, all over it."""
    goals = {
        name: {"kind": "marker", "region": {"box": [[0.1 + x, 0.2, 0.1], [0.1 + x, 0.2, 0.1]]}}
        for name, x in (("a", 0.0), ("b", apart))
    }
    compiled = scene({**goals, "q": related(None, {"between": ["a", "b"], "width": 0.3}, kind="marker")})
    table = table_of(compiled, 2000)
    assert not [k for k in judged(compiled, table) if k.broken]
    off = table.mocap_pos[:, -1, :2] - [0.1, 0.2]
    for part in off.T:
        assert stats.kstest(part / 0.3 + 0.5, "uniform").pvalue > 0.001


FURTHEST = {
    "near": {"near": "a", "distance": {"equal": 0.3}},
    "by bounds": {"near": "a", "measure": "bounds", "distance": {"equal": 0.1, "tolerance": 0.001}},
    "beside": {"beside": "a", "side": "left"},
}


@pytest.mark.parametrize("name", FURTHEST)
def test_relations_and_supports_hold_at_the_corner_of_the_largest_floor(name: str, shapes: Shapes):
    """Both hold where single precision is coarsest: at 100 m along both axes, with a thing in a drawer beside it."""
    corner = {"region": {"box": [[99.0, 99.0], [99.5, 99.5]]}}
    case = {"asset": shapes.drawer, "on": "floor", "ratio_on_support": 1.0, "joints": {"slide": {"fraction": [0, 1]}}}
    objects = {
        "a": {"asset": shapes.odd, "kind": "fixture", "on": "floor", **corner},
        "q": related(shapes.odd, FURTHEST[name]),
        "case": {**case, "region": {"box": [[96.0, 96.0], [100.0, 100.0]]}},
        "cube": {"asset": shapes.cube, "in": "case/drawer"},
    }
    compiled = scene(objects, floor={"size": [200.0, 200.0]})
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table_of(compiled, 500), settled=60)
    assert not report.relation_violations
    assert not report.conflicts
    assert not report.misplaced
    assert report.depth < 1e-4


TWO = [{"front_of": "a", "distance": {"min": 0.2}}, {"right_of": "b", "angle": 80}]
FOUR = [
    {"front_of": "a", "distance": {"min": 0.2}},
    {"right_of": "b", "angle": 170},
    {"near": "b", "measure": "bounds", "distance": {"max": 0.9}},
    {"between": ["a", "b"], "width": 1.5},
]
PINNED = [{"beside": "a", "side": "right"}, {"near": "b", "distance": {"max": 0.85}}]


@pytest.mark.parametrize(
    ("relations", "words"), [(TWO, 3), (FOUR, 5), (PINNED, 2)], ids=["two", "four", "beside and near"]
)
def test_relations_hold_together(relations: list[dict], words: int, shapes: Shapes):
    """Regions intersect, lines with areas too."""
    others = {"a": near_middle(shapes.odd, -0.4, 0.0), "b": near_middle(shapes.bar, 0.4, 0.1)}
    relations_hold({**others, "q": related(shapes.bar, *relations)}, words)


def test_relations_hold_on_a_turned_support(shapes: Shapes):
    """On a slab that is turned anew in every world; one direction in its frame, one in the anchor's."""
    slab = near_middle(shapes.slab, orientation={"yaw": [-180, 180]})
    on_it = {"asset": shapes.odd, "on": "slab", "region": {"fraction": [[0.4, 0.4], [0.6, 0.6]]}}
    relations = [{"left_of": "a", "frame": "support", "angle": 30}, {"front_of": "a"}]
    relations_hold({"slab": slab, "a": on_it, "q": related(shapes.bar, *relations, on="slab")}, 2)


def test_relations_hold_on_the_floor_of_a_drawer(shapes: Shapes):
    """A drawer that is drawn out by 16 to 20 cm carries both."""
    case = near_middle(shapes.drawer, joints={"slide": {"fraction": [0.8, 1.0]}})
    inside = {"asset": shapes.cube, "in": "case/drawer"}
    relation = {"near": "a", "distance": {"max": 0.1}}
    relations_hold({"case": case, "a": inside, "q": {**inside, "relations": [relation]}}, 1)


@since_4("a fixture's own parts collide with it, so an open lid touches its box")
def test_relations_hold_on_a_lid_that_is_shut(shapes: Shapes):
    """Nothing can stand on a lid that is drawn open, so the layout is made anew."""
    chest = near_middle(shapes.lid, joints={"hinge": {"choice": [0.0, -1.0]}})
    cube = {"asset": shapes.cube, "on": "chest/lid"}
    objects = {"chest": chest, "a": cube, "q": {**cube, "relations": [{"right_of": "a", "frame": "support"}]}}
    compiled = scene(objects)
    generator = LayoutGenerator(compiled, 400)
    generator.generate()
    assert (generator.layouts.status.numpy() == LayoutStatus.VALID).mean() > 0.95
    assert (generator.layouts.qpos.numpy()[:, compiled.mjm.joint("chest/hinge").qposadr[0]] == 0.0).all()
    assert generator.rejection_counts()["a"]["empty"] > 100
    assert not [k for k in judged(compiled, make_table(compiled, 400, 0)) if k.broken]


def test_a_region_crops_what_relations_leave(shapes: Shapes):
    """A polygon on the floor, with a direction."""
    crop = {"polygon": [[-0.5, -0.5], [0.9, 0.0], [0.0, 0.9]]}
    objects = {"a": near_middle(shapes.odd), "q": related(None, {"right_of": "a"}, kind="marker", region=crop)}
    compiled = scene(objects)
    table = table_of(compiled, N)
    assert not [k for k in judged(compiled, table) if k.broken]
    x, y = table.mocap_pos[:, -1, :2].T
    sides = [(1.4 * (y + 0.5) - 0.5 * (x + 0.5)), -(0.9 * (x - 0.9) + 0.9 * y), (1.4 * (x + 0.5) - 0.5 * (y + 0.5))]
    assert np.min(sides) > -1e-5


@pytest.mark.parametrize(
    ("relation", "words"),
    [
        ({"right_of": "a", "distance": {"max": 0.5}}, 2),
        ({"near": "a", "measure": "bounds", "distance": {"equal": 0.1}}, 1),
        ({"beside": "a", "side": "left"}, 1),
        ({"between": ["a", "b"], "width": 0.2}, 1),
    ],
    ids=str,
)
@pytest.mark.parametrize("turn", ["any", {"yaw": [0, 90]}], ids=str)
def test_relations_hold_in_a_box_in_space(relation: dict, words: int, turn: Any, shapes: Shapes):
    """Seen from above, at any height of the box."""
    others = {"a": near_middle(shapes.odd), "b": near_middle(shapes.bar, 0.5, 0.3)}
    box = {"box": [[-0.9, -0.9, 0.3], [0.9, 0.9, 0.6]]}
    thing = {"asset": shapes.odd, "region": box, "orientation": turn, "relations": [relation]}
    relations_hold({**others, "q": thing}, words)


@pytest.mark.parametrize("anchor", ["marker", "post"])
def test_markers_take_part(anchor: str, shapes: Shapes):
    """A point without an asset is placed by relations, and others by relations to it."""
    others = {
        "a": near_middle(shapes.odd),
        "marker": {"kind": "marker", "on": "floor"},
        "post": near_middle(shapes.bar, 0.5),
    }
    near = [{"near": anchor, "measure": "bounds", "distance": {"equal": 0.2}}, {"back_of": "a", "angle": 120}]
    relations_hold({**others, "q": {"kind": "marker", "on": "floor", "relations": near}}, 2)
    relations_hold({**others, "q": related(shapes.odd, *near)}, 2)


def test_an_empty_region_is_a_cause_of_its_own(shapes: Shapes):
    """A wedge that leaves the floor in some worlds: those are made anew, and nothing is put at the origin."""
    others = {"a": {"asset": shapes.cube, "kind": "fixture", "on": "floor"}}
    far = related(shapes.cube, {"right_of": "a", "frame": "world", "distance": {"min": 1.5}, "angle": 20})
    compiled = scene({**others, "q": far})
    generator = LayoutGenerator(compiled, 500)
    generator.generate()
    assert generator.rejection_counts()["q"]["empty"] > 500
    table = make_table(compiled, 500, 0)
    assert table.valid.mean() > 0.05
    assert not [k for k in judged(compiled, table) if k.broken]  # those of the bank keep their relations too


def test_every_type_of_relation_has_a_case_in_the_kernels():
    """`resolve` names all but one; what it makes of them is a sector, which the others name, a strip or a hull."""
    named = {
        function.key: {t for t in RelationType if re.search(rf"(_|RelationType\.){t.name}\b", source)}
        for function in (relations.resolve, relations.write_sides, relations.relation_holds)
        for source in [inspect.getsource(function.func)]
    }
    assert set(RelationType) - named["resolve"] == {RelationType.BESIDE}
    assert named["write_sides"] == named["relation_holds"] == {RelationType.SECTOR}
    assert {kind.type for kind in KINDS} == set(RelationType)


def test_a_region_that_is_always_empty_is_infeasible(shapes: Shapes):
    """Nothing on a floor of 2 m is 3 m away from its middle."""
    objects = {
        "a": near_middle(shapes.cube),
        "q": related(shapes.cube, {"near": "a", "distance": {"min": 3.0, "max": 4.0}}),
    }
    with pytest.raises(InfeasibleSceneError, match="'q' could not be placed, mostly because of empty"):
        scene(objects)
