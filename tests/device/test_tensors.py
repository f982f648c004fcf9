"""Attributes that are torch tensors in the memory of Warp arrays."""

from __future__ import annotations

import pytest
import torch
import warp as wp

from sceniris_gym.device.tensors import TensorView
from sceniris_gym.errors import FixedError


class Holder:
    """Holds an array of each kind."""

    whole, seed, flag, vector = (TensorView(lambda holder, name: holder.arrays[name]) for _ in range(4))

    def __init__(self) -> None:
        types = {"whole": int, "seed": wp.uint64, "flag": wp.bool, "vector": wp.vec3}
        self.arrays = {name: wp.zeros(2, dtype=dtype, device="cpu") for name, dtype in types.items()}


def test_a_tensor_shares_memory_and_is_made_once():
    """Unsigned words of 64 bits are signed, vectors have an axis, and booleans stay so."""
    holder = Holder()
    for name, array in holder.arrays.items():
        assert getattr(holder, name) is getattr(holder, name)
        assert getattr(holder, name).data_ptr() == array.ptr
    holder.arrays["seed"].fill_(2**64 - 1)
    holder.flag[1] = True
    assert (holder.seed.tolist(), holder.arrays["flag"].numpy().tolist()) == ([-1, -1], [False, True])
    found = {name: (getattr(holder, name).dtype, getattr(holder, name).shape) for name in holder.arrays}
    assert found == {
        "whole": (torch.int32, (2,)),
        "seed": (torch.int64, (2,)),
        "flag": (torch.bool, (2,)),
        "vector": (torch.float32, (2, 3)),
    }


def test_a_tensor_of_inference_mode_is_not_kept():
    """Nobody could write to it later: torch refuses that for tensors that were made in this mode."""
    holder = Holder()
    with torch.inference_mode():
        assert holder.whole.tolist() == [0, 0]
    holder.whole.add_(1)
    assert holder.arrays["whole"].numpy().tolist() == [1, 1]


def test_the_attribute_cannot_be_replaced():
    """The array would go on as it was; the class has the description itself, which tools may look at."""
    with pytest.raises(FixedError, match=r"Holder\.seed cannot be changed"):
        Holder().seed = torch.zeros(2)
    assert isinstance(Holder.seed, TensorView)
