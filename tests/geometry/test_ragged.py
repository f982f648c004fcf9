"""Many lists as one array: every list is found again at its address."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.geometry.ragged import ranges


@pytest.mark.parametrize(
    "lists",
    [[], [[]], [[], []], [[3, 1, 2]], [[1], [], [2, 3], [], []], [[], [5, 5, 5, 5], [7]]],
    ids=str,
)
def test_every_list_is_found_at_its_address(lists: list[list[int]]):
    """Also empty ones, wherever they are; nothing is added, and nothing lost."""
    flat, adr, num = ranges(lists)
    assert len(adr) == len(num) == len(lists)
    assert [flat[a : a + n] for a, n in zip(adr, num, strict=True)] == lists
    assert len(flat) == sum(map(len, lists))


def test_addresses_are_whole_numbers_in_ascending_order():
    """Of many lists of random lengths, as a kernel can take them; without any list as well."""
    lengths = np.random.default_rng(0).integers(0, 5, 300)
    for lists in ([range(n) for n in lengths], []):
        _, adr, num = ranges(lists)
        assert adr.dtype == num.dtype == int
        assert (np.diff(adr) == num[:-1]).all()


def test_lists_may_come_one_by_one_and_hold_anything():
    """A generator of arrays and tuples: entries stay what they are, rows of an array are entries."""
    rows = np.arange(6.0).reshape(3, 2)
    flat, adr, num = ranges(part for part in (rows, (None, "b"), np.zeros((0, 2))))
    np.testing.assert_array_equal(flat[:3], rows)
    assert flat[3:] == [None, "b"]
    assert (adr.tolist(), num.tolist()) == ([0, 3, 5], [3, 2, 0])
