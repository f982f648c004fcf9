"""`Fixed`: refuses assignments to attributes that captured graphs already use, which would have no effect."""

from __future__ import annotations

from typing import Any, ClassVar

from sceniris_gym.errors import FixedError


class Fixed:
    """Base class of objects whose launches are captured with the arrays of one scene.

    Attributes:
        FIXED: Attributes that only the constructor sets.
        ARGUMENTS: Arguments of the constructor that are no attributes: assigning to them would have no effect either.
    """

    FIXED: ClassVar[tuple[str, ...]] = ()
    ARGUMENTS: ClassVar[tuple[str, ...]] = ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute.

        Raises:
            FixedError: A fixed one, or an argument.
        """
        if name in self.ARGUMENTS or (name in self.FIXED and name in self.__dict__):
            raise FixedError(type(self).__name__, name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        """Delete an attribute.

        Raises:
            FixedError: A fixed one.
        """
        if name in self.FIXED:
            raise FixedError(type(self).__name__, name)
        super().__delattr__(name)
