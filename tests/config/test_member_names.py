"""Names of members: written and read by the same functions."""

from __future__ import annotations

import pytest

from sceniris_gym.config.member_names import MemberName, object_of, split_support, variant_of, without_support


@pytest.mark.parametrize(
    ("name", "support", "member", "variant"),
    [
        ("apple", "table", "apple/@table", ""),
        ("apple", "cabinet/drawer", "apple/@cabinet:drawer", ""),
        ("thing/can", "floor", "thing/can@floor", "can"),
        ("thing/can", "unit/box@table", "thing/can@unit:box@table", "can"),
    ],
)
def test_members_are_read_as_they_are_written(name: str, support: str, member: str, variant: str):
    """The object, the variant, and both without the support."""
    made = MemberName.on(name, support)
    assert made == member
    assert (object_of(made), variant_of(made), without_support(made)) == (name.partition("/")[0], variant, name)


def test_a_support_is_an_object_a_member_or_a_body():
    """A member goes before a body of the same name."""
    objects = ("cabinet", "unit/box", "apple/@unit:box")
    assert split_support("cabinet/drawer", objects) == ("cabinet", "drawer")
    assert split_support("unit/box", objects) == ("unit/box", "")
    assert split_support("apple/@unit:box", objects) == ("apple/@unit:box", "")
    assert split_support("floor", objects) == ("floor", "")
