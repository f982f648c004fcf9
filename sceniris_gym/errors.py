"""All errors and warnings for users. Each message names the place, the mistake and the fix."""

import difflib
import functools
import graphlib
import importlib
import inspect
import json
import sys
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import lazy_loader

_P = ParamSpec("_P")
_T = TypeVar("_T")
_Counts, _Texts = Mapping[str, Mapping[str, int]], Mapping[str, str]


@functools.cache
def old_names() -> dict[str, str]:
    """Return the new name of each old name. Old names were never released, and version 1.0 drops this table.

    A new name `A|B` means A or B, depending on where the old name was used. `A.b` means the part `b` of A. The old
    name of an option starts with the command, as in "train --levels".
    """
    return json.loads(Path(__file__).with_name("renamed.json").read_text(encoding="utf-8"))


def new_name(name: str, valid: Container[str]) -> str:
    """Return a sentence such as " 'knobs' is now params.", or "" if `name` is not an old name of a `valid` name."""
    found = old_names().get(name, "").split("|")
    return next((f" '{name}' is now {new}." for new in found if new.partition(".")[0] in valid), "")


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" with the valid name closest to `name`, or an empty string if no name is close.

    If `name` is an old name of a valid name, return the sentence of `new_name` instead.
    """
    valid = list(valid)
    found = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    if not found:  # names with prefixes: 'upper_drawer' is close to 'cabinet/upper_drawer'
        tails = {v.rsplit("/", 1)[-1]: v for v in reversed(valid)}
        found = [tails[t] for t in difflib.get_close_matches(name.rsplit("/", 1)[-1], tails, n=1, cutoff=0.6)]
    return new_name(name, valid) or (f" Did you mean '{found[0]}'?" if found else "")


class _Pickled(Exception):
    """An exception that pickle stores as the constructor's arguments. Each argument is also an attribute."""

    def __reduce__(self) -> tuple[Any, ...] | str:
        if "__init__" not in vars(type(self)):
            return super().__reduce__()
        return type(self), tuple(getattr(self, name) for name in inspect.signature(type(self)).parameters)


class ScenirisError(_Pickled):
    """Base class of all errors of this package."""


class ScenirisWarning(_Pickled, UserWarning):
    """Base class of all warnings of this package."""


class SceneFileError(ScenirisError):
    """A missing or unreadable YAML or MJCF file of a scene."""


class SceneKeyError(ScenirisError):
    """A wrong key or value in a scene, a support without room, or a cycle of names. The message names the key."""


class NotSupportedError(ScenirisError):
    """A key or value of a scene, a feature of a model, an option or a file type that is known but not supported."""


class UnknownNameError(ScenirisError):
    """A body, joint, object, asset or scene name that does not exist. `valid` lists the existing names."""

    def __init__(self, kind: str, name: str, where: str, valid: Iterable[str]) -> None:
        self.kind, self.name, self.where, self.valid = kind, name, where, sorted(filter(None, valid))
        listing = ", ".join(self.valid) if self.valid else "none"
        super().__init__(f"{where}: unknown {kind} '{name}'.{did_you_mean(str(name), self.valid)} Valid: {listing}.")


def in_a_cycle(where: str, names: Iterable[str], what: str) -> SceneKeyError:
    """Return the error for a cycle: each of `names` depends on the next, and the last one on the first."""
    names = list(names)
    cycle = " -> ".join([*names, names[0]])
    return SceneKeyError(f"{where}: {what}: {cycle}. Remove one of these references to break the cycle.")


def check_order(needs: Mapping[str, Iterable[str]], where: str, what: str, shown: Callable[[str], str] = str) -> None:
    """Check that names that need each other can be put into an order.

    Args:
        needs: The names that each name needs.
        where: The beginning of the error.
        what: What the names do, as in `in_a_cycle`.
        shown: Returns a name as the error shows it.

    Raises:
        SceneKeyError: Names need each other in a cycle.
    """
    try:
        graphlib.TopologicalSorter(needs).prepare()
    except graphlib.CycleError as error:
        cycle = error.args[1][:0:-1]  # each name needs the next, without repeating the first
        first = cycle.index(next(name for name in needs if name in cycle))
        raise in_a_cycle(where, map(shown, cycle[first:] + cycle[:first]), what) from None


MeshReason = Literal["empty", "flat", "open", "large", "not finite", "sliver", "size", "parts", "refused"]
"""The reason why a mesh cannot be used.

A mesh without faces is "empty", and a mesh without volume is "flat". An "open" mesh has holes that are too large. A
"large" mesh has too many faces. A "not finite" mesh has non-finite vertices. A "sliver" is too thin and light for
MuJoCo. "size" means a length under 1 mm or over 50 m. If the unit is unknown, it also means a length over 2 m or a mass
over 100 kg. "parts" means that no set of convex parts stays near the surface, and "refused" that MuJoCo rejects the
mesh.
"""


class MeshError(ScenirisError):
    """A mesh that cannot be used.

    Args:
        text: The message.
        reason: The defect, one of the words in `MeshReason`.
    """

    def __init__(self, text: str, reason: MeshReason) -> None:
        super().__init__(text)
        self.text = text
        self.reason: MeshReason = reason


class GraspError(ScenirisError):
    """An object that the gripper cannot grasp.

    The gripper would have to open by `needed` [m], but opens by at most `opening` [m]. `needed` is None if no grasp has
    a part of the object between the fingers.
    """

    def __init__(self, text: str, needed: float | None, opening: float) -> None:
        super().__init__(text)
        self.text, self.needed, self.opening = text, needed, opening


class InfeasibleSceneError(ScenirisError):
    """A scene for which no valid layout was found.

    Args:
        text: The message.
        where: The scene.
        name: The first object that could not be placed.
        cause: The most frequent cause of this object's rejections.
        counts: Rejections per object and cause.
        in_the_way: For each object that collided, a text with the pair of geoms that collided most often.
    """

    def __init__(self, text: str, where: str, name: str, cause: str, counts: _Counts, in_the_way: _Texts) -> None:
        super().__init__(text)
        self.text, self.where, self.name, self.cause = text, where, name, cause
        self.counts = {k: dict(v) for k, v in counts.items()}
        self.in_the_way = dict(in_the_way)


class ArmError(ScenirisError):
    """Bodies and joints that do not form a supported serial arm."""


class MapError(ScenirisError):
    """A reachability map that is missing, unreadable, or made for another arm."""


class ContactBudgetError(ScenirisError):
    """A batch without room for all contacts or constraint rows.

    `budget` is "nconmax" or "njmax". `room` and `wanted` are numbers of contacts or rows per world.
    """

    def __init__(self, budget: str, room: int, wanted: int) -> None:
        self.budget, self.room, self.wanted = budget, room, wanted
        super().__init__(
            f"{budget}={room} is too small for this scene: a world needed {wanted} "
            f"{'contacts' if budget == 'nconmax' else 'constraint rows'}, and the simulation ignored the rest. "
            f"Pass {budget}={max(2 * room, 2 * wanted)}."
        )


class SceneMismatchError(ScenirisError, ValueError):
    """A model, data or layout source of another CompiledScene."""


class BusyError(ScenirisError, RuntimeError):
    """An object that another thread is using."""


class FixedError(ScenirisError, AttributeError):
    """An assignment to the attribute `name` of an object of class `what`, whose arrays captured graphs use."""

    def __init__(self, what: str, name: str, cure: str | None = None) -> None:
        self.what, self.cure = what, cure
        super().__init__(
            f"{what}.{name} cannot be changed: captured steps and resets would keep using the arrays with which {what} "
            "was made. " + (cure or f"Make a new {what} with the new '{name}'.")
        )
        self.name = name  # set last: AttributeError's constructor sets its own `name` to None


class TaskError(ScenirisError, TypeError):
    """A value of the wrong type or form, which a method of a task returned."""


class ArgumentError(ScenirisError, ValueError):
    """An invalid argument, such as a mask, a seed, a count or a layout id."""


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument of the wrong type."""


def check_type(value: object, kind: type, name: str) -> None:
    """Check that an argument has the type `kind`. The message starts with `name`: the function and the argument.

    Raises:
        ArgumentTypeError: The argument has another type.
    """
    if not isinstance(value, kind):
        raise ArgumentTypeError(f"{name} should be a {kind.__name__}, got {type(value)}.")


def check_names(kind: str, names: Iterable[object], where: str, valid: Collection[str]) -> None:
    """Check that all names are in `valid`. The message contains `kind`, such as "joint", and the place `where`.

    Raises:
        UnknownNameError: A name is not in `valid`. The error is for the first such name.
    """
    for name in names:
        if name not in valid:
            raise UnknownNameError(kind, str(name), where, valid)


def refuses_old_names(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Wrap a function: a call with a renamed keyword raises an UnknownNameError, which gives the new keyword.

    Another unknown keyword raises an ArgumentTypeError. The function should not take `**kwargs`.
    """
    valid = [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        for name in (name for name in kwargs if name not in valid):
            unknown = UnknownNameError("argument", name, function.__qualname__, valid)
            raise unknown if name in old_names() else ArgumentTypeError(str(unknown))
        return function(*args, **kwargs)

    return checked


def refuses_old_imports(module: str, found: Callable[[str], object] | None = None) -> Callable[[str], object]:
    """Return a `__getattr__` for a module. For a renamed attribute, it raises an ImportError with the new name.

    Args:
        module: The name of the module.
        found: Function that imports and returns a lazy attribute of the module, or None if it has no such attributes.
    """
    found = found or lazy_loader.attach(module)[0]

    def missing(name: str) -> object:
        try:
            return found(name)
        except AttributeError:
            if name[0] != "_" and (new := new_name(name, [*dir(sys.modules[module]), "benchmarks"])):
                raise ImportError(f"{module}:{new}") from None
            raise

    return missing


def as_names(value: Any, name: str) -> tuple[str, ...]:
    """Return one name or several names as a tuple. Error messages call the argument `name`.

    Raises:
        ArgumentTypeError: The value has another type.
    """
    if isinstance(value, str):
        return (value,)
    names = tuple(value) if isinstance(value, Iterable) else (value,)
    if not all(isinstance(each, str) for each in names):
        raise ArgumentTypeError(f"{name} should be one name or several names, got {type(value)}.")
    return names


class FallbackWarning(ScenirisWarning):
    """A scene whose worlds run out of attempts or restarts too often. The message names the remedies.

    Args:
        text: The message.
        share: Fraction of worlds that ran out of restarts when the bank was filled. None if the warning is about
            `attempts: auto`. The arguments below are then left out too.
        name: The object with the most rejections.
        cause: The most frequent cause of these rejections.
        held: Number of layouts in the smaller of the two banks, and the wanted number. None if both banks are full.
    """

    def __init__(
        self, text: str, share: float | None = None, name: str = "", cause: str = "", held: Sequence[int] | None = None
    ) -> None:
        super().__init__(text)
        self.text, self.share, self.name, self.cause, self.held = text, share, name, cause, held


class ReachWarning(ScenirisWarning):
    """A reachability test that cannot be made as requested. The message gives the reason."""


class ModelWarning(ScenirisWarning):
    """An accepted but probably unintended detail of a model. The message names the detail and a remedy."""


class OutputError(ScenirisError, OSError):
    """A file that cannot be written."""

    def __init__(self, path: str, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path} cannot be written: {reason}. Give --out a path that you can write to.")


class MemoryLimitError(ScenirisError, MemoryError):
    """A request for more memory than is free on a device."""


class DatasetError(ScenirisError):
    """A data set of layouts that is incomplete, damaged, or of another kind than requested."""


class MissingExtraError(ScenirisError, ImportError):
    """A missing library that an extra of this package installs."""

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f"{package} is not installed. Install the extra: in the clone, pip install -e '.[{extra}]'.")


def import_extra(module: str, extra: str, package: str = "") -> Any:
    """Import a module that the extra `extra` installs. `package` is the module's distribution, if it has another name.

    Raises:
        MissingExtraError: The module is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise MissingExtraError(package or module, extra) from None


__getattr__ = refuses_old_imports(__name__)
