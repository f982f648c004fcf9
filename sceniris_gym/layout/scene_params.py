"""`Param`, and the params of a scene: the parts of its file that can be narrowed at run time."""

import itertools
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sceniris_gym.config.bounds import BOUNDS
from sceniris_gym.config.fields import short
from sceniris_gym.config.loader import JOINT_FORMS
from sceniris_gym.config.relations import Sector
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.masks import as_numbers
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import OWN_A, OWN_B, ObjectKind, OrientationType

STARTS = "start.weights"
"""Name of the param for the weights of the kinds of starts."""
# Relative tolerance of limits, for values rounded to six digits, as in messages, or to single precision.
_ROUNDING = 5.0e-6


class Param(NamedTuple):
    """A value in a scene file that can be narrowed. It consists of one or several numbers.

    Attributes:
        name: The key in the scene file, such as "groups.clutter.count".
        default: Numbers of the scene file, clipped to the support or the joint limits, float32: all low ends and then
            all high ends, or the weights, or the clearance.
        form: "interval" [low, high], "count" (an interval of integers), "box" (its low and its high corner), "weights",
            or "clearance" (a least distance).
        least: Least number of weights that must be above 0.
        copies: One entry for each copy of a number in an array: name of the array, index in a row of this array, and
            index of the number in `default`.
        written: The numbers of the scene file before clipping. Empty if nothing can be clipped.
        keeps: For the weights of a group that is in every layout: whether it still is with the given weights.
    """

    name: str
    default: np.ndarray
    form: str = "interval"
    least: int = 0
    copies: tuple[tuple[str, int, int], ...] = ()
    written: tuple[float, ...] = ()
    keeps: Callable[[Iterable[float]], bool] | None = None

    def _limits(self, numbers: np.ndarray) -> np.ndarray:
        """Return the least and greatest value of each number, shape (2, n). `numbers` has the scene file's values."""
        if self.half:
            return np.tile(numbers.reshape(2, -1), 2)
        bound = BOUNDS["weight" if self.form == "weights" else "clearance"]
        least = 0.0 * numbers if self.form == "weights" else numbers
        return np.array([least, np.full_like(least, bound.high)])

    @property
    def half(self) -> int:
        """The number of low ends, which equals the number of high ends. 0 for weights and clearances."""
        return 0 if self.form in ("weights", "clearance") else len(self.default) // 2

    def checked(self, value: Any, nworld: int) -> np.ndarray:
        """Check a value for all worlds, or one value per world. Return float32, shape (1 or nworld, len(default)).

        If a number is within the limits of the scene file, but beyond the limits of the model or of single precision,
        it is clipped.

        Raises:
            ArgumentError: Wrong shape, not numbers, or beyond the limits of the scene file.
        """
        width, half, given = len(self.default), self.half, as_numbers(value)
        if given.ndim == 0 and self.form == "count":
            given = given.repeat(2)  # as in "count: 2"
        if given.size != width and (given.size != nworld * width or len(given) != nworld):
            each = {"interval": "[low, high]", "count": "[low, high]", "clearance": "a number"}
            wanted = f"{each.get(self.form, f'{width} numbers')}, or one such value for each of {nworld} worlds"
            raise ArgumentError(f"{self.name} should be {wanted}, got {short(value)}.")
        rows, written = given.reshape(-1, width), np.array(self.written or self.default, float)
        least, most = limits = self._limits(written)
        slack = _ROUNDING * np.maximum(1.0, np.abs(limits))
        fits = ((rows >= least - slack[0]) & (rows <= most + slack[1])).all()
        rows = np.clip(rows, *self._limits(self.default)).astype(np.float32)
        low, high = rows[:, :half], rows[:, half:]
        is_flat = (low == high[:, :half]) & (least[:half] < most[:half])
        if not fits or (low > high[:, :half]).any() or (self.form == "box" and is_flat.any()):
            limits = f"from {least[0]:g} to {most[0]:g}"
            if half:
                ends = (f"[{', '.join(f'{x:g}' for x in part)}]" for part in (least[:half], most[half:]))
                limits = f"low and high from {' to '.join(ends)}, as in the scene file"
            raise ArgumentError(f"{self.name} should be {limits}, got {short(value)}.")
        if self.form == "count" and (rows != np.round(rows)).any():
            raise ArgumentError(f"{self.name} should be whole numbers, got {short(value)}.")
        if self.least and (np.count_nonzero(rows, axis=1) < self.least).any():
            raise ArgumentError(f"{self.name} should have at least {self.least} weights above 0, got {short(value)}.")
        if self.keeps is not None and not all(map(self.keeps, np.unique(rows > 0.0, axis=0))):
            raise ArgumentError(
                f"{self.name} should be above 0 for members that are never absent together, because the scene needs "
                f"one of them in every layout, got {short(value)}."
            )
        return rows


def scene_params(compiled: CompiledScene) -> dict[str, Param | str]:
    """Return all params of a scene by name. If a value cannot be a param, its name maps to a text with the reason."""
    finders = (_joints, _groups, _starts, _distances, _yaws, _regions, _randomize, _clearances)
    params: dict[str, Param | str] = {}
    for name, found in itertools.chain(*(find(compiled) for find in finders)):
        params[name] = _joined(params[name], found) if name in params else found
    return params


def _joined(one: Param | str, other: Param | str) -> Param | str:
    """Return the param of an object from the params of its members on different supports."""
    if isinstance(one, str) or isinstance(other, str):
        return one if isinstance(one, str) else other
    if not np.array_equal(one.default, other.default) or one.written != other.written:
        return "it differs between the supports of the object. Leave out this param."
    return one._replace(copies=one.copies + other.copies)


def _joints(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the intervals of drawn joints."""
    scene, program = compiled.scene, compiled.program
    first, ranges = program.obj_drawadr.numpy(), program.draw_range.numpy()[0]
    for i, owner in enumerate(compiled.placed):
        names = {joint: name for name, joint in scene.joints(owner).items()}
        for k, (joint, words) in enumerate(scene.joint_configs(owner).items(), first[i]):
            name = f"{compiled.config.key(owner)}.joints.{names[joint]}"
            home = float(scene.home_qpos[scene.mjm.jnt_qposadr[joint]])
            written = () if words.noise is None else (home - words.noise, home + words.noise)
            if ranges[k, 0] > ranges[k, 1]:
                yield name, f"its draw is a '{words.given(JOINT_FORMS)[0]}'. Give a 'range' in the scene file."
            else:
                copies = (("draw_range", 2 * k, 0), ("draw_range", 2 * k + 1, 1))
                yield name, Param(name, ranges[k], copies=copies, written=written)


def _groups(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the counts of groups, and the weights of group members and of variants."""
    presence = compiled.config.presence
    for g, (group, words) in enumerate(compiled.config.groups.items()):
        key = f"objects.{group}" if group in compiled.config.variants else f"groups.{group}"
        if key.startswith("groups"):
            name = f"{key}.count"
            copies = (("group", 4 * g + 2, 0), ("group", 4 * g + 3, 1))
            yield name, Param(name, np.array(words.count, np.float32), "count", copies=copies)
        adr = int(compiled.program.group.numpy()[0, g, 0])
        weights = np.array([words.weights.get(member, 1.0) for member in words.of], np.float32)
        both = range(2 * len(words.of))  # for each member, the weights in both splits
        copies = tuple(("group_weight", 2 * adr + i, i // 2) for i in both)
        if words.is_uniform:
            copies += (("group_uniform", g, 0),)
        if words.by_area:
            yield f"{key}.weights", "areas determine the weights of its supports. Write weights in the scene file."
        elif words.splits:
            yield (
                f"{key}.weights",
                "its members have 'splits', so each split has separate weights. Remove 'splits' from the members.",
            )
        else:
            sure = partial(presence.is_sure_with, f"groups.{group}")
            keeps = sure if sure(weights) else None
            yield f"{key}.weights", Param(f"{key}.weights", weights, "weights", words.count[1], copies, keeps=keeps)


def _starts(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the weights of the kinds of starts."""
    if compiled.config.start:
        weights = np.array([kind.weight for kind in compiled.config.start], np.float32)
        copies = tuple(("start_weight", k, k) for k in range(len(weights)))
        yield STARTS, Param(STARTS, weights, "weights", 1, copies)


def _distances(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the intervals of distances of relations."""
    program = compiled.program
    first, number = program.obj_reladr.numpy(), program.obj_relnum.numpy()
    low, high = program.rel_low.numpy()[0], program.rel_high.numpy()[0]
    for i, owner in enumerate(compiled.placed):
        part = compiled.config.parts.get(owner)
        for r, relation in enumerate(() if part is None else part.relations[: number[i]]):
            name, k = f"{compiled.config.key(owner)}.relations.{r}.distance", first[i] + r
            if isinstance(relation, Sector) and np.isfinite(relation.high):
                copies = (("rel_low", k, 0), ("rel_high", k, 1))
                yield name, Param(name, np.array([low[k], high[k]], np.float32), copies=copies)
            else:
                yield name, "its relation has no greatest distance. Give 'max' or 'equal' in the scene file."


def _yaws(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the intervals of rotations about the vertical [rad]."""
    program = compiled.program
    yaws, heaps, kinds = program.obj_yaw.numpy()[0], program.obj_heap.numpy()[:, 0], program.obj_orientation.numpy()
    for i, owner in enumerate(compiled.placed):
        name, part = f"{compiled.config.key(owner)}.orientation.yaw", compiled.config.parts.get(owner)
        if part is None or not part.is_placed:
            continue
        if kinds[i] == OrientationType.ANY or heaps[i] >= 0:
            yield name, "its orientation is 'any' or comes from a heap. Give {yaw: [low, high]} in the scene file."
        else:
            yield name, Param(name, yaws[i], copies=(("obj_yaw", 2 * i, 0), ("obj_yaw", 2 * i + 1, 1)))


def _regions(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the key of each object's region, with the bounding box as a param or the reason why there is no param."""
    program = compiled.program
    cuts, heaps = program.obj_cutnum.numpy(), program.obj_heap.numpy()[:, 0]
    first, number = program.obj_stableadr.numpy(), program.obj_stablenum.numpy()
    triangles = np.concatenate([[getattr(program, f"tri_{name}").numpy()] for name in "abc"])
    triadr, trinum = program.stable_triadr.numpy(), program.stable_trinum.numpy()
    for i, owner in enumerate(compiled.placed):
        name, part = f"{compiled.config.key(owner)}.region", compiled.config.parts.get(owner)
        if part is None or not part.is_placed:
            continue
        if cuts[i] > 0 or heaps[i] >= 0 or (part.region is not None and part.region.points is not None):
            yield (
                name,
                "it comes from points or a heap, or differs between layouts because of relations, a leaning support, "
                "or 'ratio_on_support' with 'orientation: any' or drawn joints. Leave out this param.",
            )
        elif part.support is None:
            ends = ("obj_box_lower", "obj_box_upper")
            box = np.concatenate([getattr(program, end).numpy()[0, i] for end in ends])
            yield name, Param(name, box, "box", copies=tuple((ends[k // 3], 3 * i + k % 3, k) for k in range(6)))
        else:
            own = range(first[i], first[i] + number[i])
            xy = np.concatenate([triangles[:, triadr[v] : triadr[v] + trinum[v]].reshape(-1, 2) for v in own])
            corners = () if part.region is None else part.region.box or ()
            ends = np.concatenate([xy.min(axis=0), xy.max(axis=0)])
            yield name, Param(name, ends, "box", written=tuple(itertools.chain(*corners)))


def _randomize(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the intervals of drawn physics and appearance."""
    for draw in compiled.scene.sim.draws:
        name = draw.key
        if draw.config.choice is not None or draw.config.distribution == "normal":
            yield (
                name,
                "it has a 'choice' or a 'normal' distribution. Use a 'uniform' distribution, which has ends to narrow.",
            )
        else:
            yield name, Param(name, np.array(draw.config.ends, np.float32).ravel())


def _clearances(compiled: CompiledScene) -> Iterator[tuple[str, Param | str]]:
    """Yield the clearances of objects and robots.

    A clearance's copies are the margins of the pairs that it applies to.
    """
    program, config, owners = compiled.program, compiled.config, compiled.scene.owners
    bodies, kinds = program.pair_bodies.numpy().tolist(), program.obj_kind.numpy()
    first, number = program.obj_pairadr.numpy(), program.obj_pairnum.numpy()
    copies: dict[str, list[tuple[str, int, int]]] = {owner: [] for owner in (*config.objects, *config.all_robots)}
    for i, owner in enumerate(compiled.placed):
        for pair in range(first[i], first[i] + number[i]):
            a, b, own, _ = bodies[pair]
            if kinds[i] != ObjectKind.STATIC and own in (OWN_A, OWN_B):  # not two parts of the same object
                for other in {owner, owners.get(b if own == OWN_A else a, owner)}:
                    copies[other].append(("pair_margin", pair, 0))
    for owner, part in (*config.objects.items(), *config.all_robots.items()):
        name, least = f"{config.key(owner)}.clearance", np.array([part.clearance], np.float32)
        known = Param(name, least, "clearance", copies=tuple(copies[owner]))
        yield name, known if known.copies else "no placed object is tested for it. Leave out this param."
