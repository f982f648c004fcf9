"""Units and up axes: what is said wins over what is guessed, and sizes that make no sense are asked for or refused."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.errors import ArgumentError, MeshError
from sceniris_gym.importers.things.thing import Link, Thing
from sceniris_gym.importers.things.units import UPRIGHT, find_scale, find_up, parse_scale
from tests.importers.things.shapes import box, surface


def thing(size: float, meters: float | None = None, up: str | None = None) -> Thing:
    """A cube of a size."""
    return Thing("cube", (Link("cube", surfaces=(surface(box((size, size, size))),)),), meters, up)


def test_what_the_user_says_wins_then_what_the_file_says_then_metres():
    """And each is told."""
    assert find_scale(thing(100.0, 0.01), "mm", None, "x") == (0.001, "as given")
    assert find_scale(thing(100.0, 0.01), None, None, "x") == (0.01, "from the file")
    assert find_scale(thing(0.1), None, None, "x") == (1.0, "guessed: the file has no unit")
    assert "--scale" in find_scale(thing(0.005), None, None, "x")[1]


@pytest.mark.parametrize(("size", "density", "told"), [(12.6, 0.0, "12.6 m long"), (1.9, 15.0, "with 103 kg")])
def test_a_guessed_unit_that_gives_furniture_is_refused_where_nobody_can_be_asked(
    size: float, density: float, told: str
):
    """OBJ and STL files are mostly in cm or mm: units that give the size of a thing in a hand are proposed."""
    with pytest.raises(MeshError, match=rf"{told}.*--scale in makes it {0.0254 * size:.3g} m") as raised:
        find_scale(thing(size), None, None, "cube.stl", density)
    assert "--scale mm" not in str(raised.value) and "--scale m keeps" in str(raised.value)
    assert raised.value.reason == "size"
    assert find_scale(thing(size), None, lambda _: "cm", "cube.stl", density) == (0.01, "as answered")
    for given, in_file in (("m", None), (None, 1.0)):  # said by the user, or by the file
        assert find_scale(thing(size, in_file), given, None, "cube.stl", density)[0] == 1.0


@pytest.mark.parametrize("size", [0.0005, 80.0])
def test_a_size_that_makes_no_sense_is_refused_where_nobody_can_be_asked(size: float):
    """With the units in which it would make sense."""
    with pytest.raises(MeshError, match=r"from 1 mm to 50 m.*--scale"):
        find_scale(thing(size), None, None, "cube.stl")


def test_a_remedy_is_one_that_helps():
    """No unit that would be refused next; where no unit helps, a number does; and what has no size has none."""
    said = str(refused(0.0001))
    assert "--scale 1000 if it is 0.1 m long" in said and "--scale m" not in said
    assert find_scale(thing(0.0001), "1000", None, "x") == (1000.0, "as given")
    assert "--scale 1e-07 if it is 0.1 m long" in str(refused(1e6))
    assert "--scale mm makes it 0.005 m" not in str(refused(5.0, "100"))
    assert "--scale m makes it 0.005 m, --scale ft makes it 0.00152 m" in str(refused(0.005, "0.01"))
    assert "export the file again" in str(refused(0.0))


def refused(size: float, scale: str | None = None) -> MeshError:
    """Return the error about a size that nobody can be asked about."""
    with pytest.raises(MeshError) as raised:
        find_scale(thing(size), scale, None, "cube.stl")
    assert raised.value.reason == "size"
    return raised.value


def test_it_is_asked_for_where_somebody_is_there():
    """And the answer has to make sense too."""
    questions = []

    def answer(text: str):
        def ask(question: str) -> str:
            questions.append(question)
            return text

        return ask

    assert find_scale(thing(80.0), None, answer("mm"), "cube.stl") == (0.001, "as answered")
    assert "--scale mm makes it 0.08 m" in questions[0]
    with pytest.raises(MeshError):
        find_scale(thing(80.0), None, answer("m"), "cube.stl")


@pytest.mark.parametrize("text", ["0", "-1", "nan", "yards"])
def test_a_scale_is_a_positive_number_or_a_unit(text: str):
    """Others are refused."""
    with pytest.raises(ArgumentError, match="scale"):
        parse_scale(text)


def test_an_axis_points_up_if_it_is_said_or_the_thing_stands_so():
    """Z is tried before y."""
    assert find_up(thing(1.0, up="y"), "x", lambda axis: True)[0] == "x"
    assert find_up(thing(1.0, up="y"), None, lambda axis: True)[0] == "y"
    assert find_up(thing(1.0), None, lambda axis: True)[0] == "z"
    assert find_up(thing(1.0), None, lambda axis: axis == "y")[0] == "y"
    assert find_up(thing(1.0), None, lambda axis: False) == ("z", "guessed: it does not stand with z or y up")


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_turns_make_the_axis_point_up(axis: str):
    """And are rotations."""
    turn = UPRIGHT[axis]
    np.testing.assert_allclose(turn @ np.eye(3)["xyz".index(axis)], [0, 0, 1])
    assert np.linalg.det(turn) == pytest.approx(1.0)
