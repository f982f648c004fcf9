"""`LayoutId`: a text that identifies a layout and suffices to reproduce it. Also layouts that a user chose.

Chosen layouts and seeds are checked once on the host, and expanded to one row per world.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self
from urllib.parse import unquote

import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError
from sceniris_gym.layout.layouts import LayoutKeys, Layouts
from sceniris_gym.layout.masks import as_numbers, as_world_ids, is_mask
from sceniris_gym.layout.params import params_in
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.program.compiled import MOST_EPISODES, PARTS, USER_SPLITS
from sceniris_gym.scene.model import SceneModel

_FORM = re.compile(rf"([^:]*):({'|'.join(USER_SPLITS)}):([0-9]{{1,20}}):([0-9]{{1,20}})(?::({PARTS}))?")


@dataclass(frozen=True)
class LayoutId:
    """The parts of a layout id, which `CompiledScene.layout_id` writes as a text. They determine the layout."""

    scene: str
    split: str
    seed: int
    episode: int
    params: str = ""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `scenehash:split:seed:episode`, followed by `:params` if some params differ from the scene file.

        Raises:
            ArgumentError: The text does not have this form, or repeats a param.
        """
        found = _FORM.fullmatch(text)
        if found is None or int(found[3]) >= 2**64 or int(found[4]) >= MOST_EPISODES:
            raise ArgumentError(
                f"layout id {short(text)} should be scenehash:split:seed:episode, as in '0123456789abcdef:train:42:0'. "
                f"The split is {' or '.join(USER_SPLITS)}, the seed below 2^64, and the episode below 2^31 - 1. Params "
                "may follow as ':name=hex', with 8 hexadecimal digits per number."
            )
        names = [unquote(part.partition("=")[0]) for part in (found[5] or "").split(",")]
        if len({*names}) < len(names):
            raise ArgumentError(f"layout id '{text}' should have each param once, got: {', '.join(names)}.")
        return cls(found[1], found[2], int(found[3]), int(found[4]), found[5] or "")

    @classmethod
    def of_scene(cls, text: Any, scene: SceneModel, cure: str, split: str | None = None) -> Self:
        """Read an id, and check its scene and optionally its split. A LayoutId is not parsed again.

        Raises:
            ArgumentError: The text does not have the form of an id.
            SceneMismatchError: The id belongs to another scene or split. The message ends with `cure`.
        """
        found = text if isinstance(text, cls) else cls.parse(str(text))
        scene.check_hash(found.scene, f"layout '{text}':", cure)
        if split not in (None, found.split):
            raise SceneMismatchError(f"layout '{text}' has the split '{found.split}', not '{split}'. {cure}")
        return found


Served = Callable[[str, LayoutKeys], tuple[str, LayoutKeys]]
"""Maps split and keys of worlds to split and keys of the layouts that the worlds get. See `LayoutSource.served`."""


class ChosenLayouts(NamedTuple):
    """The next layouts that a user chose, one row per world.

    Attributes:
        seed: Seeds, shape (nworld,), uint64.
        given: Worlds that have a chosen layout, shape (nworld,), bool. The rows of other worlds have no meaning.
        episode: Episodes, shape (nworld,), int32. None is episode 0.
        param: Param values, shape (nworld, nvalue), float32. If None, the params do not change.
    """

    seed: np.ndarray
    given: np.ndarray
    episode: np.ndarray | None = None
    param: np.ndarray | None = None

    def of_rows(self, rows: np.ndarray) -> ChosenLayouts:
        """Return the chosen layouts in these rows. `rows` are indices, shape (n,)."""
        episode, param = (part if part is None else part[rows] for part in (self.episode, self.param))
        return ChosenLayouts(self.seed[rows], self.given[rows], episode, param)


def as_layouts(
    value: Any, layouts: Layouts, split: str, served: Served, worlds: Any = None, name: str = "layouts"
) -> ChosenLayouts:
    """Return the layouts that a user chose for some worlds.

    Args:
        value: A layout id for all chosen worlds, a sequence of ids (None keeps a world's next layout), or a mapping
            with "seed", "episode" and optional "params". Other keys are ignored. A sequence has one entry per chosen
            world, in their order, or one entry per world. ChosenLayouts are not parsed again.
        layouts: The present layouts of all worlds.
        split: Split of the worlds.
        served: `LayoutSource.served` of the source of these layouts.
        worlds: The chosen worlds. See `as_worlds`.
        name: Name of the argument in messages.

    Raises:
        ArgumentError: Any other form, a wrong number of entries, or a malformed id, seed or episode.
        SceneMismatchError: An id of another scene or split.
        UnknownNameError: An id with a param that the worlds do not have.
    """
    nworld, single = layouts.nworld, isinstance(value, str | LayoutId)
    if isinstance(value, ChosenLayouts):
        found = value
    elif isinstance(value, Mapping):
        found, single = layouts_of_mapping(value, layouts, name)
    else:
        found = layouts_of_ids(value, layouts, split, name)
    seed, given, episode, param = found
    if episode is not None and param is not None:
        got_split, (got_seed, got_episode, got_param) = served(split, (seed, episode, param))
        wrong = given & ((got_seed != seed) | (got_episode != episode) | (got_split != split))
        if wrong.any() and not isinstance(value, ChosenLayouts | Mapping):
            one, cure = value if single else value[int(wrong.argmax())], "Choose a layout by 'seed' and 'episode'."
            raise SceneMismatchError(f"{name}: the layout_source gives another layout for the id '{one}'. {cure}")
        if layouts.params.are_kept:
            if (got_param != param)[given].any():
                raise ArgumentError(f"{name} should have no params, or the params with which the layouts were stored.")
            found = found._replace(param=None)
    rows = np.zeros(nworld, int) if single else entries_of_worlds(len(seed), worlds, nworld, name)
    if len(seed) == 0:  # for no worlds
        return ChosenLayouts(np.zeros(nworld, np.uint64), np.zeros(nworld, bool))
    return found.of_rows(rows)


def seeds_on_device(seed: Any, nworld: int, device: Any, worlds: Any = None) -> wp.array:
    """Return a seed for each world as an array on a device, shape (nworld,), uint64.

    Args:
        seed: One integer (world i gets seed + i), or an array with one seed per chosen world, in their order, or with
            one seed per world. A Warp array on the device is not copied.
        nworld: Number of worlds.
        device: The device.
        worlds: The chosen worlds. See `as_worlds`.

    Raises:
        ArgumentError: Invalid seeds (see `as_seeds`), a wrong number of seeds, or a Warp array of another type, shape
            or device.
    """
    if isinstance(seed, wp.array):
        if seed.dtype is not wp.uint64 or seed.shape != (nworld,) or seed.device != wp.get_device(device):
            raise ArgumentError(
                f"seed on the device should be a uint64 array of shape ({nworld},) on {device}, got "
                f"{seed.dtype.__name__} of shape {tuple(seed.shape)} on {seed.device}."
            )
        return seed
    if type(seed).__module__ == "torch":
        seed = as_numbers(seed)
        seed = seed.view(np.uint64) if seed.dtype == np.int64 else seed  # two's complement, as in `Layouts.seed`
    if isinstance(seed, Sequence | np.ndarray) and np.ndim(seed) == 1:
        entries = entries_of_worlds(len(seed), worlds, nworld, "seed")
        found = as_seeds(seed, len(seed))[entries] if len(seed) else np.zeros(nworld)  # for no worlds
    else:
        found = as_seeds(seed, nworld)
    return wp.array(found, dtype=wp.uint64, device=device)


def entries_of_worlds(number: int, worlds: Any, nworld: int, name: str) -> np.ndarray:
    """Return, for each world, the index of its entry in a list of `number` entries, shape (nworld,).

    The list has one entry per chosen world, in their order, or one entry per world. The index of a world that is not
    chosen has no meaning.
    """
    every = np.arange(nworld)
    if number == nworld and is_mask(worlds):  # avoids a copy of a mask on a device
        return every
    ids = as_world_ids(worlds, nworld)
    if number not in (len(ids), nworld):
        many = f"{len(ids)}, one for each chosen world" if len(ids) < nworld else f"{nworld}, one for each world"
        raise ArgumentError(f"{name} should be a single value, or a list of {many}, got a list of {number}.")
    if number == len(ids):
        if len(np.unique(ids)) < number:
            raise ArgumentError(f"worlds should be distinct, one for each entry of {name}, got {ids.tolist()}.")
        every[ids] = np.arange(number)
        every[every >= number] = 0
    return every


def layouts_of_mapping(value: Mapping[str, Any], layouts: Layouts, name: str) -> tuple[ChosenLayouts, bool]:
    """Return the layouts of a mapping with "seed", "episode" and optional "params", one row per layout.

    Seed and episode may each be one integer, or any number of integers. The second result is True if seed and
    episode are each one integer. All other arguments are as in `as_layouts`.

    Raises:
        ArgumentError: A missing or malformed entry.
        UnknownNameError: A param that the worlds do not have.
    """
    if not {"seed", "episode"} <= {*value}:
        raise ArgumentError(f"{name} should have the keys 'seed' and 'episode', got {short(list(value))}.")
    given = {key: as_numbers(value[key]) for key in ("seed", "episode")}
    number = max((len(found) for found in given.values() if found.ndim == 1), default=1)
    for key, found in given.items():
        if found.dtype.kind not in "iu" or found.shape not in ((), (number,)):
            form = "an integer, or one for each world" if number == 1 else f"an integer, or {number} of them"
            raise ArgumentError(f"{name}['{key}'] should be {form}, got {short(value[key])}.")
    if (given["seed"] < 0).any() and not hasattr(value["seed"], "dtype"):  # arrays may be in two's complement
        raise ArgumentError(f"{name}['seed'] should be from 0 to 2^64 - 1, got {short(value['seed'])}.")
    if (given["episode"] < 0).any() or (given["episode"] >= MOST_EPISODES).any():
        raise ArgumentError(f"{name}['episode'] should be from 0 to 2^31 - 2, got {short(value['episode'])}.")
    seed, episode = (np.broadcast_to(found, (number,)) for found in given.values())
    # torch's tensors have seeds in two's complement
    param = layouts.params.rows(value["params"], number) if "params" in value else None
    found = ChosenLayouts(seed.astype(np.uint64), np.ones(number, bool), episode.astype(np.int32), param)
    return found, all(part.ndim == 0 for part in given.values())


def layouts_of_ids(ids: Any, layouts: Layouts, split: str, name: str) -> ChosenLayouts:
    """Return the layouts of one id or a sequence of ids, one row per id. For None in the sequence, `given` is false.

    Args:
        ids: The ids.
        layouts: Layouts of worlds with the required scene and params.
        split: The required split.
        name: Name of the argument in messages.

    Raises:
        ArgumentTypeError: Not an id or a sequence.
        ArgumentError: A malformed id.
        SceneMismatchError: An id of another scene or split.
        UnknownNameError: An id with a param that the worlds do not have.
    """
    scene, table = layouts.compiled.scene, layouts.params
    texts = [ids] if isinstance(ids, str | LayoutId) else ids
    if not isinstance(texts, Sequence) or not all(isinstance(text, str | LayoutId | None) for text in texts):
        raise ArgumentTypeError(
            f"{name} should be a layout id, a sequence of them, or a mapping with 'seed' and 'episode', got "
            f"{short(ids)}."
        )
    cure = f"{name} should have ids of the scene and split of these worlds."
    none = LayoutId(scene.hash, split, 0, 0)
    named = [none if text is None else LayoutId.of_scene(text, scene, cure, split) for text in texts]
    values: dict[str, np.ndarray] = {}
    for text, one in zip(texts, named, strict=True):
        if one.params not in values:
            try:
                values[one.params] = table.rows(params_in(one.params), 1)[0]
            except ArgumentError as error:
                raise ArgumentError(f"{name}: layout id '{text}': {error}") from None
    return ChosenLayouts(
        np.array([one.seed for one in named], np.uint64),
        np.array([text is not None for text in texts], bool),
        np.array([one.episode for one in named], np.int32),
        np.array([values[one.params] for one in named], np.float32).reshape(len(named), len(table.default)),
    )
