"""What cannot be sent to another process says what to send instead; a CompiledScene is compiled there again."""

from __future__ import annotations

from typing import NoReturn

from sceniris_gym.errors import NotSupportedError


class StaysHere:
    """Base of what holds memory of a device, and so belongs to one process.

    Attributes:
        SEND: What to send instead, as a message says it.
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
