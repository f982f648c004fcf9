"""`StaysHere`: refuses pickling, and names what to send to another process instead."""

from __future__ import annotations

from typing import NoReturn

from sceniris_gym.errors import NotSupportedError


class StaysHere:
    """Base class of objects that hold memory of a device, and so belong to one process.

    Attributes:
        SEND: The object to send instead, as the error message says it.
    """

    SEND = "its CompiledScene, which is compiled again where it arrives, or the scene's name, and make it there"

    def __reduce__(self) -> NoReturn:
        """Refuse to be pickled or copied.

        Raises:
            NotSupportedError: Always.
        """
        raise NotSupportedError(
            f"{type(self).__name__} holds memory of a device and cannot be pickled or copied. Send {self.SEND}."
        )
