"""Models from MJCF and URDF files, with the contents of all referenced files in `MjSpec.assets`.

With these contents, a scene can be moved, and written as a zip file that unpacks into one folder. A model may attach
other models (`<model>` and `<attach>`), with files in their own folders. A URDF may refer to meshes by a package name.
"""

import io
import math
import re
import zipfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path, PurePosixPath
from shlex import quote
from typing import Any
from xml.etree import ElementTree

import mujoco

from sceniris_gym.config.loader import user_path
from sceniris_gym.errors import SceneFileError, import_extra, in_a_cycle
from sceniris_gym.files import no_file, opened, read_bytes

URDF = ".urdf"
"""Suffix of URDF files. Files with any other suffix are read as MJCF."""
THINGS = (".obj", ".stl", ".ply", ".off", ".glb", ".gltf", ".dae", ".usd", ".usda", ".usdc", ".usdz")
"""Suffixes of meshes and USD files. They are not models, but the importer makes assets from them."""
_COLLADA = ".dae"
MODEL_FOLDERS = ("meshdir", "assetdir", "texturedir")
"""Attributes of `compiler` that name folders."""
# Elements whose short text can make a large model, with the attributes that multiply its size. `_MOST` is the number of
# parts that MuJoCo makes in some seconds.
_GROWING = {"hfield": ("nrow", "ncol"), "texture": ("width", "height"), "attach": ()}
_GROWING |= dict.fromkeys(("replicate", "composite", "flexcomp"), ("count",))
_MOST = {"hfield": 1 << 26, "texture": 1 << 28, "made": 20_000}
_NUMBER = re.compile(r"\+?\d+(\.\d*)?(e\+?\d{1,2})?")
_MOST_MODELS = 1_000
_APART = re.compile(rb"<\?.*?\?>|<!\[CDATA\[.*?\]\]>|<!--(.*?)-->", re.DOTALL)
_DOCTYPE = re.compile(rb"<!DOCTYPE(?!\s+[\w.-]+\s*>)")
_PACKAGES = ("package://", "model://")
# Lower bounds for the masses and inertias of a URDF, which may leave them out [kg, kg m^2].
_LEAST_MASS, _LEAST_INERTIA = 1e-3, 1e-6


def load_model(path: Path, where: str, repaired: Callable[[str], str] | None = None) -> mujoco.MjSpec:
    """Read an MJCF or a URDF file, with the contents of its referenced files in `MjSpec.assets`.

    Unnamed keyframes, bodies, and geoms of the world get names.

    Args:
        path: The file.
        where: The text at the beginning of error messages.
        repaired: Converts the text of the file to a text that MuJoCo can read.

    Raises:
        SceneFileError: The file or a referenced file is missing, or MuJoCo cannot read it.
        MissingExtraError: The model has a Collada mesh, and pycollada is not installed.
    """
    path = user_path(path, Path(), where)
    if not path.is_file():
        raise SceneFileError(f"{where}: '{path}': {no_file(path)}. Give the path of an MJCF or URDF file.")
    if path.suffix.lower() in THINGS:
        raise SceneFileError(
            f"{where}: '{path}' should be an MJCF or URDF file. "
            f"`sceniris-gym import {quote(str(path))} -o {quote(path.stem + '.xml')}` makes an asset of it."
        )
    try:
        folders: list[tuple[str, Path]] = []
        _read(path, "", folders)
    except (OSError, RecursionError, SceneFileError) as error:
        raise SceneFileError(f"{where}: '{path}' cannot be read: {str(error).rstrip('.')}.") from None
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
        spec.compiler.fusestatic = False  # so that fixed links keep their names
        spec.compiler.balanceinertia = True
        spec.compiler.boundmass, spec.compiler.boundinertia = _LEAST_MASS, _LEAST_INERTIA
    found = [(one, _source(path, folders, *one)) for one in _referring(spec)]
    if missing := [one for one, source in found if source is None]:
        raise SceneFileError(f"{where}: '{path}' refers to {_listed(path, missing)}.")
    for (element, _, file), source in found:
        assert source is not None
        key, content = _as_mesh(source, file)
        if spec.assets.get(key, content) != content:  # another attached model has a different file of this name
            key = renamed(key, f"{len(spec.assets)}_")
        if key != file and element.file == file:
            element.file = key
        spec.assets[key] = content
    return _named_by_place(spec)


def _named_by_place(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Name keyframes, bodies, and geoms of the world after their place if they have no name. Return `spec`.

    Their names are `key_`, `body_` or `geom_` and their id in the compiled model, as in `geom_0` for the first geom.
    """
    for kind, elements in (("key", spec.keys), ("body", spec.bodies), ("geom", spec.worldbody.geoms)):
        for i, element in enumerate(elements):
            if not element.name and getattr(spec, kind)(name := f"{kind}_{i}") is None:
                element.name = name
    return spec


def renamed(file: str, prefix: str) -> str:
    """Return a file's name with a prefix and without its folders. MuJoCo also finds a file without its folders."""
    return prefix + file.rpartition("/")[2]


def file_of(uri: str, folder: Path) -> Path | None:
    """Return the file of a mesh that a URDF in `folder` names, or None if the file does not exist.

    A mesh in a package is searched in the URDF's folder and in all folders above: first with the package's name as a
    subfolder, then without the name.
    """
    return next((place for place in _places(uri, folder) if place.is_file()), None)


def _places(uri: str, folder: Path) -> list[Path]:
    for scheme in _PACKAGES:
        if uri.startswith(scheme):
            package, _, rest = uri.removeprefix(scheme).partition("/")
            above = (folder, *folder.parents)
            return [*(f / package / rest for f in above), *(f / rest for f in above)]
    return [folder / uri.removeprefix("file://")]


def named_files(root: ElementTree.Element, folder: Path) -> set[Path]:
    """Return the files that a model in `folder` names, in all places where MuJoCo may look for them."""
    below = {folder / c.get(word, "") for c in (root, *root.iter("compiler")) for word in MODEL_FOLDERS}
    files = {file for each in root.iter() for name, file in each.attrib.items() if name.startswith("file")}
    return {p for file in files for name in (file, Path(file).name) for f in below for p in _places(name, f)}


def model_tree(path: Path, folder: Path, seen: set[Path]) -> ElementTree.Element:
    """Return the contents of a model's file, with includes replaced by the included files.

    Comments become empty, because MuJoCo accepts comments with '--' or with bytes that XML does not allow.

    Args:
        path: The file.
        folder: The folder of included files.
        seen: The files that were included so far. This file is added.

    Raises:
        OSError: The path or an included path is not a file.
        SceneFileError: A file is included twice, or is not well-formed XML, so this function could read it differently
            from MuJoCo.
    """
    if path.resolve() in seen:
        raise SceneFileError(f"{path}: is included twice, or includes itself. Include each file once.")
    seen.add(path.resolve())
    try:
        text = _APART.sub(_without_comment, read_bytes(path).lstrip())
        root = ElementTree.fromstring(_DOCTYPE.sub(b"<<", text))  # rejected: MuJoCo reads its contents
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # LookupError: unknown encoding
        raise SceneFileError(f"{path}: should be MJCF or URDF in well-formed XML, found: {error}.") from None
    for parent in list(root.iter()):
        for i in reversed([i for i, child in enumerate(parent) if child.tag == "include"]):
            parent[i : i + 1] = list(model_tree(folder / parent[i].get("file", ""), folder, seen))
    return root


def _without_comment(found: re.Match[bytes]) -> bytes:
    return found[0] if found[1] is None else b"<!--" + b"\n" * found[1].count(b"\n") + b"-->"


def _read(path: Path, prefix: str, folders: list[tuple[str, Path]], above: tuple[Path, ...] = ()) -> Counter[str]:
    """Append the name prefix and the folder of a model to `folders`. Do the same for all models that it attaches.

    Returns:
        The size of the compiled model, see `_size`.

    Raises:
        OSError: An included or referenced path is not a file.
        SceneKeyError: A model contains itself.
        SceneFileError: A model becomes too large when compiled, or is not well-formed XML.
    """
    chain = (*above, path.resolve())
    if chain[-1] in above:
        raise in_a_cycle(str(path), map(str, above[above.index(chain[-1]) :]), "models contain each other")
    folders.append((prefix, path.parent))
    if len(folders) > _MOST_MODELS:
        raise SceneFileError(f"{path}: is one of over {_MOST_MODELS} attached models. Attach fewer.")
    root = model_tree(path, path.parent, set())
    for place in named_files(root, path.parent):
        if place.exists() and not (place.is_file() or place.is_dir()):
            opened(place)  # raises the error about it
    prefixes = {attach.get("model"): attach.get("prefix") or "" for attach in root.iter("attach")}
    models: dict[str | None, Counter[str]] = defaultdict(Counter)
    for part in root.iter("model"):
        if (file := part.get("file")) is not None:
            name = part.get("name")
            models[name] += _read(path.parent / file, prefix + prefixes.get(name, ""), folders, chain)
    return _size(root, str(path), models)


def _size(element: ElementTree.Element, where: str, models: dict[str | None, Counter[str]]) -> Counter[str]:
    """Count the parts that MuJoCo makes from an XML element: the written elements, their copies, and attached models.

    The cells of height fields and textures also count.

    Args:
        element: The element.
        where: The text at the beginning of error messages.
        models: The sizes of models that may be attached, by name. The key None has the models without a name.

    Raises:
        SceneFileError: The element is too large.
    """
    size = Counter({element.tag if element.tag in _MOST else "written": 1})
    if element.tag == "attach":
        size += models.get(element.get("model"), models[None])
    for child in element:
        size += _size(child, where, models)
    if (words := _GROWING.get(element.tag)) is not None:
        numbers = [n for word in words for n in element.get(word, "").split() if _NUMBER.fullmatch(n)]
        size = Counter({kind: number * math.prod(int(float(n)) for n in numbers) for kind, number in size.items()})
        size["made"] += size.pop("written", 0)
    for kind, most in _MOST.items():
        if size[kind] > most:
            raise SceneFileError(
                f"{where}: <{element.tag}> makes {size[kind]:,} parts. It should make {most:,} at most."
            )
    return size


def _referring(spec: mujoco.MjSpec) -> Iterator[tuple[Any, str, str]]:
    """Yield (element, subfolder, file name) for each file that an element of the model refers to.

    The subfolder is `meshdir` or `texturedir` of the compiler that applies to the element.
    """
    referring: list[tuple[Any, str, list[str]]] = [
        *((element, "meshdir", [element.file]) for element in (*spec.meshes, *spec.hfields, *spec.skins)),
        *((texture, "texturedir", [texture.file, *texture.cubefiles]) for texture in spec.textures),
    ]
    for element, folder, files in referring:
        compiler = getattr(element, "compiler", None) or spec.compiler  # of the model, attached or not, that defines it
        yield from ((element, getattr(compiler, folder), file) for file in files if file)


def _source(path: Path, folders: list[tuple[str, Path]], element: Any, subfolder: str, file: str) -> Path | None:
    """Return the file of an element, preferably from the folder of its model, otherwise from any model's folder."""
    if path.suffix.lower() == URDF:
        return file_of(file, path.parent / subfolder) or file_of(file, path.parent)
    ranked = sorted(folders, key=lambda each: -len(each[0]) if element.name.startswith(each[0]) else 1)
    return next((place for _, folder in ranked if (place := folder / subfolder / file).is_file()), None)


def _listed(path: Path, missing: list[tuple[Any, str, str]]) -> str:
    """Return text for an error about missing files: the first file, where it should be, and how many there are."""
    places = (file if "://" in file else str(path.parent / subfolder / file) for _, subfolder, file in missing)
    names = list(dict.fromkeys(places))
    more = f" ({len(names)} files are missing in all)" if len(names) > 1 else ""
    place = "into a folder with the package's name, next to the model or above it" if "://" in names[0] else "there"
    return f"'{names[0]}', which does not exist{more}. Put the file {place}, or correct its name"


def _as_mesh(source: Path, name: str) -> tuple[str, bytes]:
    """Return the name and the content of a file for MuJoCo. A Collada mesh becomes an STL file."""
    if source.suffix.lower() != _COLLADA:
        return name, source.read_bytes()
    import_extra("collada", "import", "pycollada")
    import trimesh

    content = io.BytesIO()
    trimesh.load_mesh(source).export(content, file_type="stl")
    return f"{name.removesuffix(source.suffix)}.stl", content.getvalue()


def zipped(spec: mujoco.MjSpec) -> bytes:
    """Return a specification and its files as a zip file that stock MuJoCo can open.

    Files with paths outside the zip (`../part.obj`, `/home/me/part.obj`) get new names.
    """
    copy = spec.copy()
    unsafe = sorted(name for name in spec.assets if not _is_safe(name))
    names = {name: f"file_{i}{PurePosixPath(name).suffix}" for i, name in enumerate(unsafe)}
    for part in (*copy.meshes, *copy.hfields, *copy.textures, *copy.skins):
        part.file = names.get(part.file, part.file)
    copy.assets.update({names[name]: spec.assets[name] for name in unsafe})
    # A copy also keeps files under their former names.
    files = {name: content for name, content in copy.assets.items() if name not in names}
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in {**files, f"{spec.modelname}.xml": copy.to_xml()}.items():
            archive.writestr(zipfile.ZipInfo(name), content)
    return file.getvalue()


def _is_safe(name: str) -> bool:
    path = PurePosixPath(name.replace("\\", "/"))
    return not path.is_absolute() and ".." not in path.parts and ":" not in name
