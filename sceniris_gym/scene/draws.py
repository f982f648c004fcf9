"""`FieldDraw`: a draw of physics or appearance, with the rows and components of the model field that it changes."""

import copy
import fnmatch
from collections.abc import Iterator, Mapping
from itertools import product
from typing import NamedTuple, NoReturn

import mujoco
import numpy as np

from sceniris_gym.config.randomize import DEVIATIONS, WORDS, DrawConfig, End, Ends, Word
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.scene.field_table import OPTIONS, check_field, elements, rows_inside
from sceniris_gym.scene.support import subtree

COLOUR_ROLES = [int(mujoco.mjtTextureRole.mjTEXROLE_RGB), int(mujoco.mjtTextureRole.mjTEXROLE_RGBA)]
"""Roles of the textures that colour a geom."""
CONSTRAINING = ("body_mass", "dof_frictionloss")
"""Fields of which MuJoCo's compiler leaves out zeros, so draws do not change a zero."""
_PHYSICS = [word for kind in ("object", "scene") for word in WORDS[kind].values() if word.field != "geom_rgba"]
LEAST: dict[str, Ends] = {word.field: "least" for word in _PHYSICS}
MOST: dict[str, Ends] = {word.field: "most" for word in _PHYSICS}
"""The low and the high end of each physics field that can be drawn."""
WEAK: dict[str, Ends] = {word.field: word.weak for word in _PHYSICS if word.weak}
LOOSE: dict[str, Ends] = {word.field: word.loose for word in _PHYSICS if word.loose}
"""The ends that `Word.weak` and `Word.loose` name, for each field."""


class FieldDraw(NamedTuple):
    """An entry of `randomize` in a scene, with the values of the model that it changes.

    Attributes:
        name: The name that selects the random numbers, such as 'can.mass'. All variants of an object share this name.
        key: The key in the scene file, such as 'objects.can.randomize.mass'.
        word: The drawn field, and the fields that keep their ratio to this field.
        config: The distribution.
        rows: Drawn rows of the field, shape (nrow,).
        components: Drawn components of each row, shape (ncomponent,).
        numbers: Index of the random number for each component of each row, shape (nrow, ncomponent).
        choice: Values to choose from, shape (nchoice, ncomponent or 1).
    """

    name: str
    key: str
    word: Word
    config: DrawConfig
    rows: np.ndarray
    components: np.ndarray
    numbers: np.ndarray
    choice: np.ndarray

    @property
    def width(self) -> int:
        """The number of random numbers that each reset of a world draws."""
        return int(self.numbers.max()) + 1

    @property
    def is_rotation(self) -> bool:
        """True for the rotation of a camera: three random numbers that change the whole quaternion."""
        return self.word.field == "cam_quat"


def drawn_fields(draws: tuple[FieldDraw, ...]) -> list[str]:
    """Return the fields that draws write, without duplicates."""
    return list(dict.fromkeys(name for d in draws for name in (d.word.field, *(f for f, _, _ in d.word.follow))))


def simple_bodies(config: SceneConfig, mjm: mujoco.MjModel) -> list[str]:
    """Return the bodies with a drawn centre of mass that MuJoCo marks as simple. They need a full mass matrix."""
    parts = {part.body or name: part for name, part in config.objects.items()}
    parts |= {robot.name: robot for robot in config.all_robots.values()}
    drawn = [mjm.body(name).id for name, part in parts.items() if "ipos" in part.randomize]
    return [mjm.body(b).name for body in drawn for b in subtree(mjm, body) if mjm.body_simple[b]]


def nominal_values(mjm: mujoco.MjModel, field: str) -> np.ndarray:
    """Return the values of a model field, shape (n, width). A geom without a colour has the colour of its material."""
    values = np.array(getattr(mjm.opt if field in OPTIONS else mjm, field), float)
    if field == "geom_rgba":  # MuJoCo's default grey gives way to the colour of the material
        of_material = (values == (0.5, 0.5, 0.5, 1.0)).all(axis=1) & (mjm.geom_matid >= 0)
        values[of_material] = mjm.mat_rgba[mjm.geom_matid[of_material]]
    return values.reshape(1 if field in OPTIONS else len(values), -1)


def mean_colours(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the mean colour of each geom, with the mean colour of its texture, shape (ngeom, 4)."""
    found = nominal_values(mjm, "geom_rgba")
    for geom in np.flatnonzero(mjm.geom_matid >= 0):
        texture = int(mjm.mat_texid[mjm.geom_matid[geom], COLOUR_ROLES].max())
        if texture >= 0:
            texels, channels = int(mjm.tex_height[texture] * mjm.tex_width[texture]), int(mjm.tex_nchannel[texture])
            data = mjm.tex_data[mjm.tex_adr[texture] :][: texels * channels].reshape(texels, channels)
            found[geom, :3] *= data[:, :3].mean(axis=0) / 255.0
    return found


def field_draws(config: SceneConfig, mjm: mujoco.MjModel, bodies: Mapping[str, int]) -> tuple[FieldDraw, ...]:
    """Return the draws of a scene, in the order of its file.

    Raises:
        UnknownNameError: A light, camera, material, texture or model field does not exist.
        SceneKeyError: A draw has no effect, its values are out of range, or their number is wrong.
        ArgumentError: A field is 0 in the whole model. Steps skip such a field, so a draw would have no effect.
    """
    draws = [_resolved(mjm, config.where, *written) for written in _written(config, mjm, bodies)]
    drawn: dict[object, str] = {}
    for draw in draws:
        where = f"{config.where}: {draw.key}"
        for at in product([draw.word.field], draw.rows.tolist(), draw.components.tolist()):
            if drawn.setdefault(at, draw.name) != draw.name:
                _refuse(where, f"'{drawn[at]}' draws some of the same values. Draw them in one place only.")
    return tuple(draws)


def _written(
    config: SceneConfig, mjm: mujoco.MjModel, bodies: Mapping[str, int]
) -> Iterator[tuple[str, str, Word, DrawConfig, list[int]]]:
    """Yield each draw of the scene: its name, its key in the scene file, its field, its distribution and its rows."""
    for name, part in {**config.objects, **config.all_robots}.items():
        for key, draw in part.randomize.items():
            word, path = WORDS["object"][key], f"{config.key(name)}.randomize.{key}"
            rows = rows_inside(mjm, word.field, bodies[name])
            if rows or name not in config.owners:  # a variant may lack joints that others have
                yield f"{config.owners.get(name, name)}.{key}", path, word, draw, rows
    if config.randomize is None:
        return
    for key, word in WORDS["scene"].items():
        if (draw := getattr(config.randomize, key)) is not None:
            yield key, f"randomize.{key}", word, draw, [0]
    for kind in ("light", "camera", "material"):
        for pattern, draws in getattr(config.randomize, f"{kind}s").items():
            rows = [i for name, i in elements(mjm, kind) if fnmatch.fnmatchcase(name, pattern)]
            if not rows:
                names = (name for name, _ in elements(mjm, kind))
                raise UnknownNameError(kind, pattern, f"{config.where}: randomize.{kind}s", names)
            for key, draw in draws.items():
                name = f"{kind}s.{pattern}.{key}"
                yield name, f"randomize.{name}", WORDS[kind][key], draw, rows


def _resolved(
    mjm: mujoco.MjModel, where: str, name: str, key: str, word: Word, config: DrawConfig, rows: list[int]
) -> FieldDraw:
    """Return the draw of `rows`, without the rows that the draw cannot change. Errors begin with `where`."""
    where = f"{where}: {key}"
    check_field(word.field, mjm, where)
    values = nominal_values(mjm, word.field)
    if word.form not in {None, config.form}:
        _refuse(f"{where}.{config.form}", f"it should be given by '{word.form}'.")
    rows = [row for row in rows if _has_effect(mjm, word.field, row)]
    if word.field in {"body_mass", "body_ipos"} and not mjm.body_weldid[rows].any():
        rows = []  # the bodies never move
    if word.field == "actuator_delay":  # limited by the number of samples in MuJoCo's history
        longest = min((mjm.actuator_history[row, 0] for row in rows), default=0) * mjm.opt.timestep
        word = word._replace(most=float(longest))
    choice = _choice(mjm, word, config, where)
    given = choice.shape[1] if config.choice is not None else len(config.ends[0])
    counts = sorted({1, word.width, word.shared or 1})
    if given not in counts:
        _refuse(f"{where}.{config.form}", f"it should have {' or '.join(map(str, counts))} numbers, got {given}.")
    count = given if given > 1 else (word.shared or word.width)
    constrains = word.field in CONSTRAINING
    needed = config.scale is not None or constrains
    part = slice(word.first, word.first + word.width)
    kept = np.array([row for row in rows if not needed or np.any(values[row, part])], int)
    if not len(kept):
        zero = "its value is 0 in the model. Change it there" + ("." if constrains else ", or give it by 'abs'.")
        _refuse(where, zero if rows else "no selected element has or uses this value. Leave out this key.")
    one = np.arange(count if word.field == "cam_quat" or (config.choice is None and given > 1) else 1)
    numbers = np.broadcast_to(one, (len(kept), count))
    if config.each:
        numbers = numbers + len(one) * np.arange(len(kept))[:, None]
    draw = FieldDraw(name, key, word, config, kept, word.first + np.arange(count), numbers, choice)
    ends = _ends(draw, values)
    every, least, most = np.broadcast_arrays(ends, word.least, word.most)
    outside = np.argwhere((every < least) | (every > most))
    if len(outside):
        k = outside[0, -1]
        found, bounds = f"{every[..., k].min():g} to {every[..., k].max():g}", f"{least.flat[k]:g} to {most.flat[k]:g}"
        part = f" of component {k + 1}" if isinstance(word.least, tuple) else ""
        _refuse(f"{where}.{config.form}", f"its values{part} would be from {found}, but should be from {bounds}.")
    above, axes = ends > 0.0, 2 if config.choice is not None else (0, 2)
    if word.field.endswith("solref") and (above.any(axis=axes) != above.all(axis=axes)).any():  # MuJoCo has two formats
        _refuse(f"{where}.{config.form}", "its values should be all above 0, or all at most 0.")
    if word.field == "actuator_forcerange" and (ends[..., 0].max(axis=0) >= ends[..., -1].min(axis=0)).any():
        _refuse(f"{where}.{config.form}", "lower limits should be below upper limits. Give values as [lower, upper].")
    simple = [mjm.body(int(row)).name for row in kept if word.field == "body_ipos" and mjm.body_simple[row]]
    if simple:
        _refuse(where, f"body '{simple[0]}' needs simple=\"false\" in its model, for a full mass matrix.")
    return draw


def _refuse(where: str, advice: str) -> NoReturn:
    raise SceneKeyError(f"{where}: cannot be drawn like this: {advice}")


def _has_effect(mjm: mujoco.MjModel, field: str, row: int) -> bool:
    """Return whether physics or rendering uses the value of element `row` in a model field."""
    if field == "actuator_delay":
        return mjm.actuator_history[row, 0] > 0
    if field == "actuator_forcerange":
        return bool(mjm.actuator_forcelimited[row])
    if field.startswith("jnt_"):  # the stiffness of a freejoint would pull its body to the model's pose
        return mjm.jnt_type[row] != mujoco.mjtJoint.mjJNT_FREE
    return field != "cam_fovy" or not mjm.cam_sensorsize[row].any()


def _choice(mjm: mujoco.MjModel, word: Word, config: DrawConfig, where: str) -> np.ndarray:
    """Return the values to choose from, shape (nchoice, ncomponent). Names of textures are replaced by their ids."""
    textures = {mjm.texture(i).name: i for i in range(mjm.ntex)} if word.field == "mat_texid" else {}
    rows: list[tuple[float, ...]] = []
    for value in config.choice or ():
        if word.field == "mat_texid" and value not in textures:
            raise UnknownNameError("texture", str(value), f"{where}.choice", filter(None, textures))
        if word.field != "mat_texid" and isinstance(value, str):
            _refuse(f"{where}.choice", f"its values should be numbers, got '{value}'.")
        single = textures[value] if isinstance(value, str) else value
        rows.append(single if isinstance(single, tuple) else (float(single),))
    if len({len(row) for row in rows}) > 1:
        _refuse(f"{where}.choice", "all values should have the same number of components.")
    return np.array(rows, float).reshape(len(rows), len(rows[0]) if rows else 0)


def _ends(draw: FieldDraw, values: np.ndarray) -> np.ndarray:
    """Return the extreme values of a draw, or all values of a choice, shape (nend, nrow or 1, ncomponent or 1).

    For a rotation, the values are angles.
    """
    config = draw.config
    ends = draw.choice if config.choice is not None else np.array(config.ends)
    if config.distribution == "normal":
        ends = ends[0] + DEVIATIONS * np.array([-ends[1], ends[1]])
    now = values[draw.rows][:, draw.components % values.shape[1]]
    if config.scale is not None:
        return now * ends[:, None]
    return now + ends[:, None] if config.add is not None and not draw.is_rotation else ends[:, None]


def at_ends(mjm: mujoco.MjModel, draws: tuple[FieldDraw, ...], **ends: Ends) -> mujoco.MjModel:
    """Return a model with fields at the ends of their drawn ranges, and with derived fields updated.

    Args:
        mjm: The model. It is returned unchanged, and not copied, if no draw has a field in `ends`.
        draws: The draws of the scene.
        ends: Field -> the end to use, 'least' or 'most'. A tuple has an end for each component of the field.
    """
    own = [draw for draw in draws if draw.word.field in ends]
    if not own:
        return mjm
    found = copy.copy(mjm)
    for draw in own:
        values = nominal_values(mjm, name := draw.word.field)
        every, at, before = _ends(draw, values), np.ix_(draw.rows, draw.components), values[draw.rows, :1]
        is_least = np.broadcast_to(np.array(ends[name]) == "least", values.shape[1:])[draw.components]
        values[at] = np.where(is_least, every.min(axis=0), every.max(axis=0))
        getattr(found.opt if name in OPTIONS else found, name).reshape(values.shape)[at] = values[at]
        for follower, first, width in draw.word.follow:
            getattr(found, follower)[draw.rows, first : first + width] *= values[draw.rows, :1] / before
    mujoco.mj_setConst(found, mujoco.MjData(found))
    return found


def corners(draws: tuple[FieldDraw, ...], field: str) -> list[tuple[End, ...]]:
    """Return all combinations of 'least' and 'most' for the components of a field, to find the worst combination."""
    ends: tuple[End, End] = ("least", "most")
    count = max((1 + int(draw.components.max()) for draw in draws if draw.word.field == field), default=0)
    return list(product(ends, repeat=count))
