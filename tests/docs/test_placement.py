"""The page on placement: every example loads, can be made, lies where its picture shows it, and has that picture."""

from __future__ import annotations

import re

import numpy as np
import pytest
import shapely
from PIL import Image

from docs.examples import FOLDER, TEXT_KEY, Example, read_examples
from docs.seen import View
from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.objects import JointConfig, ObjectConfig, RegionConfig
from sceniris_gym.config.orientation import Orientation, Stable
from sceniris_gym.config.relations import Distance, Relation
from sceniris_gym.config.scene import Floor, RobotConfig, SceneConfig
from sceniris_gym.program.device import Cause

PAGE = FOLDER / "placement.md"
EXAMPLES = read_examples(PAGE)
PARTS = (
    *(SceneConfig, Floor, RobotConfig, ObjectConfig, RegionConfig, JointConfig, GroupConfig),
    *(Relation, Distance, Orientation, Stable),
)
NOT_EXPLAINED = {"name", "objects", "asset"}  # what is no matter of placement


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: e.name)
def test_an_example_is_made_where_its_region_is(example: Example) -> None:
    """Its world is built, and every pivot lies in the region that shapely makes of its words."""
    view = View(example.load(), 64)
    assert any(view.is_fresh(i) for i in range(64))
    for name in filter(view.is_placed, example.own_objects):
        for i in view.worlds(name):
            region = view.region(name, i)
            if region is not None:
                pivot = shapely.Point(view.bounds(name, i).pivot[:2])
                assert shapely.distance(region, pivot) < 2e-4, (name, i)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: e.name)
def test_an_example_has_a_picture_that_was_drawn_from_it(example: Example) -> None:
    """The picture holds the text of its example, so that it is drawn anew when that changes."""
    with Image.open(example.picture) as picture:
        assert picture.size == (480, 360)
        assert picture.info[TEXT_KEY] == example.text
    assert example.picture.stat().st_size < 40_000


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: e.name)
def test_an_example_has_three_lines(example: Example) -> None:
    """No more than what is needed for its word, and none that is too long to be read."""
    lines = example.text.splitlines()
    assert len(lines) == 3
    assert max(map(len, lines)) <= 120


def test_prose_is_wrapped() -> None:
    """Lines of the page are no longer than those of the code, but for tables and for the list of words."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if len(line) > 120 and not line.startswith(("|", "- [", "!["))] == []


def test_every_block_of_yaml_is_an_example_and_every_picture_has_one() -> None:
    """Nothing is left over in the page or in its folder."""
    assert len(EXAMPLES) == PAGE.read_text(encoding="utf-8").count("```yaml")
    assert {e.picture for e in EXAMPLES} == set((FOLDER / "placement").glob("*.png"))


def test_every_word_of_the_scene_file_is_explained() -> None:
    """All keys of all parts, all forms of an orientation and all causes stand in the page as words."""
    explained = set(re.findall(r"`([a-z_]+)`", PAGE.read_text(encoding="utf-8")))
    keys = {field.alias or key for part in PARTS for key, field in part.model_fields.items()}
    causes = {cause.name.lower() for cause in Cause if cause != Cause.NONE}
    words = {"fixed", "any", "stable", "free", "fixture", "static", "marker", "anchor", "support", "world", "base"}
    assert (keys - NOT_EXPLAINED) | causes | words <= explained


def test_bounds_of_an_object_that_is_faced_are_seen_in_its_heading() -> None:
    """What the pictures show is measured: a chair's front points from its pivot at the cabinet's."""
    view = View(next(e for e in EXAMPLES if e.name == "face_to").load(), 16)
    for i in view.worlds("chair"):
        chair, cabinet = view.bounds("chair", i), view.bounds("cabinet", i)
        ahead = (cabinet.pivot - chair.pivot)[:2]
        np.testing.assert_allclose(ahead / np.linalg.norm(ahead), chair.front, atol=1e-4)
