"""Axes of a suite: which part of a scene each axis widens, and the params of a case at each grade.

A scene is widened until its params include the last grade of every axis. Nominal cases narrow the params to the values
of the task's own scene, so they have the same layouts as this scene, bit for bit.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.scene_params import Param, scene_params
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.settings import ImageConfig

FACTOR = 0.15
"""Change of a factor per grade."""
START = 0.1
"""Norm of the change of the arm's joints per grade [rad]."""
OPENING = 0.05
"""Change of a joint's position per grade, as a fraction of its limits."""
CONFOUNDERS = ("lemon", "block", "orange", "tin", "can")
"""Assets that `clutter` adds to a scene without groups, one more per grade."""
CAMERA = {"pos": 0.02, "quat": 2.0}
"""Shift [m] and rotation [degrees] of cameras per grade."""

Values = dict[str, Any]
"""Values of params by name."""
Draw = Callable[[int, np.random.Generator], Values]


class Axis(NamedTuple):
    """An axis of a suite.

    Attributes:
        widened: Overrides of the scene, by dotted keys, that widen the params up to the last grade.
        nominal: Values of these params. They give the same layouts as the task's own scene.
        draw: Returns the params of a case from its grade and a random generator.
        grades: Grades, empty for the grades of the suite.
        split: Split of the layouts, "" for the split of the suite.
    """

    widened: Values
    nominal: Values
    draw: Draw
    grades: tuple[int, ...] = ()
    split: str = ""


class Base(NamedTuple):
    """The scene of a task, before it is widened, its params by name, and the pictures that the policy sees."""

    compiled: CompiledScene
    images: ImageConfig | None
    params: Mapping[str, Param]
    grades: int

    @classmethod
    def of(cls, compiled: CompiledScene, images: ImageConfig | None, grades: int) -> Self:
        """Return the base of a suite with this number of grades."""
        found = scene_params(compiled)
        return cls(compiled, images, {name: one for name, one in found.items() if isinstance(one, Param)}, grades)

    def joints(self, section: str) -> dict[str, tuple[float, float, float, float]]:
        """Return low and high of the drawn joints in a section of the scene file, and the joints' limits, by param."""
        config, scene, found = self.compiled.config, self.compiled.scene, {}
        owners = {config.key(owner): owner for owner in self.compiled.placed}
        for name, one in self.params.items():
            key, _, joint = name.partition(".joints.")
            if joint and name.startswith(section):
                j = scene.joints(owners[key])[joint]
                limits = scene.mjm.jnt_range[j] if scene.mjm.jnt_limited[j] else (-np.inf, np.inf)
                found[name] = (*one.default.tolist(), *map(float, limits))
        return found


def axes_of(base: Base, names: Sequence[str] = ()) -> dict[str, Axis]:
    """Return the axes of a suite by name, as in `names`, or all axes of the task.

    Raises:
        ArgumentError: The task lacks an axis in `names`, or all axes. The message has the reason.
    """
    found = {name: AXES[name](base) for name in names or AXES}
    axes = {name: axis for name, axis in found.items() if isinstance(axis, Axis)}
    if len(axes) < len(found) and (names or not axes):
        raise ArgumentError(next(f"--axes {name}: {why}" for name, why in found.items() if isinstance(why, str)))
    return axes


def _direction(size: int, random: np.random.Generator) -> np.ndarray:
    vector = random.normal(size=size)
    return vector / np.linalg.norm(vector)


def _factor(draws: Mapping[str, Any], base: Base) -> Axis | str:
    """Return the axis of a drawn factor. `draws` has the draw that the scene file already has, or None, by its key."""
    nominal = {}
    for key, one in draws.items():
        if one is None:
            nominal[key] = [1.0, 1.0]
        elif one.scale is not None and one.distribution == "uniform" and len(one.scale[0]) == 1 and not one.each:
            nominal[key] = [one.scale[0][0], one.scale[1][0]]
    if not nominal:
        return "the scene has nothing that this axis can scale. Give another axis."
    most = FACTOR * base.grades
    widened = {key: {"scale": [min(1.0 - most, low), max(1.0 + most, high)]} for key, (low, high) in nominal.items()}
    return Axis(widened, nominal, lambda grade, r: dict.fromkeys(nominal, [1 + FACTOR * grade * r.choice((-1, 1))] * 2))


def _things(base: Base) -> dict[str, Any]:
    """Return the `reachable` objects by name, or all free objects if no object is `reachable`."""
    free = {name: part for name, part in base.compiled.config.objects.items() if part.kind == "free"}
    return {name: part for name, part in free.items() if part.reachable} or free


def _draws(word: str, base: Base) -> dict[str, Any]:
    """Return draws of these objects by key."""
    owners = base.compiled.config.owners
    return {f"objects.{owners.get(n, n)}.randomize.{word}": one.randomize.get(word) for n, one in _things(base).items()}


def _friction(base: Base) -> Axis | str:
    # in a grasp, the friction of the fingers applies
    robots = [robot for robot in base.compiled.config.all_robots.values() if robot.in_scene]
    fingers = {f"{one.section}.randomize.friction": one.randomize.get("friction") for one in robots}
    return _factor(_draws("friction", base) | fingers, base)


def _robot(base: Base) -> Axis | str:
    """Return the axis of starts: the arm's joints differ from their centres by a vector of a given norm."""
    if not (found := base.joints("robot")):
        return "the scene draws no joint of its robot. Give the robot 'joints' in the scene file."
    low, high, least, most = np.array([*found.values()]).T
    away = START * base.grades
    ends = np.minimum(low, np.maximum(low - away, least)), np.maximum(high, np.minimum(high + away, most))

    def draw(grade: int, random: np.random.Generator) -> Values:
        at = (low + high) / 2.0 + START * grade * _direction(len(found), random)
        return {name: [q, q] for name, q in zip(found, at.clip(*ends).tolist(), strict=True)}

    widened = {name: {"range": pair} for name, pair in zip(found, np.transpose(ends).tolist(), strict=True)}
    return Axis(widened, {name: list(pair[:2]) for name, pair in found.items()}, draw)


def _joint(base: Base) -> Axis | str:
    """Return the axis of openings: each drawn joint leaves its interval, to the side with more room."""
    widened, nominal, steps = {}, {}, {}
    for name, (low, high, least, most) in base.joints("objects").items():
        end, room = (low, least - low) if low - least >= most - high else (high, most - high)
        step = np.sign(room) * min(abs(room) / base.grades, OPENING * (most - least))
        if low < high and np.isfinite(step) and step:
            steps[name], last = (end, step), float(end + step * base.grades)
            nominal[name], widened[name] = [low, high], {"range": [min(low, last), max(high, last)]}
    if not steps:
        return "the scene draws no joint of an object that has room beyond its interval. Give another axis."
    return Axis(widened, nominal, lambda grade, _: {n: [float(end + grade * by)] * 2 for n, (end, by) in steps.items()})


def _clutter(base: Base) -> Axis | str:
    """Return the axis of the number of group members, from the least to the greatest.

    Without a group, each grade adds an object to the support of an object that the task is about.
    """
    ends, widened = {name: one.default.tolist() for name, one in base.params.items() if one.form == "count"}, {}
    ends = {name: (low, high - low) for name, (low, high) in ends.items() if low < high}
    if not ends:
        support = next((one.support for one in _things(base).values() if one.support is not None), None)
        if support is None:
            return "the scene has no group with a count from low to high, and no object on a support."
        added = {f"confounder_{asset}": {"asset": asset, support.word: support.parent} for asset in CONFOUNDERS}
        widened = {f"objects.{name}": words for name, words in added.items()}
        widened |= {"groups.confounders": {"of": [*added], "count": [0, base.grades]}}
        ends = {"groups.confounders.count": (0, base.grades)}

    def draw(grade: int, _: np.random.Generator) -> Values:
        return {name: [low + round(grade / base.grades * more)] * 2 for name, (low, more) in ends.items()}

    return Axis(widened, {name: [low, low + (0 if widened else more)] for name, (low, more) in ends.items()}, draw)


def _variant(base: Base) -> Axis | str:
    """Return the axis of variants: the held-out ones if the scene has a holdout, otherwise one at a time."""
    config = base.compiled.config
    if any(config.groups[name].splits for name in config.variants):
        return Axis({}, {}, lambda *_: {}, (1,), "eval")
    nominal = {
        key: base.params[key].default.tolist()
        for n in config.variants
        if (key := f"objects.{n}.weights") in base.params
    }
    if not nominal:
        return "the scene has no object with variants. Give another axis."

    def draw(_: int, random: np.random.Generator) -> Values:
        return {key: np.eye(len(all_))[random.integers(len(all_))].tolist() for key, all_ in nominal.items()}

    return Axis({}, nominal, draw, (1,))


def _light(base: Base) -> Axis | str:
    if base.images is None or not base.compiled.mjm.nlight:
        return "the policy of this task sees no pictures with lights. Give another axis."
    scene = base.compiled.config.randomize
    drawn = {} if scene is None else scene.lights
    if drawn.keys() - {"*"}:
        return "the scene draws single lights. Draw all lights with the pattern '*' instead."
    return _factor({"randomize.lights.*.diffuse": drawn.get("*", {}).get("diffuse")}, base)


def _camera(base: Base) -> Axis | str:
    """Return the axis of cameras, which shifts and rotates the cameras of the policy's pictures."""
    seen, scene = base.images, base.compiled.config.randomize
    names = [] if seen is None else [n for n in seen.cameras if scene is None or n not in scene.cameras]
    if not names:
        return "the policy of this task sees no pictures of a camera that the scene keeps still. Give another axis."
    steps = {f"randomize.cameras.{n}.{word}": step for n in names for word, step in CAMERA.items()}

    def draw(grade: int, random: np.random.Generator) -> Values:
        return {name: [(step * grade * _direction(3, random)).tolist()] * 2 for name, step in steps.items()}

    widened = {name: {"add": [[-step * base.grades] * 3, [step * base.grades] * 3]} for name, step in steps.items()}
    return Axis(widened, {name: [[0.0] * 3] * 2 for name in steps}, draw)


AXES: dict[str, Callable[[Base], Axis | str]] = {
    "robot": _robot,
    "clutter": _clutter,
    "joint": _joint,
    "variant": _variant,
    "mass": lambda base: _factor(_draws("mass", base), base),
    "friction": _friction,
    "light": _light,
    "camera": _camera,
}
"""Axes of params by name. Each returns a text with the reason if a task lacks the axis."""
