"""`LayoutSource`: the base class of the layout sources of a randomizer."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.sequence import LaunchSequence, launching
from sceniris_gym.errors import ArgumentError, ArgumentTypeError
from sceniris_gym.layout.layout_id import ChosenLayouts, as_layouts, seeds_on_device
from sceniris_gym.layout.layouts import LayoutKeys, Layouts
from sceniris_gym.layout.masks import as_host_mask, as_worlds, fill_mask
from sceniris_gym.layout.params import launch_set
from sceniris_gym.layout.seeds import launch_close, launch_open, launch_reseed


class LayoutSource(StaysHere):
    """A source of layouts for a batch of worlds, fresh (`LayoutGenerator`) or stored (`StoredLayouts`).

    Subclasses set `layouts` and implement `launch_make`. All other methods have defaults. Kernels take the Warp arrays
    in `layouts.view`, whose memory users read as torch tensors such as `layouts.qpos`.

    The `launch_` methods only launch kernels, without allocation or host synchronisation, so that a captured graph can
    contain them. They do not validate arguments.

    Attributes:
        layouts: The latest layout of each world, always in the same arrays.
        split: Split of the layouts, "train" or "eval". None takes the split of the randomizer.
        hears: Whether the source uses `launch_finish`. Otherwise resets do not call it.
        chooser: Chooses the next layouts. Only a LayoutPipeline has one: its argument `chooser`, or by default the
            chooser of the source that it wraps.
    """

    layouts: Layouts
    split: str | None = None
    hears: bool = False
    chooser: Any = None

    def launch_make(self, mask: wp.array | None) -> None:
        """Write the next layouts of the masked worlds into the rows of `layouts.view`.

        World i gets the layout of `pending_seed[i]`, `pending_episode[i]` and `next_param[i]`. The caller then writes
        seed, episode and params of the row.

        Args:
            mask: Selected worlds, shape (nworld,), bool. None selects all.
        """
        raise ArgumentTypeError(f"{type(self).__name__}: should implement the method `launch_make(mask)`.")

    def launch_generate(self, mask: wp.array | None) -> None:
        """Advance the masked worlds by one episode and write their new layouts into `layouts`.

        Args:
            mask: Selected worlds, shape (nworld,), bool. None selects all.
        """
        launch_open(self.layouts.view, mask)
        self.launch_make(mask)
        launch_close(self.layouts.view, mask)

    def twin(self) -> LayoutSource:
        """Return a second source of the same layouts with separate memory, for prefetching.

        Raises:
            ArgumentTypeError: The class does not override this method, so it does not support prefetching.
        """
        raise ArgumentTypeError(
            f"{type(self).__name__}: cannot prefetch, as prefetching takes a second source of the same layouts. Use "
            "the source without prefetching, or give its class a method `twin` that returns a second source."
        )

    def launch_reseed(self, seeds: wp.array | None, mask: wp.array | None, episodes: wp.array | None = None) -> None:
        """Choose the next layouts of the masked worlds. Present layouts keep their seeds and episodes.

        Level replay does not call this when episodes end: it writes its choices directly into `layouts`.

        Args:
            seeds: Seeds on the device, shape (nworld,), uint64. If None, the seeds of the present layouts are kept.
            mask: Selected worlds, shape (nworld,), bool. None selects all.
            episodes: Episodes on the device, shape (nworld,), int32. None is episode 0.
        """
        launch_reseed(self.layouts.view, seeds, mask, episodes)

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """Set param values for the next layouts of the masked worlds.

        Args:
            columns: Columns of the params, shape (n,), int32.
            values: Values for these columns, shape (1 or nworld, n), float32.
            mask: Selected worlds, shape (nworld,), bool. None selects all.
        """
        launch_set(self.layouts.view.next_param, columns, values, mask)

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Process the outcomes of episodes, before their worlds are reset. A source that overrides this sets `hears`.

        Args:
            success: 1 for worlds that succeeded, 0 for the others, shape (nworld,), float32.
            finished: Worlds whose episode ended, shape (nworld,), bool.
        """

    def after_reset(self) -> None:
        """Host-side hook, called after the launches of every reset, including captured resets."""

    def served(self, split: str, keys: LayoutKeys) -> tuple[str, LayoutKeys]:
        """Return split, seeds, episodes and params of the layouts that worlds with `split` and `keys` get."""
        return split, keys

    def ids(self, split: str, keys: LayoutKeys | None = None) -> list[str]:
        """Return the ids of the present layouts, or of the layouts served for other `keys`. See `Layouts.ids`."""
        own = self.layouts.view
        keys = keys or (own.seed.numpy(), own.episode.numpy(), own.param.numpy())
        return self.layouts.ids(*self.served(split, keys))

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """Return the number of rejected candidates so far, by object and cause. Waits for the device.

        By default, the mapping is empty, which suits sources that do not search for layouts.
        """
        return {}

    @cached_property
    def _generate_graph(self) -> tuple[LaunchSequence, wp.array]:
        """The launches of `generate`, and the mask of the worlds that they advance."""
        mask = wp.zeros(self.layouts.nworld, dtype=wp.bool, device=self.layouts.view.seed.device)
        return LaunchSequence(lambda: self.launch_generate(mask), mask.device), mask

    @launching
    def generate(self, worlds: Any = None) -> None:
        """Advance worlds by one episode and write their new layouts into `layouts`.

        The first call captures the launches into a graph. If the caller is capturing a graph, the launches join the
        caller's graph instead.

        Args:
            worlds: None for all worlds, booleans of shape (nworld,), ids of worlds, or a slice.

        Raises:
            ArgumentError, ArgumentTypeError: `worlds` has a world that does not exist, or other values than booleans
                and integers.
        """
        graph, own = self._generate_graph
        fill_mask(self._mask_of(worlds, own), own)
        graph.replay()
        self.after_reset()

    @launching
    def reseed(self, worlds: Any = None, *, seed: Any = None, layouts: Any = None) -> None:
        """Choose the next layouts of worlds. Later episodes continue from there.

        The present layouts keep their seeds and episodes until the next layouts are served.

        Args:
            worlds: As in `generate`.
            seed: One integer (world i gets seed + i), or an array with one 64-bit seed per chosen world, in their
                order, or with one per world. The worlds start at episode 0. A uint64 Warp array on the device, shape
                (nworld,), is not copied to the host. Torch tensors are read in two's complement.
            layouts: A layout id, a sequence of ids (None keeps a world's next layout), or a mapping {"seed": ...,
                "episode": ...} with optional "params".

        Raises:
            ArgumentError: Not exactly one of `seed` and `layouts`, or a malformed id, seed, episode or param value.
            SceneMismatchError: An id of another scene or split.
            UnknownNameError: A param that the worlds do not have.
            ArgumentError, ArgumentTypeError: As in `generate`.
        """
        if (seed is None) == (layouts is None):
            raise ArgumentError(f"worlds should have `seed` or `layouts`, got {'neither' if seed is None else 'both'}.")
        nworld, device, mask = self.layouts.nworld, self.layouts.view.seed.device, self._mask_of(worlds)
        if layouts is None:
            self.launch_reseed(seeds_on_device(seed, nworld, device, worlds), mask)
            return
        chosen = self.chosen(layouts, worlds)
        if not chosen.given.all():
            mask = self._mask_of(chosen.given if mask is None else chosen.given & as_host_mask(mask, nworld))
        rows = np.zeros((1, 0)) if chosen.param is None else self.layouts.params.checked(chosen.param, nworld)
        columns = self._changeable(np.arange(rows.shape[1]))
        seeds = wp.array(chosen.seed, dtype=wp.uint64, device=device)
        episodes = None if chosen.episode is None else wp.array(chosen.episode, dtype=int, device=device)
        self.launch_reseed(seeds, mask, episodes)
        self._set_params(columns, rows, mask)

    def chosen(self, layouts: Any, worlds: Any = None, name: str = "layouts") -> ChosenLayouts:
        """Return the layouts that a user chose for some worlds. See `as_layouts`."""
        return as_layouts(layouts, self.layouts, self.split or "train", self.served, worlds, name)

    @launching
    def set_params(self, values: Mapping[str, Any], worlds: Any = None) -> None:
        """Set params of worlds, from their next layouts on.

        Args:
            values: Values by name of the param. Write a value as in the scene file, such as [1, 3] for
                "groups.clutter.count", or give an array with one such value per world. Joint positions are in m or rad.
            worlds: As in `generate`.

        Raises:
            UnknownNameError: The worlds were not made with such a param.
            ArgumentError: A value beyond the limits of the scene file, or a source of stored layouts.
            ArgumentError, ArgumentTypeError: As in `generate`.
        """
        self._set_params(*self.checked_params(values), self._mask_of(worlds))

    def checked_params(self, values: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """Return the columns and the rows of numbers that `set_params` would write, or raise as `set_params` does."""
        columns, rows = self.layouts.params.part(values, self.layouts.nworld)
        return self._changeable(columns), rows

    def _changeable(self, columns: np.ndarray) -> np.ndarray:
        """Return `columns` unchanged. Raise if there are columns to set, but the params of stored layouts are fixed."""
        if len(columns) and self.layouts.params.are_kept:
            raise ArgumentError(
                "set_params: stored layouts keep the params they were made with. To change them, use a LayoutGenerator."
            )
        return columns

    def _set_params(self, columns: np.ndarray, rows: np.ndarray, mask: wp.array | None) -> None:
        if len(columns):
            with wp.ScopedDevice(self.layouts.view.seed.device):
                self.launch_set_params(wp.array(columns, dtype=int), wp.array(rows, dtype=float), mask)

    def _mask_of(self, worlds: Any, mask_out: wp.array | None = None) -> wp.array | None:
        return as_worlds(worlds, self.layouts.nworld, self.layouts.view.seed.device, mask_out)
