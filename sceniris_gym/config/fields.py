"""The types of values in a scene file (numbers, intervals, points, names), each with its own error message."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import shapely
from pydantic import AfterValidator, AllowInfNan, BeforeValidator, Field, Strict, WrapValidator
from pydantic_core import PydanticCustomError

from sceniris_gym.config.bounds import BOUNDS, LEAST_GAP, MAX_POINTS
from sceniris_gym.config.messages import ADVICE
from sceniris_gym.config.tier import TIERS
from sceniris_gym.errors import did_you_mean

FLOOR = "floor"
ROBOT = "robot"


def wrong(advice: str, word: str = "", valid: Iterable[str] = ()) -> PydanticCustomError:
    """Return the error about a wrong value.

    Args:
        advice: A phrase that says what is right, beginning with "should".
        word: The word that was found, if it may be misspelt.
        valid: The valid words.
    """
    context = {"advice": advice, "hint": did_you_mean(word, valid)}
    return PydanticCustomError(ADVICE, "{advice}", context)  # type: ignore[arg-type]


def listed(value: Any) -> Any:
    """Return a NumPy array as a list, and any other value unchanged."""
    return value.tolist() if hasattr(value, "tolist") else value


def must(holds: Callable[[Any], bool], advice: str) -> AfterValidator:
    """Return the check that a value passes a test; `advice` begins with "should"."""

    def check(value: Any) -> Any:
        if not holds(value):
            raise wrong(advice)
        return value

    return AfterValidator(check)


def within(kind: str) -> AfterValidator:
    """Return the check of a number against the bound of its kind in `BOUNDS`."""
    return must(BOUNDS[kind].holds, BOUNDS[kind].advice)


def _are_corners(box: tuple[tuple[float, ...], tuple[float, ...]]) -> bool:
    low, high = box
    return len(low) == len(high) and len(low) in (2, 3) and all(a <= b for a, b in zip(low, high, strict=True))


def _is_simple(polygon: tuple[tuple[float, float], ...]) -> bool:
    return len(polygon) >= 3 and (shape := shapely.Polygon(polygon)).is_valid and shape.area > 0.0


def _are_alike(points: tuple[tuple[float, ...], ...]) -> bool:
    return 1 <= len(points) <= MAX_POINTS and {len(point) for point in points} in ({2}, {3})


_ASCENDING = must(lambda ends: ends[0] <= ends[1], "should be [low, high] with low <= high")
_NOT_ZERO = must(lambda xy: max(map(abs, xy)) >= 1e-9, "should be a direction [x, y] that is not [0, 0]")
_OFF_THE_SUPPORT = must(
    lambda gap: gap >= LEAST_GAP,
    "should be at least 0.00002 m: any closer, rounding makes the object touch its support",
)
_EACH_ONCE = must(lambda names: len(set(names)) == len(names), "should name each object once")
_CORNERS = must(_are_corners, "should be [[x, y], [x, y]] or [[x, y, z], [x, y, z]], the low corner first")
_SIMPLE = must(_is_simple, "should be at least three corners [x, y] of a polygon whose edges do not cross")
_ALIKE = must(_are_alike, f"should be 1 to {MAX_POINTS:,} points, all of them [x, y] or all of them [x, y, z]")


def _tier(value: Any) -> Any:
    if not isinstance(value, bool) and value not in TIERS:
        raise wrong(f"should be true, false, or one of {', '.join(TIERS)}", str(value), TIERS)
    return value


def in_memory(model: Any) -> bool:
    """Return whether a model is a `mujoco.MjSpec` or a `mujoco.MjModel`, without importing MuJoCo."""
    return type(model).__module__.startswith("mujoco") and type(model).__name__ in ("MjSpec", "MjModel")


def _model(model: Any) -> Any:
    if isinstance(model, str | Path):
        return Path(model)
    if model is not None and not in_memory(model):
        raise wrong("should be the path of an MJCF file, a mujoco.MjSpec or a mujoco.MjModel")
    return model


class MemberName(str):
    """The name of a variant of an object, 'object/variant', as `config.variants` writes it."""

    __slots__ = ()


def object_name(name: str) -> str:
    """Return the name of an object, a group or a variant, after a check."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name):
        instead = f"; an object of any name can be the body '{name}', by 'body'" if "/" in name else ""
        raise wrong(f"should be a name of letters, digits, '_' and '-'{instead}")
    if name in (FLOOR, ROBOT, "world", "anchor", "support"):
        raise wrong("should be a different name: this one is reserved")
    return name


Number = Annotated[float, Strict(), AllowInfNan(False)]
Fraction = Annotated[Number, Field(ge=0.0, le=1.0)]
Position = Annotated[Number, within("position")]
Turn = Annotated[Number, within("turn")]
JointPosition = Annotated[Number, within("joint")]
Noise = Annotated[Number, Field(ge=0.0), within("noise")]
Clearance = Annotated[Number, Field(ge=0.0), within("clearance")]
Length = Annotated[Number, Field(ge=0.0), within("distance")]
Width = Annotated[Number, Field(gt=0.0), within("distance")]
Gap = Annotated[Number, _OFF_THE_SUPPORT, within("gap")]
Scale = Annotated[Number, within("scale")]
TurnInterval = Annotated[tuple[Turn, Turn], BeforeValidator(listed), _ASCENDING]
JointInterval = Annotated[tuple[JointPosition, JointPosition], BeforeValidator(listed), _ASCENDING]
Point2 = Annotated[tuple[Position, Position], BeforeValidator(listed)]
_Component = Annotated[Number, within("direction")]
Direction2 = Annotated[tuple[_Component, _Component], BeforeValidator(listed), _NOT_ZERO]
FractionPoint2 = Annotated[tuple[Fraction, Fraction], BeforeValidator(listed)]
Point3 = Annotated[tuple[Position, Position, Position], BeforeValidator(listed)]
Corner = Annotated[tuple[Position, ...], BeforeValidator(listed)]
FractionInterval = Annotated[tuple[Fraction, Fraction], BeforeValidator(listed), _ASCENDING]
Choice = Annotated[tuple[JointPosition, ...], BeforeValidator(listed), Field(min_length=1)]
_Extent = Annotated[Number, Field(gt=0.0), within("extent")]
Extents2 = Annotated[tuple[_Extent, _Extent], BeforeValidator(listed)]
Box = Annotated[tuple[Corner, Corner], BeforeValidator(listed), _CORNERS]
FractionBox = Annotated[tuple[FractionPoint2, FractionPoint2], BeforeValidator(listed), _CORNERS]
Polygon = Annotated[tuple[Point2, ...], BeforeValidator(listed), _SIMPLE]
Points = Annotated[tuple[Corner, ...], BeforeValidator(listed), _ALIKE]
Reachable = Annotated[bool | str, BeforeValidator(_tier)]
Names = Annotated[tuple[str, ...], _EACH_ONCE]
ObjectName = Annotated[str, AfterValidator(object_name)]
PartName = Annotated[
    ObjectName, WrapValidator(lambda name, check: str(name) if isinstance(name, MemberName) else check(name))
]
Model = Annotated[Any, BeforeValidator(_model)]
