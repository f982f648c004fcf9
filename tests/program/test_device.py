"""The device program's fields: whatever the host hands over comes in the types that kernels are compiled for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.program.device import WORLD_FIELDS, Program, fill_struct
from sceniris_gym.program.device_reach import Reach


@wp.struct
class Held:
    """An array field of each kind."""

    count: int
    numbers: wp.array[int]
    lengths: wp.array[float]
    ids: wp.array[wp.uint64]
    pairs: wp.array[wp.vec2]
    triples: wp.array[wp.vec3i]
    turns: wp.array[wp.vec4]
    rows: wp.array2d[int]
    places: wp.array2d[wp.vec3]
    blocks: wp.array3d[float]


@wp.kernel(enable_backward=False, module="unique")
def _total(held: Held, out: wp.array[float]):
    """Sum all that a kernel sees, each entry once."""
    total = float(0.0)
    for i in range(held.numbers.shape[0]):
        total += float(held.numbers[i])
    for i in range(held.turns.shape[0]):
        for k in range(4):
            total += held.turns[i][k]
    for i in range(held.triples.shape[0]):
        for k in range(3):
            total += float(held.triples[i][k])
    for i in range(held.blocks.shape[0]):
        for j in range(held.blocks.shape[1]):
            for k in range(held.blocks.shape[2]):
                total += held.blocks[i, j, k]
    out[0] = total


def _arrays() -> dict[str, np.ndarray]:
    """Values for each field, in the types and layouts that numpy makes of them."""
    draws = np.random.default_rng(0)
    return {
        "numbers": np.array([True, False, True]),
        "lengths": np.arange(6)[::2],
        "ids": np.array([2**63 + 11, 1], np.uint64),
        "pairs": draws.random((2, 5)).T,
        "triples": draws.integers(-9, 9, (4, 3)),
        "turns": draws.random((3, 4)),
        "rows": np.arange(12).reshape(3, 4)[:, ::2],
        "places": draws.random((2, 5, 3)),
        "blocks": draws.random((2, 3, 4)).transpose(1, 0, 2),
    }


def test_arrays_come_in_the_declared_types_with_the_values_that_were_given():
    """From bool, int64, float64, and views that are not contiguous; what is no array is left alone."""
    held, arrays = Held(), _arrays()  # pyrefly: ignore[missing-argument]
    held.count = 7
    fill_struct(Held, held, arrays, "cpu")
    for name, values in arrays.items():
        field, found = Held.vars[name].type, getattr(held, name)  # pyrefly: ignore[missing-attribute]
        assert (found.dtype, found.ndim) == (field.dtype, field.ndim), name
        assert str(found.device) == "cpu"
        np.testing.assert_allclose(found.numpy().astype(float), values.astype(float), rtol=1e-6, err_msg=name)
    assert held.ids.numpy()[0] == 2**63 + 11
    assert held.count == 7


def test_a_kernel_sees_what_was_filled_in():
    """Strides and all."""
    held, arrays, out = Held(), _arrays(), wp.zeros(1, dtype=float, device="cpu")  # pyrefly: ignore[missing-argument]
    fill_struct(Held, held, arrays, "cpu")
    wp.launch(_total, dim=1, inputs=[held, out], device="cpu")
    expected = sum(float(arrays[name].sum()) for name in ("numbers", "turns", "triples", "blocks"))
    assert out.numpy()[0] == pytest.approx(expected, rel=1e-5)


def test_a_filled_field_does_not_change_with_the_array_it_was_filled_from():
    """The scene is frozen, whatever the host does with its own."""
    held, values = Held(), np.arange(4, dtype=np.int32)  # pyrefly: ignore[missing-argument]
    fill_struct(Held, held, {"numbers": values}, "cpu")
    values[:] = -1
    assert held.numbers.numpy().tolist() == [0, 1, 2, 3]


def test_a_field_that_is_not_declared_is_an_error():
    """A name that is misspelled is seen at once."""
    with pytest.raises(KeyError):
        fill_struct(Held, Held(), {"numbres": np.zeros(3)}, "cpu")  # pyrefly: ignore[missing-argument]


@pytest.mark.parametrize("declared", [Program, Reach], ids=["Program", "Reach"])
def test_every_field_of_a_scene_can_be_empty(declared: Any):
    """A list without entries is an array without entries of the same kind, and no null pointer."""
    fields = {name: var.type for name, var in declared.vars.items() if wp.types.is_array(var.type)}
    assert len(fields) > 20
    instance = declared()
    empty = {}
    for name, field in fields.items():
        ndim = field.ndim - (declared is Program and name in WORLD_FIELDS)  # one row for all worlds
        empty[name] = np.zeros((0,) * ndim + getattr(field.dtype, "_shape_", ()))
    fill_struct(declared, instance, empty, "cpu")
    for name, field in fields.items():
        found = getattr(instance, name)
        assert (found.dtype, found.ndim, found.size) == (field.dtype, field.ndim, 0), name
