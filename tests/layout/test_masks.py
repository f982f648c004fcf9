"""Masks and rows of all libraries: what arrives on the device, and what is refused with what words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentError, ArgumentTypeError
from sceniris_gym.layout.masks import (
    MOST_WORLDS,
    as_count,
    as_host_mask,
    as_rows,
    as_shape,
    as_world_ids,
    as_worlds,
    check_mask,
    mask_of_ids,
    mask_of_rows,
)

CPU = wp.get_device("cpu")
MASK = [True, False, False, True, True]


@pytest.mark.parametrize(
    "make",
    [
        np.array,
        lambda values: np.array([[v, not v] for v in values])[:, 0],  # every second element of a larger array
        torch.tensor,
        lambda values: torch.tensor([[v, not v] for v in values])[:, 0],
        lambda values: wp.array(values, dtype=wp.bool, device="cpu"),
    ],
    ids=["numpy", "numpy view", "torch", "torch view", "warp"],
)
def test_masks_of_all_libraries_arrive_as_they_are(make):
    """True where they were true, as Warp booleans, and what was given stays as it was."""
    given = make(MASK)
    found = as_worlds(given, 5, CPU)
    assert found is not None
    assert isinstance(found, wp.array)
    assert (found.dtype, found.device) == (wp.bool, CPU)
    assert found.numpy().tolist() == MASK
    assert np.asarray(given.numpy() if hasattr(given, "numpy") else given).tolist() == MASK


@pytest.mark.parametrize(
    "given",
    [
        torch.ones(5, dtype=torch.bool, device="meta"),
        torch.ones(5, dtype=torch.bool).to_sparse(),
        np.ma.array(np.ones(5, bool), mask=MASK),
    ],
    ids=["meta", "sparse", "masked"],
)
def test_a_mask_without_all_its_values_is_refused(given: Any):
    """Warp would read memory that is not there, or what was masked."""
    with pytest.raises(ArgumentError, match="worlds should be a dense array"):
        as_worlds(given, 5, CPU)


def test_rows_without_values_or_of_different_lengths_are_refused():
    """As masks are."""
    with pytest.raises(ArgumentError, match="rows should be a dense array"):
        as_rows(torch.ones(5, dtype=torch.int32, device="meta"), 5, 5, CPU)
    with pytest.raises(ArgumentTypeError, match="rows should be integers"):
        as_rows([[1], [1, 2]], 5, 5, CPU)


def test_masks_that_run_backwards_arrive_in_their_order():
    """Negative strides are no matter."""
    found = as_worlds(np.array(MASK)[::-1], 5, CPU)
    assert found is not None
    assert found.numpy().tolist() == MASK[::-1]
    assert as_rows(np.arange(5)[::-1], 5, 5, CPU).numpy().tolist() == [4, 3, 2, 1, 0]


def test_what_was_computed_with_gradients_is_taken_too():
    """A comparison has none, but its tensors may come from where they are recorded."""
    scores = torch.tensor([0.2, -0.1], requires_grad=True)
    found = as_worlds(scores > 0, 2, CPU)
    assert found is not None
    assert found.numpy().tolist() == [True, False]


@pytest.mark.parametrize("check", [lambda m: check_mask(m, 2, "chosen"), lambda m: as_host_mask(m, 2, "chosen")])
@pytest.mark.parametrize(
    ("mask", "error", "words"),
    [
        ([True, False], ArgumentTypeError, "boolean array of numpy, torch or Warp"),
        (None, ArgumentTypeError, "boolean array of numpy"),
        (True, ArgumentTypeError, "boolean array of numpy"),
        (np.array([1, 0]), ArgumentTypeError, "int64"),
        (np.array([1.0, 0.0]), ArgumentTypeError, "float64"),
        (np.array([True, None]), ArgumentTypeError, "object"),
        (torch.tensor([1, 0], dtype=torch.uint8), ArgumentTypeError, "uint8"),
        (wp.zeros(2, dtype=int, device="cpu"), ArgumentTypeError, "int"),
        (np.ones(3, bool), ArgumentError, r"shape \(2,\).* \(3,\)"),
        (np.ones((2, 1), bool), ArgumentError, r"shape \(2,\).* \(2, 1\)"),
        (np.array(True), ArgumentError, r"shape \(2,\).* \(\)"),
        (torch.ones(1, 2, dtype=torch.bool), ArgumentError, r"shape \(2,\).* \(1, 2\)"),
        (wp.zeros(3, dtype=wp.bool, device="cpu"), ArgumentError, r"shape \(2,\).* \(3,\)"),
    ],
)
def test_what_is_no_mask_is_named(check, mask: Any, error: type[Exception], words: str):
    """By the name that it has for the user, with its type or shape and the right one."""
    with pytest.raises(error, match=f"chosen.*{words}"):
        check(mask)


@pytest.mark.parametrize(
    ("worlds", "ids"),
    [
        (None, [0, 1, 2, 3, 4]),
        (MASK, [0, 3, 4]),
        ([], []),
        ((4, 2), [4, 2]),
        (slice(4, None, -2), [4, 2, 0]),
        (np.array([3, 3, 0]), [3, 3, 0]),
        (np.arange(5)[::-1], [4, 3, 2, 1, 0]),
        (torch.tensor([1]), [1]),
        (torch.tensor(MASK), [0, 3, 4]),
        (wp.array([2, 0], dtype=int, device="cpu"), [2, 0]),
    ],
)
def test_booleans_select_worlds_and_integers_number_them(worlds: Any, ids: list[int]):
    """NumPy's rule, for sequences, slices and arrays of all libraries; ids keep their order on the host."""
    assert as_world_ids(worlds, 5).tolist() == ids
    mask, memory = as_worlds(worlds, 5, CPU), wp.ones(5, dtype=wp.bool, device="cpu")
    assert (np.arange(5) if mask is None else np.flatnonzero(mask.numpy())).tolist() == sorted({*ids})
    again = as_worlds(worlds, 5, CPU, memory)
    assert again is memory or again is None or len(np.asarray(worlds)) == 5


@pytest.mark.parametrize("make", [list, np.array, torch.tensor, lambda v: wp.array(v, dtype=int, device="cpu")])
def test_integers_that_look_like_a_mask_are_refused(make):
    """As many as worlds, with repetitions: `mjw.reset_data` takes these as a mask."""
    for take in (lambda worlds: as_worlds(worlds, 4, CPU), lambda worlds: as_world_ids(worlds, 4)):
        with pytest.raises(ArgumentError, match="worlds should be booleans or ids: 4 integers with repetitions"):
            take(make([1, 0, 1, 0]))
        take(make([1, 0, 1]))


@pytest.mark.parametrize(
    ("worlds", "error", "words"),
    [
        ([0, 3], ArgumentError, r"worlds\[1\] should be from 0 to 2, got 3"),
        ([-1], ArgumentError, r"worlds\[0\] should be from 0 to 2, got -1"),
        (np.zeros((2, 2), int), ArgumentError, r"worlds should have shape \(k,\), .* got \(2, 2\)"),
        (2, ArgumentError, r"worlds should be booleans, ids or a slice, got 2\. For one world, pass \[2\]\."),
        ([True, False], ArgumentError, r"worlds should have shape \(3,\), .* got \(2,\)"),
        (np.ones((1, 3), bool), ArgumentError, r"worlds should have shape \(3,\)"),
        ([0.5], ArgumentTypeError, "worlds should hold booleans or ids, got float64"),
        ("here", ArgumentTypeError, "worlds should hold booleans or ids, got <U4"),
        ([[0], [0, 1]], ArgumentTypeError, "worlds should be integers"),
        (
            wp.zeros(2, dtype=wp.int64, device="cpu"),
            ArgumentTypeError,
            "Warp array of int32, got int64",
        ),
        (slice("a", None), ArgumentError, r"worlds should be a slice of integers, got slice\('a', None, None\): "),
        (slice(0, 2, 0), ArgumentError, r"worlds should be a slice of integers, got slice\(0, 2, 0\): "),
    ],
)
def test_what_are_no_worlds_is_named(worlds: Any, error: type[Exception], words: str):
    """With the place of the wrong one, or its type and shape."""
    for take in (lambda: as_worlds(worlds, 3, CPU), lambda: as_world_ids(worlds, 3)):
        with pytest.raises(error, match=words):
            take()


@pytest.mark.parametrize("make", [torch.tensor, lambda ids: wp.array(ids, dtype=int, device="cpu")])
def test_ids_and_rows_that_do_not_exist_are_refused_on_the_host(make):
    """By their place, in tensors and Warp arrays as in lists. A capture does not know them yet."""
    for wrong in (7, -2):
        with pytest.raises(ArgumentError, match=rf"worlds\[1\] should be from 0 to 4, got {wrong}"):
            as_worlds(make([0, wrong]), 5, CPU)
        with pytest.raises(ArgumentError, match=rf"rows\[1\] should be from 0 to 4, or -1 for none, got {wrong}"):
            as_rows(make([0, wrong]), 5, 2, CPU)
    ids, memory = wp.array([0, 7], dtype=int, device="cpu"), wp.zeros(5, dtype=wp.bool, device="cpu")
    with wp.ScopedCapture(CPU) as capture:
        as_worlds(ids, 5, CPU, memory)
    ids.assign([3, 9])
    wp.capture_launch(capture.graph)
    assert np.flatnonzero(memory.numpy()).tolist() == [3]


@pytest.mark.cuda
def test_ids_on_a_gpu_are_not_read():
    """Worlds that do not exist are passed over."""
    mask = as_worlds(torch.tensor([0, 7], device="cuda:0"), 5, "cuda:0")
    assert mask is not None
    assert np.flatnonzero(mask.numpy()).tolist() == [0]


@pytest.mark.parametrize(
    "make",
    [
        list,
        tuple,
        np.array,
        lambda rows: np.array(rows, np.int8),
        torch.tensor,
        lambda rows: torch.tensor(rows, dtype=torch.int32),
        lambda rows: wp.array(rows, dtype=wp.int32, device="cpu"),
    ],
    ids=["list", "tuple", "int64", "int8", "torch int64", "torch int32", "warp"],
)
def test_rows_of_all_libraries_arrive_as_they_are(make):
    """As 32-bit integers, -1 for none among them."""
    found = as_rows(make([3, -1, 0, 3]), 4, 4, CPU)
    assert (found.dtype, found.device) == (wp.int32, CPU)
    assert found.numpy().tolist() == [3, -1, 0, 3]


@pytest.mark.parametrize(
    ("rows", "error", "words"),
    [
        ([0, 4], ArgumentError, r"rows\[1\] should be from 0 to 3, or -1 .* got 4"),
        ((-2, 0), ArgumentError, r"rows\[0\] should be .* got -2"),
        (np.array([0, 2**40]), ArgumentError, r"rows\[1\] should be .* got 1099511627776"),
        ([0, 1, 2], ArgumentError, r"shape \(2,\).* \(3,\)"),
        (torch.zeros(2, 1, dtype=torch.int64), ArgumentError, r"shape \(2,\).* \(2, 1\)"),
        ([0.0, 1.0], ArgumentTypeError, "float64"),
        (np.array([True, False]), ArgumentTypeError, "bool"),
        (torch.tensor([0.0, 1.0]), ArgumentTypeError, "float32"),
        (wp.zeros(2, dtype=float, device="cpu"), ArgumentTypeError, "float32"),
        (["0", "1"], ArgumentTypeError, "<U1"),
    ],
)
def test_what_are_no_rows_is_named(rows: Any, error: type[Exception], words: str):
    """With the place of the wrong one where the host can see it."""
    with pytest.raises(error, match=words):
        as_rows(rows, 4, 2, CPU)


def test_rows_and_numbers_of_worlds_become_masks():
    """True where the row of a world exists, and for worlds that are named; numbers of no world are passed over."""
    mask = wp.zeros(3, dtype=wp.bool, device="cpu")
    mask_of_rows(wp.array([0, -1, 2], dtype=int, device="cpu"), 2, mask)
    assert mask.numpy().tolist() == [True, False, False]
    mask_of_ids(wp.array([2, 1, 2, -1, 3], dtype=int, device="cpu"), mask)
    assert mask.numpy().tolist() == [False, True, True]


@pytest.mark.parametrize("make", [np.array, torch.tensor, lambda values: wp.array(values, dtype=wp.bool, device="cpu")])
def test_masks_on_the_host_are_copies(make):
    """Of all libraries: a later change of one does not change the other."""
    given = make(MASK)
    found = as_host_mask(given, 5)
    assert isinstance(found, np.ndarray)
    found[:] = ~found
    assert np.asarray(given.numpy() if hasattr(given, "numpy") else given).tolist() == MASK


@pytest.mark.parametrize("value", [3, np.int8(3), np.uint64(3), torch.tensor(3)])
def test_integers_of_all_libraries_are_counts(value: Any):
    """As an int."""
    assert type(as_count(value, "n")) is int
    assert as_count(value, "n") == 3


@pytest.mark.parametrize(
    "value", [0, -1, 1.0, "3", None, True, [3], MOST_WORLDS + 1, pytest.param(10**5000, id="long")]
)
def test_what_is_no_count_is_refused(value: Any):
    """By its name."""
    with pytest.raises(ArgumentError, match="n should be"):
        as_count(value, "n")


def test_the_range_is_the_caller_s():
    """Both ends belong to it."""
    assert as_count(0, "n", 0) == 0
    assert as_count(5, "n", 1, 5) == 5
    with pytest.raises(ArgumentError, match="n should be at most 5, got 6"):
        as_count(6, "n", 1, 5)


def test_an_integer_is_a_shape_of_one_axis():
    """As in NumPy; lengths are counts from 0 on."""
    assert as_shape(3, "s") == as_shape([np.int64(3)], "s") == (3,)
    assert as_shape((), "s") == ()
    for wrong in (2.5, (3, -1), "3"):
        with pytest.raises(ArgumentError, match="s should be"):
            as_shape(wrong, "s")  # pyrefly: ignore[bad-argument-type]
