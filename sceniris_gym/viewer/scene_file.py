"""Reads and compiles the scene that the viewer shows, and notices changes of its files."""

import contextlib
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from sceniris_gym.config.loader import scene_files, shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import InfeasibleSceneError, SceneFileError, ScenirisError, ScenirisWarning
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model_files import model_tree, named_files

_MODELS = (".xml", ".mjcf", ".urdf")


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


def _files_of(config: SceneConfig) -> set[Path]:
    """Return the model files of a scene, and all files that they name, even if they do not exist."""
    parts, of_package = (*config.objects.values(), *config.all_robots.values()), shipped("assets", ".xml")
    models = {of_package.get(part.asset, Path(part.asset)) for part in parts if part.asset is not None}
    models |= {config.model} if isinstance(config.model, Path) else set()
    found: set[Path] = set()
    while models:
        path, included, named = models.pop(), set[Path](), set[Path]()
        with contextlib.suppress(OSError, SceneFileError):  # building the model rejects it
            named = named_files(model_tree(path, path.parent, included), path.parent)
        models |= {file for file in named - found if file.suffix.lower() in _MODELS and file.is_file()}
        found |= {path, *included, *named}
    return found
