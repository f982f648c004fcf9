"""Parses BDDL problem files into regions, objects, fixtures and predicates, each with its line in the file."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

from sceniris_gym.config.fields import short
from sceniris_gym.config.loader import user_path
from sceniris_gym.errors import SceneFileError, SceneKeyError, UnknownNameError, check_names
from sceniris_gym.files import read_bytes

PREDICATES = {"On": 2, "In": 2, "Open": 1, "Close": 1, "Turnon": 1, "Turnoff": 1}
"""Number of names that each supported predicate takes."""
_TOKEN = re.compile(r";[^\n]*|[()]|[^\s();]+")
_SECTIONS = ("domain", "language", "regions", "fixtures", "objects", "obj_of_interest", "init", "goal", "requirements")
_ATTRIBUTES = (":target", ":ranges", ":yaw_rotation", ":rgba")


class Word(str):
    """A word of the file. `where` is the word's position, 'FILE:LINE'."""

    where = ""


class Group(list):
    """A list of words and groups in parentheses. `where` is the position of the '(', 'FILE:LINE'."""

    where = ""

    def __repr__(self) -> str:
        return f"({' '.join(str(part) for part in self)})"


@dataclass(frozen=True)
class Predicate:
    """A predicate about objects, fixtures or regions, such as (On plate_1 kitchen_table_plate_region).

    Attributes:
        word: A key of `PREDICATES`.
        names: The objects, fixtures or regions that the predicate is about.
        where: Beginning of error messages: position and text, 'FILE:LINE: (On ...)'.
    """

    word: str
    names: tuple[str, ...]
    where: str = field(default="", compare=False)

    def __str__(self) -> str:
        return f"({self.word} {' '.join(self.names)})"


@dataclass(frozen=True)
class Region:
    """A region of a problem file: rectangles on a work surface, or a site of a fixture or an object.

    Attributes:
        target: The work surface, fixture or object that has the region.
        name: Name of the region. Predicates use 'TARGET_NAME'.
        boxes: Rectangles (low x, low y, high x, high y) [m], relative to the origin of the work surface. Empty for a
            site.
        yaw: Least and greatest heading [rad] of a fixture that is placed in the region.
        where: Position of the region in the file, 'FILE:LINE'.
    """

    target: str
    name: str
    boxes: tuple[tuple[float, ...], ...]
    yaw: tuple[float, float]
    where: str


@dataclass(frozen=True)
class Problem:
    """The contents of a problem file.

    Attributes:
        path: The file.
        language: The instruction to the robot.
        regions: Name as in predicates, 'TARGET_NAME' -> region.
        fixtures, objects: Name -> class, for each fixture and for each object.
        of_interest: Objects and regions that the task involves.
        init: Predicates that are true at the start.
        goal: Predicates that must all be true for success.
        places: Name of a fixture or object -> its position in the file, 'FILE:LINE'.
    """

    path: Path
    language: str
    regions: Mapping[str, Region]
    fixtures: Mapping[str, str]
    objects: Mapping[str, str]
    of_interest: tuple[str, ...]
    init: tuple[Predicate, ...]
    goal: tuple[Predicate, ...]
    places: Mapping[str, str]

    @property
    def things(self) -> dict[str, str]:
        """Class of each fixture and object, by name."""
        return {**self.fixtures, **self.objects}


def read_problem(path: str | Path) -> Problem:
    """Read a problem file.

    Raises:
        SceneFileError: The file is missing, cannot be read, or is no problem file, or its parentheses do not match.
        SceneKeyError: A part of the file is missing or malformed, or two predicates contradict each other.
        UnknownNameError: A section, attribute or predicate is unknown, or a predicate refers to a name that the file
            does not define.
    """
    file = user_path(path, Path(), "read_bddl")
    try:
        text = read_bytes(file).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = "it does not exist" if not file.exists() else str(error)
        raise SceneFileError(f"read_bddl: '{file}' cannot be read: {why}. Give a problem file (.bddl).") from None
    sections = _sections(_parsed(text, file), file)
    regions = {f"{r.target}_{r.name}": r for r in map(_region, sections["regions"])}
    things: dict[str, dict[str, str]] = {"fixtures": {}, "objects": {}}
    places: dict[str, str] = {}
    for key, found in things.items():
        for name, kind in _typed(sections[key]):
            if name in places or name == "world":
                raise SceneKeyError(
                    f"{name.where}: {places.get(name, 'MuJoCo')} uses the name '{name}' already. Choose another."
                )
            found[str(name)], places[str(name)] = kind, name.where
    problem = Problem(
        file,
        " ".join(_words(sections["language"])),
        regions,
        **things,
        of_interest=tuple(_words(sections["obj_of_interest"])),
        init=tuple(map(_predicate, sections["init"])),
        goal=tuple(_goal(sections["goal"])),
        places=places,
    )
    for first, second in (pair for part in (problem.init, problem.goal) for pair in combinations(part, 2)):
        if first.names == second.names and first.word != second.word and len(first.names) == 1:
            raise SceneKeyError(f"{second.where} contradicts {first.where}. Leave out one of the two.")
    for predicate in (*problem.init, *problem.goal):
        for i, name in enumerate(predicate.names):
            if predicate.word == "In" and i == 1 and name not in regions:
                raise UnknownNameError("region", name, predicate.where, regions)
            check_names("object, fixture or region", [name], predicate.where, [*places, *regions])
            if name in regions:
                check_names("object or fixture", [regions[name].target], f"{regions[name].where}: :target", places)
    return problem


def _parsed(text: str, file: Path) -> Group:
    """Parse the text of a file, and return the outermost group. All words and groups store their positions."""
    top = Group()
    stack = [top]
    for number, line in enumerate(text.split("\n"), 1):
        for token in _TOKEN.findall(line):
            where = f"{file}:{number}"
            if token == "(":
                stack.append(Group())
                stack[-1].where = where
                stack[-2].append(stack[-1])
            elif token == ")":
                if len(stack) == 1:
                    raise SceneFileError(f"{where}: this ')' should be left out: it has no matching '('.")
                stack.pop()
            elif not token.startswith(";"):
                stack[-1].append(word := Word(token))
                word.where = where
    if len(stack) > 1:
        raise SceneFileError(f"{stack[-1].where}: the '(' of this line should be closed by a ')'.")
    if not top or not isinstance(top[0], Group) or top[0][:1] != ["define"]:
        raise SceneFileError(f"{file}: should be a problem file that begins with '(define (problem NAME) ...'.")
    return top[0]


def _sections(group: Group, file: Path) -> dict[str, Group]:
    """Return the sections of a file: name without ':' -> group, which is empty if the file lacks the section.

    Raises:
        SceneKeyError: The section `fixtures`, `init` or `goal` is missing or empty.
    """
    found = {name: Group() for name in _SECTIONS}
    for part in group[1:]:
        head = str([*part, "()"][0]) if isinstance(part, Group) else f"{part} without parentheses"
        if head not in ("problem", *(f":{name}" for name in _SECTIONS)):
            raise UnknownNameError("section", head, part.where, [f":{name}" for name in _SECTIONS])
        found.setdefault(head.removeprefix(":"), Group()).extend(part[1:])
    for name in ("fixtures", "init", "goal"):
        if not found[name]:
            raise SceneKeyError(f"{file}: a problem should have a section '(:{name} ...)', which is missing or empty.")
    return found


def _region(group: Group) -> Region:
    try:
        name, *parts = group
        given = {str(part[0]): part[1:] for part in parts}
        (target,) = given.pop(":target")
        boxes = _rows(given.pop(":ranges", []), 4)
        low, high = (_rows(given.pop(":yaw_rotation", []), 2) or [(0.0, 0.0)])[-1]
        given.pop(":rgba", None)
        if any(box[0] > box[2] or box[1] > box[3] for box in boxes) or low > high or not isinstance(name, Word):
            raise ValueError
    except (IndexError, KeyError, TypeError, ValueError):
        raise SceneKeyError(
            f"{group.where}: {short(group)} should be a region: a name and '(:target NAME)'. On the work surface it "
            "also has '(:ranges ((LOW_X LOW_Y HIGH_X HIGH_Y)))', and may have '(:yaw_rotation ((LEAST GREATEST)))'."
        ) from None
    check_names("attribute of a region", given, f"{group.where}: {name}", _ATTRIBUTES)
    return Region(str(target), name, tuple(boxes), (low, high), group.where)


def _rows(value: list, size: int) -> list[tuple[float, ...]]:
    """Convert the rows of a list to numbers. Raise ValueError unless each row has `size` finite numbers."""
    found = [tuple(float(word) for word in row) for row in (value[0] if value else [])]
    if not all(len(row) == size and all(map(math.isfinite, row)) for row in found):
        raise ValueError
    return found


def _typed(group: Group) -> Iterator[tuple[Word, str]]:
    """Yield each name with its class. In the file, names are followed by their class: `a b - class_1 c - class_2`."""
    names: list[Word] = []
    words = iter(_words(group))
    for word in words:
        if word != "-":
            names.append(word)
            continue
        kind = next(words, None)
        if kind is None or not names:
            raise SceneKeyError(f"{word.where}: '-' should stand between names and their class.")
        yield from ((name, str(kind)) for name in names)
        names = []
    for name in names:
        raise SceneKeyError(f"{name.where}: '{name}' should be followed by '- CLASS'.")


def _words(group: Group) -> list[Word]:
    for part in group:
        if not isinstance(part, Word):
            raise SceneKeyError(f"{part.where}: {short(part)} should be a word without parentheses.")
    return group


def _goal(groups: Group) -> Iterator[Predicate]:
    """Yield the predicates of a goal, including the predicates inside `And`."""
    for group in groups:
        if isinstance(group, Group) and group and str(group[0]).lower() == "and":
            yield from _goal(Group(group[1:]))
        else:
            yield _predicate(group)


def _predicate(group: Group | Word) -> Predicate:
    head, *names = map(str, group if isinstance(group, Group) and group else [group])
    word = {name.lower(): name for name in PREDICATES}.get(head.lower())
    if word is None:
        raise UnknownNameError("predicate", head, group.where, [*PREDICATES, "And"])
    if len(names) != PREDICATES[word] or not isinstance(group, Group):
        count = "one object or region" if PREDICATES[word] == 1 else "an object, and an object or region"
        raise SceneKeyError(f"{group.where}: {short(group)} should be ({word} ...) with {count}.")
    return Predicate(word, tuple(names), f"{group.where}: ({word} {' '.join(names)})")
