"""The `settle` command: settles a scene's heap many times in MuJoCo C. Each result is a row of poses for layouts."""

from pathlib import Path
from typing import Any

from sceniris_gym.commands.options import checked_target
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, check_names
from sceniris_gym.files import replacing
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.settling import settle as settled


def settle(config: SceneConfig, heap: str | None, num: int, out: Path | None, seed: int) -> dict[str, Any]:
    """Settle a heap of a scene `num` times, and write the poses of its objects, one row per result.

    Args:
        config: The scene.
        heap: The name of the heap, or None for the only heap of the scene.
        num: Number of rows.
        out: File to write, or None for the path in the scene.
        seed: Row i depends only on the seed and on i.

    Raises:
        UnknownNameError: The heap is unknown.
        NotSupportedError: `heap` is None and the scene has no heap or several, or the output path is missing.
        SceneKeyError: The container does not hold the objects.
    """
    if heap is None and len(config.heaps) != 1:
        listed = ", ".join(config.heaps) or "none"
        raise NotSupportedError(f"settle: the heap is missing. Give --heap NAME. Heaps of {config.where}: {listed}.")
    heap = next(iter(config.heaps)) if heap is None else heap
    check_names("heap", [heap], config.where, config.heaps)
    named = config.heaps[heap].rows
    if out is None and named is None:
        raise NotSupportedError(f"settle: no file to write. Give -o ROWS.npz, or heaps.{heap}.rows in the scene.")
    path = checked_target(out, str(named))
    rows = settled(build_model(config), heap, num, seed)
    with replacing(path) as temporary:
        rows.write(temporary)
    return {"heap": heap, "things": list(rows.names), "rows": len(rows.pos), "file": str(path)}


def report(found: dict[str, Any]) -> str:
    """Return the settled heap as text."""
    things = f"{len(found['things'])} objects"
    return f"{found['file']}: {found['rows']} heaps of {things}. Set heaps.{found['heap']}.rows to the file."
