"""Models read from MJCF and URDF files, with the files that they refer to held in `MjSpec.assets`.

So the scene can be moved, and written as a zip file. A model may attach others (`<model>` and `<attach>`), whose files
lie beside them; a URDF may name its meshes by package.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from shlex import quote
from typing import Any
from xml.etree import ElementTree

import mujoco

from sceniris_gym.config.paths import user_path
from sceniris_gym.errors import CycleError, SceneFileError, import_extra
from sceniris_gym.files import read_bytes

URDF = ".urdf"
"""Suffix of URDF files; files with any other suffix are read as MJCF."""
THINGS = (".obj", ".stl", ".ply", ".off", ".glb", ".gltf", ".dae", ".usd", ".usda", ".usdc", ".usdz")
"""Suffixes of meshes and USD, which are no models; the importer makes assets of them."""
_COLLADA = ".dae"
# What a few words make much of: the attributes that multiply, and the most that MuJoCo makes in some seconds.
_GROWING = {"hfield": (("nrow", "ncol"), 1 << 26), "texture": (("width", "height"), 1 << 28)} | dict.fromkeys(
    ("replicate", "composite", "flexcomp"), (("count",), 20_000)
)
_PACKAGES = ("package://", "model://")
# Lower bounds for the masses and inertias of a URDF, which may leave them out [kg, kg m^2].
_LEAST_MASS, _LEAST_INERTIA = 1e-3, 1e-6


def load_model(path: Path, where: str, repaired: Callable[[str], str] | None = None) -> mujoco.MjSpec:
    """Read an MJCF or a URDF file, with the files it refers to held in `MjSpec.assets`.

    Args:
        path: The file.
        where: The beginning of errors.
        repaired: Returns the text of the file as MuJoCo can read it, from the text that it has.

    Raises:
        SceneFileError: The file or one that it refers to is missing, or MuJoCo cannot read it.
        MissingExtraError: It has a Collada mesh, and pycollada is not installed.
    """
    path = user_path(path, Path(), where)
    if not path.is_file():
        raise SceneFileError(f"{where}: there is no file '{path}'. Give the path of an MJCF or URDF file.")
    if path.suffix.lower() in THINGS:
        raise SceneFileError(
            f"{where}: '{path}' should be an MJCF or URDF file. "
            f"`sceniris-gym import {quote(str(path))} -o {quote(path.stem + '.xml')}` makes an asset of it."
        )
    try:
        folders = list(_folders(path, "", path.parent))
    except (OSError, RecursionError) as error:
        raise SceneFileError(f"{where}: '{path}' cannot be read: {error}.") from None
    try:
        if repaired is None:
            spec = mujoco.MjSpec.from_file(str(path))
        else:
            spec = mujoco.MjSpec.from_string(repaired(path.read_text(encoding="utf-8")))
    except (ValueError, ElementTree.ParseError) as error:
        raise SceneFileError(
            f"{where}: MuJoCo cannot read '{path}': {' '.join(str(error).split())}. It should be an MJCF or URDF file."
        ) from None
    if path.suffix.lower() == URDF:
        spec.compiler.fusestatic = False  # so that links that are fixed to each other keep their names
        spec.compiler.balanceinertia = True
        spec.compiler.boundmass, spec.compiler.boundinertia = _LEAST_MASS, _LEAST_INERTIA
    referring = list(_referring(spec))
    sources = [_source(path, folders, *one) for one in referring]
    missing = [one for one, source in zip(referring, sources, strict=True) if source is None]
    if missing:
        raise SceneFileError(f"{where}: '{path}' refers to {_listed(path, missing)}.")
    for (element, _, file), source in zip(referring, sources, strict=True):
        assert source is not None
        key, content = _as_mesh(source, file)
        if spec.assets.get(key, content) != content:  # a file of another attached model has the same name
            key = renamed(key, f"{len(spec.assets)}_")
        if key != file and element.file == file:
            element.file = key
        spec.assets[key] = content
    return spec


def renamed(file: str, prefix: str) -> str:
    """Return a file's name with a prefix and without folders, as MuJoCo also looks for it without them."""
    return prefix + file.rpartition("/")[2]


def file_of(uri: str, folder: Path) -> Path | None:
    """Return the file that a URDF in a folder refers to by a mesh's file name; None if it does not exist.

    A package is looked for among the folders above the URDF: a folder of its name, or one that holds the same files.
    """
    for scheme in _PACKAGES:
        if uri.startswith(scheme):
            package, _, rest = uri.removeprefix(scheme).partition("/")
            above = (folder, *folder.parents)
            places = [*(f / package / rest for f in above), *(f / rest for f in above)]
            return next((place for place in places if place.is_file()), None)
    path = folder / uri.removeprefix("file://")
    return path if path.is_file() else None


def _folders(path: Path, prefix: str, folder: Path, above: tuple[Path, ...] = ()) -> Iterator[tuple[str, Path]]:
    """Yield the folder of a model, and those of all models that it attaches, each after the prefix of its names.

    Raises:
        OSError: One of them, or a file that one includes from `folder`, is no file.
        CycleError: One contains itself.
        SceneFileError: One is larger than its text by far.
    """
    chain = (*above, path.resolve())
    if chain[-1] in above:
        raise CycleError(str(path), map(str, above[above.index(chain[-1]) :]), "models contain each other")
    yield prefix, folder
    try:
        root = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError:  # MuJoCo reads some files that are no XML
        return
    _check_size(root, str(path))
    prefixes = {attach.get("model"): attach.get("prefix") or "" for attach in root.iter("attach")}
    for part in (*root.iter("model"), *root.iter("include")):
        if (file := part.get("file")) and (found := folder / file).exists():
            below = folder if part.tag == "include" else found.parent
            yield from _folders(found, prefix + prefixes.get(part.get("name"), ""), below, chain)


def _check_size(element: ElementTree.Element, where: str) -> int:
    """Return the number of elements that MuJoCo makes of one, or of cells of a texture or a field of heights.

    Raises:
        SceneFileError: It is too large.
    """
    inside = 1 + sum(_check_size(child, where) for child in element)
    words, most = _GROWING.get(element.tag, ((), inside))
    numbers = [int(n) for word in words for n in element.get(word, "").split() if n.isdecimal()]
    if (size := inside * math.prod(numbers)) > most:
        raise SceneFileError(f"{where}: <{element.tag}> makes {size:,} parts, and should make at most {most:,}.")
    return size


def _referring(spec: mujoco.MjSpec) -> Iterator[tuple[Any, str, str]]:
    """Yield each element that refers to a file, the file's folder below that of the model, and the file."""
    for element in (*spec.meshes, *spec.hfields, *spec.skins):
        if element.file:
            yield element, _compiler(element, spec).meshdir, element.file
    for texture in spec.textures:
        for file in (texture.file, *texture.cubefiles):
            if file:
                yield texture, _compiler(texture, spec).texturedir, file


def _compiler(element: Any, spec: mujoco.MjSpec) -> Any:
    """Return the compiler settings of the model that an element comes from, which may have been attached."""
    return getattr(element, "compiler", None) or spec.compiler


def _source(path: Path, folders: list[tuple[str, Path]], element: Any, subfolder: str, file: str) -> Path | None:
    """Return the file that an element refers to: in the folder of its own model if there, else of any other."""
    if path.suffix.lower() == URDF:
        return file_of(file, path.parent / subfolder) or file_of(file, path.parent)
    ranked = sorted(folders, key=lambda each: -len(each[0]) if element.name.startswith(each[0]) else 1)
    return next((place for _, folder in ranked if (place := folder / subfolder / file).is_file()), None)


def _listed(path: Path, missing: list[tuple[Any, str, str]]) -> str:
    """Return the first of the missing files, and where it should be."""
    places = (file if "://" in file else str(path.parent / subfolder / file) for _, subfolder, file in missing)
    names = list(dict.fromkeys(places))
    more = f", nor do other files ({len(names)} in all)" if len(names) > 1 else ""
    package = " in a folder of the package's name above the file" if "://" in names[0] else ""
    return f"'{names[0]}', which does not exist{more}. Put it there{package}, or correct its name"


def _as_mesh(source: Path, name: str) -> tuple[str, bytes]:
    """Return the name and the content of a file as MuJoCo reads it: a Collada mesh becomes an STL file."""
    if source.suffix.lower() != _COLLADA:
        return name, source.read_bytes()
    import_extra("collada", "import", "pycollada")
    import trimesh

    content = io.BytesIO()
    trimesh.load_mesh(source).export(content, file_type="stl")
    return f"{name.removesuffix(source.suffix)}.stl", content.getvalue()
