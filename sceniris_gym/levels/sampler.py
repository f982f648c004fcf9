"""`LevelSampler`: chooses the next layout of each world out of a buffer of levels."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp
from warp.utils import array_cast

from sceniris_gym.config.fields import short
from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.random import SPLITS, STREAM_BITS
from sceniris_gym.errors import ArgumentError, SceneMismatchError, check_names, check_type
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.masks import as_count, as_numbers
from sceniris_gym.layout.params import launch_set
from sceniris_gym.layout.pipeline import Chooser
from sceniris_gym.levels.buffer import Episodes, bounds_of, create_buffer, launch_choose, launch_forget, launch_update
from sceniris_gym.levels.choice import Levels
from sceniris_gym.levels.refresh import launch_move, launch_refresh, set_ranges
from sceniris_gym.program.compiled import USER_SPLITS

LEVEL_STREAM = (1 << STREAM_BITS) - 4


class LevelSampler(Chooser, StaysHere):
    """A `Chooser` whose worlds play levels: layouts that are chosen by how earlier episodes on them went.

    A world's next level is chosen when its present one begins, so that it can be made ahead, and the score of an
    episode counts from the next choice on. Nothing waits for the host. Choices are a pure function of the seeds of the
    worlds and of all outcomes, but for a race on a GPU: of several worlds that end on one level in the same step, one
    may count.

    Weights are refreshed every `Levels.every` resets, outside of graphs of the caller's own; until then choices go by
    the old ones.

    Args:
        levels: The choice.
        layouts: The layouts of the worlds.
        split: Their split.

    Attributes:
        level: Place in the buffer of each world's level, -1 for a fresh one, shape (nworld,), int32.
        probe: The end of an interval of `Ranges` that each world's level is at, -1 for none, shape (nworld,), int32.
        size: Number of levels in the buffer; waits for the device.
    """

    def __init__(self, levels: Levels, layouts: Layouts, split: str = "train") -> None:
        check_type(levels, Levels, "LevelSampler: levels")
        check_type(layouts, Layouts, "LevelSampler: layouts")
        check_names("split", [split], "LevelSampler", USER_SPLITS)
        self.levels, self.layouts, self.split = levels, layouts, split
        self._device, self._since = layouts.qpos.device, 0
        self._stream = wp.uint32((SPLITS[self.split] << STREAM_BITS) + LEVEL_STREAM)
        self._buffer = buffer = create_buffer(levels, self.layouts.view)
        self.level, self.probe = buffer.level, buffer.probe
        self.rows = {"level": self.level, "probe": self.probe}
        if levels.ranges is not None:
            set_ranges(buffer, levels.ranges, self.layouts.params)
        launch_forget(buffer, None, None)

    @property
    def size(self) -> int:
        """See the class."""
        return int((self._buffer.age.numpy() >= 0).sum())

    def launch_choose(self, mask: wp.array | None) -> None:
        """Let the masked worlds play the levels that they were served, and choose those that follow."""
        if self.levels.ranges is not None:
            launch_move(self._buffer, self.levels.ranges)
        launch_choose(self._buffer, mask, self._stream, self.levels.replay)

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """See `Chooser`; the worlds make their fresh levels with these numbers from then on."""
        launch_set(self._buffer.base_param, columns, values, mask)
        launch_forget(self._buffer, None, mask)

    def launch_forget(self, seeds: wp.array | None, mask: wp.array | None) -> None:
        """See `Chooser`; the worlds draw their fresh levels by these seeds from then on, if there are some."""
        launch_forget(self._buffer, seeds, mask)

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Tell how episodes ended; those on layouts from the bank do not count.

        Args:
            success: 1 for worlds that succeeded, else 0, shape (nworld,), float32.
            finished: Worlds whose episode ended, shape (nworld,), bool.
        """
        layouts = self.layouts.view
        played = Episodes(self.level, layouts.seed, layouts.episode, success, layouts.param)
        launch_update(self._buffer, played._replace(mask=finished, status=layouts.status, probe=self.probe))

    def insert(self, seed: Any, episode: Any, score: Any, params: Mapping[str, Any] | None = None) -> None:
        """Insert levels of your own in the place of others with lower scores, and refresh the weights; see `update`."""
        launch_refresh(self._buffer, self.levels)
        self.update(None, seed, episode, score, params)

    def sample(self, number: int, seed: int = 0) -> dict[str, Any]:
        """Draw levels of the buffer by their weights. Waits for the device.

        Returns:
            `level`, `seed` and `episode`, each of shape (number,), and `params`, their values by name.

        Raises:
            ArgumentError: The buffer is empty. A number or a seed that is no integer of at least 0.
        """
        as_count(number, "LevelSampler.sample: number", 0)
        as_count(seed, "LevelSampler.sample: seed", 0, (1 << 64) - 1)
        sums = self._buffer.cumulative.numpy()
        if sums[-1] == 0:
            raise ArgumentError("LevelSampler.sample: the buffer is empty. Play, or insert levels, first.")
        level = np.searchsorted(sums, np.random.default_rng(seed).integers(sums[-1], size=number), side="right")
        seed, episode, param = (getattr(self._buffer, name).numpy()[level] for name in ("seed", "episode", "param"))
        return {"level": level, "seed": seed, "episode": episode, "params": self.layouts.params.named(param)}

    @property
    def ranges(self) -> dict[str, np.ndarray]:
        """The present intervals of the params that follow success, by name. Waits for the device."""
        row = self.layouts.params.default[None].copy()
        row[0, self._buffer.column.numpy()] = self._buffer.present.numpy()
        named = self.layouts.params.named(row)
        return {} if self.levels.ranges is None else {name: named[name][0] for name in self.levels.ranges.start}

    def update(self, level: Any, seed: Any, episode: Any, score: Any, params: Mapping[str, Any] | None = None) -> None:
        """Give scores to levels that were played: those of the buffer are updated, others inserted.

        A level is inserted in the place of one with a lower score, if there is one.

        Args:
            level: `layout_level` of an info, shape (n,): a torch tensor or NumPy array of integers, as all others. Rows
                with -2, layouts from the bank, do not count. None inserts as many levels as there is room for, as
                `insert` does.
            seed: `layout_seed` of the same info, shape (n,).
            episode: `layout_episode`, shape (n,). Rows below 0 do not count.
            score: Scores, floats of at least 0, shape (n,): regret, or the mean loss of values in the episode. Where
                successes are counted: 1 for a success, 0 for a failure. Rows with any other number do not count.
            params: `layout_params` of the same info; None has those of the scene file.

        Raises:
            ArgumentError: Not arrays of one length.
            UnknownNameError: A param that the worlds do not have.
        """
        columns = seed, episode, score, level
        given = [each if getattr(each, "is_cuda", False) else as_numbers(each) for each in columns]
        given[3] = np.full(np.shape(given[0]), -1) if level is None else given[3]
        shapes = [tuple(np.shape(values)) for values in given]
        if len({*shapes}) != 1 or len(shapes[0]) != 1:
            raise ArgumentError(
                f"LevelSampler.update: numbers should have one length, shape (n,), got shapes {shapes}."
            )
        types = wp.uint64, wp.int32, wp.float32, wp.int32
        seeds, episodes, scores, places = map(self._column, given, types)
        rows = self.layouts.params.rows({} if params is None else params, shapes[0][0])
        most = min(self.layouts.nworld, self._buffer.vacant.shape[0])  # so each row of a launch has places of its own
        for first in range(0, len(rows), most):
            part = slice(first, min(first + most, len(rows)))
            param = wp.array(rows[part], dtype=float, ndim=2, device=self._device)
            columns = (array[part] for array in (places, seeds, episodes, scores))
            launch_update(self._buffer, Episodes(*columns, param=param))
            if level is None:
                launch_refresh(self._buffer, self.levels)

    def _column(self, values: Any, dtype: type) -> wp.array:
        """Return a column on the device, seeds as the 64 bits that they are."""
        is_whole = values.dtype.kind in "biu" if isinstance(values, np.ndarray) else not values.is_floating_point()
        if dtype is not wp.float32 and not is_whole:
            raise ArgumentError("LevelSampler.update: levels, seeds and episodes should be integers.")
        if dtype is wp.int32:  # what is beyond does not count, and should not begin again from below
            values = values.clip(-(1 << 31), (1 << 31) - 1)
        given = wp.array(values) if isinstance(values, np.ndarray) else wp.from_torch(values.detach().contiguous())
        given = given.to(self._device)
        if dtype is wp.uint64 and given.dtype in (wp.int64, wp.uint64):
            return given.view(wp.uint64)
        made = wp.empty(given.shape, dtype=dtype, device=self._device)
        array_cast(given, made)
        return made

    def after_reset(self) -> None:
        """Refresh the weights every so many resets."""
        self._since += 1
        if self._since >= self.levels.every and not self._device.is_capturing:
            self._since = 0
            launch_refresh(self._buffer, self.levels)

    def state(self) -> dict[str, np.ndarray]:
        """Return the levels, their values, and what the worlds play, for `restore`. Waits for the device.

        `source` has the hash of the scene, the split and the names of the params.
        """
        arrays = {name: getattr(self._buffer, name).numpy().copy() for name in bounds_of(self._buffer)}
        source = self.layouts.compiled.hash, self.split, *self.layouts.params.names
        return arrays | {"resets": np.array(self._since), "source": np.array(source)}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Go on from a `state` of a sampler with the same levels, scene, split, params and number of worlds.

        Raises:
            SceneMismatchError: It is of another scene, of another split, or has other params.
            ArgumentError: It is of another sampler, or has a number that no sampler has.
            ArgumentTypeError: No mapping.
        """
        check_type(state, Mapping, "LevelSampler.restore: state")
        where, own, bounds = "LevelSampler.restore", self.state(), bounds_of(self._buffer)
        if not np.array_equal(state.get("source", ()), own["source"]):
            raise SceneMismatchError(
                f"{where}: state['source'] (scene, split, params) should be {own['source'].tolist()}, got "
                f"{short(state.get('source'))}. Give the state of a sampler of this scene, split and params."
            )
        for name, (least, most) in {**bounds, "resets": (0, np.inf)}.items():
            values = state.get(name)
            if not isinstance(values, np.ndarray) or (values.shape, values.dtype) != (own[name].shape, own[name].dtype):
                raise ArgumentError(f"{where}: {name} should have shape {own[name].shape} and type {own[name].dtype}.")
            if name == "cumulative":  # sums that rise
                least = np.maximum.accumulate([0, *values])[1:]
            wrong = np.flatnonzero(~((values >= least) & (values <= most)))
            if len(wrong):
                first, ends = wrong[0], [np.broadcast_to(end, values.shape).flat[wrong[0]] for end in (least, most)]
                got = f"got {values.flat[first]} at {first}"
                raise ArgumentError(f"{where}: {name} should be from {ends[0]:g} to {ends[1]:g} there, {got}.")
        for name in ("param", "base_param", "next_param"):
            self.layouts.params.checked(state[name], len(state[name]))
        for array, name in ((getattr(self._buffer, name), name) for name in bounds):
            if array.size:
                array.assign(state[name])
        self._since = int(state["resets"])
