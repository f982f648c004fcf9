"""Mass and inertia of a homogeneous link: from its closed surface, or from its convex parts."""

from __future__ import annotations

import numpy as np

from sceniris_gym.errors import SliverError
from sceniris_gym.importers.things.convex_parts import Parts
from sceniris_gym.importers.things.repair import Solid
from sceniris_gym.importers.things.splitting import hull_of, mesh_of, union_of
from sceniris_gym.importers.things.thing import LEAST_MOMENT, Inertia


def inertia_of(solid: Solid, parts: Parts, density: float, where: str) -> Inertia:
    """Return the inertia of a homogeneous link.

    The union of its convex parts is weighed where its surface would not do: overlapping pieces would be counted twice,
    and a shell has no inside.

    Args:
        solid: Its surface [m].
        parts: Its convex parts.
        density: In kg/m^3.
        where: The beginning of errors.

    Raises:
        SliverError: Its moments are too small for MuJoCo.
    """
    mesh = solid.mesh
    alone = solid.closed and mesh.is_watertight and mesh.body_count == 1
    if not alone or mesh.volume <= 0.0 or np.linalg.eigvalsh(mesh.moment_inertia)[0] <= 0.0:
        mesh = mesh_of(union_of([hull_of(part.vertices) for part in parts.meshes]))
    full = density * np.asarray(mesh.moment_inertia)
    found = Inertia(density * float(mesh.volume), np.asarray(mesh.center_mass), full)
    if (least := found.least) <= LEAST_MOMENT:
        raise SliverError(
            f"{where}: it is a sliver of {1e6 * found.mass:.2g} mg, and its least moment of inertia is {least:.1g} "
            f"kg m^2. It should be at least {LEAST_MOMENT:g} kg m^2 for MuJoCo. Leave it out, or give it a thickness; "
            "if it should be larger, give its --scale."
        )
    return found
