"""Options that commands share, and the checks of them before any work."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from sceniris_gym.config.bounds import MOST_WORLDS
from sceniris_gym.errors import ArgumentError, SceneKeyError

if TYPE_CHECKING:
    from sceniris_gym.config.scene import SceneConfig
    from sceniris_gym.program.compiled import CompiledScene

_scene = tyro.conf.arg(metavar="SCENE", help="name of a shipped scene, or a path")
Scene = Annotated[str, tyro.conf.Positional, _scene]
OptionalScene = Annotated[str | None, tyro.conf.Positional, _scene]
Out = Annotated[Path | None, tyro.conf.arg(aliases=["-o"])]
Seed = Annotated[int, tyro.conf.arg(aliases=["-s"])]
Split = Literal["train", "eval"]
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
Device = Annotated[str | None, tyro.conf.arg(help="cpu, cuda:0, ...; by default cuda:0 if there is one, else cpu")]
Json = Annotated[Flag, tyro.conf.arg(help="print one line of JSON and nothing else")]
Picture = Annotated[
    Path | None, tyro.conf.arg(help="PNG to write: the places of objects from above, also without 'reachable'")
]
Changes = Annotated[
    tyro.conf.UseAppendAction[tuple[str, ...]],
    tyro.conf.arg(name="set", metavar="KEY=VALUE", help="change part of the scene, e.g. objects.apple.clearance=0.01"),
]


def checked_target(out: Path | None, default: str | Path = "") -> Path:
    """Return the path of a result, which can be written."""
    from sceniris_gym.files import check_writable

    path = Path(default) if out is None else out
    check_writable(path)
    return path


def compiled_scene(scene: str, changes: Sequence[str], device: str | None) -> CompiledScene:
    """Compile the scene of a command."""
    from sceniris_gym.layout.compile import compile_scene

    return compile_scene(scene_config(scene, changes), device)


def scene_config(scene: str, changes: Sequence[str]) -> SceneConfig:
    """Read the scene of a command, with its changes laid over it."""
    from sceniris_gym.config.scene import SceneConfig

    return SceneConfig.load(scene, read_changes(changes))


def read_changes(changes: Sequence[str]) -> dict[str, Any]:
    """Read `key=value` pairs; values are YAML, as in a scene file."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    overrides = {}
    for change in changes:
        key, equals, value = change.partition("=")
        if not (key and equals):
            raise SceneKeyError(f"--set {change}: should be KEY=VALUE, as in objects.apple.clearance=0.01.")
        try:
            overrides[key] = YAML(typ="safe").load(value)
        except (YAMLError, ValueError, RecursionError) as error:
            why = "too deeply nested" if isinstance(error, RecursionError) else error
            raise SceneKeyError(f"--set {change:.80}: the value should be YAML: {why}") from None
    return overrides


def check_counts(least: int, *, most: int = MOST_WORLDS, **counts: int) -> None:
    """Refuse counts that are too small or too large, by the names of their options."""
    for name, count in counts.items():
        if not least <= count <= most:
            bound = f"at least {least}" if count < least else f"at most {most}"
            raise ArgumentError(f"--{name.replace('_', '-')} {count}: should be {bound}.")


def check_seed(seed: int) -> None:
    """Refuse a seed that is not an unsigned integer of 64 bits."""
    if not 0 <= seed < 1 << 64:
        raise ArgumentError(f"--seed {seed}: should be an integer from 0 to 2^64 - 1.")
