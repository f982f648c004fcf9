"""Files of folders that cannot be variants of an object: they are left out of the scene, with a warning."""

from __future__ import annotations

import warnings

import mujoco

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ModelWarning, SceneFileError, ScenirisError
from sceniris_gym.progress import tell
from sceniris_gym.scene.assemble import attach_variants, compile_spec
from sceniris_gym.scene.variants import check_variants

_TOLD = 5  # files of an object that a warning names


def without_broken(config: SceneConfig) -> SceneConfig:
    """Return the scene without the files of folders that MuJoCo cannot load, or that are no single rigid body.

    Warns of those that are left out. The scene itself is returned if there are none.

    Raises:
        SceneFileError: No file of a folder is left.
    """
    left_out: list[str] = []
    for name, members in config.folders.items():
        broken = {}
        for i, member in enumerate(members):
            tell("files of a folder", i + 1, len(members))
            alone = mujoco.MjSpec()
            try:
                attach_variants(alone, name, {member: config.objects[member]}, config.where, bodies=True)
                mjm = compile_spec(alone, f"{config.where}: objects.{member}.asset")
                check_variants(alone, mjm, {name: (member,)}, config.where)
            except ScenirisError as error:
                broken[member] = str(error)
        where = f"{config.where}: objects.{name}.asset"
        if len(broken) == len(members):
            raise SceneFileError(f"{where}: no file of the folder can be a variant. The first: {broken[members[0]]}")
        if broken:
            told = "\n".join(["", *list(broken.values())[:_TOLD]])
            more = f"\n{len(broken) - _TOLD} more" if len(broken) > _TOLD else ""
            message = f"{where}: {len(broken)} of {len(members)} files of the folder are left out:{told}{more}"
            warnings.warn(ModelWarning(message), stacklevel=3)
            left_out += broken
    return config.without(left_out) if left_out else config
