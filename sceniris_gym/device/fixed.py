"""What captured graphs hold on to cannot be exchanged: an assignment is refused rather than without effect."""

from __future__ import annotations

from typing import Any, ClassVar

from sceniris_gym.errors import FixedError


class Fixed:
    """Base of what is made for one scene and keeps it, as its launches are captured with the arrays of that scene.

    Attributes:
        FIXED: Attributes that are set once, by the constructor.
        ARGUMENTS: Arguments of the constructor that are no attributes, and so would be new ones without a meaning.
    """

    FIXED: ClassVar[tuple[str, ...]] = ()
    ARGUMENTS: ClassVar[tuple[str, ...]] = ()

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute.

        Raises:
            FixedError: One that is fixed.
        """
        if name in self.ARGUMENTS or (name in self.FIXED and name in self.__dict__):
            raise FixedError(type(self).__name__, name)
        super().__setattr__(name, value)

    def __delattr__(self, name: str) -> None:
        """Delete an attribute.

        Raises:
            FixedError: One that is fixed.
        """
        if name in self.FIXED:
            raise FixedError(type(self).__name__, name)
        super().__delattr__(name)
