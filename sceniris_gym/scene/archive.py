"""A scene as a zip file whose members stay in the folder that it is unpacked in."""

from __future__ import annotations

import io
import zipfile
from pathlib import PurePosixPath
from typing import BinaryIO

import mujoco


def write_zip(spec: mujoco.MjSpec, file: BinaryIO) -> None:
    """Write a specification and its files so that stock MuJoCo opens them.

    Files whose names lead elsewhere (`../part.obj`, `/home/me/part.obj`) get names of their own.
    """
    unsafe = sorted(name for name in spec.assets if not _is_safe(name))
    if not unsafe:
        spec.to_zip(file)
        return
    copy = spec.copy()
    names = {name: f"file_{i}{PurePosixPath(name).suffix}" for i, name in enumerate(unsafe)}
    for part in (*copy.meshes, *copy.hfields, *copy.textures, *copy.skins):
        part.file = names.get(part.file, part.file)
    for name, other in names.items():
        copy.assets[other] = spec.assets[name]
    written = io.BytesIO()
    copy.to_zip(written)
    with zipfile.ZipFile(written) as archive, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as kept:
        for name in archive.namelist():  # a copy keeps the files that nothing refers to any more
            if name not in names:
                kept.writestr(name, archive.read(name))


def _is_safe(name: str) -> bool:
    path = PurePosixPath(name.replace("\\", "/"))
    return not path.is_absolute() and ".." not in path.parts and ":" not in name
