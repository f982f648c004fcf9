"""Base classes of objects that hold device memory: one process owns them, and captured graphs use their attributes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

from sceniris_gym.errors import FixedError, NotSupportedError, new_name


class RefusesOldNames:
    """Base class of objects whose error for a renamed attribute gives the new name."""

    if not TYPE_CHECKING:  # a type checker would take any attribute to be there

        def __getattr__(self, name: str) -> Any:
            """Raise the error for a missing attribute."""
            if new := new_name(name, dir(self)):
                raise AttributeError(f"{type(self).__name__}:{new}")
            return object.__getattribute__(self, name)


class StaysHere(RefusesOldNames):
    """Base class of objects that hold device memory and therefore belong to one process.

    Attributes:
        _SEND: The end of the error message, which names an object to send instead.
    """

    _SEND = "its CompiledScene or the scene's name to the other process, and construct a new object there"

    def __reduce__(self) -> NoReturn:
        """Reject pickling and copying.

        Raises:
            NotSupportedError: Always.
        """
        raise NotSupportedError(
            f"{type(self).__name__} holds memory of a device and cannot be pickled or copied. Send {self._SEND}."
        )


class Fixed:
    """Base class of objects whose launches are captured with the arrays of one scene.

    Attributes:
        _FIXED: Attributes that only the constructor sets.
        _ARGUMENTS: Arguments of the constructor that are not attributes. Assigning to them would have no effect.
    """

    _FIXED: ClassVar[tuple[str, ...]] = ()
    _ARGUMENTS: ClassVar[tuple[str, ...]] = ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute.

        Raises:
            FixedError: The attribute is fixed, or is an argument of the constructor.
        """
        if name in self._ARGUMENTS or (name in self._FIXED and name in self.__dict__):
            raise FixedError(type(self).__name__, name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        """Delete an attribute.

        Raises:
            FixedError: The attribute is fixed.
        """
        if name in self._FIXED:
            raise FixedError(type(self).__name__, name)
        super().__delattr__(name)
