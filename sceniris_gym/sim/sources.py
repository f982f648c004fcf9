"""Make the pipeline that gives layouts to resets, and check stored layouts before they are written."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError, as_names, check_type
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.generate import LayoutGenerator, generator_memory
from sceniris_gym.layout.layouts import Layouts, LayoutsView, column_of, view_of
from sceniris_gym.layout.pipeline import LayoutPipeline
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.layout.stored import StoredLayouts, check_table
from sceniris_gym.layout.wave.search import suited_size
from sceniris_gym.levels.curriculum import ADR, LevelReplay, as_curriculum
from sceniris_gym.levels.sampler import LevelSampler
from sceniris_gym.program.compiled import CompiledScene, check_split
from sceniris_gym.scene.layout_table import LayoutTable

SourceLike = LayoutSource | LayoutTable | Callable[[CompiledScene, int], LayoutSource]
"""Types of `layout_source`: a source, stored rows, or a function (compiled, num_envs), such as a LayoutDataset."""


def make_pipeline(
    compiled: CompiledScene,
    nworld: int,
    where: str,
    *,
    layout_source: SourceLike | None = None,
    seed: int | Sequence[int] | np.ndarray = 0,
    split: str = "train",
    prefetch: bool | wp.Stream | None = None,
    curriculum: LevelReplay | ADR | Mapping[str, Any] | None = None,
    params: str | Sequence[str] = (),
    graph: bool = True,
) -> tuple[LayoutPipeline, LevelSampler | None]:
    """Return the layout pipeline of some worlds, and its LevelSampler if there is a curriculum.

    Args:
        compiled: The scene.
        nworld: Number of worlds.
        where: Name of the class that holds the pipeline. Errors begin with this name.
        layout_source: Makes or stores the layouts. None makes a LayoutGenerator. ResetRandomizer explains this argument
            and the following ones.
        seed: Seeds of the generator.
        split: Split of the generator.
        prefetch: Whether to make the generator's layouts in advance.
        curriculum: Chooses the layouts.
        params: Params of the worlds.
        graph: Whether to capture the launches into graphs.

    Raises:
        ArgumentTypeError: `layout_source`, `curriculum` or `prefetch` is of another type.
        ArgumentError: A source is given together with `prefetch` or `params`, both the source and `curriculum` choose
            layouts, the stream belongs to another device, or the split is unknown.
    """
    check_prefetch(prefetch, f"{where}: prefetch")
    replay = as_curriculum(curriculum, f"{where}: curriculum")
    if replay is not None and replay.adr is not None:
        params = (*as_names(params, "params"), *replay.adr.init_range)
    if layout_source is None:
        check_split(split, where)
        layout_source = LayoutGenerator(compiled, nworld, seed=seed, split=split, params=params)
        prefetch = wp.get_device(compiled.device).is_cuda if prefetch is None else prefetch
    elif prefetch or params:
        raise ArgumentError(
            f"{where}: prefetch and params only apply without a layout_source. Leave out the layout_source, or "
            "leave out prefetch and params and give a LayoutPipeline that prefetches."
        )
    layout_source = as_layout_source(layout_source, compiled, nworld, f"{where}: layout_source")
    if replay is not None and layout_source.chooser is not None:
        raise ArgumentError(f"{where}: both curriculum and layout_source choose layouts. Give one of them.")
    ahead = Ahead(layout_source, None if prefetch is True else prefetch, graph=graph) if prefetch else None
    split = layout_source.split or split
    sampler = None if replay is None else LevelSampler(replay, layout_source.layouts, split)
    return LayoutPipeline(layout_source, split, ahead=ahead, chooser=sampler), sampler


def maker_memory(compiled: CompiledScene, nworld: int, layout_source: Any, prefetch: Any) -> list[tuple[int, int]]:
    """Return the bytes of the generators of `make_pipeline`, as parts of `check_worlds`. Prefetching takes a second."""
    ahead = prefetch or (prefetch is None and wp.get_device(compiled.device).is_cuda)
    made = [generator_memory(compiled, suited_size(compiled, nworld))] * (2 if ahead else 1)
    return made if layout_source is None else []


def check_prefetch(prefetch: Any, where: str) -> None:
    """Check that `prefetch` is a boolean, a wp.Stream or None.

    Raises:
        ArgumentTypeError: `prefetch` has another type.
    """
    if not isinstance(prefetch, bool | wp.Stream | None):
        raise ArgumentTypeError(
            f"{where} should be a boolean, a wp.Stream or None, got {type(prefetch)}. "
            "wp.stream_from_torch(stream) converts a torch stream into a wp.Stream."
        )


def as_layout_source(given: Any, compiled: CompiledScene, nworld: int, where: str) -> LayoutSource:
    """Return a LayoutSource for these worlds: `given` itself, the rows of a LayoutTable, or the result of a function.

    Raises:
        ArgumentTypeError: `given` has another type, or is a function that returns another type.
    """
    if isinstance(given, LayoutSource):
        return given
    if isinstance(given, LayoutTable):
        return StoredLayouts(compiled, given, nworld)
    try:
        inspect.signature(given).bind(compiled, nworld)
    except (TypeError, ValueError):
        raise ArgumentTypeError(
            f"{where} should be a LayoutSource, LayoutTable, LayoutDataset or a function (compiled, num_envs), "
            f"got {short(given)}."
        ) from None
    made = given(compiled, nworld)
    check_type(made, LayoutSource, where)
    return made


def stored_rows(layouts: Layouts | LayoutTable, own: Layouts, device: str) -> LayoutsView:
    """Return the parts of stored layouts that a reset writes, on a device.

    Args:
        layouts: The layouts, on the device or on the host.
        own: The Layouts of the worlds into which the reset writes.
        device: The device of the result.

    Raises:
        ArgumentTypeError: `layouts` has another type.
        SceneMismatchError: The layouts belong to another scene, or contain values that this scene cannot produce. Or
            their physics or appearance was drawn with other params than the worlds have.
        UnknownNameError, ArgumentError: The scene does not have a param of the layouts, or a param's value is out of
            range.
    """
    if not isinstance(layouts, Layouts | LayoutTable):
        raise ArgumentTypeError(f"layouts should be Layouts or a LayoutTable, got {type(layouts)}.")
    compiled, known = own.compiled, own.params.names
    if isinstance(layouts, LayoutTable):
        check_table(compiled, layouts, "layouts")
        params = layouts.params
    else:
        compiled.scene.check_hash(layouts.compiled.hash, "layouts: each of them", "Give layouts of this scene.")
        params = layouts.params.names
    if params != known and {*params, *known} & set(own.params.of_draws.values()):
        raise SceneMismatchError(
            f"layouts were drawn with the params {list(params)}, but these worlds have {list(known)}. Make the "
            f"randomizer with params={list(params)}."
        )
    names = ("param", *columns("draw", "pose")) if params == known else columns("draw", "pose")
    read: Any = getattr if isinstance(layouts, LayoutTable) else column_of
    rows = {name: read(layouts, name) for name in names}
    return view_of(len(rows["qpos"]), device, rows)
