"""`TensorView`: an attribute that gives a Warp array as a torch tensor, which shares the array's memory."""

from collections.abc import Callable
from typing import Any

import warp as wp

from sceniris_gym.errors import FixedError


class TensorView:
    """An attribute that gives a Warp array as a torch tensor, which shares the array's memory. uint64 becomes int64.

    The first read imports torch and makes the tensor. Later reads return the same tensor, so the object with this
    attribute must never replace the array.

    Args:
        array: Function that returns the Warp array. Its arguments are the object and the name of the attribute.
    """

    def __init__(self, array: Callable[[Any, str], wp.array]) -> None:
        self._array = array

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, holder: Any, owner: type) -> Any:
        if holder is None:
            return self
        tensor = vars(holder).get(self._name)
        if tensor is None:
            array = self._array(holder, self._name)
            tensor = wp.to_torch(array.view(wp.int64) if array.dtype is wp.uint64 else array)
            if not tensor.is_inference():  # outside of inference mode it could not be written to
                vars(holder)[self._name] = tensor
        return tensor

    def __set__(self, holder: Any, value: Any) -> None:
        raise FixedError(type(holder).__name__, self._name)
