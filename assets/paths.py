"""Folders of the scripts: MJCF files go into ``FOLDER``, meshes and textures into its ``meshes``."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent


def mjcf_file(name: str) -> Path:
    """The MJCF file of an asset."""
    return FOLDER / f"{name}.xml"


def mesh_file(name: str) -> Path:
    """A mesh or texture, with its ending."""
    return FOLDER / "meshes" / name
