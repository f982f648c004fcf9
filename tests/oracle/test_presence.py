"""The enumerator of presence, on scenes whose answer is known by hand."""

from __future__ import annotations

from fractions import Fraction

from tests.oracle.presence import outcomes


def names(found: dict[frozenset, Fraction]) -> dict[str, Fraction]:
    """Return the probabilities by the initials of the present objects, in order."""
    return {"".join(sorted(name[0] for name, _, _ in items)): chance for items, chance in found.items()}


def test_a_count_is_cut_to_those_that_can_be_there():
    """One or two of b and c, where c needs a, and a is there in half of the layouts."""
    objects = {"a": {"on": "floor"}, "b": {"on": "floor"}, "c": {"on": "floor", "if": "a"}}
    groups = {"first": {"of": ["a"], "count": [0, 1]}, "rest": {"of": ["b", "c"], "count": [1, 2]}}
    half, eighth = Fraction(1, 2), Fraction(1, 8)
    assert names(outcomes({"objects": objects, "groups": groups})) == {
        "b": half,
        "ab": eighth,
        "ac": eighth,
        "abc": 2 * eighth,
    }


def test_a_group_that_names_its_neighbour_is_drawn_before_its_condition_holds():
    """One or two of two groups, of which the second needs a, one of two things in the first."""
    groups = {
        "meal": {"of": ["a", "b"], "count": 1},
        "sweets": {"of": ["c"], "count": 1, "if": "a"},
        "guests": {"of": ["meal", "sweets"], "count": [1, 2]},
    }
    eighth = Fraction(1, 8)
    found = names(outcomes({"objects": {name: {"on": "floor"} for name in "abc"}, "groups": groups}))
    assert found == {"": 2 * eighth, "a": eighth, "b": 3 * eighth, "ac": 2 * eighth}


def test_what_is_on_the_absent_is_absent_with_it():
    """A tower of three whose foot is one of two, and a lid on whichever of two supports is there."""
    objects = {
        "a": {"on": "floor"},
        "b": {"on": "a"},
        "c": {"on": "b"},
        "d": {"on": "floor"},
        "e": {"on": {"c": 1, "d": 3}},
    }
    found = names(outcomes({"objects": objects, "groups": {"foot": {"of": ["a", "d"], "count": 1}}}))
    assert found == {"abce": Fraction(1, 2), "de": Fraction(1, 2)}


def test_supports_that_are_there_share_by_weight():
    """Twice as often on the first, and on one alone if it is the only one."""
    objects = {"a": {"on": "floor"}, "b": {"on": {"floor": 2, "a": 1}}}
    found = outcomes({"objects": objects, "groups": {"some": {"of": ["a"], "count": [0, 1]}}})
    assert found[frozenset({("b", "", "floor")})] == Fraction(1, 2)
    assert found[frozenset({("a", "", ""), ("b", "", "floor")})] == Fraction(1, 3)
    assert found[frozenset({("a", "", ""), ("b", "", "a")})] == Fraction(1, 6)
