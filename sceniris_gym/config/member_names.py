"""Names of members: an object, '/', its variant, and for one of several supports '@' and the support.

Examples are 'food/can', 'apple/@table' and 'food/can@cabinet:drawer'. `config.variants` and `config.several_supports`
write such names. All other modules read them by these functions.
"""

from collections.abc import Container

INSIDE, SUPPORT = "/", "@"
"""The signs before a variant or a body, and before a support."""


class MemberName(str):
    """The full name of a member, such as 'object/variant'. Names in a scene file cannot have these signs."""

    __slots__ = ()

    @classmethod
    def on(cls, name: str, support: str) -> "MemberName":
        """Return the name of an object or a variant on one of its supports."""
        return cls(f"{name}{'' if INSIDE in name else INSIDE}{SUPPORT}{support.replace(INSIDE, ':')}")


def object_of(name: str) -> str:
    """Return the object that a member, or a support such as 'object/body', belongs to."""
    return name.partition(INSIDE)[0]


def variant_of(name: str) -> str:
    """Return the variant in a member's name, '' if it has none."""
    return name.partition(INSIDE)[2].partition(SUPPORT)[0]


def without_support(name: str) -> str:
    """Return the object or the variant of a member."""
    return name.partition(SUPPORT)[0].removesuffix(INSIDE)


def split_support(parent: str, objects: Container[str]) -> tuple[str, str]:
    """Split the name of a support into an object (or a member) and the body inside it, '' for the root.

    Args:
        parent: The support: 'object', a member, 'object/body' or 'object/variant/body'.
        objects: All objects and members of the scene.
    """
    owner, body = parent, ""
    while owner not in objects and INSIDE in owner:
        owner, _, last = owner.rpartition(INSIDE)
        body = f"{last}{INSIDE}{body}" if body else last
    return owner, body
