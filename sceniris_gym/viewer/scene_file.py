"""The scene that is on show: compiled from a file, and again whenever the file or one that it needs is saved."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sceniris_gym.config.loader import SHIPPED_NAME, scene_files, shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import (
    AttemptsWarning,
    FallbackWarning,
    InfeasibleSceneError,
    ModelWarning,
    ReachWarning,
    ScenirisError,
)
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.scene.model import build_model

_NOTICES = (AttemptsWarning, FallbackWarning, ModelWarning, ReachWarning)

Stamps = dict[Path, tuple[int, int]]


@dataclass(frozen=True)
class LoadedScene:
    """What became of a scene file.

    Attributes:
        compiled: The scene; None where it cannot be read. One of which no layout can be made is there, without a bank.
        error: What is wrong with it, None if nothing is.
        notices: Warnings about it.
    """

    compiled: CompiledScene | None
    error: ScenirisError | None = None
    notices: tuple[str, ...] = ()

    @property
    def stuck(self) -> bool:
        """Whether it is a scene of which no layout can be made."""
        return isinstance(self.error, InfeasibleSceneError)


class SceneFile:
    """A scene by name or path, with changes laid over it, on the CPU.

    Args:
        scene: Name of a shipped scene, or a path.
        changes: Dotted keys and values, as `SceneConfig.load` takes them.
    """

    def __init__(self, scene: str, changes: Mapping[str, Any]) -> None:
        self.scene, self.changes = scene, changes
        self._stamps: Stamps = {}
        self._files: list[Path] = []

    def load(self) -> LoadedScene:
        """Read and compile the scene."""
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            loaded = self._load()
        return replace(loaded, notices=tuple(str(w.message) for w in warned if w.category in _NOTICES))

    def _load(self) -> LoadedScene:
        self._files = scene_files(self.scene) or self._files  # one that is gone may come back
        self._stamps = self._read_stamps()
        try:
            config = SceneConfig.load(self.scene, self.changes)
            self._files = list(dict.fromkeys([*self._files, *_files_of(config)]))
            self._stamps = self._read_stamps()
            model = build_model(config)
        except ScenirisError as error:
            return LoadedScene(None, error)
        try:
            return LoadedScene(compile_scene(model, "cpu"))
        except InfeasibleSceneError as error:
            return LoadedScene(upload_scene(model, "cpu"), error)
        except ScenirisError as error:
            return LoadedScene(None, error)

    def changed(self) -> bool:
        """Whether any of its files was saved since it was loaded."""
        return self._read_stamps() != self._stamps

    def _read_stamps(self) -> Stamps:
        stamps = {}
        for path in self._files:
            try:
                found = path.stat()
            except OSError:  # between being removed and written anew by an editor
                continue
            stamps[path] = found.st_mtime_ns, found.st_size
        return stamps


def _files_of(config: SceneConfig) -> list[Path]:
    """The MJCF files that a scene names."""
    parts = [*config.objects.values(), *config.all_robots.values()]
    assets = {part.asset for part in parts if part.asset is not None}
    of_package = shipped("assets", ".xml")
    files = [of_package.get(a) if SHIPPED_NAME.fullmatch(a) else Path(a) for a in sorted(assets)]
    known = [file for file in files if file is not None]  # an unknown name is said when the model is built
    return [*known, *([config.model] if isinstance(config.model, Path) else [])]
