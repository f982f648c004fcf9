"""Types of values in a scene file (numbers, intervals, points, names), with errors that name the keys of the file."""

import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any, NoReturn

import shapely
from pydantic import AfterValidator, AllowInfNan, BeforeValidator, Field, Strict, ValidationError, WrapValidator
from pydantic_core import ErrorDetails, InitErrorDetails, PydanticCustomError

from sceniris_gym.config.bounds import BOUNDS, LEAST_GAP, MAX_POINTS
from sceniris_gym.config.member_names import MemberName
from sceniris_gym.config.tier import TIERS
from sceniris_gym.errors import ArgumentTypeError, SceneKeyError, did_you_mean

FLOOR = "floor"
ROBOT = "robot"
DEFAULT = "default"
"""The key of a part for all variants without another key."""


def wrong(advice: str, word: str = "", valid: Iterable[str] = ()) -> PydanticCustomError:
    """Return the error for a wrong value.

    Args:
        advice: A phrase that describes the right value and begins with "should".
        word: The wrong value, if it may be a misspelling. The message then suggests the most similar valid value.
        valid: The valid values.
    """
    context = {"advice": advice, "hint": did_you_mean(word, valid)}
    return PydanticCustomError(ADVICE, "{advice}", context)


def refuse(loc: tuple[str, ...], advice: str, value: Any) -> NoReturn:
    """Raise an error for a value of a scene that is not validated yet.

    Args:
        loc: The keys of the value.
        advice: A phrase that describes the right value and begins with "should".
        value: The wrong value.
    """
    raise located(loc, wrong(advice), value)


def located(loc: tuple[str, ...], error: PydanticCustomError, value: Any) -> ValidationError:
    """Return an error with the keys of its value."""
    return ValidationError.from_exception_data("SceneConfig", [InitErrorDetails(type=error, loc=loc, input=value)])


@contextmanager
def locating(loc: tuple[str, ...], value: Any) -> Iterator[None]:
    """Add the location of a value in the scene to errors that the `with` block raises about this value."""
    try:
        yield
    except PydanticCustomError as error:
        raise located(loc, error, value) from None


def check_words(words: Iterable[Any], valid: Collection[str], advice: str) -> None:
    """Raise an error for the first of `words` that is not in `valid`. `advice` begins with "should"."""
    for word in words:
        if word not in valid:
            raise wrong(advice, str(word), valid)


def listed(value: Any) -> Any:
    """Return a NumPy array as a list, and any other value unchanged."""
    return value.tolist() if hasattr(value, "tolist") else value


def must(holds: Callable[[Any], bool], advice: str) -> AfterValidator:
    """Return a validator that rejects a value if `holds` is False for it. `advice` begins with "should"."""

    def check(value: Any) -> Any:
        if not holds(value):
            raise wrong(advice)
        return value

    return AfterValidator(check)


def within(kind: str) -> AfterValidator:
    """Return a validator that checks a number against the bound of its kind in `BOUNDS`."""
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
    lambda gap: gap >= LEAST_GAP, "should be at least 0.00002 m: rounding could make a closer object touch its support"
)
_EACH_ONCE = must(lambda names: len(set(names)) == len(names), "should name each object once")
_CORNERS = must(_are_corners, "should be [[x, y], [x, y]] or [[x, y, z], [x, y, z]], the low corner first")
_SIMPLE = must(_is_simple, "should be at least three corners [x, y] of a polygon whose edges do not cross")
_ALIKE = must(_are_alike, f"should be 1 to {MAX_POINTS:,} points, all of them [x, y] or all of them [x, y, z]")


def _tier(value: Any) -> Any:
    if not isinstance(value, bool):
        check_words([value], TIERS, f"should be true, false, or one of {', '.join(TIERS)}")
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


def object_name(name: str) -> str:
    """Check the name of an object, a group or a variant, and return it."""
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", name):
        instead = f". Choose such a name, and write 'body: {name}'" if "/" in name else ""
        raise wrong(f"should be a name of letters, digits, '_' and '-' that starts with a letter or '_'{instead}")
    if name in (FLOOR, ROBOT, "world", "anchor", "support"):
        raise wrong("should not be floor, robot, world, anchor or support: these names are reserved")
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
NameOrNames = Annotated[Names, BeforeValidator(lambda names: (names,) if isinstance(names, str) else listed(names))]
ObjectName = Annotated[str, AfterValidator(object_name)]
JointOfPart = Annotated[
    dict[str, str | None], BeforeValidator(lambda name: {DEFAULT: name} if isinstance(name, str) else name)
]
PartName = Annotated[
    ObjectName, WrapValidator(lambda name, check: str(name) if isinstance(name, MemberName) else check(name))
]
Model = Annotated[Any, BeforeValidator(_model)]


# A context variable, because pydantic's validators cannot take additional arguments.
where_now: ContextVar[str | None] = ContextVar("where_now", default=None)
"""The file or the class that is being read, or None."""

# Error types of this module. The context of UNKNOWN_KEY has `key` and `valid`. The context of ADVICE has `advice` (a
# phrase that begins with "should") and `hint` (a guess at the intended word).
UNKNOWN_KEY, ADVICE = "unknown_key", "advice"
DRAWN = ("weight", "split")
"""Words that set how a variant is drawn."""

_SHOULD = {
    **dict.fromkeys(("float_type", "float_parsing"), "should be a number"),
    "finite_number": "should be a finite number",
    "int_type": "should be a whole number",
    "string_type": "should be a name",
    "path_type": "should be the path of a file",
    "tuple_type": "should be a list",
    "dict_type": "should be a mapping of names to settings",
    **dict.fromkeys(("model_type", "model_attributes_type"), "should be a mapping of keys to values"),
    "too_long": "should have {max_length} values at most",
    "too_short": "should have at least {min_length} values",
    "greater_than": "should be above {gt}",
    "greater_than_equal": "should be at least {ge}",
    "less_than_equal": "should be at most {le}",
    "literal_error": "should be {expected}",
    ADVICE: "{advice}",
}
"""The advice for each type of pydantic error. The context of the error fills in the braces."""
_VARIANT = re.compile(r"^(objects\.[^./]*)/[^.]*")


@contextmanager
def reading(where: str) -> Iterator[None]:
    """Translate the ValidationErrors of a `with` block into ScenirisErrors that begin with `where`."""
    token = where_now.set(where)
    try:
        yield
    except (ValidationError, UnicodeError) as error:
        raise SceneKeyError(_told(error, where)) from None
    finally:
        where_now.reset(token)


def _told(error: ValidationError | UnicodeError, where: str) -> str:
    with suppress(UnicodeError):  # half of a surrogate pair: pydantic cannot format the error
        if isinstance(error, ValidationError):
            found: dict[tuple[str, str], list[str]] = {}
            for each in error.errors(include_url=False):
                path = _path(each)
                found.setdefault((_VARIANT.sub(r"\1", path), _sentence(each)), []).append(path)
            # errors shared by all variants of an object are reported once
            told = (f"{path if len(own) > 1 else own[0]}: {sentence}" for (path, sentence), own in found.items())
            return "\n".join(f"{where}: {line}" for line in told)
    return f"{where}: a name or a value has a character that is not valid Unicode text. Remove this character."


def _path(error: ErrorDetails) -> str:
    match error["loc"]:
        case ("groups", group, "weights" | "splits" as word, member) if str(member).startswith(f"{group}/"):
            return f"objects.{member}.{word.removesuffix('s')}"  # a variant's weight, by its key in the scene file
    return ".".join(str(key) for key in error["loc"] if not str(key).startswith("[")) or "scene"


def _sentence(error: ErrorDetails) -> str:
    context, kind = error.get("ctx", {}), error["type"]
    if kind == UNKNOWN_KEY:
        key, valid = str(context["key"]), [*context["valid"], *(DRAWN if _VARIANT.match(_path(error)) else ())]
        if key.lower() == "true" and "on" in valid:
            return (
                "this key is the word 'on', which a YAML 1.1 loader reads as true. "
                "Quote it ('on': floor), or let SceneConfig.load read the file."
            )
        return f"unknown key.{did_you_mean(key, valid)} Valid: {', '.join(valid)}."
    if kind == "missing":
        return "is missing. Add this key."
    advice = _SHOULD[kind].format_map(context) if kind in _SHOULD else f"is wrong: {error['msg']}"
    hint = context.get("hint", "")
    if kind == "literal_error" and isinstance(error["input"], str):
        hint = did_you_mean(error["input"], re.findall(r"'([^']*)'", str(context["expected"])))
    # A quote from the beginning of a whole scene would not help.
    subject = "it" if not error["loc"] and isinstance(error["input"], dict) else short(error["input"])
    return f"{subject} {advice}.{hint}"


def short(value: Any) -> str:
    """Return the text of a value for a message, on one line of at most 80 characters."""
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # an integer with too many digits for Python, or lists nested too deeply
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else text[:77] + "..."


def as_integer(value: Any, name: str) -> int:
    """Return an integer of any library as an int. The message starts with `name`: the function and the argument.

    Raises:
        ArgumentTypeError: The value is not an integer.
    """
    try:
        return operator.index(value)
    except TypeError:
        raise ArgumentTypeError(f"{name} should be an integer, got {short(value)}.") from None
