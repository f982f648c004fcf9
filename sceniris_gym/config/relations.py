"""Positions relative to other objects: a class for each kind of relation, and their union `AnyRelation`.

Directions are seen from above, with x to the right and y to the back. The front is -y.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping
from enum import IntEnum
from operator import attrgetter
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from sceniris_gym.config.bounds import MAX_ANCHORS, MAX_RELATIONS
from sceniris_gym.config.fields import Direction2, Length, Names, Number, Turn, Width, must, wrong
from sceniris_gym.config.section import Section, check_one_of

HEADINGS = {"right": 0.0, "back": 0.5 * math.pi, "left": math.pi, "front": -0.5 * math.pi}
"""Heading [rad] of each side, from x towards y."""
ROBOT_HEADINGS = {"front": 0.0, "left": 0.5 * math.pi, "back": math.pi, "right": -0.5 * math.pi}
"""Heading [rad] of each side of a robot. A robot looks along the x axis of its base, and its left side is along y."""
FRAMES = ("anchor", "support", "world")
"""The values of `frame` in a relation that are not names of objects."""

# A band is drawn from slices that contain it. Below this half width [m], too few drawn points lie in the band, partly
# because of rounding.
_LEAST_TOLERANCE = 1.0e-4
# Half of the thinnest wedge [rad] that two directions may share: about a tenth of a degree.
_LEAST_ANGLE = 1.0e-3
_THIN_BAND = "too few sampled points would lie in a thinner band"
_WIDE_ENOUGH = must(lambda half: half >= _LEAST_TOLERANCE, f"should be at least {_LEAST_TOLERANCE:g} m: {_THIN_BAND}")


class Distance(Section):
    """An interval of distances [m]: from `min` to `max`, or within `tolerance` (default 0.01) of `equal`."""

    min: Length | None = None
    max: Length | None = None
    equal: Length | None = None
    tolerance: Annotated[Length, _WIDE_ENOUGH] | None = None

    @property
    def low(self) -> float:
        """The minimum distance [m]."""
        return max(0.0, self.equal - self._band) if self.equal is not None else self.min or 0.0

    @property
    def high(self) -> float:
        """The maximum distance [m], infinity without a limit."""
        if self.equal is not None:
            return self.equal + self._band
        return math.inf if self.max is None else self.max

    @property
    def _band(self) -> float:
        return 0.01 if self.tolerance is None else self.tolerance

    @model_validator(mode="after")
    def _is_one_band(self) -> Distance:
        if not self.given(("min", "max", "equal")):
            raise wrong("should have 'min', 'max' or both, or 'equal'")
        if self.equal is not None and (others := self.given(("min", "max"))):
            raise wrong(f"should have 'equal' or {' and '.join(map(repr, others))}, not both")
        if self.equal is None and self.tolerance is not None:
            raise wrong("should have a 'tolerance' only with 'equal'")
        if self.equal is None and self.low < self.high < self.low + 2.0 * _LEAST_TOLERANCE - 1e-9:
            raise wrong(f"should have its 'max' at least {2.0 * _LEAST_TOLERANCE:g} m above its 'min': {_THIN_BAND}")
        if self.high <= self.low:
            raise wrong("should have a 'min' below its 'max', and a 'max' above 0")
        return self


class RelationType(IntEnum):
    """The shape of a relation's region."""

    SECTOR = 0
    BETWEEN = 1
    BESIDE = 2
    JOINED = 3


class Relation(Section):
    """The base of all relations, with the defaults of each kind.

    Each kind declares its keys in a fixed order, because scene hashes depend on the order. The first keys are `one_of`.

    Attributes:
        one_of: The keys that mark a relation of this kind, such as `left_of`. A relation has one of them.
        type: The shape of the kind's region.
        least_anchors: Minimum number of present anchors for the relation to apply.
        default_frame: The frame of the heading for relations without a `frame`, as written in a scene file.
        half_angle: Maximum angle between the heading and the direction from the anchor to the object [rad].
        low, high: Interval of the distance from the anchor [m].
        by_bounds: Whether the region depends on the bounds of both objects.
        has_own_width: Whether the region's width is the width of the placed object.
    """

    type: ClassVar[RelationType]
    least_anchors: ClassVar[int] = 1
    default_frame: ClassVar[str] = "world"
    half_angle: ClassVar[float] = math.pi
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = math.inf
    by_bounds: ClassVar[bool] = False
    has_own_width: ClassVar[bool] = False

    @property
    def word(self) -> str:
        """The key that marks the kind of the relation, such as 'near' or 'left_of'."""
        return self.given(self.one_of)[0]

    @property
    def anchor_key(self) -> str:
        """The key that names the anchors."""
        return self.word

    @property
    def anchors(self) -> tuple[str, ...]:
        """Names of the anchors: the objects that the relation refers to."""
        named = attrgetter(self.anchor_key)(self)
        return named if isinstance(named, tuple) else (named,)

    @property
    def reference_frame(self) -> str:
        """The frame of the heading: 'support', 'world' or the name of an object."""
        frame = getattr(self, "frame", self.default_frame)
        return self.anchors[0] if frame == "anchor" else frame

    @property
    def references(self) -> list[tuple[str, str]]:
        """The objects that the relation names: (key, name)."""
        named = [(self.anchor_key, anchor) for anchor in self.anchors]
        frame = [] if self.reference_frame in (*FRAMES, *self.anchors) else [("frame", self.reference_frame)]
        return named + frame

    @property
    def summary(self) -> str:
        """The relation in one line, such as 'right_of plate, at most 0.5 m'."""
        return f"{self.word} {' and '.join(self.anchors)}"

    def heading(self, robots: Container[str]) -> float:
        """Return the angle [rad] of the relation's direction in its `reference_frame`, from x towards y.

        Return 0 for a relation without a direction.

        Args:
            robots: Names of the scene's robots. Robots look along their +x.
        """
        return 0.0

    def excludes(self, other: Relation) -> bool:
        """Return whether two relations exclude each other: in every world, their regions share at most a line."""
        return False

    def _side_heading(self, side: str, robots: Container[str]) -> float:
        return (ROBOT_HEADINGS if self.reference_frame in robots else HEADINGS)[side]

    @classmethod
    def _problem(cls, key: Any, valid: list[str]) -> PydanticCustomError:
        words = [word for kind in KINDS if key in kind.model_fields for word in kind.one_of]
        if words and key not in cls.misplaced:
            return wrong(f"should be given only with {_listing(words)}, not with {_listing(cls.one_of)}")
        return super()._problem(key, _KEYS)


class Sector(Relation):
    """The base of relations whose region is a sector or a ring around one anchor."""

    type = RelationType.SECTOR
    default_frame = "anchor"
    if TYPE_CHECKING:
        distance: Distance | None
        measure: str

    @property
    def low(self) -> float:  # pyrefly: ignore[bad-override]
        """The minimum distance [m]."""
        return 0.0 if self.distance is None else self.distance.low

    @property
    def high(self) -> float:  # pyrefly: ignore[bad-override]
        """The maximum distance [m], infinity without a limit."""
        return math.inf if self.distance is None else self.distance.high

    @property
    def by_bounds(self) -> bool:  # pyrefly: ignore[bad-override]
        """True if the distance is measured between bounds, not between origins."""
        return self.measure == "bounds"

    @property
    def summary(self) -> str:
        """The relation in one line, with its distances."""
        low = f", at least {self.low:g} m" if self.low > 0.0 else ""
        high = f", at most {self.high:g} m" if self.high < math.inf else ""
        return f"{super().summary}{low}{high}{' between bounds' if self.by_bounds else ''}"

    @model_validator(mode="after")
    def _measures_a_distance(self) -> Sector:
        if self.distance is None and "measure" in self.model_fields_set:
            raise wrong("should have a 'distance', because it has a 'measure'")
        return self


class Direction(Sector):
    """The object is on one side of another object, or in a `direction` [x, y] from that object.

    Seen from the other object, it may be up to `angle` [degrees] off this direction, by default 90.

    Attributes:
        of: The anchor of a `direction`.
    """

    one_of = ("front_of", "back_of", "left_of", "right_of", "direction")
    front_of: str | None = None
    back_of: str | None = None
    left_of: str | None = None
    right_of: str | None = None
    direction: Direction2 | None = None
    of: str | None = None
    angle: Annotated[Number, Field(gt=0.0, le=180.0)] | None = None
    frame: str = "anchor"
    distance: Distance | None = None
    measure: Literal["origin", "bounds"] = "origin"

    @property
    def anchor_key(self) -> str:
        """The key that names the anchor."""
        return self.word if self.direction is None else "of"

    @property
    def half_angle(self) -> float:  # pyrefly: ignore[bad-override]
        """Largest allowed angle [rad] between the relation's direction and the line from the anchor to the object."""
        return math.radians(90.0 if self.angle is None else self.angle)

    def heading(self, robots: Container[str]) -> float:
        """Return the angle [rad] of the direction in the relation's `reference_frame`."""
        if self.direction is not None:
            return math.atan2(self.direction[1], self.direction[0])
        return self._side_heading(self.word.removesuffix("_of"), robots)

    def excludes(self, other: Relation) -> bool:
        """Return whether two directions have the same anchor and frame, and their sectors share at most a line."""
        if not isinstance(other, Direction) or (self.anchors, self.frame) != (other.anchors, other.frame):
            return False
        apart = abs(math.remainder(self.heading(()) - other.heading(()), 2.0 * math.pi))
        return apart > self.half_angle + other.half_angle - _LEAST_ANGLE

    @model_validator(mode="after")
    def _is_seen_from_an_object(self) -> Direction:
        if self.direction is not None and self.of is None:
            raise wrong("should have 'of', the name of the object from which 'direction' points")
        if self.of is not None and self.direction is None:
            raise wrong(f"should have 'of' only with 'direction', not with '{self.word}'")
        return self


class Near(Sector):
    """The object is near another object, up to a maximum distance and in any direction."""

    one_of = ("near",)
    near: str
    distance: Distance | None = None
    measure: Literal["origin", "bounds"] = "origin"

    @model_validator(mode="after")
    def _is_limited(self) -> Near:
        if self.high == math.inf:
            raise wrong("should have a 'distance' with 'max' or 'equal', because 'near' needs a limit")
        return self


class Between(Relation):
    """The object is within the hull of its anchors, or on a strip between anchors that lie on a line.

    The strip is `width` [m] wide. The default width is the shorter edge of the placed object's footprint.
    """

    one_of = ("between",)
    type = RelationType.BETWEEN
    least_anchors = 2
    between: Annotated[Names, Field(min_length=2, max_length=MAX_ANCHORS)]
    width: Width | None = None

    @property
    def has_own_width(self) -> bool:  # pyrefly: ignore[bad-override]
        """True if the strip has the width of the placed object."""
        return self.width is None


class Connection(Section):
    """Two sites that join an object to another object.

    Seen from above, the `site` of the object is at the site `of_site` of the other object, `of`. The x axis of `site`
    is rotated by `angle` [degrees] from the x axis of `of_site`. By default, the axes point in opposite directions.
    """

    of: str
    site: str
    of_site: str
    angle: Turn = 180.0


class Joined(Relation):
    """The object is joined to another object: a site of the object meets a site of the other object.

    The distance between the sites, along the x axis of the other object's site, is `gap` [m], by default 0.
    """

    one_of = ("beside",)
    type = RelationType.JOINED
    misplaced = dict.fromkeys(
        ("side", "align", "frame"), "should not be given if 'beside' names sites: they determine the pose"
    )
    anchor_key: ClassVar[str] = "beside.of"  # pyrefly: ignore[bad-override]
    beside: Connection
    gap: Length | None = None

    @property
    def summary(self) -> str:
        """The relation in one line, with the two sites."""
        return f"{self.beside.site} at {self.beside.of_site} of {self.beside.of}"


class Beside(Relation):
    """The object is side by side with another object, with `gap` [m] between their bounds.

    Along the side where they meet, the span of the wider object contains the span of the narrower object. With `align`,
    their ends at this side of the anchor are in line, or their middles.
    """

    one_of = ("beside",)
    type = RelationType.BESIDE
    by_bounds = True
    beside: str
    frame: str = "anchor"
    side: Literal["left", "right", "front", "back"] = Field(None, validate_default=True)
    gap: Length = 0.01
    align: Literal["left", "right", "front", "back", "middle"] | None = None

    @property
    def summary(self) -> str:
        """The relation in one line, with the other object, the side, the gap and what is in line."""
        align = "" if self.align is None else f", align {self.align}"
        return f"beside {self.beside}, {self.side}, gap {self.gap:g} m{align}"

    def aligned(self, robots: Container[str]) -> int | None:
        """Return which ends are in line: 1 left of the direction to the object, -1 right of it, 0 for the middles."""
        if self.align in (None, "middle"):
            return None if self.align is None else 0
        return round(math.sin(self._side_heading(self.align, robots) - self._side_heading(self.side, robots)))

    @model_validator(mode="after")
    def _aligns_across(self) -> Beside:
        if self.align not in (None, "middle") and self.aligned(()) == 0:
            ends = ("'back', 'front'", "'left', 'right'")[self.side in ("front", "back")]
            raise wrong(f"should have {ends} or 'middle' as 'align', because its side is '{self.side}'")
        return self

    def heading(self, robots: Container[str]) -> float:
        """Return the angle [rad] of the side in the relation's `reference_frame`."""
        return self._side_heading(self.side, robots)


def _of_its_kind(value: Any) -> Relation:
    """Return a relation from a mapping of its keys. A key such as `near` determines the kind of the relation."""
    if not isinstance(value, Mapping):
        return value if isinstance(value, Relation) else Direction.model_validate(value)
    given = {key for key in _KEYS if value.get(key) is not None}
    if set(value) <= set(_KEYS):
        check_one_of([word for word in RELATION_WORDS if word in given], RELATION_WORDS)
    kind = next((kind for kind in KINDS if given.intersection(kind.one_of)), Direction)
    if kind is Beside and isinstance(value["beside"], Mapping | Connection):
        kind = Joined
    unset = set(_KEYS) - given - set(kind.model_fields)
    return kind.model_validate({k: v for k, v in value.items() if k not in unset})


AnyRelation = Annotated[Direction | Near | Between | Beside | Joined, BeforeValidator(_of_its_kind)]
"""A relation of any kind."""
Relations = Annotated[tuple[AnyRelation, ...], Field(max_length=MAX_RELATIONS)]
"""The relations of one object."""
KINDS: tuple[type[Relation], ...] = get_args(get_args(AnyRelation)[0])
"""The classes of relations."""
RELATION_WORDS = tuple(dict.fromkeys(word for kind in KINDS for word in kind.one_of))
"""Words of relations. Each relation has exactly one."""
_KEYS = list(dict.fromkeys(key for kind in KINDS for key in kind.model_fields))


def _listing(words: Iterable[str]) -> str:
    *others, last = (f"'{word}'" for word in dict.fromkeys(words))
    return f"{', '.join(others)} or {last}" if others else last
