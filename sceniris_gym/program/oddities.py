"""What is accepted although it was probably not meant: one warning for each kind, with its extent and the remedy."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

from sceniris_gym.errors import ModelWarning
from sceniris_gym.geometry.pieces import flat_faces, geom_name
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.model import SceneModel


def warn_of_oddities(scene: SceneModel, plan: Plan) -> None:
    """Warn of what is odd in a scene: `ModelWarning`, once for each kind of oddity."""
    for text in (*_flat(scene, plan),):
        warnings.warn(f"{scene.config.where}: {text}", ModelWarning, stacklevel=2)


def _flat(scene: SceneModel, plan: Plan) -> Iterator[str]:
    """Faces without area, which have no inside and no normal."""
    if scene.config.geometry != "visual":
        return
    counts = {p.geom: int(flat_faces(p.mesh.triangles).sum()) for p in plan.pieces if p.mesh is not None}
    found = [f"{count} of geom '{geom_name(scene.mjm, geom)}'" for geom, count in counts.items() if count]
    if found:
        yield (
            f"faces without area are left out: {_some(found)}. Nothing is lost if the mesh is closed without them; "
            "merge its vertices and remove degenerate faces to be rid of this."
        )


def _some(found: list[str], most: int = 5) -> str:
    """The first of a list of findings, and how many more there are."""
    more = f", and {len(found) - most} more" if len(found) > most else ""
    return ", ".join(found[:most]) + more
