"""The `furniture` command: writes kitchen furniture with drawn sizes."""

from collections import Counter
from pathlib import Path
from typing import Any

from sceniris_gym.builders.furniture import MANIFEST, furniture


def write(folder: Path, num: int, seed: int, height: float, turning: bool) -> dict[str, Any]:
    """Write units of furniture, and return the path of the manifest and the number of units of each kind.

    Raises:
        ScenirisError: See `sceniris_gym.builders.furniture.furniture`.
    """
    manifest = furniture(folder, num, seed, height, turning)
    return {"manifest": str(folder / MANIFEST), "units": Counter(unit["kind"] for unit in manifest["units"])}
