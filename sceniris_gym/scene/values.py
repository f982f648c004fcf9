"""The kinds of values a scene file holds: numbers, intervals, points and names, each with its own complaint."""

from __future__ import annotations

import re
from typing import Annotated, Any

import shapely
from pydantic import AfterValidator, AllowInfNan, BeforeValidator, Field, Strict
from pydantic_core import PydanticCustomError

from sceniris_gym.scene.complaints import ADVICE

FLOOR = "floor"
ROBOT = "robot"


def wrong(advice: str) -> PydanticCustomError:
    """Return the error of a value; `advice` says what it should be and begins with "should"."""
    return PydanticCustomError(ADVICE, "{advice}", {"advice": advice})  # type: ignore[arg-type]


def _listed(value: Any) -> Any:
    """Let everything that is a sequence of numbers be one, NumPy's arrays too, but no set and no text."""
    return value.tolist() if hasattr(value, "tolist") else value


def _ascending(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] > interval[1]:
        raise wrong("should be [low, high] with low <= high")
    return interval


def _corners(box: tuple[tuple[float, ...], tuple[float, ...]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    low, high = box
    if len(low) != len(high) or len(low) not in (2, 3) or any(a > b for a, b in zip(low, high, strict=False)):
        raise wrong("should be [[x, y], [x, y]] or [[x, y, z], [x, y, z]], the low corner first")
    return box


def _simple(polygon: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if len(polygon) < 3 or not (shape := shapely.Polygon(polygon)).is_valid or shape.area <= 0.0:
        raise wrong("should be at least three corners [x, y] of a polygon whose edges do not cross")
    return polygon


def _object_name(name: str) -> str:
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name):
        raise wrong("should be a name of letters, digits, '_' and '-'")
    if name in (FLOOR, ROBOT, "world"):
        raise wrong("should be another name: this one is taken by the scene itself")
    return name


Number = Annotated[float, Strict(), AllowInfNan(False)]
Fraction = Annotated[Number, Field(ge=0.0, le=1.0)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Interval = Annotated[tuple[Number, Number], BeforeValidator(_listed), AfterValidator(_ascending)]
Point2 = Annotated[tuple[Number, Number], BeforeValidator(_listed)]
FractionPoint2 = Annotated[tuple[Fraction, Fraction], BeforeValidator(_listed)]
Point3 = Annotated[tuple[Number, Number, Number], BeforeValidator(_listed)]
Corner = Annotated[tuple[Number, ...], BeforeValidator(_listed)]
FractionInterval = Annotated[tuple[Fraction, Fraction], BeforeValidator(_listed), AfterValidator(_ascending)]
Choice = Annotated[tuple[Number, ...], BeforeValidator(_listed), Field(min_length=1)]
Extents2 = Annotated[tuple[Positive, Positive], BeforeValidator(_listed)]
Box = Annotated[tuple[Corner, Corner], BeforeValidator(_listed), AfterValidator(_corners)]
FractionBox = Annotated[tuple[FractionPoint2, FractionPoint2], BeforeValidator(_listed), AfterValidator(_corners)]
Polygon = Annotated[tuple[Point2, ...], BeforeValidator(_listed), AfterValidator(_simple)]
ObjectName = Annotated[str, AfterValidator(_object_name)]
