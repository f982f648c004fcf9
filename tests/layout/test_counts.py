"""Counts: integers of all libraries, within a range, and everything else refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from sceniris_gym.errors import CountError
from sceniris_gym.layout.counts import MOST_WORLDS, as_count, as_shape


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
    with pytest.raises(CountError, match="n should be"):
        as_count(value, "n")


def test_the_range_is_the_caller_s():
    """Both ends belong to it."""
    assert as_count(0, "n", 0) == 0
    assert as_count(5, "n", 1, 5) == 5
    with pytest.raises(CountError, match="n should be at most 5, got 6"):
        as_count(6, "n", 1, 5)


def test_an_integer_is_a_shape_of_one_axis():
    """As in NumPy; lengths are counts from 0 on."""
    assert as_shape(3, "s") == as_shape([np.int64(3)], "s") == (3,)
    assert as_shape((), "s") == ()
    for wrong in (2.5, (3, -1), "3"):
        with pytest.raises(CountError, match="s should be"):
            as_shape(wrong, "s")  # type: ignore[arg-type]
