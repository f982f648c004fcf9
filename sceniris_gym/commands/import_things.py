"""The `import` command: turns a mesh file, or a folder of mesh files, into assets with pictures."""

import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.errors import NotSupportedError, SceneFileError
from sceniris_gym.importers.things.folder import Outcome, import_folder, things_in
from sceniris_gym.importers.things.importer import SUFFIXES, Options, import_thing
from sceniris_gym.importers.things.units import Ask
from sceniris_gym.scene.layout_table import LayoutTable


def import_one(source: Path, out: Path, options: Options, ask: Ask | None, device: str | None) -> dict[str, Any]:
    """Import a mesh file, and draw the asset.

    Returns:
        The manifest, with the paths of the asset and its picture.

    Raises:
        NotSupportedError: The asset's name does not end in .xml.
        ScenirisError: See `import_thing`.
    """
    if out.suffix != ".xml":
        raise NotSupportedError(f"--out {out}: the asset is written as MJCF. Give a path that ends in .xml.")
    return import_thing(source, out, options, ask) | {"asset": str(out), "picture": str(draw(out, device))}


def import_many(folder: Path, out: Path, options: Options, jobs: int | None, device: str | None) -> dict[str, Any]:
    """Import all mesh files below a folder, draw the assets, and print progress to stderr.

    Returns:
        The number of imported files, the rejected files with reasons, and the manifest's path.

    Raises:
        NotSupportedError: `out` is an MJCF file.
        SceneFileError: The folder holds no files to import.
    """
    if out.suffix == ".xml":
        raise NotSupportedError(f"--out {out}: a folder of files becomes a folder of assets. Give a folder, not .xml.")
    sources = things_in(folder)
    if not sources:
        raise SceneFileError(f"{folder}: contains no files to import. Give a folder with {', '.join(SUFFIXES)}.")
    outcomes = import_folder(sources, out, options, jobs=jobs, done=_tell)
    for outcome in outcomes:
        if outcome.asset is not None:
            draw(outcome.asset, device)
    return {
        "imported": sum(outcome.asset is not None for outcome in outcomes),
        "refused": {str(o.source): f"{type(o.error).__name__}: {o.error}" for o in outcomes if o.error is not None},
        "manifest": str(out / "manifest.json"),
    }


def draw(asset: Path, device: str | None) -> Path:
    """Draw an asset in its start pose into the asset's folder, and return the path of the picture."""
    from sceniris_gym.pictures.layout_picture import CAMERA, captioned, save

    spec = mujoco.MjSpec.from_file(str(asset))
    spec.worldbody.add_camera(name=CAMERA, fovy=40.0)
    spec.worldbody.add_light(pos=[1.0, -2.0, 4.0], dir=[-0.2, 0.4, -0.9], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    mjm = spec.compile()
    table = LayoutTable.from_states(mjm.qpos0[None], np.zeros((1, 0, 3)), np.zeros((1, 0, 4)), np.ones((1, 1), bool))
    picture = asset.parent / asset.stem / "picture.png"
    save(captioned(mjm, table, [asset.stem], device=device), picture)
    return picture


def report(found: dict[str, Any]) -> str:
    """Return the manifest of one asset as text."""
    rests = [rest["moved_mm"] for rest in found["rests"] if rest["moved_mm"] < 10.0]
    lines = [
        f"{found['source']} -> {found['asset']}",
        f"  size      {' x '.join(f'{v:.3g}' for v in found['size_m'])} m ({found['meters_per_unit']:g} m per unit, "
        f"{found['scale']})",
        f"  up        {found['up']} ({found['up_from']})",
        f"  mass      {found['mass_kg']:.3g} kg",
        f"  repaired  {'; '.join(found['repaired']) or 'nothing: it was closed'}",
        f"  parts     {found['parts']} convex ({found['method']}), {found['error_mm']:.2g} mm off the surface at most; "
        f"{found['tolerance_mm']:.2g} mm allowed",
        f"  rests     in {len(rests)} poses for half a second, moving {max(rests, default=0.0):.2g} mm at most",
        f"  grasps    {found['grasps']} antipodal, as sites",
        *(f"  note      {note}" for note in found["notes"]),
        f"  picture   {found['picture']}",
    ]
    return "\n".join(lines)


def _tell(outcome: Outcome) -> None:
    made = outcome.manifest
    told = f"refused: {outcome.error}" if made is None else f"{made['parts']} parts, {made['error_mm']:.2g} mm off"
    print(f"{outcome.source}: {told}", file=sys.stderr, flush=True)
