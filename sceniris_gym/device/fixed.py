"""Base classes of objects that hold device memory.

Such an object cannot be sent to another process. If a captured graph uses an array of the object, the attribute that
holds the array cannot be set.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

from sceniris_gym.errors import FixedError, NotSupportedError, new_name


class RefusesOldNames:
    """Base class for renamed attributes: reading an old name raises an AttributeError that gives the new name."""

    if not TYPE_CHECKING:  # a type checker would take any attribute to be there

        def __getattr__(self, name: str) -> Any:
            """Raise an AttributeError, which gives the new name of a renamed attribute."""
            if new := new_name(name, dir(self)):
                raise AttributeError(f"{type(self).__name__}:{new}")
            return object.__getattribute__(self, name)


class StaysHere(RefusesOldNames):
    """Base class of objects that hold device memory and therefore belong to one process.

    Attributes:
        _SEND: End of the error message on pickling. It names an object to send to the other process instead.
    """

    _SEND = "its CompiledScene or the scene's name to the other process, and construct a new object there"

    def __reduce__(self) -> NoReturn:
        """Reject pickling and copying.

        Raises:
            NotSupportedError: Always.
        """
        raise NotSupportedError(
            f"{type(self).__name__} holds device memory and cannot be pickled or copied. Send {self._SEND}."
        )


class Fixed:
    """Base class of objects whose kernel launches are captured in a graph.

    A captured graph keeps the arrays that it was captured with, so replacing an attribute later would have no effect.

    Attributes:
        _FIXED: Names of attributes that can be set only once, in the constructor.
        _ARGUMENTS: Names of constructor arguments that are not attributes. Setting one of them is an error.
    """

    _FIXED: ClassVar[tuple[str, ...]] = ()
    _ARGUMENTS: ClassVar[tuple[str, ...]] = ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute.

        Raises:
            FixedError: `name` is in `_FIXED` and the attribute is already set, or `name` is in `_ARGUMENTS`.
        """
        if name in self._ARGUMENTS or (name in self._FIXED and name in self.__dict__):
            raise FixedError(type(self).__name__, name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        """Delete an attribute.

        Raises:
            FixedError: `name` is in `_FIXED`.
        """
        if name in self._FIXED:
            raise FixedError(type(self).__name__, name)
        super().__delattr__(name)
