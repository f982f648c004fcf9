"""Where an object is placed relative to others: `Relation`, one entry of an object's `relations`.

Directions are seen from above, x to the right and y to the back, so that the front is -y.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from sceniris_gym.config.fields import Direction2, Length, Number, Turn, Width, wrong
from sceniris_gym.config.limits import MAX_ANCHORS
from sceniris_gym.config.section import Section, check_one_of

HEADINGS = {"right": 0.0, "back": 0.5 * math.pi, "left": math.pi, "front": -0.5 * math.pi}
"""Heading [rad] of each side, from x towards y."""
ROBOT_HEADINGS = {"front": 0.0, "left": 0.5 * math.pi, "back": math.pi, "right": -0.5 * math.pi}
"""The same in the frame of a robot, which looks along the x axis of its base and has its left hand along y."""
SIDES = {f"{side}_of": side for side in ("front", "back", "left", "right")}
"""The words that name a direction by themselves, and their sides."""
FRAMES = ("anchor", "support", "world")
"""Frames of a relation that are not objects."""
RELATION_WORDS = (*SIDES, "direction", "near", "between", "beside")
"""Words of which a relation has exactly one."""

# The words that each option goes with.
_DIRECTED = (*SIDES, "direction")
_OPTIONS = {
    "of": ("direction",),
    "angle": _DIRECTED,
    "frame": (*_DIRECTED, "beside"),
    "distance": (*_DIRECTED, "near"),
    "measure": (*_DIRECTED, "near"),
    "width": ("between",),
    "side": ("beside",),
    "gap": ("beside",),
}


# A band is drawn from slices that contain it, and should fill enough of them: below this half width [m] redraws get
# frequent, partly because of rounding.
_LEAST_TOLERANCE = 1.0e-4
# Half of the thinnest wedge [rad] that directions may have in common: about a tenth of a degree.
_LEAST_ANGLE = 1.0e-3
_THIN_BAND = "too few of the points drawn for a thinner band would lie in it"


def _wide_enough(tolerance: float) -> float:
    if tolerance < _LEAST_TOLERANCE:
        raise wrong(f"should be at least {_LEAST_TOLERANCE:g} m; {_THIN_BAND}")
    return tolerance


class Distance(Section):
    """How far away [m]: from `min` to `max`, or `equal` within `tolerance` (0.01)."""

    min: Length | None = None
    max: Length | None = None
    equal: Length | None = None
    tolerance: Annotated[Length, AfterValidator(_wide_enough)] | None = None

    @property
    def low(self) -> float:
        """The least distance [m]."""
        return max(0.0, self.equal - self._band) if self.equal is not None else self.min or 0.0

    @property
    def high(self) -> float:
        """The greatest distance [m]; infinity if there is no limit."""
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
            raise wrong(f"should have its 'max' at least {2.0 * _LEAST_TOLERANCE:g} m above its 'min'; {_THIN_BAND}")
        if self.high <= self.low:
            raise wrong("should have a 'min' below its 'max', and a 'max' above 0")
        return self


class Connection(Section):
    """How an object is joined to another one at two sites.

    The site `my` of the object is where the site `its` of the object `of` is, seen from above. Its x axis points the
    other way, or is turned by `turn` [degrees] from that of the other site.
    """

    of: str
    my: str
    its: str
    turn: Turn = 180.0


def _form(value: Any) -> str:
    return "[sites]" if isinstance(value, Mapping | Connection) else "[name]"


class Relation(Section):
    """One relation of an object to others; exactly one of the words is given.

    `front_of`, `back_of`, `left_of`, `right_of` an object; `direction` [x, y] `of` an object; `near` an object;
    `between` objects; `beside` an object, or joined to it at a site of each. docs/placement.md explains the options.

    Attributes of the relation, whatever the word:
        kind: 'direction', 'near', 'between', 'beside' or 'joined'.
        anchors: Names of the objects that it is relative to.
        heading: Heading of its direction in its frame [rad], from x towards y; 0 without a direction.
        half_angle: How far from that heading the object may lie [rad]; pi for all but 'direction'.
        frame: The frame of its direction: 'anchor', 'support', 'world' or the name of an object.
        low, high: Distance interval [m]; (0, inf) without a distance.
        bounds: Whether the distance is measured between bounds rather than between origins.
        width: Width of the strip around a line of anchors [m]; None for the shorter edge of the object's footprint.
        gap: Gap between the bounds of objects that are beside each other [m]; see `site_gap`.
    """

    front_of: str | None = None
    back_of: str | None = None
    left_of: str | None = None
    right_of: str | None = None
    direction: Direction2 | None = None
    near: str | None = None
    between: Annotated[tuple[str, ...], Field(min_length=2, max_length=MAX_ANCHORS)] | None = None
    beside: (
        Annotated[Annotated[str, Tag("[name]")] | Annotated[Connection, Tag("[sites]")], Discriminator(_form)] | None
    ) = None
    of: str | None = None
    angle: Annotated[Number, Field(gt=0.0, le=180.0)] | None = None
    frame: str = "anchor"
    distance: Distance | None = None
    measure: Literal["origin", "bounds"] = "origin"
    width: Width | None = None
    side: Literal["left", "right", "front", "back"] | None = None
    gap: Length = 0.01

    @property
    def word(self) -> str:
        """The word of `RELATION_WORDS` that is given."""
        return self.given(RELATION_WORDS)[0]

    @property
    def kind(self) -> Literal["direction", "near", "between", "beside", "joined"]:
        """The kind of region that the relation describes."""
        if self.near is not None:
            return "near"
        if self.between is not None:
            return "between"
        if isinstance(self.beside, Connection):
            return "joined"
        return "beside" if self.beside is not None else "direction"

    @property
    def anchors(self) -> tuple[str, ...]:
        """Names of the objects that the relation is relative to."""
        if self.between is not None:
            return self.between
        if isinstance(self.beside, Connection):
            return (self.beside.of,)
        return (getattr(self, "of" if self.direction is not None else self.word),)

    def heading(self, robots: Container[str]) -> float:
        """Heading of the direction in its frame [rad], from x towards y; 0 without a direction.

        Args:
            robots: Names of the scene's robots, which look along their +x.
        """
        if self.direction is not None:
            return math.atan2(self.direction[1], self.direction[0])
        side = self.side or SIDES.get(self.word)
        if side is None:
            return 0.0
        frame = self.anchors[0] if self.frame == "anchor" else self.frame
        return (ROBOT_HEADINGS if frame in robots else HEADINGS)[side]

    @property
    def half_angle(self) -> float:
        """Greatest angle between the heading and the direction from the anchor to the object [rad]."""
        if self.kind != "direction":
            return math.pi
        return math.radians(90.0 if self.angle is None else self.angle)

    @property
    def low(self) -> float:
        """The least distance [m]."""
        return 0.0 if self.distance is None else self.distance.low

    @property
    def high(self) -> float:
        """The greatest distance [m]; infinity if there is no limit."""
        return math.inf if self.distance is None else self.distance.high

    @property
    def bounds(self) -> bool:
        """Whether the distance is measured between bounds rather than between origins."""
        return self.measure == "bounds"

    @property
    def site_gap(self) -> float:
        """How far apart two joined sites are along the x axis of the other object's [m]: 0 unless it is given."""
        return self.gap if "gap" in self.model_fields_set else 0.0

    @property
    def frame_object(self) -> str | None:
        """The object that is the frame, or None."""
        return None if self.frame in FRAMES else self.frame

    def leaves_nothing_of(self, other: Relation) -> bool:
        """Whether two directions from one anchor, in one frame, have a line in common at most."""
        if {self.kind, other.kind} != {"direction"} or (self.anchors, self.frame) != (other.anchors, other.frame):
            return False
        apart = abs(math.remainder(self.heading(()) - other.heading(()), 2.0 * math.pi))
        return apart > self.half_angle + other.half_angle - _LEAST_ANGLE

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Relation:
        word = check_one_of(self, RELATION_WORDS).word
        for option, words in _OPTIONS.items():
            if option in self.model_fields_set and getattr(self, option) is not None and word not in words:
                raise wrong(f"should have '{option}' only with {_listing(words)}, not with '{word}'")
        if self.direction is not None and self.of is None:
            raise wrong("should name the object that 'direction' is relative to, with 'of'")
        if self.kind == "joined" and (given := [w for w in ("side", "frame") if w in self.model_fields_set]):
            raise wrong(f"should have no '{given[0]}' where 'beside' names sites, which say where it is")
        if self.kind == "beside" and self.side is None:
            raise wrong("should have a 'side' with 'beside': left, right, front or back")
        if self.near is not None and self.high == math.inf:
            raise wrong("should have a 'distance' with 'max' or 'equal' with 'near'")
        if self.distance is None and "measure" in self.model_fields_set:
            raise wrong("should have a 'distance' with 'measure'")
        if self.between is not None and len(set(self.between)) < len(self.between):
            raise wrong("should name every object of 'between' once")
        return self


def _listing(words: tuple[str, ...]) -> str:
    *others, last = (f"'{word}'" for word in words)
    return f"{', '.join(others)} or {last}" if others else last
