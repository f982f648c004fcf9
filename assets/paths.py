"""Output folders of the scripts: ``FOLDER`` for MJCF files, and its ``meshes`` for meshes and textures."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent


def mjcf_file(name: str) -> Path:
    """Path of an asset's MJCF file."""
    return FOLDER / f"{name}.xml"


def mesh_file(name: str) -> Path:
    """Path of a mesh or texture. ``name`` includes the suffix."""
    return FOLDER / "meshes" / name
