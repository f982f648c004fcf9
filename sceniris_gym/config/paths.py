"""Paths as users write them, resolved or refused with an error of our own."""

from __future__ import annotations

from pathlib import Path

from sceniris_gym.config.messages import short
from sceniris_gym.errors import SceneFileError


def user_path(text: str | Path, folder: Path, where: str) -> Path:
    """Return a path, relative ones below `folder`, with `~` as the home folder.

    Raises:
        SceneFileError: It is not a path, there is no such user, or no file system accepts such a path.
    """
    try:
        path = folder / Path(text).expanduser()
        path.is_file()
    except (RuntimeError, ValueError, OSError, TypeError) as error:
        why = "there is no such user" if isinstance(error, RuntimeError) else getattr(error, "strerror", None) or error
        raise SceneFileError(
            f"{where}: {short(str(text))} is not a path: {str(why).lower()}. Give the path of a file."
        ) from None
    return path
