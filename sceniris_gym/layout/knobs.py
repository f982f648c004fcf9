"""`KnobTable`: numbers of a scene file that may change while it is used, world by world, without compiling it again.

A knob narrows what the scene file says: a count, an interval, a region. So all that was proved of the scene, and every
size that was worked out for it, stays true.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
import warp as wp

from sceniris_gym.config.messages import short
from sceniris_gym.config.relations import Sector
from sceniris_gym.errors import ArgumentError, LayoutIdError, UnknownNameError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, copied

wp.set_module_options({"enable_backward": False})

_FLOAT, _INT, _SAME = (wp.constant(i) for i in range(3))
_PART = re.compile(r"([^=,:]+)=((?:[0-9a-f]{8})+)")


@wp.struct
class Target:
    """A number of an array with a row for each world, and the knob that it has.

    Attributes:
        address: First element of the array.
        width: Elements of a row.
        offset: Number of the element in a row.
        kind: A float, an integer, or a flag that tells whether `count` values are as in the scene file.
        value: Column of the knob's value.
        count: See `kind`.
    """

    address: wp.uint64
    width: int
    offset: int
    kind: int
    value: int
    count: int


@dataclass(frozen=True)
class Knob:
    """A number or a few of a scene file that may change.

    Attributes:
        name: The key in the scene file, such as "groups.clutter.count".
        default: Its numbers as the scene file has them, float32: least ones, then greatest ones; or weights.
        form: "interval" [low, high], "count" (an interval of integers), "box" (its low and its high corner), or
            "weights".
        least: The number of weights that should be above 0.
        places: The fields that hold it: name, and the element of a row for each number, -1 for none.
    """

    name: str
    default: np.ndarray
    form: str = "interval"
    least: int = 0
    places: tuple[tuple[str, tuple[int, ...]], ...] = ()

    def checked(self, value: Any, nworld: int) -> np.ndarray:
        """Return a value for all worlds, or one for each, as float32 of shape (1 or nworld, number of numbers).

        Raises:
            ArgumentError: Anything else, or beyond what the scene file says.
        """
        value = value.detach().cpu().numpy() if hasattr(value, "detach") else value
        try:
            given = np.asarray(value.numpy() if isinstance(value, wp.array) else value, np.float32)
        except (TypeError, ValueError):
            given = np.zeros(0, np.float32)
        width = len(self.default)
        if given.size not in (width, nworld * width):
            each = "[low, high]" if self.form in ("interval", "count") else f"{width} numbers"
            raise ArgumentError(f"{self.name} should be {each}, or such for each of {nworld} worlds: {short(value)}.")
        rows = given.reshape(-1, width)
        low, high = np.split(rows, 2, axis=1) if self.form != "weights" else (rows, rows)
        first, last = np.split(self.default, 2) if self.form != "weights" else (np.zeros(1), np.full(1, np.inf))
        if not ((low <= high) & (low >= first) & (high <= last) & np.isfinite(rows).all()).all():
            limits = "numbers of 0 or more"
            if self.form != "weights":
                limits = f"low and high within {first.tolist()} and {last.tolist()}, as the scene file has them"
            raise ArgumentError(f"{self.name} should be {limits}: {short(value)}.")
        if self.form == "count" and (rows != np.round(rows)).any():
            raise ArgumentError(f"{self.name} should be whole numbers: {short(value)}.")
        if ((rows > 0).sum(axis=1) < self.least).any():
            raise ArgumentError(f"{self.name} should have at least {self.least} weights above 0: {short(value)}.")
        return rows


class KnobTable:
    """The knobs that some worlds of a scene have, each with its columns in a row of numbers.

    Args:
        compiled: The scene.
        names: Names of knobs, or patterns such as "objects.*.region".
        where: Begins errors.

    Attributes:
        knobs: The knobs, sorted by name.
        first: The first column of each knob, by its name.
        default: The numbers of the scene file, shape (nvalue,), float32.

    Raises:
        UnknownNameError: There is no such knob.
        ArgumentError: A part of the scene file that cannot be one, and the reason.
    """

    def __init__(self, compiled: CompiledScene, names: str | Sequence[str], where: str = "knobs") -> None:
        known, refused = _known(compiled)
        chosen: dict[str, Knob] = {}
        for name in (names,) if isinstance(names, str) else names:
            found = [name] if name in known else fnmatch.filter(known, name)
            if not found and name in refused:
                raise ArgumentError(f"{where}: '{name}' cannot be a knob: {refused[name]}")
            if not found:
                raise UnknownNameError("knob", str(name), where, known)
            chosen |= {one: known[one] for one in found}
        self.knobs = tuple(chosen[name] for name in sorted(chosen))
        columns = np.cumsum([0, *(len(knob.default) for knob in self.knobs)]).tolist()
        self.first = {knob.name: column for knob, column in zip(self.knobs, columns, strict=False)}
        self.default = np.concatenate([knob.default for knob in self.knobs]) if chosen else np.zeros(0, np.float32)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the knobs, sorted."""
        return tuple(self.first)

    def knob(self, name: str, where: str = "set_knob") -> Knob:
        """Return a knob by its name.

        Raises:
            UnknownNameError: It is none of these.
        """
        if name not in self.first:
            raise UnknownNameError("knob", str(name), f"{where}, one of `knobs`", self.names)
        return next(knob for knob in self.knobs if knob.name == name)

    def named(self, rows: Any) -> dict[str, Any]:
        """Return columns of rows by the names of their knobs, each of shape (nrow, number of numbers)."""
        return {k.name: rows[:, self.first[k.name] : self.first[k.name] + len(k.default)] for k in self.knobs}

    def text(self, row: np.ndarray) -> str:
        """Return the fifth part of a layout id: the knobs that differ from the scene file, sorted, float32 in hex."""
        parts = []
        for name, values in self.named(np.asarray(row, np.float32)[None]).items():
            if (values[0] != self.knob(name).default).any():
                bits = "".join(f"{number:08x}" for number in values[0].view(np.uint32))
                parts.append(f"{quote(name, safe='./*')}={bits}")
        return ",".join(parts)

    def row(self, text: str) -> np.ndarray:
        """Return the numbers that the fifth part of a layout id means, shape (nvalue,), float32.

        Raises:
            LayoutIdError: A malformed text, or as many numbers as the knob does not have.
            UnknownNameError, ArgumentError: A knob that is not in the table, or numbers that it cannot have.
        """
        return self.rows(knobs_in(text), 1)[0]

    def rows(self, values: Mapping[str, Any], nworld: int) -> np.ndarray:
        """Return the numbers of all worlds in which some knobs have other values, shape (nworld, nvalue), float32.

        Raises:
            UnknownNameError, ArgumentError: A knob that is not in the table, or values that it cannot have.
        """
        rows = np.tile(self.default, (nworld, 1))
        for name, value in values.items():
            checked = self.knob(name).checked(value, nworld)
            rows[:, self.first[name] : self.first[name] + checked.shape[1]] = checked
        return rows

    def fill(self, program: Program, nworld: int) -> tuple[Program, wp.array | None]:
        """Return the program with a row for each world where knobs are, and the numbers that knobs have in it."""
        names = {name for knob in self.knobs for name, _ in knob.places if hasattr(program, name)}
        made, device = copied(Program, program), program.home_qpos.device
        for name in names:
            array = getattr(program, name)
            with wp.ScopedDevice(device):
                rows = np.repeat(array.numpy(), nworld, axis=0)
                setattr(made, name, wp.array(rows, dtype=array.dtype, ndim=2))
        return made, self.targets({name: getattr(made, name) for name in names})

    def targets(self, arrays: Mapping[str, wp.array]) -> wp.array | None:
        """Return the numbers that knobs have in arrays with a row for each world; None if there are none."""
        found = []
        for knob in self.knobs:
            for name, elements in (place for place in knob.places if place[0] in arrays):
                array = arrays[name]
                size = 1 if array.dtype is wp.bool else 4
                kind = _SAME if size == 1 else _INT if knob.form == "count" else _FLOAT
                for k, element in enumerate(elements):
                    if element >= 0:
                        words = (array.ptr, array.strides[0] // size, element, kind, self.first[knob.name] + k)
                        found.append(_target(*words, len(knob.default)))
        if not found:
            return None
        return wp.array(found, dtype=Target, device=next(iter(arrays.values())).device)


def knobs_in(text: str) -> dict[str, np.ndarray]:
    """Return the knobs that the fifth part of a layout id names, with their numbers.

    Raises:
        LayoutIdError: A malformed text.
    """
    found = {}
    for part in text.split(",") if text else ():
        match = _PART.fullmatch(part)
        if match is None:
            raise LayoutIdError(f"layout id: its fifth part should be name=hex, 8 digits a number, got '{part}'.")
        bits = [int(match[2][i : i + 8], 16) for i in range(0, len(match[2]), 8)]
        found[unquote(match[1])] = np.array(bits, np.uint32).view(np.float32)
    return found


def _target(address: int, width: int, offset: int, kind: int, value: int, count: int) -> Target:
    target = Target()
    target.address, target.width, target.offset, target.kind = wp.uint64(address), width, offset, kind
    target.value, target.count = value, count
    return target


@wp.kernel
def _write(
    # In:
    mask: wp.array[wp.bool],
    knob: wp.array2d[float],
    default_knob: wp.array[float],
    targets: wp.array[Target],
):
    worldid, i = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    target = targets[i]
    at = worldid * target.width + target.offset
    value = knob[worldid, target.value]
    if target.kind == _FLOAT:
        floats = wp.array(ptr=target.address, shape=(at + 1,), dtype=float)
        floats[at] = value
    elif target.kind == _INT:
        integers = wp.array(ptr=target.address, shape=(at + 1,), dtype=int)
        integers[at] = int(value)
    else:
        same = wp.uint8(1)
        for k in range(target.value, target.value + target.count):
            if knob[worldid, k] != default_knob[k]:
                same = wp.uint8(0)
        flags = wp.array(ptr=target.address, shape=(at + 1,), dtype=wp.uint8)
        flags[at] = same


def launch_write(targets: wp.array, mask: wp.array | None, knob: wp.array, default: wp.array) -> None:
    """Write the knobs of the masked worlds into the arrays that hold them.

    Args:
        targets: See `KnobTable.targets`.
        mask: Which worlds, shape (nworld,), bool; all if None.
        knob: Numbers of the knobs, shape (nworld, nvalue).
        default: Those of the scene file, shape (nvalue,).
    """
    dim = (knob.shape[0], targets.shape[0])
    wp.launch(_write, dim, inputs=[mask, knob, default, targets], device=knob.device)


@wp.kernel
def _set(
    mask: wp.array[wp.bool],
    first: int,
    values: wp.array2d[float],
    # Out:
    knob: wp.array2d[float],
):
    worldid, k = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    knob[worldid, first + k] = values[worldid % values.shape[0], k]


def launch_set(knob: wp.array, first: int, values: wp.array, mask: wp.array | None) -> None:
    """Write numbers into the columns from `first` on of the masked worlds; `values` have one row, or one per world."""
    dim = (knob.shape[0], values.shape[1])
    wp.launch(_set, dim, inputs=[mask, first, values], outputs=[knob], device=knob.device)


def _known(compiled: CompiledScene) -> tuple[dict[str, Knob], dict[str, str]]:
    """Return all knobs of a scene by name, and the reason for each part of a like kind that cannot be one."""
    known, refused = {}, {}
    for find in _FINDERS:
        for name, found in find(compiled):
            if isinstance(found, Knob):
                known[name] = found
            else:
                refused[name] = found
    return known, refused


def _joints(compiled: CompiledScene) -> Iterator[tuple[str, Knob | str]]:
    """Yield the intervals that joints are drawn from."""
    scene, program = compiled.scene, compiled.program
    first, choices = program.obj_drawadr.numpy(), program.draw_choicenum.numpy()
    ranges = program.draw_range.numpy()[0]
    for i, owner in enumerate(compiled.placed):
        names = {joint: name for name, joint in scene.joints(owner).items()}
        for k, joint in enumerate(scene.joint_configs(owner), first[i]):
            name = f"{compiled.config.key(owner)}.joints.{names[joint]}"
            if choices[k] > 0:
                yield name, "it is a 'choice' of positions. Give a 'range' in the scene file."
            else:
                yield name, Knob(name, ranges[k], places=(("draw_range", (2 * k, 2 * k + 1)),))


def _groups(compiled: CompiledScene) -> Iterator[tuple[str, Knob | str]]:
    """Yield the counts of groups, and the weights of their members or of the variants of an object."""
    for g, (group, words) in enumerate(compiled.config.groups.items()):
        key = f"objects.{group}" if group in compiled.config.variants else f"groups.{group}"
        if key.startswith("groups"):
            name = f"{key}.count"
            place = ("group", (4 * g + 2, 4 * g + 3))
            yield name, Knob(name, np.array(words.count, np.float32), "count", places=(place,))
        adr = int(compiled.program.group.numpy()[0, g, 0])
        weights = np.array([words.weights.get(member, 1.0) for member in words.of], np.float32)
        columns = [
            [2 * (adr + i) + column if words.weights_in(split)[i] > 0.0 else -1 for i in range(len(words.of))]
            for column, split in enumerate(("train", "eval"))
        ]
        places = tuple(("group_weight", tuple(column)) for column in columns)
        if words.is_uniform:
            places += (("group_uniform", (g,)),)
        if words.splits:
            yield f"{key}.weights", "its members have 'splits', each with weights of its own."
        else:
            yield f"{key}.weights", Knob(f"{key}.weights", weights, "weights", words.count[1], places)


def _distances(compiled: CompiledScene) -> Iterator[tuple[str, Knob | str]]:
    """Yield the intervals of distances of relations."""
    program = compiled.program
    first, number = program.obj_reladr.numpy(), program.obj_relnum.numpy()
    low, high = program.rel_low.numpy()[0], program.rel_high.numpy()[0]
    for i, owner in enumerate(compiled.placed):
        part = compiled.config.parts.get(owner)
        for r, relation in enumerate(() if part is None else part.relations[: number[i]]):
            name, k = f"{compiled.config.key(owner)}.relations.{r}.distance", first[i] + r
            if isinstance(relation, Sector) and np.isfinite(relation.high):
                places = (("rel_low", (k, -1)), ("rel_high", (-1, k)))
                yield name, Knob(name, np.array([low[k], high[k]], np.float32), places=places)
            else:
                yield name, "its relation has no greatest distance. Give 'max' or 'equal' in the scene file."


_FINDERS: tuple[Callable[[CompiledScene], Iterator[tuple[str, Knob | str]]], ...] = (_joints, _groups, _distances)
