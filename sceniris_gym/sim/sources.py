"""The source of layouts that a randomizer resets to, chosen by its arguments."""

from __future__ import annotations

from collections.abc import Sequence

import warp as wp

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, as_names, check_type
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.prepared import PreparedLayouts
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.levels.choice import Levels
from sceniris_gym.levels.sampler import LevelSampler
from sceniris_gym.program.compiled import CompiledScene


def choose_source(
    compiled: CompiledScene,
    nworld: int,
    given: LayoutSource | None,
    *,
    seed: int | Sequence[int],
    split: str,
    prefetch: bool | wp.Stream | None,
    levels: Levels | None,
    knobs: str | Sequence[str],
    graph: bool,
) -> LayoutSource:
    """Return the source that is given, or else a generator, which prefetches and plays levels as it is asked to.

    Args:
        compiled: The scene.
        nworld: Number of worlds.
        given: The argument `layout_source` of ResetRandomizer, which explains the others, too.
        seed: Seeds of a generator.
        split: Its split.
        prefetch: Make its layouts ahead.
        levels: Levels to play.
        knobs: Knobs of the worlds.
        graph: Capture the launches into graphs.

    Raises:
        ArgumentTypeError: `given`, `levels` or `prefetch` is of another type.
        ArgumentError: Both a source and `prefetch` or `knobs`, or a stream of another device.
    """
    if levels is not None:
        check_type(levels, Levels, "ResetRandomizer: levels")
        named = () if levels.ranges is None else tuple(levels.ranges.start)
        knobs = (*as_names(knobs, "knobs"), *named)
    if given is None:
        given = generator = LayoutGenerator(compiled, nworld, seed=seed, split=split, knobs=knobs)
        prefetch = wp.get_device(compiled.device).is_cuda if prefetch is None else prefetch
        if not isinstance(prefetch, bool | wp.Stream):
            raise ArgumentTypeError(
                f"ResetRandomizer: prefetch should be a boolean, a wp.Stream or None, got {type(prefetch)}. "
                "wp.stream_from_torch(stream) turns a stream of torch's into a wp.Stream."
            )
        if prefetch:
            given = PreparedLayouts(generator, None if prefetch is True else prefetch, graph=graph)
    elif prefetch or knobs:
        raise ArgumentError(
            "ResetRandomizer: prefetch and knobs are for layouts that the randomizer generates itself. Give either "
            "them or a layout_source, which may be a PreparedLayouts."
        )
    check_type(given, LayoutSource, "ResetRandomizer: layout_source")
    return given if levels is None else LevelSampler(given, levels, split)
