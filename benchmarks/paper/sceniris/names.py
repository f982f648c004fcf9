"""Names of joints and bodies inside an asset, which those of an original configuration are compared with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco

from sceniris_gym.config.loader import SHIPPED_NAME, shipped
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.scene.model_files import load_model


@dataclass(frozen=True)
class Names:
    """Names inside an asset: those of its joints except a free one, and of the bodies below its root."""

    joints: tuple[str, ...]
    bodies: tuple[str, ...]


def names_in(asset: str, where: str) -> Names:
    """Return the names inside an asset, which is either shipped or a file.

    Raises:
        UnknownNameError: There is no such shipped asset.
        SceneFileError: The file is missing, or MuJoCo cannot read it.
    """
    path, assets = Path(asset), shipped("assets", ".xml")
    if SHIPPED_NAME.fullmatch(asset):
        if asset not in assets:
            raise UnknownNameError("asset", asset, where, assets)
        path = assets[asset]
    spec = load_model(path, where)
    free = mujoco.mjtJoint.mjJNT_FREE
    joints = [joint.name or f"joint{i}" for i, joint in enumerate(spec.joints) if joint.type != free]
    bodies = [body.name for body in spec.bodies if body.name != "world" and body.parent.name != "world"]
    return Names(tuple(joints), tuple(bodies))
