"""Problem files as they are written: what is read of them, and errors that name a line and a remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import SceneFileError, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.importers.libero.problem import Predicate, Region, read_problem
from tests.importers.libero.problems import KITCHEN, write


def line_of(text: str) -> int:
    """Return the line of the test file that has a text."""
    return next(i for i, line in enumerate(KITCHEN.splitlines(), 1) if text in line)


def test_a_problem_is_read_as_it_is_written(tmp_path: Path):
    """Classes of things, regions with rectangles and headings, predicates and the instruction."""
    problem = read_problem(write(tmp_path))
    assert problem.language == "put the bowl on the plate and close the top drawer"
    assert problem.objects["akita_black_bowl_2"] == "akita_black_bowl"
    assert list(problem.fixtures.values()) == ["kitchen_table", "wooden_cabinet", "flat_stove"]
    file, yaw = tmp_path / "problem.bddl", (3.141592653589793, 3.141592653589793)
    where = f"{file}:{line_of('(cabinet_region')}"
    cabinet = Region("kitchen_table", "cabinet_region", ((0.0, -0.31, 0.02, -0.29),), yaw, where)
    assert problem.regions["kitchen_table_cabinet_region"] == cabinet
    assert problem.regions["wooden_cabinet_1_top_region"].boxes == ()
    assert len(problem.init) == 7
    assert [str(p) for p in problem.goal] == [
        "(On akita_black_bowl_1 plate_1)",
        "(Close wooden_cabinet_1_top_region)",
    ]
    assert problem.init[-1] == Predicate("Turnon", ("flat_stove_1",))
    assert problem.init[-1].where == f"{file}:{line_of('(Turnon flat')}: (Turnon flat_stove_1)"
    assert problem.of_interest == ("akita_black_bowl_1", "plate_1")
    assert problem.places["plate_1"] == f"{file}:{line_of('plate_1 - plate')}"


def test_predicates_are_read_in_any_case(tmp_path: Path):
    """As LIBERO reads them; a goal may also be a single predicate."""
    changes = {"(Turnon flat": "(TURNON flat", "(And (On akita_black_bowl_1 plate_1)": "(and (turnOff flat_stove_1)"}
    problem = read_problem(write(tmp_path, **changes))
    assert problem.init[-1].word == "Turnon"
    assert problem.goal[0] == Predicate("Turnoff", ("flat_stove_1",))


def test_files_of_editors_on_windows_are_read(tmp_path: Path):
    """With a byte order mark, and line ends of two characters."""
    path = write(tmp_path)
    plain = read_problem(path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert read_problem(path) == plain


WRONG = [
    ("(On plate_1 kitchen", "(Onto plate_1 kitchen", UnknownNameError, "unknown predicate 'Onto'. Did you mean 'On'?"),
    ("(Turnon flat", "(Not flat", UnknownNameError, "unknown predicate 'Not'"),
    ("kitchen_table_plate_region)", "kitchen_table_plat_region)", UnknownNameError, "'kitchen_table_plate_region'?"),
    (
        "(Open wooden_cabinet_1_top_region)",
        "(Open wooden_cabinet_1 top)",
        SceneKeyError,
        "(Open ...) with one object or region",
    ),
    (
        "(On akita_black_bowl_1 plate_1)",
        "(In akita_black_bowl_1 plate_1)",
        UnknownNameError,
        "unknown region 'plate_1'",
    ),
    ("(:target flat_stove_1)", "(:goal flat_stove_1)", SceneKeyError, "should be a region: a name and '(:target"),
    (
        "(Open wooden_cabinet_1_top_region)",
        "(Open wooden_cabinet_1_top_region) (Close wooden_cabinet_1_top_region)",
        SceneKeyError,
        "(Close wooden_cabinet_1_top_region) contradicts ",
    ),
    ("(:yaw_rotation ((0.0 0.0)))", "(:yaw_rotation ((3.2 3.0)))", SceneKeyError, "have '(:yaw_rotation ((LEAST GREA"),
    ("(:rgba (0 0 1 0))", "(:colour (0 0 1 0))", UnknownNameError, "unknown attribute of a region ':colour'"),
    ("(0.02 0.1 0.06 0.14)", "(0.06 0.1 0.02 0.14)", SceneKeyError, "(:ranges ((LOW_X LOW_Y HIGH_X HIGH_Y)))"),
    ("(0.02 0.1 0.06 0.14)", "(0.02 0.1 nan 0.14)", SceneKeyError, "should be a region"),
    ("(0.02 0.1 0.06 0.14)", "(0.02 0.1 0.06)", SceneKeyError, "should be a region"),
    ("plate_1 - plate", "plate_1 -", SceneKeyError, "should stand between names and their class"),
    ("plate_1 - plate\n", "plate_1\n", SceneKeyError, "'plate_1' should be followed by '- CLASS'"),
    ("plate_1 - plate\n", "flat_stove_1 - plate\n", SceneKeyError, "uses the name 'flat_stove_1' already"),
    ("(:obj_of_interest", "(:objekt", UnknownNameError, "unknown section ':objekt'. Did you mean ':objects'?"),
    ("plate_1 - plate\n", "world - plate\n", SceneKeyError, "MuJoCo uses the name 'world' already"),
    ("(:fixtures", ":regions (:fixtures", UnknownNameError, "unknown section ':regions without parentheses'"),
    ("(:target flat_stove_1)", "()", SceneKeyError, "should be a region"),
    ("(:language put", "(:language (put)", SceneKeyError, "should be a word without parentheses"),
    ("(top_region (:target wooden_cabinet_1))", "(top_region (:target wooden_1))", UnknownNameError, "region"),
]


@pytest.mark.parametrize(("before", "after", "error", "message"), WRONG, ids=[w[1][:24].strip() for w in WRONG])
def test_errors_name_the_line_and_the_remedy(
    before: str, after: str, error: type[ScenirisError], message: str, tmp_path: Path
):
    """Each part of a file that cannot be read is refused, with the file and the line."""
    with pytest.raises(error) as raised:
        read_problem(write(tmp_path, **{before: after}))
    assert message in str(raised.value)
    where, _, rest = str(raised.value).partition("problem.bddl:")
    assert where == f"{tmp_path}/"
    assert rest.partition(":")[0].isdigit()


def test_parentheses_that_do_not_match_are_named(tmp_path: Path):
    """One that is never closed by its line, and one too many."""
    with pytest.raises(SceneFileError, match=r"bddl:2: the '\(' of this line should be closed"):
        read_problem(write(tmp_path, KITCHEN.rstrip()[:-1]))
    with pytest.raises(SceneFileError, match=r"has no matching '\('"):
        read_problem(write(tmp_path, KITCHEN + ")"))


def test_other_files_are_refused(tmp_path: Path):
    """A missing file, text that is no problem, and a problem without things."""
    with pytest.raises(SceneFileError, match="it does not exist"):
        read_problem(tmp_path / "none.bddl")
    for endless in ("/dev/zero", "/dev/random"):
        with pytest.raises(SceneFileError, match="a pipe or a device, not a file"):
            read_problem(endless)
    with pytest.raises(SceneFileError, match=r"begins with '\(define"):
        read_problem(write(tmp_path, "objects: {}"))
    with pytest.raises(SceneKeyError, match=r"a section '\(:fixtures"):
        read_problem(write(tmp_path, "(define (problem X) (:init (On a b)))"))


def test_a_region_of_a_thing_that_is_missing_is_an_error_only_if_it_is_used(tmp_path: Path):
    """Files of LIBERO have regions of fixtures that they lack."""
    extra = {"(cook_region": "(left_region (:target bowl_drainer_1)) (cook_region"}
    assert "bowl_drainer_1_left_region" in read_problem(write(tmp_path, **extra)).regions
    used = {**extra, "(On plate_1 kitchen_table_plate_region)": "(On plate_1 bowl_drainer_1_left_region)"}
    with pytest.raises(UnknownNameError, match="unknown object or fixture 'bowl_drainer_1'"):
        read_problem(write(tmp_path, **used))
