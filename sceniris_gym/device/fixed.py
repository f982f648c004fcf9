"""Objects that hold memory of a device: they belong to one process, and captured graphs use their attributes."""

from __future__ import annotations

from typing import Any, ClassVar, NoReturn

from sceniris_gym.errors import FixedError, NotSupportedError


class StaysHere:
    """Base class of objects that hold memory of a device, and so belong to one process.

    Attributes:
        _SEND: The object to send instead, as the error message says it.
    """

    _SEND = "its CompiledScene, which is compiled again where it arrives, or the scene's name, and make it there"

    def __reduce__(self) -> NoReturn:
        """Refuse to be pickled or copied.

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
        _ARGUMENTS: Arguments of the constructor that are no attributes: assigning to them would have no effect either.
    """

    _FIXED: ClassVar[tuple[str, ...]] = ()
    _ARGUMENTS: ClassVar[tuple[str, ...]] = ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute.

        Raises:
            FixedError: A fixed one, or an argument.
        """
        if name in self._ARGUMENTS or (name in self._FIXED and name in self.__dict__):
            raise FixedError(type(self).__name__, name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        """Delete an attribute.

        Raises:
            FixedError: A fixed one.
        """
        if name in self._FIXED:
            raise FixedError(type(self).__name__, name)
        super().__delattr__(name)
