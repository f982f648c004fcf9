"""Reads and compiles the scene that the viewer shows, and notices changes of its files."""

import contextlib
import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from sceniris_gym.config.loader import scene_files, shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import InfeasibleSceneError, ScenirisError, ScenirisWarning
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model_files import file_of

_MODELS = (".xml", ".mjcf", ".urdf")
_FILE = re.compile(r"""\bfile\w*\s*=\s*["']([^"']+)["']""")
_FOLDER = re.compile(r"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"']+)["']""")


class LoadedScene(NamedTuple):
    """The outcome of reading and compiling a scene file.

    Attributes:
        compiled: The scene, or None if it cannot be read or built. If no valid layout was found, the scene has no
            bank of layouts.
        error: The error in the scene, or None.
        notices: Texts of the warnings about the scene.
    """

    compiled: CompiledScene | None
    error: ScenirisError | None = None
    notices: tuple[str, ...] = ()


class SceneFile:
    """Compiles a scene, and notices when its files change.

    Args:
        scene: Name of a shipped scene, or path of a scene file.
        changes: Dotted keys and values that replace values in the file, as `SceneConfig.load` takes them.
        device: Device for which the scene is compiled.
    """

    def __init__(self, scene: str, changes: Mapping[str, Any], device: str = "cpu") -> None:
        self.scene, self.changes, self.device = scene, changes, device
        self._stamps: dict[Path, tuple[int, int] | None] = {}

    def load(self) -> LoadedScene:
        """Read and compile the scene."""
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            loaded = self._load()
        return loaded._replace(notices=tuple(str(w.message) for w in warned if issubclass(w.category, ScenirisWarning)))

    def _load(self) -> LoadedScene:
        self._stamps = _stamps_of(scene_files(self.scene) or self._stamps)  # a missing file may come back
        try:
            config = SceneConfig.load(self.scene, self.changes)
            self._stamps = _stamps_of([*self._stamps, *_files_of(config)])
            model = build_model(config)
            try:
                return LoadedScene(compile_scene(model, self.device))
            except InfeasibleSceneError as error:
                return LoadedScene(upload_scene(model, self.device), error)
        except ScenirisError as error:
            return LoadedScene(None, error)

    def changed(self) -> bool:
        """Return True if a file of the scene changed since it was loaded."""
        return _stamps_of(self._stamps) != self._stamps


def _stamps_of(files: Iterable[Path]) -> dict[Path, tuple[int, int] | None]:
    """Return time [ns] and size of each file, None for a missing file, which an editor may be replacing."""
    stamps: dict[Path, tuple[int, int] | None] = dict.fromkeys(files)
    for path in stamps:
        with contextlib.suppress(OSError):
            found = path.stat()
            stamps[path] = found.st_mtime_ns, found.st_size
    return stamps


def _files_of(config: SceneConfig) -> list[Path]:
    """Return the model files of a scene, and all files that they name."""
    parts, of_package = (*config.objects.values(), *config.all_robots.values()), shipped("assets", ".xml")
    models = [of_package.get(part.asset, Path(part.asset)) for part in parts if part.asset is not None]
    models += [config.model] if isinstance(config.model, Path) else []
    found: dict[Path, None] = {}
    for path in models:
        _add_referred(path, (), found)
    return list(found)


def _add_referred(path: Path, folders: tuple[Path, ...], found: dict[Path, None]) -> None:
    """Add a model file to `found`, with all files that it names, even if they do not exist.

    Args:
        path: The model file.
        folders: Folders of the files that include this file. Names in this file may be relative to these folders.
        found: The files. If a named file may be in several folders, a path for each folder is added.
    """
    if path in found:
        return
    found[path] = None
    if path.suffix.lower() not in _MODELS or not path.is_file():
        return
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError):  # building the model rejects it
        return
    folders = tuple(dict.fromkeys([path.parent, *folders]))  # paths are relative to the file, or to the including file
    folders += tuple(folder / name for folder in folders for name in _FOLDER.findall(text))
    for name in _FILE.findall(text):
        for place in [file_of(name, path.parent)] if "://" in name else [folder / name for folder in folders]:
            if place is not None:
                _add_referred(place, folders, found)
