"""All errors and warnings that a user can meet. Each message says what was wrong, where, and what would be right."""

from __future__ import annotations

import difflib
import importlib
import inspect
from collections.abc import Collection, Iterable, Mapping
from typing import Any, Literal


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" for the valid name closest to `name`, or an empty string when none is close."""
    valid = list(valid)
    found = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    if not found:  # names with prefixes: 'upper_drawer' is close to 'cabinet/upper_drawer'
        tails = {v.rsplit("/", 1)[-1]: v for v in reversed(valid)}
        found = [tails[t] for t in difflib.get_close_matches(name.rsplit("/", 1)[-1], tails, n=1, cutoff=0.6)]
    return f" Did you mean '{found[0]}'?" if found else ""


class _Pickled(Exception):
    """An exception that pickles by its constructor's arguments, each of which is an attribute of the same name."""

    def __reduce__(self) -> tuple[Any, ...] | str:
        if "__init__" not in vars(type(self)):
            return super().__reduce__()
        return type(self), tuple(getattr(self, name) for name in inspect.signature(type(self)).parameters)


class ScenirisError(_Pickled):
    """Base class of all errors of this package."""


class ScenirisWarning(_Pickled, UserWarning):
    """Base class of all warnings of this package."""


class SceneFileError(ScenirisError):
    """A file of a scene, YAML or MJCF, that is missing or cannot be read."""


class SceneKeyError(ScenirisError):
    """A wrong key or value in a scene; the message names its path."""


class NotSupportedError(ScenirisError):
    """A word of the scene language, or a feature of a model, that is known but not supported yet."""


class UnknownNameError(ScenirisError):
    """A name of a body, joint, object, asset or scene that does not exist; `valid` are those that do."""

    def __init__(self, kind: str, name: str, where: str, valid: Iterable[str]) -> None:
        self.kind, self.name, self.where, self.valid = kind, name, where, sorted(filter(None, valid))
        listing = ", ".join(self.valid) if self.valid else "none"
        super().__init__(f"{where}: unknown {kind} '{name}'.{did_you_mean(str(name), self.valid)} Valid: {listing}.")


class NoSupportError(ScenirisError):
    """A support without a surface for objects, or of which cropping to a region or erosion leaves none."""


class CycleError(ScenirisError):
    """Names that depend on each other in a cycle, each on the next: supports of objects, or bases of scene files."""

    def __init__(self, where: str, names: Iterable[str], what: str) -> None:
        self.where, self.names, self.what = where, list(names), what
        cycle = " -> ".join([*self.names, self.names[0]])
        super().__init__(f"{where}: {what}: {cycle}. Remove one of these references to break the cycle.")


class HeapError(ScenirisError):
    """A container that does not hold the things of a heap, or rows of settled heaps that do not fit the scene."""


MeshReason = Literal["empty", "flat", "open", "large", "not finite", "sliver", "size", "parts", "refused"]
"""Why a mesh cannot be used: it has no faces, no volume, holes that are too large, too many faces, or vertices that are
not finite; it is too thin and light for MuJoCo, or under 1 mm or over 50 m long; no convex parts stay near its surface;
or MuJoCo refuses it."""


class MeshError(ScenirisError):
    """A mesh that cannot be used.

    Args:
        text: The message.
        reason: Its fault, by a word of `MeshReason`.
    """

    def __init__(self, text: str, reason: MeshReason) -> None:
        super().__init__(text)
        self.text = text
        self.reason: MeshReason = reason


class GraspError(ScenirisError):
    """An object that the gripper cannot grasp: the least opening `needed` [m] is more than its widest `opening` [m].

    `needed` is None if no grasp has anything between the fingers.
    """

    def __init__(self, where: str, needed: float | None, opening: float) -> None:
        self.where, self.needed, self.opening = where, needed, opening
        why = "no grasp has anything between the fingers"
        if needed is not None:
            why = f"its narrowest grasp needs an opening of {needed:.3g} m, but the gripper opens to {opening:.3g} m"
        super().__init__(
            f"{where}.reachable: {why}. Give the asset sites 'grasp_*' where it can be grasped (+z the approach axis, "
            "+y the closing axis), or use a smaller object."
        )


_MOST_NAMED = 3  # objects of a message
_CLOSER = "Place it closer to the robot, turn it towards it, or use a less thorough tier of 'reachable'."
_ADVICE = {
    "overhead": "'on' requires open space above, 'inside' a part of the supporting object; 'in' accepts both.",
    "unsound": "Layouts had numbers that are not finite, or are out of all bounds: look for such numbers in the model.",
    "falls": "Draw its 'mass' or 'ipos' from less, give it a wider support or a region further from the edge, or write "
    "'stands: false' if it is meant to fall.",
    **dict.fromkeys(("unreachable", "no_ik", "blocked"), _CLOSER),
}
"""The remedies for some causes."""


class InfeasibleSceneError(ScenirisError):
    """A scene for which no valid layout was found.

    Args:
        where: The scene.
        name: The object that could not be placed; all objects before it could.
        cause: The most frequent cause of its rejections.
        counts: Rejections per object and cause.
        leaning: Its support, if that leaned in most worlds.
        orientation: The `orientation` of that support, if it does not keep the support upright.
        obstruction: The pair of geoms that is most in its way, if it collides.
        joined: The object that it is joined to at sites, if there is one.
        room: A support that is too small for all its objects, and the area that would do, in words.
    """

    def __init__(
        self,
        where: str,
        name: str,
        cause: str,
        counts: Mapping[str, Mapping[str, int]],
        leaning: str | None = None,
        orientation: str | None = None,
        obstruction: str | None = None,
        joined: str | None = None,
        room: str | None = None,
    ) -> None:
        self.where, self.name, self.cause, self.leaning, self.orientation = where, name, cause, leaning, orientation
        self.obstruction, self.joined, self.room = obstruction, joined, room
        self.counts = {k: dict(v) for k, v in counts.items()}
        rejected = {obj: sum(by_cause.values()) for obj, by_cause in self.counts.items() if any(by_cause.values())}
        worst = sorted(rejected, key=rejected.__getitem__)[-_MOST_NAMED:]
        rows = "; ".join(
            f"{obj}: " + ", ".join(f"{c} {n}" for c, n in self.counts[obj].items() if n)
            for obj in rejected
            if obj in worst
        )
        if len(rejected) > len(worst):
            rows += f"; and {len(rejected) - len(worst)} other objects less often"
        plain = "Give it a larger region or support, a smaller clearance, or fewer neighbours."
        advice = room or _ADVICE.get(cause, plain)
        if leaning is not None:
            better = "Restrict the joints that move it to states in which it is level."
            if orientation is not None:
                owner = leaning.split("/")[0]
                better = f"Keep '{owner}' upright: give it a yaw or 'fixed' instead of 'orientation: {orientation}'."
            advice = (
                f"Its support '{leaning}' leans by more than 0.1 degree in most of the drawn states, but objects are "
                f"placed on level surfaces only. {better}"
            )
        elif cause == "collision" and joined is not None:
            advice = (
                f"It is joined to '{joined}': give 'beside' a 'gap' of a few millimetres, or put the sites that far "
                "outside of both, so that they keep their 'clearance'."
            )
        way = "" if obstruction is None else f"Most in its way: {obstruction}. "
        super().__init__(
            f"{where}: no valid layout was found: '{name}' could not be placed, mostly because of {cause}. "
            f"{way}Rejections: {rows}. {advice}"
        )


class ArmError(ScenirisError):
    """Bodies and joints that do not form a serial arm, or not a supported one."""


class MapError(ScenirisError):
    """A reachability map that is missing, unreadable, or made for another arm."""


class ContactBudgetError(ScenirisError):
    """More contacts or constraint rows than a batch has room for: `budget`, "nconmax" or "njmax", per world."""

    def __init__(self, budget: str, room: int, wanted: int) -> None:
        self.budget, self.room, self.wanted = budget, room, wanted
        super().__init__(
            f"{budget}={room} is too small for this scene: {wanted} were needed just now, and the rest are ignored. "
            f"Pass {budget}={max(2 * room, 2 * wanted)}."
        )


class MaskError(ScenirisError, ValueError):
    """A mask of worlds with a wrong type, shape or device."""


class MaskTypeError(MaskError, TypeError):
    """A mask of worlds that is not an array of booleans."""


class SceneMismatchError(ScenirisError, ValueError):
    """A model, data or layout source that does not belong to the CompiledScene it is used with."""


class SeedError(ScenirisError, ValueError):
    """A seed that is not a 64-bit integer, or a number of seeds that differs from the number of worlds."""


class BusyError(ScenirisError, RuntimeError):
    """An object that another thread uses at this moment."""

    def __init__(self, what: str) -> None:
        self.what = what
        super().__init__(
            f"{what}: another thread is using it at this moment, and the order of their calls would be a matter of "
            "chance. Call it from one thread at a time, or give each thread one of its own."
        )


class FixedError(ScenirisError, AttributeError):
    """Raised on assignment to an attribute `name` of a class `what` that captured graphs already use."""

    def __init__(self, what: str, name: str, cure: str | None = None) -> None:
        self.what, self.cure = what, cure
        super().__init__(
            f"{what}.{name} cannot be changed: steps and resets are captured with the arrays of the scene that {what} "
            "was made with, and would go on with them. " + (cure or f"Make another {what} with the other '{name}'.")
        )
        self.name = name  # which AttributeError has as well, and sets to None


class TaskError(ScenirisError, TypeError):
    """A method of a task returned `got`, which is of the wrong type or form."""

    def __init__(self, task: str, method: str, got: str, form: str) -> None:
        self.task, self.method, self.got, self.form = task, method, got, form
        super().__init__(f"{task}.{method} returned {got}, but should return {form}.")


class LayoutIdError(ScenirisError):
    """A layout id that is not `scenehash:split:seed:episode`."""


class CountError(ScenirisError, ValueError):
    """A number of layouts, candidates or worlds that is too small, too large, or no whole number."""


class ArgumentError(ScenirisError, ValueError):
    """An argument that its function does not take."""


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument of a type that its function does not take."""


def check_type(value: object, kind: type, name: str) -> None:
    """Refuse an argument that is not of a type; `name` names the function and the argument.

    Raises:
        ArgumentTypeError: It is of another type.
    """
    if not isinstance(value, kind):
        raise ArgumentTypeError(f"{name} should be a {kind.__name__}, got {type(value)}.")


def check_names(kind: str, names: Iterable[object], where: str, valid: Collection[str]) -> None:
    """Refuse names that are not among the valid ones; `kind` and `where` are for the message.

    Raises:
        UnknownNameError: For the first of them.
    """
    for name in names:
        if name not in valid:
            raise UnknownNameError(kind, str(name), where, valid)


def as_names(value: Any, name: str) -> tuple[str, ...]:
    """Return names that are given as a single one or as several; `name` is that of the argument.

    Raises:
        ArgumentTypeError: Anything else.
    """
    if isinstance(value, str):
        return (value,)
    names = tuple(value) if isinstance(value, Iterable) else (value,)
    if not all(isinstance(each, str) for each in names):
        raise ArgumentTypeError(f"{name} should be a name or several, got {type(value)}.")
    return names


class FallbackWarning(ScenirisWarning):
    """A scene whose worlds run out of attempts or restarts more often than they should.

    Args:
        where: The scene.
        share: Share of the layouts made for the bank that ran out of restarts.
        name: The object with the most rejections.
        cause: Their most frequent cause.
        cures: Words of the scene file that would help.
        held: Layouts in the smaller of the two banks, and the number wanted, if fewer were found.
    """

    def __init__(
        self, where: str, share: float, name: str, cause: str, cures: Iterable[str], held: tuple[int, int] | None = None
    ) -> None:
        self.where, self.share, self.name, self.cause, self.cures = where, share, name, cause, tuple(cures)
        self.held = held
        few = "" if held is None else f" No more were found, so the bank holds {held[0]} of {held[1]}."
        super().__init__(
            f"{where}: {share:.0%} of the worlds run out of restarts and get a layout from the bank, mostly because of "
            f"'{name}' ({cause}).{few} Write {', or '.join(self.cures)}."
        )


class AttemptsWarning(ScenirisWarning):
    """`attempts: auto` reached the largest number of attempts, and worlds still run out of them."""

    def __init__(self, where: str, attempts: int) -> None:
        self.where, self.attempts = where, attempts
        super().__init__(
            f"{where}: attempts: auto stopped at {attempts}, with which more than 1% of the worlds still start again. "
            "Give the objects larger regions or fewer neighbours ('sceniris-gym check' shows which), or write "
            "a number: where nothing is left for an object, attempts only take time."
        )


class ReachWarning(ScenirisWarning):
    """Reachability that is not decided as requested; the message says why."""


class ModelWarning(ScenirisWarning):
    """A detail of a model that is accepted but was probably not meant; the message names it and a remedy."""


class OutputError(ScenirisError, OSError):
    """A file that cannot be written."""

    def __init__(self, path: str, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path} cannot be written: {reason}. Give --out a path that you can write to.")


class MemoryLimitError(ScenirisError, MemoryError):
    """Something that takes at least `needed` bytes, more than are `free` on a device."""

    def __init__(self, what: str, needed: int, free: int, device: str, cure: str) -> None:
        self.what, self.needed, self.free, self.device, self.cure = what, needed, free, device, cure
        super().__init__(
            f"{what}: takes {needed / 2**30:.1f} GiB or more, and {max(free, 0) / 2**30:.1f} GiB are free on {device}. "
            f"{cure}"
        )


class DatasetError(ScenirisError):
    """A data set of layouts that is incomplete, damaged, or not the one asked for."""


class MissingExtraError(ScenirisError, ImportError):
    """A library that is not installed, and that an extra of this package installs."""

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f"{package} is not installed. Install the extra: pip install 'sceniris-gym[{extra}]'.")


def import_extra(module: str, extra: str, package: str = "") -> Any:
    """Import a module that an extra of this package installs; `package` is its distribution, if named otherwise.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise MissingExtraError(package or module, extra) from None
