"""The pages on the scene language: every example loads, can be made, and lies where its picture shows it."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from docs.examples import FOLDER, PAGES, TEXT_KEY, Example, read_examples
from docs.seen import View
from sceniris_gym.config.groups import GroupConfig, StackConfig
from sceniris_gym.config.objects import JointConfig, ObjectConfig, RegionConfig
from sceniris_gym.config.orientation import Orientation, Stable
from sceniris_gym.config.relations import KINDS, Connection, Distance
from sceniris_gym.config.robot import RobotConfig, TcpConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import CameraConfig, Floor
from sceniris_gym.program.checks import oddities
from sceniris_gym.program.device import Cause
from tests.oracle.hostile_judge import KICK
from tests.sources import PACKAGE, tree_of

EXAMPLES = read_examples(*PAGES)
TEXT = "".join(page.read_text(encoding="utf-8") for page in PAGES)
PARTS = (
    *(SceneConfig, Floor, RobotConfig, TcpConfig, ObjectConfig, RegionConfig, JointConfig, GroupConfig, StackConfig),
    *(CameraConfig,),
    *(*KINDS, Connection, Distance, Orientation, Stable),
)
NOT_EXPLAINED = {"name", "objects", "asset", "by_area"}  # what is no matter of placement, or no word of a file


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
    """Lines of the pages are no longer than those of the code, but for tables and pictures."""
    assert [line for line in TEXT.splitlines() if len(line) > 120 and not line.startswith(("|", "!["))] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_page_is_short(page: Path) -> None:
    """It has one topic; the table of all words may be longer."""
    assert page.stem == "words" or page.stat().st_size < 8_200


def test_every_block_of_yaml_is_an_example_and_every_picture_has_one() -> None:
    """Nothing is left over in the pages or in the folder of pictures."""
    assert len(EXAMPLES) == TEXT.count("```yaml")
    assert {e.picture for e in EXAMPLES} == set((FOLDER / "examples").glob("*.png"))


def test_every_word_of_the_scene_file_is_explained() -> None:
    """All keys of all parts, all forms of an orientation and all causes stand in the pages as words."""
    prose = "".join(page.read_text(encoding="utf-8") for page in PAGES if page.stem != "words")
    explained = set(re.findall(r"`([a-z_]+)`", prose))
    keys = {field.alias or key for part in PARTS for key, field in part.model_fields.items()}
    causes = {cause.name.lower() for cause in Cause if cause != Cause.NONE}
    words = {"fixed", "any", "stable", "free", "fixture", "static", "marker", "anchor", "support", "world", "base"}
    assert (keys - NOT_EXPLAINED) | causes | words <= explained


def test_bounds_of_an_object_that_is_faced_are_seen_in_its_heading() -> None:
    """In the pictures a chair's front points from its pivot at the cabinet's, by measurement."""
    view = View(next(e for e in EXAMPLES if e.name == "face_to").load(), 16)
    for i in view.worlds("chair"):
        chair, cabinet = view.bounds("chair", i), view.bounds("cabinet", i)
        ahead = (cabinet.pivot - chair.pivot)[:2]
        np.testing.assert_allclose(ahead / np.linalg.norm(ahead), chair.front, atol=1e-4)


def _page(name: str) -> str:
    return (FOLDER / f"{name}.md").read_text(encoding="utf-8")


def _rows(text: str) -> list[str]:
    """Return the rows of all tables of a text, without their heads."""
    return re.findall(r"^\| (?!what)[^\n]*", text, re.MULTILINE)


@cache
def _raised() -> list[tuple[Path, str, str, str]]:
    """The file, its function, the name and the words of every error that is raised, or that makes its words itself."""
    return list(_each_raised())


def _each_raised() -> Iterator[tuple[Path, str, str, str]]:
    for path in PACKAGE.rglob("*.py"):
        file = path.relative_to(PACKAGE)
        for top in tree_of(path).body:
            of = top.name if isinstance(top, ast.FunctionDef | ast.ClassDef) else ""
            for node in ast.walk(top):
                if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                    name = ast.unparse(node.exc.func)
                    yield file, of, name, "" if name in OWN_WORDS else _texts(node.exc)
                elif isinstance(node, ast.FunctionDef):
                    called = {
                        n.func.id for n in ast.walk(node) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
                    }
                    for made in OWN_WORDS & called:
                        yield file, of, made, _texts(*node.body[1:])  # without the docstring


def _texts(*nodes: ast.AST) -> str:
    found = [n for node in nodes for n in ast.walk(node) if isinstance(n, ast.Constant)]
    return " ... ".join(n.value for n in found if isinstance(n.value, str))


OF_MODELS = {"ArmError", "MeshError", "NotSupportedError"}
OWN_WORDS = {"GraspError", "InfeasibleSceneError"}  # put together in their function
LIMITS = {
    "program/checks/places.py",
    "program/checks/objects.py: check_relations",
    "program/checks/standing.py",  # the page on standing
    "program/grips.py",  # the page on starts
    "program/starts.py",
    "scene/heaps.py: read_rows",  # a missing file
    "scene/parking.py",
    "sim/redrawing.py",  # the page on redraws
    "sim/rest.py",  # the page on starts
}
ELSEWHERE = ("audit", "commands", "dataset", "pictures", "training", "importers")


def _about_models() -> Iterator[str]:
    """The words of what a valid model in a valid scene file may meet, but for what the section on limits has."""
    others = (
        "cannot be combined",
        "bench: ",
        "generate: ",
        "init: --assets",
        "becomes two files",
        "replay: ",
        "view: ",
        "should be a PNG",
        "--tier clear",
        "the audit cannot judge",
    )
    others += ("no geom that collides", "holds device memory", "close fingers", "without params")
    for file, of, name, words in _raised():
        is_ours = name in OF_MODELS and not any(other in words for other in others) and file.name != "errors.py"
        is_ours = is_ours or name in OWN_WORDS
        is_ours = is_ours or (name == "SceneKeyError" and file.parts[0] in ("scene", "geometry", "program"))
        is_ours = is_ours or "is a marker and has no surface" in words
        elsewhere = {str(file), f"{file}: {of}"} & LIMITS or file.parts[0] in ELSEWHERE
        if is_ours and not elsewhere and words.strip(": ."):
            yield words


def test_what_is_not_supported_is_listed_in_the_words_of_its_error() -> None:
    """Each row quotes an error; each error about a model is quoted by a row."""
    rows = [row.split("|")[2] for row in _rows(_page("unsupported"))]
    quotes = [re.findall(r'"([^"]+)"', row) for row in rows]
    assert len(rows) > 15
    assert all(quotes)
    raised = [words for *_, words in _raised()]
    for quote in (q for row in quotes for q in row):
        assert any(quote in words for words in raised), quote
    missing = [w for w in _about_models() if not any(quote in w for row in quotes for quote in row)]
    assert not missing, "\n".join(missing)


def test_the_bound_on_kicks_is_that_of_the_judge() -> None:
    """The page has the judge's bounds on accelerations beyond gravity and springs, for slides and for hinges."""
    text = " ".join(_page("joints").split())
    assert f"plus {KICK:g} m/s2 for a slide" in text
    assert f"it is {KICK:g} m/s2 over the radius of gyration" in text


def test_warnings_are_listed_with_their_numbers() -> None:
    """Those of the code."""
    text = _page("limits").split("## Warnings\n")[1].split("\n## ")[0]
    least, most = oddities._SMALLEST, oddities._LARGEST
    for number in (
        f"{oddities._FILLED:g} times",
        f"{1e3 * least:g} mm or above {most:g} m",
        f"{1e3 * oddities._SUNK:g} mm",
        f"{oddities._FINE:g} m",
    ):
        assert number in text
    kinds = re.findall(r"def _\w+\(plan: Plan\)", Path(str(oddities.__file__)).read_text(encoding="utf-8"))
    assert len(_rows(text)) == len(kinds)
