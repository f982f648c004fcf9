"""Scaling of a rigid asset: geometry by a factor, masses by its third power, moments of inertia by its fifth power."""

import mujoco
import numpy as np

from sceniris_gym.errors import NotSupportedError


def scale_asset(spec: mujoco.MjSpec, factor: float, where: str) -> None:
    """Scale a specification in place, about the origins of its bodies. Densities stay the same.

    Raises:
        NotSupportedError: The asset has joints, tendons, height fields, skins or flexible parts.
    """
    moving = [joint for joint in spec.joints if joint.type != mujoco.mjtJoint.mjJNT_FREE]
    soft = {"height fields": spec.hfields, "skins": spec.skins, "flexible parts": spec.flexes}
    for kind, elements in ({"joints": moving, "tendons": spec.tendons} | soft).items():
        if elements:
            raise NotSupportedError(f"{where}: is for rigid assets, but this asset has {kind}. Leave out 'scale'.")
    for element in (*spec.bodies, *spec.frames, *spec.geoms, *spec.sites, *spec.cameras, *spec.lights):
        element.pos = factor * element.pos
    for mesh in spec.meshes:
        mesh.scale, mesh.refpos = factor * mesh.scale, factor * mesh.refpos
    for shape in (*spec.geoms, *spec.sites):
        shape.size, shape.fromto = factor * shape.size, factor * shape.fromto  # fromto is nan if unused
    for geom in spec.geoms:
        geom.mass *= factor**3
    for body in spec.bodies:
        body.ipos, body.mass = factor * body.ipos, factor**3 * body.mass
        body.inertia, body.fullinertia = factor**5 * body.inertia, factor**5 * np.asarray(body.fullinertia)
