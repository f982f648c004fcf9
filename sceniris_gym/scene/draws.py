"""Draws of a scene's physics and looks, resolved to single numbers of the model's fields: `FieldDraw`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sceniris_gym.config.randomize import (
    CAMERA_WORDS,
    LIGHT_WORDS,
    MATERIAL_WORDS,
    OBJECT_WORDS,
    SCENE_WORDS,
    DrawConfig,
    Word,
)
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.scene.field_table import OPTIONS, check_field, rows_inside, rows_named
from sceniris_gym.scene.support import subtree


@dataclass(frozen=True)
class FieldDraw:
    """A word of `randomize` in the model.

    Attributes:
        name: Its name, such as 'can.mass', which its numbers are drawn by.
        word: The field that is drawn, and those that follow.
        config: The distribution.
        rows: Elements of the field.
        components: Components of each element, shape (ncomponent,).
        numbers: The drawn number of each component, by element, shape (nrow, ncomponent).
        choice: Values to choose from, shape (nchoice, ncomponent or 1).
    """

    name: str
    word: Word
    config: DrawConfig
    rows: np.ndarray
    components: np.ndarray
    numbers: np.ndarray
    choice: np.ndarray

    @property
    def width(self) -> int:
        """The number of numbers that are drawn; a choice is one."""
        return int(self.numbers.max()) + 1

    @property
    def is_turn(self) -> bool:
        """True for a turn of a camera, whose three numbers change all of its quaternion."""
        return self.word.field == "cam_quat"


def drawn_fields(draws: tuple[FieldDraw, ...]) -> list[str]:
    """Return the fields that draws write, each once."""
    return list(dict.fromkeys(name for d in draws for name in (d.word.field, *(f for f, _, _ in d.word.follow))))


def simple_bodies(config: SceneConfig, mjm: mujoco.MjModel) -> list[str]:
    """Return the simple bodies whose centre of mass is drawn, so that MuJoCo has to keep a full mass matrix."""
    bodies = [config.objects[name].body or name for name in config.objects if "ipos" in config.objects[name].randomize]
    bodies += [robot.name for robot in config.all_robots.values() if "ipos" in robot.randomize]
    inside = [b for name in bodies for b in subtree(mjm, mjm.body(name).id)]
    return [mjm.body(b).name for b in inside if mjm.body_simple[b]]


def nominal_values(mjm: mujoco.MjModel, field: str) -> np.ndarray:
    """Return a field of the model, shape (n, width); colours of geoms are those that are seen."""
    values = np.array(getattr(mjm.opt if field in OPTIONS else mjm, field), float)
    if field == "geom_rgba":  # grey stands for the colour of the material
        of_material = (values == (0.5, 0.5, 0.5, 1.0)).all(axis=1) & (mjm.geom_matid >= 0)
        values[of_material] = mjm.mat_rgba[mjm.geom_matid[of_material]]
    return values.reshape(1 if field in OPTIONS else len(values), -1)


def field_draws(config: SceneConfig, mjm: mujoco.MjModel, bodies: Mapping[str, int]) -> tuple[FieldDraw, ...]:
    """Return the draws of a scene, in the order of its file.

    Raises:
        UnknownNameError: A light, camera, material or texture that the model does not have.
        SceneKeyError: Nothing to draw, values out of range, or as many numbers as no value has.
        NotSupportedError: A field that steps leave out, or that the installed MuJoCo does not have.
    """
    return tuple(_resolved(mjm, *each) for each in _written(config, mjm, bodies))


def _written(
    config: SceneConfig, mjm: mujoco.MjModel, bodies: Mapping[str, int]
) -> Iterator[tuple[str, str, Word, DrawConfig, list[int]]]:
    """Yield the draws as written: name, place for messages, word, distribution, and rows of the field."""
    for name, part in {**config.objects, **config.all_robots}.items():
        for key, draw in part.randomize.items():
            word, where = OBJECT_WORDS[key], f"{config.where}: {config.key(name)}.randomize.{key}"
            yield f"{name}.{key}", where, word, draw, rows_inside(mjm, word.field, bodies[name])
    if config.randomize is None:
        return
    where = f"{config.where}: randomize"
    for key, word in SCENE_WORDS.items():
        if (draw := getattr(config.randomize, key)) is not None:
            yield key, f"{where}.{key}", word, draw, [0]
    for kind, words in (("light", LIGHT_WORDS), ("camera", CAMERA_WORDS), ("material", MATERIAL_WORDS)):
        for pattern, draws in getattr(config.randomize, f"{kind}s").items():
            rows = rows_named(mjm, kind, pattern)
            if not rows:
                count = {"light": mjm.nlight, "camera": mjm.ncam, "material": mjm.nmat}[kind]
                names = [getattr(mjm, kind)(i).name for i in range(count)]
                raise UnknownNameError(kind, pattern, f"{where}.{kind}s", filter(None, names))
            for key, draw in draws.items():
                yield f"{kind}s.{pattern}.{key}", f"{where}.{kind}s.{pattern}.{key}", words[key], draw, rows


def _resolved(mjm: mujoco.MjModel, name: str, where: str, word: Word, config: DrawConfig, rows: list[int]) -> FieldDraw:
    """Return a draw of these rows, without those that it does not change."""
    check_field(word.field, mjm, where)
    values = nominal_values(mjm, word.field)
    if word.field == "actuator_delay":  # MuJoCo keeps so many samples of the past
        rows = [row for row in rows if mjm.actuator_history[row, 0] > 0]
        longest = min((mjm.actuator_history[row, 0] for row in rows), default=0) * mjm.opt.timestep
        word = replace(word, most=float(longest))
    choice = _choice(mjm, word, config, where)
    given = choice.shape[1] if config.choice is not None else len(config.ends[0])
    if given not in (1, word.width) and not (word.shared == 3 and given == 3):
        raise SceneKeyError(f"{where}.{config.form}: should have 1 or {word.width} numbers, got {given}.")
    count = given if given > 1 else (word.shared or word.width)
    components = word.first + np.arange(3 if word.field == "cam_quat" else count)
    found = np.array([row for row in rows if _is_changed(word, config, values[row])], int)
    if not len(found):
        advice = (
            "has no geom, joint or actuator that it could be drawn for" if not rows else "is 0 and cannot be scaled"
        )
        raise SceneKeyError(f"{where}: {advice}. Leave it out" + (", or give 'abs'." if rows else "."))
    alone = config.choice is not None or given == 1
    one = np.zeros(len(components), int) if alone and word.field != "cam_quat" else np.arange(len(components))
    step = (one.max() + 1) if config.each else 0
    numbers = one + step * np.arange(len(found))[:, None]
    draw = FieldDraw(name, word, config, found, components, numbers, choice)
    _check_range(draw, values, where)
    if word.field == "body_ipos" and np.any(mjm.body_simple[found]):
        simple = mjm.body(int(found[np.flatnonzero(mjm.body_simple[found])[0]])).name
        raise SceneKeyError(
            f"{where}: '{simple}' should have simple=\"false\" in its model, so that M has room for it."
        )
    return draw


def _is_changed(word: Word, config: DrawConfig, values: np.ndarray) -> bool:
    if word.field == "body_mass":
        return bool(values[0] > 0.0)
    relative = config.scale is not None or word.field == "dof_frictionloss"
    return not relative or bool(np.any(values[word.first : word.first + word.width]))


def _choice(mjm: mujoco.MjModel, word: Word, config: DrawConfig, where: str) -> np.ndarray:
    """Return the values of a choice, textures by their numbers."""
    rows: list[tuple[float, ...]] = []
    for value in config.choice or ():
        if isinstance(value, str):
            if word.field != "mat_texid":
                raise SceneKeyError(f"{where}.choice: '{value}' should be a number, or a list of numbers.")
            texture = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_TEXTURE, value)
            if texture < 0:
                names = [mjm.texture(i).name for i in range(mjm.ntex)]
                raise UnknownNameError("texture", value, f"{where}.choice", filter(None, names))
            rows.append((texture,))
        else:
            rows.append((float(value),) if isinstance(value, bool) else value)
    if len({len(row) for row in rows}) > 1:
        raise SceneKeyError(f"{where}.choice: all values should have as many numbers.")
    return np.array(rows, float).reshape(len(rows), len(rows[0]) if rows else 0)


def _check_range(draw: FieldDraw, values: np.ndarray, where: str) -> None:
    """Refuse values beyond the bounds of the word; a single number is for all components."""
    word, config = draw.word, draw.config
    ends = np.array(list(draw.choice) if config.choice is not None else config.extremes)
    now = values[draw.rows][:, draw.components % values.shape[1]]
    if config.scale is not None:
        now = np.stack([now * end for end in ends])
    elif config.add is not None and not draw.is_turn:
        now = np.stack([now + end for end in ends])
    else:
        now = ends
    if now.min() < word.least or now.max() > word.most:
        raise SceneKeyError(
            f"{where}.{config.form}: values from {now.min():g} to {now.max():g} should be "
            f"from {word.least:g} to {word.most:g}."
        )
