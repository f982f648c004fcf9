"""Paths as users write them: whatever they hold, what comes of it is a path or one of our errors."""

from __future__ import annotations

from pathlib import Path

from sceniris_gym.errors import SceneFileError


def user_path(text: str | Path, folder: Path, where: str) -> Path:
    """Return a path, relative ones below `folder`, with `~` as the home folder.

    Raises:
        SceneFileError: There is no such user, or no file system takes such a path.
    """
    try:
        path = folder / Path(text).expanduser()
        path.is_file()
    except (RuntimeError, ValueError, OSError) as error:
        shown = str(text) if len(str(text)) <= 80 else f"{str(text)[:77]}..."
        why = "there is no such user" if isinstance(error, RuntimeError) else getattr(error, "strerror", None) or error
        raise SceneFileError(
            f"{where}: {shown!r} is not a path: {str(why).lower()}. Give the path of a file."
        ) from None
    return path
