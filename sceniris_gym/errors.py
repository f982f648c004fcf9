"""Every error a user can meet. Each message says what was wrong, where, and what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping


def nearest(name: str, valid: Iterable[str]) -> str | None:
    """Return the valid name closest to `name`, or None when none is close."""
    valid = list(valid)
    found = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    if not found:  # names with prefixes: 'upper_drawer' is near to 'cabinet/upper_drawer'
        tails = {v.rsplit("/", 1)[-1]: v for v in reversed(valid)}
        found = [tails[t] for t in difflib.get_close_matches(name.rsplit("/", 1)[-1], tails, n=1, cutoff=0.6)]
    return found[0] if found else None


def did_you_mean(name: str, valid: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" for the valid name closest to `name`, or an empty string."""
    found = nearest(name, valid)
    return f" Did you mean '{found}'?" if found is not None else ""


class ScenirisError(Exception):
    """Base class of all errors of this package."""


class SceneFileError(ScenirisError):
    """A scene file that is missing or is not readable as YAML."""


class SceneKeyError(ScenirisError):
    """A key or a value of a scene that is not understood; the message names its path."""


class NotSupportedError(ScenirisError):
    """A word of the scene language, or a feature of a model, that is known but not supported yet."""


class UnknownNameError(ScenirisError):
    """A name of a body, joint, object, asset or scene that does not exist.

    Args:
        kind: what the name should name, e.g. "body".
        name: the unknown name.
        where: file and key path, or the function, in which it was found.
        valid: the names that exist there.
    """

    def __init__(self, kind: str, name: str, where: str, valid: Iterable[str]) -> None:
        self.kind, self.name, self.where, self.valid = kind, name, where, sorted(valid)
        listing = ", ".join(self.valid) if self.valid else "none"
        super().__init__(f"{where}: unknown {kind} '{name}'.{did_you_mean(name, self.valid)} Valid: {listing}.")

    def __reduce__(self) -> tuple:
        return type(self), (self.kind, self.name, self.where, self.valid)


class NoSupportError(ScenirisError):
    """A parent that has no surface to place anything on."""


class ErodedSupportError(ScenirisError):
    """A support of which a region, or the erosion by `ratio_on_support`, leaves nothing."""


class CycleError(ScenirisError):
    """Names that depend on each other in a circle: parents of objects, or bases of scene files.

    Args:
        where: the file or scene in which the cycle was found.
        names: the names along the cycle, each depending on the next, the last one on the first.
        what: what depends on what, e.g. "objects are supported by each other".
    """

    def __init__(self, where: str, names: Iterable[str], what: str) -> None:
        self.where, self.names, self.what = where, list(names), what
        circle = " -> ".join([*self.names, self.names[0]])
        super().__init__(f"{where}: {what}: {circle}. Change one of them so that the chain has an end.")

    def __reduce__(self) -> tuple:
        return type(self), (self.where, self.names, self.what)


class MeshError(ScenirisError):
    """A mesh that cannot be used for collision: it is open, or has no faces."""


class GraspError(ScenirisError):
    """An object that a gripper cannot take: all its grasps are wider than the gripper opens.

    Args:
        where: the scene and the object.
        needed: the least gap that a grasp needs [m]; None where no grasp has anything between the fingers.
        opening: the widest gap of the gripper [m].
    """

    def __init__(self, where: str, needed: float | None, opening: float) -> None:
        self.where, self.needed, self.opening = where, needed, opening
        why = "no grasp has anything between the fingers"
        if needed is not None:
            why = f"the narrowest of its grasps is {needed:.3g} m wide, and the gripper opens {opening:.3g} m"
        super().__init__(
            f"{where}.reachable: {why}. Give the asset sites 'grasp_*' where it can be taken (+z the approach, +y the "
            "closing axis), or use a smaller object."
        )

    def __reduce__(self) -> tuple:
        return type(self), (self.where, self.needed, self.opening)


class InfeasibleSceneError(ScenirisError):
    """A scene of which no valid layout could be made.

    Args:
        where: the scene.
        name: the object that could not be placed; all before it could.
        cause: the cause that rejected it most often.
        counts: rejections per object and cause.
        leaning: its support, if that was drawn leaning in most worlds.
        turn: the word of that support's orientation, if that does not keep it upright.
    """

    def __init__(
        self,
        where: str,
        name: str,
        cause: str,
        counts: Mapping[str, Mapping[str, int]],
        leaning: str | None = None,
        turn: str | None = None,
    ) -> None:
        self.where, self.name, self.cause, self.leaning, self.turn = where, name, cause, leaning, turn
        self.counts = {k: dict(v) for k, v in counts.items()}
        rows = "; ".join(
            f"{obj}: " + ", ".join(f"{c} {n}" for c, n in by_cause.items() if n)
            for obj, by_cause in self.counts.items()
            if any(by_cause.values())
        )
        advice = "Give it a larger region or support, or a smaller clearance, or fewer neighbours."
        if leaning is not None:
            better = "Draw its joints, or those above it, where it is level."
            if turn is not None:
                owner = leaning.split("/")[0]
                better = f"Keep '{owner}' upright: give it a yaw or 'fixed' instead of 'orientation: {turn}'."
            advice = (
                f"Its support '{leaning}' leans by more than 0.1 degree in most of the states that were drawn, and "
                f"things are placed on level surfaces only. {better}"
            )
        elif cause == "roof":
            advice = "'on' wants nothing of the support's object above it, 'inside' something; 'in' takes both."
        elif cause in ("unreachable", "no_ik", "blocked"):
            advice = "Bring it nearer to the robot, turn it towards it, or ask for a less thorough tier of 'reachable'."
        super().__init__(
            f"{where}: no valid layout was found: '{name}' could not be placed, mostly because of {cause}. "
            f"Rejections: {rows}. {advice}"
        )

    def __reduce__(self) -> tuple:
        return type(self), (self.where, self.name, self.cause, self.counts, self.leaning, self.turn)


class ArmError(ScenirisError):
    """Bodies and joints that are not a serial arm, or not one that can be used."""


class PosesError(ScenirisError, ValueError):
    """A file of TCP poses that is missing, or holds something else."""


class MapError(ScenirisError):
    """A reachability map that is missing, not readable, or not of the arm it is used for."""


class ContactBudgetError(ScenirisError):
    """More contacts or constraint rows than a batch of worlds has room for.

    Args:
        budget: the argument that set the room, "nconmax" or "njmax".
        room: its value [per world].
        wanted: what was needed at least [per world].
    """

    def __init__(self, budget: str, room: int, wanted: int) -> None:
        self.budget, self.room, self.wanted = budget, room, wanted
        super().__init__(
            f"{budget}={room} is too small for this scene, the rest is ignored: {wanted} were needed at this moment. "
            f"Pass {budget}={max(2 * room, 2 * wanted)}."
        )

    def __reduce__(self) -> tuple:
        return type(self), (self.budget, self.room, self.wanted)


class MaskError(ScenirisError, ValueError):
    """A mask of worlds with a wrong type, shape or device."""


class MaskTypeError(MaskError, TypeError):
    """A mask of worlds that is not an array of booleans."""


class SceneMismatchError(ScenirisError, ValueError):
    """A model, data or generator that does not belong to the CompiledScene it is used with."""


class SeedError(ScenirisError, ValueError):
    """A seed that is not an integer of 64 bits, or seeds of which there are not as many as worlds."""


class TaskError(ScenirisError, TypeError):
    """What a method of a task returned has another form than it should.

    Args:
        task: name of the task's class.
        method: the method.
        got: what it returned.
        form: what it should return.
    """

    def __init__(self, task: str, method: str, got: str, form: str) -> None:
        self.task, self.method, self.got, self.form = task, method, got, form
        super().__init__(f"{task}.{method} returned {got}, but should return {form}.")

    def __reduce__(self) -> tuple:
        return type(self), (self.task, self.method, self.got, self.form)


class LayoutIdError(ScenirisError):
    """A layout id that is not `scenehash:split:seed:episode`."""


class CountError(ScenirisError, ValueError):
    """A number of layouts, candidates or worlds that is too small."""


class ReachWarning(UserWarning):
    """Reachability is decided in another way than the scene asks for; the message says why."""


class OutputError(ScenirisError, OSError):
    """A file that cannot be written.

    Args:
        path: the file.
        reason: why.
    """

    def __init__(self, path: str, reason: str) -> None:
        self.path, self.reason = path, reason
        super().__init__(f"{path} cannot be written: {reason}. Give a path in a folder that is yours with --out.")

    def __str__(self) -> str:
        return str(self.args[0])

    def __reduce__(self) -> tuple:
        return type(self), (self.path, self.reason)


class MissingExtraError(ScenirisError, ImportError):
    """A training library that is not installed.

    Args:
        package: what could not be imported.
        extra: the extra of this package that installs it.
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f"{package} is not installed. Install the extra: pip install 'sceniris-gym[{extra}]'.")

    def __reduce__(self) -> tuple:
        return type(self), (self.package, self.extra)


class KeysLeftOutWarning(UserWarning):
    """A configuration of the original package was read without some of its keys, or some of them are not as there.

    Args:
        keys: dotted paths of the keys that are left out.
        changed: dotted paths of the keys that are carried over with another meaning or value: what they are here.
        advice: how more could be carried over, sentences.
    """

    def __init__(
        self, keys: Iterable[str], changed: Mapping[str, str] | None = None, advice: Iterable[str] = ()
    ) -> None:
        self.keys, self.changed, self.advice = tuple(keys), dict(changed or {}), tuple(advice)
        texts = [f"not carried over from the original configuration: {', '.join(self.keys)}."] if self.keys else []
        if self.changed:
            meanings = "; ".join(f"{key} ({meaning})" for key, meaning in self.changed.items())
            texts.append(f"carried over from the original configuration with another meaning or value: {meanings}.")
        super().__init__(" ".join((*texts, *self.advice)))

    def __reduce__(self) -> tuple:
        return type(self), (self.keys, self.changed, self.advice)
