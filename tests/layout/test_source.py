"""Promises of every source of layouts, and the little that is asked of one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentTypeError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts, LayoutStatus, LayoutsView
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.layout.scenes import compile_on_cpu, prefetched

NWORLD = 4
Maker = Callable[[CompiledScene], LayoutSource]


@wp.kernel(enable_backward=False)
def _lift(mask: wp.array[wp.bool], layouts: LayoutsView):
    i = wp.tid()
    if not mask or mask[i]:
        layouts.qpos[i, 2] = float(layouts.pending_episode[i])


class Lifted(LayoutSource):
    """A source of somebody's own, with nothing but what it has to have: it lifts the first object by 1 m."""

    def __init__(self, compiled: CompiledScene) -> None:
        self.layouts = Layouts.create(compiled, NWORLD)

    def launch_make(self, mask: wp.array | None) -> None:
        """Lift."""
        wp.launch(_lift, dim=NWORLD, inputs=[mask, self.layouts.view], device=self.layouts.view.qpos.device)


class Counted(Lifted):
    """A source that counts the resets behind which something is done."""

    resets = 0

    def after_reset(self) -> None:
        """Count."""
        self.resets += 1


def fresh(compiled: CompiledScene) -> LayoutSource:
    """Return a generator."""
    return LayoutGenerator(compiled, NWORLD, seed=30)


def stored(compiled: CompiledScene) -> LayoutSource:
    """Return a source of layouts that are stored."""
    return StoredLayouts(compiled, make_table(compiled, 40, 0), NWORLD, seed=30)


def prepared(compiled: CompiledScene) -> LayoutSource:
    """Return a generator that works ahead."""
    return prefetched(LayoutGenerator(compiled, NWORLD, seed=30))


SOURCES = pytest.mark.parametrize("make", [fresh, stored, prepared])


@pytest.fixture(scope="module")
def mid() -> CompiledScene:
    """The shipped scene `mid`."""
    return compile_on_cpu("mid")


def mask_of(values: list[bool]) -> wp.array:
    """Return a mask on the device."""
    return wp.array(values, dtype=wp.bool, device="cpu")


@SOURCES
def test_masked_worlds_go_on_by_one_episode(mid: CompiledScene, make: Maker):
    """The others keep their layouts to the bit; without a mask all go on, and each layout is a new one."""
    source = make(mid)
    assert source.layouts.episode.numpy().tolist() == [-1] * NWORLD
    source.launch_generate(None)
    assert source.layouts.episode.numpy().tolist() == [0] * NWORLD
    assert (source.layouts.status.numpy() != LayoutStatus.NONE).all()
    before = source.layouts.qpos.numpy().copy()
    source.launch_generate(mask_of([True, False, False, True]))
    assert source.layouts.episode.numpy().tolist() == [1, 0, 0, 1]
    after = source.layouts.qpos.numpy()
    np.testing.assert_array_equal(after[[1, 2]], before[[1, 2]])
    assert (after[[0, 3]] != before[[0, 3]]).any(axis=1).all()


@SOURCES
def test_new_seeds_start_again_at_their_first_episode(mid: CompiledScene, make: Maker):
    """In the masked worlds: layouts do not depend on what was made before, nor on which world makes them."""
    source, other = make(mid), make(mid)
    source.launch_generate(None)
    first = source.layouts.qpos.numpy().copy()  # of seeds 30 to 33
    for _ in range(2):
        other.launch_generate(None)
    other.launch_reseed(wp.array([33, 1, 30, 2], dtype=wp.uint64, device="cpu"), mask_of([True, False, True, False]))
    assert other.layouts.seed.numpy().tolist() == [30, 31, 32, 33]  # until the next layouts are served
    assert other.layouts.episode.numpy().tolist() == [1] * NWORLD
    other.launch_generate(None)
    np.testing.assert_array_equal(other.layouts.qpos.numpy()[[0, 2]], first[[3, 0]])
    assert other.layouts.seed.numpy().tolist() == [33, 31, 30, 33]
    assert other.layouts.episode.numpy().tolist() == [0, 2, 0, 2]


@SOURCES
def test_layouts_are_the_same_arrays_for_ever(mid: CompiledScene, make: Maker):
    """So that what reads them can be captured, and the launches with it."""
    source = make(mid)
    names = ("seed", "episode", "qpos", "mocap_pos", "mocap_quat", "status", "present", "grasp", "grasp_qpos")
    before = [getattr(source.layouts, name).data_ptr() for name in names]
    with wp.ScopedCapture(device="cpu") as capture:
        source.launch_generate(None)
    source.launch_reseed(wp.array([5, 6, 7, 8], dtype=wp.uint64, device="cpu"), None)
    for episode in range(3):
        wp.capture_launch(capture.graph)
        assert source.layouts.episode.numpy().tolist() == [episode] * NWORLD
    assert [getattr(source.layouts, name).data_ptr() for name in names] == before


@SOURCES
def test_rejections_are_counted_by_object_and_cause(mid: CompiledScene, make: Maker):
    """Names and numbers; there are none where nothing is searched for."""
    source = make(mid)
    source.launch_generate(None)
    for name, causes in source.rejection_counts().items():
        assert name in mid.placed
        assert all(isinstance(count, int) and count >= 0 for count in causes.values())


@pytest.mark.parametrize("make", [fresh, stored, Lifted])
def test_a_randomizer_takes_every_source(mid: CompiledScene, make: Maker):
    """A randomizer writes the layouts that its source has made, also those of somebody's own class."""
    batch, source = Batch(mid.scene, NWORLD, "cpu"), make(mid)
    randomizer = ResetRandomizer(mid, batch.model, batch.data, layout_source=source)
    randomizer.reseed(seed=[1, 2, 3, 4])
    for mask in (None, np.array([True, False, True, False])):
        randomizer.reset(mask)
        np.testing.assert_array_equal(batch.data.qpos.numpy(), source.layouts.qpos.numpy())
    assert source.layouts.seed.numpy().tolist() == [1, 2, 3, 4]
    assert source.layouts.episode.numpy().tolist() == [1, 0, 1, 0]
    assert randomizer.rejection_counts() == source.rejection_counts()


@pytest.mark.usefixtures("recorded")
def test_something_may_follow_every_reset(mid: CompiledScene):
    """Behind its launches, captured or not, whichever way worlds are chosen; nothing follows a write of layouts."""
    for graph in (True, False):
        batch, source = Batch(mid.scene, NWORLD, "cpu"), Counted(mid)
        randomizer = ResetRandomizer(mid, batch.model, batch.data, layout_source=source, graph=graph)
        randomizer.reset()
        randomizer.reset([2])
        randomizer.launch_reset(mask_of([False, True, False, False]))
        source.generate(np.array([False, True, False, False]))
        assert source.resets == 4
        assert source.layouts.episode.numpy().tolist() == [0, 2, 1, 0]
        randomizer.write(source.layouts, [0, -1, -1, -1])
        assert source.resets == 4


def test_what_is_no_source_is_refused(mid: CompiledScene):
    """Also where it has methods of the same names."""
    batch = Batch(mid.scene, NWORLD, "cpu")
    with pytest.raises(
        ArgumentTypeError,
        match="should be a LayoutSource, LayoutTable, LayoutDataset or",
    ):
        ResetRandomizer(mid, batch.model, batch.data, layout_source=object())  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(ArgumentTypeError, match=r"LayoutSource: should implement the method `launch_make\(mask\)`"):
        LayoutSource().launch_make(None)


@SOURCES
def test_masks_and_seeds_of_all_libraries_are_taken(mid: CompiledScene, make: Maker):
    """With the same checks as a randomizer's."""
    source = make(mid)
    for mask in (np.array([True, False, False, False]), torch.tensor([True, True, False, False])):
        source.generate(mask)
    source.generate(mask_of([True, True, True, False]))
    assert source.layouts.episode.numpy().tolist() == [2, 1, 0, -1]
    source.reseed(np.array([True, False, False, True]), seed=[7, 8, 9, 10])
    source.generate()
    assert source.layouts.seed.numpy().tolist() == [7, 31, 32, 10]
    assert source.layouts.episode.numpy().tolist() == [0, 2, 1, 0]
