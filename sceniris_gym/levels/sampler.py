"""`LevelSampler`: chooses the next layout of each world from a buffer of levels."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.random import SPLITS, STREAM_BITS
from sceniris_gym.device.tensors import TensorView
from sceniris_gym.errors import ArgumentError, SceneMismatchError, check_names, check_type, refuses_old_names
from sceniris_gym.layout.layout_id import layouts_of_ids
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.masks import as_count, as_numbers, as_worlds
from sceniris_gym.layout.params import launch_set
from sceniris_gym.layout.pipeline import Chooser
from sceniris_gym.levels.buffer import Episodes, bounds_of, create_buffer, launch_choose, launch_forget, launch_update
from sceniris_gym.levels.curriculum import FRESH, FROM_BANK, LevelReplay
from sceniris_gym.levels.refresh import launch_move, launch_refresh, set_ranges
from sceniris_gym.program.compiled import USER_SPLITS

LEVEL_STREAM = (1 << STREAM_BITS) - 4


class LevelSampler(Chooser, StaysHere):
    """A `Chooser` that replays layouts according to the outcomes of earlier episodes.

    A level is one layout, identified by its seed, episode and params. A world's next level is chosen when the world's
    current episode begins, so that the next level can be prefetched. The outcome of an episode is known only after that
    choice, so it first affects the level after the next. A method waits for the device only if its documentation says
    so.

    Choices are a pure function of the worlds' seeds and of all outcomes. There is one exception, on a GPU: if several
    worlds finish the same level in one step, it may happen that only one of the outcomes counts, and which one varies.

    Weights are refreshed after every `LevelReplay.refresh_interval` calls of `reset`. A call counts once, for any
    number of worlds. While you capture a graph, weights are not refreshed. Choices use the weights of the latest
    refresh.

    Args:
        replay: The settings.
        layouts: The layouts of the worlds.
        split: Split of the layouts.

    Attributes:
        level: Index of each world's level in the buffer, or -1 for a fresh level, shape (nworld,), int32.
        boundary: Index of the ADR interval end that each world's level tests, or -1, shape (nworld,), int32.
        size: Number of levels in the buffer. Waits for the device.
    """

    level, boundary = (TensorView(lambda sampler, name: getattr(sampler._buffer, name)) for _ in range(2))

    def __init__(self, replay: LevelReplay, layouts: Layouts, split: str = "train") -> None:
        check_type(replay, LevelReplay, "LevelSampler: replay")
        check_type(layouts, Layouts, "LevelSampler: layouts")
        check_names("split", [split], "LevelSampler", USER_SPLITS)
        self.replay, self.layouts, self.split = replay, layouts, split
        self._device, self._since = layouts.view.qpos.device, 0
        self._stream = wp.uint32((SPLITS[self.split] << STREAM_BITS) + LEVEL_STREAM)
        self._buffer = buffer = create_buffer(replay, self.layouts.view)
        if replay.adr is not None:
            set_ranges(buffer, replay.adr, self.layouts.params)
        launch_forget(buffer, None, None)

    @property
    def size(self) -> int:
        """Number of levels in the buffer. Waits for the device."""
        return int((self._buffer.age.numpy() >= 0).sum())

    def rows(self) -> Mapping[str, Any]:
        """Return the tensors that snapshots store, by name, each with a row per world."""
        return {"level": self.level, "boundary": self.boundary}

    def launch_choose(self, mask: wp.array | None) -> None:
        """Give each masked world the level that was chosen for it earlier, and choose its next level."""
        if self.replay.adr is not None:
            launch_move(self._buffer, self.replay.adr)
        launch_choose(self._buffer, mask, self._stream, self.replay.replay_prob)

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """Set param values of masked worlds, as in `Chooser`. Later fresh levels of these worlds have the values."""
        launch_set(self._buffer.base_param, columns, values, mask)
        launch_forget(self._buffer, None, mask)

    def launch_forget(self, seeds: wp.array | None, mask: wp.array | None) -> None:
        """Drop the next levels of masked worlds, as in `Chooser`. Later fresh levels use `seeds`, if given."""
        launch_forget(self._buffer, seeds, mask)

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Count the outcomes of episodes. Episodes on layouts from the bank do not count.

        Args:
            success: 1 for worlds that succeeded, 0 for the others, shape (nworld,), float32.
            finished: Worlds whose episode ended, shape (nworld,), bool.
        """
        buffer, layouts = self._buffer, self.layouts.view
        played = Episodes(buffer.level, layouts.seed, layouts.episode, success, layouts.param)
        launch_update(buffer, played._replace(mask=finished, status=layouts.status, boundary=buffer.boundary))

    @refuses_old_names
    def insert(self, layouts: Any, scores: Any) -> None:
        """Insert levels, and refresh the weights. If the buffer is full, new levels replace levels with lower scores.

        Args:
            layouts: See `update`. All layouts count as new to the buffer, even if they have a `level` of at least 0.
                Layouts from the bank (`level` -2) are left out. There may be more layouts than worlds.
            scores: See `update`.

        Raises:
            ArgumentError, UnknownNameError, SceneMismatchError: See `update`.
        """
        self._score("LevelSampler.insert", layouts, scores, None, are_new=True)

    def sample(self, number: int, seed: int = 0) -> dict[str, Any]:
        """Draw levels from the buffer, with probabilities proportional to their weights. Waits for the device.

        Returns:
            A mapping with `level`, `seed` and `episode`, each of shape (number,), and `params`, the values of each
            param by name.

        Raises:
            ArgumentError: The buffer is empty, or `number` or `seed` is not an integer of at least 0.
        """
        as_count(number, "LevelSampler.sample: number", 0)
        as_count(seed, "LevelSampler.sample: seed", 0, (1 << 64) - 1)
        sums = self._buffer.cumulative.numpy()
        if sums[-1] == 0:
            raise ArgumentError("LevelSampler.sample: the buffer is empty. Play or insert levels first.")
        level = np.searchsorted(sums, np.random.default_rng(seed).integers(sums[-1], size=number), side="right")
        seed, episode, param = (getattr(self._buffer, name).numpy()[level] for name in ("seed", "episode", "param"))
        return {"level": level, "seed": seed, "episode": episode, "params": self.layouts.params.named(param)}

    @property
    def ranges(self) -> dict[str, np.ndarray]:
        """The current ADR interval of each param, by name. Waits for the device."""
        row = self.layouts.params.default[None].copy()
        row[0, self._buffer.column.numpy()] = self._buffer.present.numpy()
        named = self.layouts.params.named(row)
        return {} if self.replay.adr is None else {name: named[name][0] for name in self.replay.adr.init_range}

    @refuses_old_names
    def update(self, layouts: Any, scores: Any, worlds: Any = None) -> None:
        """Set the scores of levels after playing them.

        A level that has left the buffer is inserted again, and replaces a level with a lower score.

        Args:
            layouts: `info["layout"]`, or another mapping with integer arrays `seed`, `episode` and `level` of shape
                (n,), and with `params`, arrays of values by name. Rows with `level` -2 (layouts from the bank) or an
                episode below 0 do not count. If `level` is left out, all layouts count as new to the buffer. If
                `params` is left out, the levels get the scene file's values. You may also pass a layout id, or a
                sequence of ids.
            scores: Finite floats of at least 0, shape (n,). If `LevelReplay.score` is "custom", these are the scores,
                such as the regret or the mean value loss of each episode. If it is "learnability" or "failure", pass 1
                for a success and 0 for a failure. Rows with negative or infinite scores or NaN do not count.
            worlds: Worlds whose rows count, as booleans, ids or a slice. The arrays should then have a row for each
                world. If None, all rows count.

        Raises:
            ArgumentError: The arrays have different lengths, or `worlds` is given but the arrays do not have a row for
                each world.
            UnknownNameError: `params` names a param that the worlds do not have.
            SceneMismatchError: A layout id is from another scene or split.
        """
        self._score("LevelSampler.update", layouts, scores, worlds, are_new=False)

    def _score(self, where: str, layouts: Any, scores: Any, worlds: Any, *, are_new: bool) -> None:
        """Check the arguments of `update`, then update the levels, or insert them if `are_new`."""
        given = layouts if isinstance(layouts, Mapping) else self._named(layouts, f"{where}: layouts")
        if not {"seed", "episode"} <= {*given}:
            raise ArgumentError(f"{where}: layouts should have the keys 'seed' and 'episode', got {short([*given])}.")
        if "bool" in str(getattr(scores, "dtype", "")):
            scores = scores * 1.0
        columns = given.get("level"), given["seed"], given["episode"], scores
        found: list[Any] = [each if getattr(each, "is_cuda", False) else as_numbers(each) for each in columns]
        found[0] = found[0] if "level" in given else np.full(np.shape(found[1]), FRESH)
        shapes = [tuple(np.shape(values)) for values in found]
        if len({*shapes}) != 1 or len(shapes[0]) != 1:
            got = ", ".join(map(short, columns))
            raise ArgumentError(f"{where}: level, seed, episode, scores should have the same shape (n,), got {got}.")
        found[0] = found[0].clip(FROM_BANK, FRESH) if are_new else found[0]
        arrays = [*map(self._column, found, (wp.int32, wp.uint64, wp.int32, wp.float32))]
        rows = self.layouts.params.rows(given.get("params", {}), shapes[0][0])
        nworld = self.layouts.nworld
        if worlds is not None and len(rows) != nworld:
            raise ArgumentError(f"{where}: layouts should have a row for each of {nworld} worlds, got {len(rows)}.")
        mask = as_worlds(worlds, nworld, self._device)
        if are_new:
            launch_refresh(self._buffer, self.replay)
        most = min(nworld, self._buffer.vacant.shape[0])  # each row of a launch has separate slots
        for first in range(0, len(rows), most):
            part = slice(first, min(first + most, len(rows)))
            param = wp.array(rows[part], dtype=float, ndim=2, device=self._device)
            chosen = None if mask is None else mask[part]
            launch_update(self._buffer, Episodes(*(array[part] for array in arrays), param=param, mask=chosen))
            if are_new:
                launch_refresh(self._buffer, self.replay)

    def _named(self, ids: Any, name: str) -> dict[str, Any]:
        """Return the seeds, episodes and params of the layouts with these ids, in the form that `update` takes."""
        found = layouts_of_ids(ids, self.layouts, self.split, name)
        if not found.given.all():
            raise ArgumentError(f"{name} should have an id in each entry, got None.")
        return {"seed": found.seed, "episode": found.episode, "params": self.layouts.params.named(found.param)}

    def _column(self, values: Any, dtype: type) -> wp.array:
        """Return numbers as a Warp array on the device, converted to `dtype`. Seeds keep their 64 bits."""
        is_whole = values.dtype.kind in "biu" if isinstance(values, np.ndarray) else not values.is_floating_point()
        if dtype is not wp.float32 and not is_whole:
            raise ArgumentError(f"LevelSampler: levels, seeds and episodes should be integers, got {values.dtype}.")
        if dtype is wp.int32:  # clip first, because an out-of-range number must not wrap around to a valid number
            values = values.clip(-(1 << 31), (1 << 31) - 1)
        given = wp.array(values) if isinstance(values, np.ndarray) else wp.from_torch(values.detach().contiguous())
        given = given.to(self._device)
        if dtype is wp.uint64 and given.dtype in (wp.int64, wp.uint64):
            return given.view(wp.uint64)
        made = wp.empty(given.shape, dtype=dtype, device=self._device)
        wp.utils.array_cast(given, made)
        return made

    def after_reset(self) -> None:
        """Count a call of `reset`, and refresh the weights after every `refresh_interval` calls."""
        self._since += 1
        if self._since >= self.replay.refresh_interval and not self._device.is_capturing:
            self._since = 0
            launch_refresh(self._buffer, self.replay)

    def state(self) -> dict[str, np.ndarray]:
        """Return the buffer and the worlds' levels as arrays by name, for `restore`. Waits for the device.

        The array `source` holds the hash of the scene, the split and the names of the params.
        """
        arrays = {name: getattr(self._buffer, name).numpy().copy() for name in bounds_of(self._buffer)}
        source = self.layouts.compiled.hash, self.split, *self.layouts.params.names
        return arrays | {"resets": np.array(self._since), "source": np.array(source)}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Restore a `state` of a sampler with the same settings, scene, split, params and number of worlds.

        Raises:
            SceneMismatchError: The state comes from another scene or split, or from worlds with other params.
            ArgumentError: An array of the state is missing, has another shape or type, or has a value out of range.
            ArgumentTypeError: The state is not a mapping.
        """
        check_type(state, Mapping, "LevelSampler.restore: state")
        where, own, bounds = "LevelSampler.restore", self.state(), bounds_of(self._buffer)
        if not np.array_equal(state.get("source", ()), own["source"]):
            raise SceneMismatchError(
                f"{where}: state['source'] (scene, split, params) should be {own['source'].tolist()}, got "
                f"{short(state.get('source'))}. Pass the state of a sampler with this scene, split and params."
            )
        for name, (least, most) in {**bounds, "resets": (0, np.inf)}.items():
            values = state.get(name)
            if not isinstance(values, np.ndarray) or (values.shape, values.dtype) != (own[name].shape, own[name].dtype):
                raise ArgumentError(f"{where}: state['{name}'] should be {own[name].dtype} of shape {own[name].shape}.")
            if name == "cumulative":  # running sums do not fall
                least = np.maximum.accumulate([0, *values])[1:]
            wrong = np.flatnonzero(~((values >= least) & (values <= most)))
            if len(wrong):
                first, ends = wrong[0], [np.broadcast_to(end, values.shape).flat[wrong[0]] for end in (least, most)]
                got = f"got {values.flat[first]} at index {first}"
                raise ArgumentError(f"{where}: state['{name}'] should be from {ends[0]:g} to {ends[1]:g}, {got}.")
        for name in ("param", "base_param", "next_param"):
            self.layouts.params.checked(state[name], len(state[name]))
        for array, name in ((getattr(self._buffer, name), name) for name in bounds):
            if array.size:
                array.assign(state[name])
        self._since = int(state["resets"])
