"""Shared options of commands, and checks of their values before any work."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from difflib import get_close_matches
from functools import partial, wraps
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import tyro

from sceniris_gym.config.bounds import COUNT
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, old_names

if TYPE_CHECKING:
    from sceniris_gym.config.scene import SceneConfig
    from sceniris_gym.program.compiled import CompiledScene

_scene = tyro.conf.arg(metavar="SCENE", help="name of a shipped scene, or a path")
Scene = Annotated[str, tyro.conf.Positional, _scene]
OptionalScene = Annotated[str | None, tyro.conf.Positional, _scene]
LAYOUTS = tyro.conf.arg(aliases=["-n"], metavar="INT", help="number of layouts")
Layouts = Annotated[int, LAYOUTS, COUNT]
NumEnvs = Annotated[int, tyro.conf.arg(help="number of worlds"), COUNT]
OUT = tyro.conf.arg(aliases=["-o"], metavar="PATH")
Out = Annotated[Path | None, OUT]
_seed = tyro.conf.arg(aliases=["-s"], help="seed of the map, rows, units, or first layout (layout i has SEED + i)")
Seed = Annotated[int, _seed, range(1 << 64)]
Split = Annotated[Literal["train", "eval"], tyro.conf.arg(help="training or evaluation layouts")]
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
_device = tyro.conf.arg(metavar="STR", help="cpu, cuda:0, ..., by default cuda:0 if available, otherwise cpu")
Device = Annotated[str | None, _device]
Json = Annotated[Flag, tyro.conf.arg(help="print only one line of JSON")]
Picture = Annotated[
    Path | None, tyro.conf.arg(help="PNG to write: the places of objects from above, also without 'reachable'")
]
Changes = Annotated[
    tyro.conf.UseAppendAction[tuple[str, ...]],
    tyro.conf.arg(name="set", metavar="KEY=VALUE", help="change part of the scene, e.g. objects.apple.clearance=0.01"),
]


@dataclass(frozen=True)
class Evaluation:
    """Options of the evaluation of a trained policy.

    Attributes:
        run: folder of a training, with its model.pt
        layouts: number of layouts of each kind
        out: JSON file to write, with the result for every layout
        failed: file to write, with the ids of the valid layouts without success, one per line
        video: MP4 to write, with the episodes of the first 16 worlds (extra `video`)
        min_success: least fraction of valid layouts that should end in success. Below it, the exit status is 1
        task: a registered task, or your own as MODULE:ID, by default the task of RUN
        trust: read a checkpoint that holds more than weights, although this executes code in the file
        device: Warp's name of the device
    """

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    layouts: Layouts = 4096
    out: Out = None
    failed: Path | None = None
    video: Path | None = None
    min_success: Annotated[float | None, range(2)] = None  # from 0 to 1
    task: str = ""
    trust: Flag = False
    device: Device = None


@dataclass(frozen=True)
class Demos:
    """Options of demonstrations.

    Attributes:
        task: a registered task, or your own as MODULE:ID
        episodes: number of demonstrations. All of them end in success
        out: folder for demos.json and demos-*.npz
        target: object to grasp, needed if several objects are reachable and the task does not name its `targets`
        camera: camera whose pictures are also written (repeatable)
        size: width and height of the pictures [pixels]
        format: lerobot also writes a LeRobot data set to the subfolder lerobot (extra `lerobot`)
    """

    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    episodes: Annotated[int, COUNT] = 2000
    out: Annotated[Path, OUT] = Path("demos")
    target: str | None = None
    camera: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="NAME")] = ()
    size: tuple[int, int] = (128, 128)
    format: Literal["npz", "lerobot"] = "npz"
    num_envs: NumEnvs = 1024
    seed: Seed = 0
    split: Split = "train"
    device: Device = None
    changes: Changes = ()


def parsed(name: str, command: Callable[..., Any], words: Sequence[str]) -> Callable[[], Any]:
    """Parse the words after the name of a command, and return the call of the command.

    Raises:
        ArgumentError: The command does not have an option. The message gives the option's new name, or a similar one.
    """
    prog = f"sceniris-gym {name}"
    for given in (word.partition("=")[0] for word in words):
        if new := old_names().get(f"{name} {given}"):
            raise ArgumentError(f"{name}: '{given}' is now {new}. See {prog} --help.")
    with redirect_stdout(StringIO()) as text, suppress(SystemExit):
        tyro.cli(command, prog=prog, args=["--help"])
    options = re.findall(r"--[a-z-]+", text.getvalue())
    # tyro names an unknown option only if no argument is missing
    unknown = [word for word in words if word[:2] == "--" and word.partition("=")[0].replace("_", "-") not in options]
    later = wraps(command)(lambda *args, **kwargs: partial(command, *args, **kwargs))
    call, unknown = (later(), unknown) if unknown else tyro.cli(later, prog=prog, args=words, return_unknown_args=True)
    if unknown:
        # '--out' and '--layouts' are similar by 0.7
        near = get_close_matches(unknown[0].partition("=")[0], options, n=1, cutoff=0.8)
        hint = f"Did you mean '{near[0]}'?" if near else "It has no similar option."
        raise ArgumentError(f"{name}: unknown argument '{unknown[0]}'. {hint} See {prog} --help.")
    check_numbers(command, call.keywords)
    return call


def checked_target(out: Path | None, default: str | Path = "") -> Path:
    """Return the path of a result, after a check that it can be written."""
    from sceniris_gym.files import check_writable

    path = Path(default) if out is None else out
    check_writable(path)
    return path


def compiled_scene(scene: str, changes: Sequence[str], device: str | None) -> CompiledScene:
    """Compile the scene of a command."""
    from sceniris_gym.layout.compile import compile_scene

    return compile_scene(scene_config(scene, changes), device)


def scene_config(scene: str, changes: Sequence[str]) -> SceneConfig:
    """Read the scene of a command and apply its changes."""
    from sceniris_gym.config.scene import SceneConfig

    return SceneConfig.load(scene, read_changes(changes))


def read_ids(given: Sequence[str]) -> list[str]:
    """Return layout ids. Each given text is an id, or a file with one id per line."""
    ids: list[str] = []
    for text in given:
        path = Path(text)
        if ":" not in text and not path.is_file():
            raise ArgumentError(f"{text}: should be a layout id (scenehash:split:seed:episode) or a file of such ids.")
        found = [text] if ":" in text else path.read_text().split()
        if not found:
            raise ArgumentError(f"{text}: should have one layout id per line, but is empty.")
        ids += found
    return ids


def replay_command(layouts: str, scene: str | None, changes: Sequence[str] = ()) -> str:
    """Return the command that draws layouts of a scene, given an id or a file with ids."""
    words = [] if scene is None else ["--scene", scene]
    return shlex.join(["sceniris-gym", "replay", layouts, *words, *(f"--set={change}" for change in changes)])


def check_numbers(command: Callable[..., object] | type, options: Mapping[str, Any]) -> None:
    """Reject options outside the ranges in the annotations of a command or a class. Options may be None or left out."""
    for name, hint in get_type_hints(command, include_extras=True).items():
        for bounds in getattr(hint, "__metadata__", ()):
            number = options.get(name)
            if isinstance(bounds, range) and number is not None and not bounds[0] <= number <= bounds[-1]:
                bound = f"at least {bounds[0]}" if number < bounds[0] else f"at most {bounds[-1]}"
                raise ArgumentError(f"--{name.replace('_', '-')} {number}: should be {bound}.")
