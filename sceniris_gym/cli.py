"""The command line: `sceniris-gym <command>`. Results go to stdout, everything else to stderr."""

from __future__ import annotations

import errno
import functools
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from json import dumps
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NoReturn, ParamSpec

import tyro

import sceniris_gym
from sceniris_gym.errors import CountError, NotSupportedError, SceneKeyError, ScenirisError, SeedError
from sceniris_gym.layout.counts import MOST_WORLDS
from sceniris_gym.reach.tier import Tier, TierWord

if TYPE_CHECKING:
    from sceniris_gym.config.scene import SceneConfig
    from sceniris_gym.program.compiled import CompiledScene
    from sceniris_gym.tools.paper.peers import Peer

Scene = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE", help="name of a shipped scene, or a path")]
Device = Annotated[str | None, tyro.conf.arg(help="cpu, cuda:0, ...; by default cuda:0 if there is one, else cpu")]
Json = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="print one line of JSON and nothing else")]
Picture = Annotated[
    Path | None, tyro.conf.arg(help="PNG to write: where objects lie, from above, without and with 'reachable'")
]
Changes = Annotated[
    tyro.conf.UseAppendAction[tuple[str, ...]],
    tyro.conf.arg(name="set", metavar="KEY=VALUE", help="change part of the scene, e.g. objects.apple.clearance=0.01"),
]
P = ParamSpec("P")
_UNWRITABLE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG})
_MOST_LAYOUTS = 1_000_000_000  # of a data set, some hundred gigabytes


def _command(work: Callable[P, str]) -> Callable[P, str]:
    """Send everything that libraries print during a command to stderr: stdout is for the result."""

    @functools.wraps(work)
    def quiet(*args: P.args, **kwargs: P.kwargs) -> str:
        import warp as wp

        wp.config.log_level = wp.LOG_WARNING
        with _stdout_to_stderr():
            return work(*args, **kwargs)

    return quiet


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


@_command
def demo(out: Path = Path("demo/layouts.png"), device: Device = None, json: Json = False) -> str:
    """Reset 64 worlds of the Mid scene three times, print figures, and write a picture of 16 worlds."""
    from sceniris_gym.tools.commands import demo as tool

    _target(out)
    figures = tool.demo(out, device)
    return dumps(figures) if json else tool.report(figures)


@_command
def generate(
    scene: Scene,
    n: Annotated[int, tyro.conf.arg(aliases=["-n"], help="number of layouts")],
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], help="folder for layouts.npz and scene.zip")],
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"], help="row i has seed + i, episode 0")] = 0,
    split: Annotated[Literal["train", "eval"], tyro.conf.arg(help="training or evaluation layouts")] = "train",
    chunk: Annotated[int, tyro.conf.arg(help="layouts made at once; does not change them")] = 4096,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Write a data set of layouts, together with their MuJoCo model."""
    _at_least(1, chunk=chunk)
    _at_least(1, n=n, most=_MOST_LAYOUTS)
    _seed(seed)
    from tqdm import tqdm

    from sceniris_gym.tools.commands.generate import write_dataset
    from sceniris_gym.tools.tables import make_table

    for file in ("layouts.npz", "scene.zip"):
        _target(out / file)
    compiled = _compiled(scene, changes, device)
    with tqdm(total=n, unit="layout", file=sys.stderr) as bar:
        table = make_table(compiled, n, seed, split=split, chunk=chunk, progress=bar.update)
    write_dataset(compiled, table, out)
    figures = {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "first_id": compiled.layout_id(seed, 0, split),
        "layouts": n,
        "valid": float(table.valid.mean()),
        "first_pass_valid": float(table.first_pass_valid.mean()),
        "files": [str(out / "layouts.npz"), str(out / "scene.zip")],
    }
    made = f"{n} layouts of '{compiled.config.name}' written to {out}, {figures['valid']:.2%} valid"
    return dumps(figures) if json else f"{made}; the first one is {figures['first_id']}"


@_command
def audit(
    scene: Scene,
    layouts: Annotated[int, tyro.conf.arg(help="layouts to judge")] = 1000,
    rejected: Annotated[int, tyro.conf.arg(help="rejected candidates to judge")] = 1000,
    settled: Annotated[int | None, tyro.conf.arg(help="layouts to step for 0.5 s; by default all")] = None,
    seed: int = 0,
    save: Annotated[Path | None, tyro.conf.arg(help="write the rows to this .npz instead of judging them")] = None,
    rows: Annotated[Path | None, tyro.conf.arg(help="judge the rows of such a file, on a CPU; make none")] = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Make layouts and audit them with FCL, MuJoCo C and shapely, which share no code with the generator."""
    _at_least(1, layouts=layouts)
    _at_least(0, rejected=rejected, settled=settled or 0)
    _seed(seed)
    from sceniris_gym.tools.commands import audit as tool

    if rows is not None:
        if save is not None:
            raise NotSupportedError("audit: --save and --rows are separate commands. Give one at a time.")
        from sceniris_gym.program.compiled import upload_scene
        from sceniris_gym.scene.model import build_model

        compiled = upload_scene(build_model(_config(scene, changes)), "cpu")
        found = tool.judge_rows(compiled, tool.load_rows(compiled, rows), settled)
        return dumps(found) if json else _listing(found)
    target = None if save is None else _target(save)
    compiled = _compiled(scene, changes, device)
    made = tool.make_rows(compiled, layouts, rejected, seed)
    if target is None:
        found = tool.judge_rows(compiled, made, settled)
    else:
        tool.save_rows(compiled, made, target)
        found = {"scene": compiled.config.name, "hash": compiled.hash, "seed": seed, "file": str(target)}
        found |= {"layouts": len(made.table), "rejected": len(made.rejected)}
    return dumps(found) if json else _listing(found)


@_command
def bench(
    scene: Annotated[
        str | None, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE", help="name of a shipped scene, or a path")
    ] = None,
    num_envs: int = 4096,
    geometry: Annotated[
        Literal["physics", "visual"] | None, tyro.conf.arg(help="kind of geometry; by default the scene's own")
    ] = None,
    seed: int = 0,
    picture: Picture = None,
    suite: Annotated[
        Literal["paper"] | None, tyro.conf.arg(help="instead of a scene: the experiments of the Sceniris paper")
    ] = None,
    quick: Annotated[
        bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="of a suite, only what takes minutes on a CPU")
    ] = False,
    peer: Annotated[
        tyro.conf.UseAppendAction[tuple[Literal["scene_synthesizer", "uniform"], ...]],
        tyro.conf.arg(help="with a suite: measure this too, on the same meshes"),
    ] = (),
    out: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], help="with a suite: folder for paper.json and paper.png")
    ] = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Measure how fast layouts are made and worlds are reset, of a scene or of a whole suite."""
    if suite is not None:
        own = (scene, geometry, picture) != (None, None, None) or (num_envs, seed) != (4096, 0)
        if own or changes:
            raise NotSupportedError("bench: --suite has scenes of its own. Leave out SCENE and what belongs to one.")
        return _paper(device, quick, peer, out, json)
    if scene is None:
        raise NotSupportedError("bench: nothing to measure. Give a SCENE, or --suite paper.")
    if quick or peer or out is not None:
        raise NotSupportedError("bench: --quick, --peer and --out belong to a suite. Add --suite paper, without SCENE.")
    _at_least(1, num_envs=num_envs)
    _seed(seed)
    from sceniris_gym.tools.commands import bench as tool
    from sceniris_gym.tools.files import check_picture

    if picture is not None:
        check_picture(picture)

    overrides = _overrides(changes) | ({} if geometry is None else {"geometry": geometry})
    measured = tool.bench(scene, num_envs, device, seed, overrides, picture)
    return dumps(measured) if json else _listing(measured)


def _paper(device: str | None, quick: bool, peers: Sequence[Peer], out: Path | None, json: bool) -> str:
    """Measure the experiments of the paper, and write them as JSON and as a picture."""
    from sceniris_gym.tools.paper import report, suite

    if out is not None:
        report.check(out)
    found = suite.run(device, quick, peers, suite.progress)
    if out is not None:
        report.write(found, out)
    return report.as_json(found) if json else report.as_text(found)


@_command
def replay(
    layout: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID", help="scenehash:split:seed:episode")],
    scene: Annotated[str | None, tyro.conf.arg(help="the layout's scene, if it is not a shipped one")] = None,
    out: Annotated[Path | None, tyro.conf.arg(help="picture to write; by default in demo/")] = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Make one layout again from its id, and show it as numbers and as a picture."""
    from sceniris_gym.layout.compile import compile_scene
    from sceniris_gym.tools.commands import replay as tool
    from sceniris_gym.tools.render import captioned, save

    name = tool.LayoutId.parse(layout)
    picture = _target(out, tool.default_picture(layout))
    compiled = compile_scene(tool.find_scene(name.scene, None if scene is None else _config(scene, changes)), device)
    table = tool.replay(compiled, name)
    found = {"id": layout, **tool.describe(compiled, table), "picture": str(picture)}
    save(captioned(compiled.mjm, table, [layout], device=compiled.device), picture)
    return dumps(found) if json else tool.report(found)


@_command
def check(
    scene: Scene,
    layouts: Annotated[int, tyro.conf.arg(help="layouts to make")] = 1024,
    seed: int = 0,
    picture: Picture = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Say why a scene is hard: how many candidates were rejected, per object and cause."""
    _at_least(1, layouts=layouts)
    _seed(seed)
    from sceniris_gym.tools.commands import check as tool
    from sceniris_gym.tools.files import check_picture

    if picture is not None:
        check_picture(picture)
    found = tool.check(_compiled(scene, changes, device), layouts, seed, picture)
    return dumps(found) if json else tool.report(found)


@_command
def reach(
    arm: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ARM", help="name of a shipped arm, or its MJCF")],
    build: Annotated[
        bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="build the map; resumes a build that was stopped")
    ] = False,
    poses: Annotated[Path | None, tyro.conf.arg(help=".npy of TCP poses to judge, (N, 4, 4), base frame")] = None,
    out: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], help="file to write: the map, the verdicts or the picture")
    ] = None,
    tier: Annotated[TierWord | None, tyro.conf.arg(help="tier to judge by; by default that of the arm")] = None,
    map_: Annotated[Path | None, tyro.conf.arg(name="map", help="map file; by default the arm's own")] = None,
    scene: Annotated[str | None, tyro.conf.arg(help="draw how 'reachable' narrows where its objects lie")] = None,
    height: Annotated[float, tyro.conf.arg(help="height of the picture's top view, base frame [m]")] = 0.1,
    step: Annotated[
        float | None, tyro.conf.arg(help="step of the map's grid [m]; by default 0.025, more for long arms")
    ] = None,
    tilt_step: Annotated[float, tyro.conf.arg(help="tilt step of the map's grid [degrees]")] = 2.5,
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"], help="seed of the map, or of the first layout")] = 0,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Describe and draw what an arm reaches, build its map, or judge poses."""
    _seed(seed)
    from sceniris_gym.tools.commands import reach as tool

    asked = [f"--{word}" for word, value in (("build", build), ("poses", poses), ("scene", scene)) if value]
    if len(asked) > 1:
        raise NotSupportedError(f"reach: {' and '.join(asked)} are separate commands. Give one at a time.")
    if poses is not None:
        found = tool.judge(
            arm, map_, poses, _target(out, "reached.npy"), None if tier is None else Tier.of(tier), device
        )
    elif build:
        target = _target(out, tool.default_map(arm))
        found = tool.build(arm, target, device, step=step, tilt_step=radians(tilt_step), seed=seed)
    elif scene is not None:
        target = _target(out, f"demo/reach_{Path(scene).stem}.png")
        found = tool.narrowed(arm, _config(scene, changes), target, device, seed=seed)
    else:
        found = tool.show(arm, map_, _target(out, f"demo/reach_{Path(arm).stem}.png"), height, device)
    return dumps(found) if json else _listing(found)


ABOUT = "Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments."
COMMANDS = {command.__name__: command for command in (demo, generate, audit, bench, replay, check, reach)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command.

    A ScenirisError or an OSError ends it with a message on stderr and exit status 2. Ctrl-C ends it with status 130 and
    SIGTERM with 143, as in a shell, after temporary files are removed.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    if list(arguments) == ["--version"]:
        print(f"sceniris-gym {sceniris_gym.__version__}")
        return
    about = f"{ABOUT} Version {sceniris_gym.__version__} (--version)."
    kept = signal.signal(signal.SIGTERM, _terminate)
    try:
        print(tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="sceniris-gym", description=about, args=arguments))
    except ScenirisError as error:
        _end(str(error), 2)
    except OSError as error:
        _end(_in_words(error), 2)
    except KeyboardInterrupt:
        _end("interrupted", 128 + signal.SIGINT)
    finally:
        signal.signal(signal.SIGTERM, kept)


def _terminate(*_: object) -> NoReturn:
    """Exit by an exception, so that temporary files are removed."""
    _end("terminated", 128 + signal.SIGTERM)


def _in_words(error: OSError) -> str:
    """Say which file an error of the operating system is about, and what helps."""
    file = "a file" if error.filename is None else str(error.filename)
    why = str(error) if error.strerror is None else error.strerror.lower()
    advice = "Make room there, or give it another place: --out for results, WARP_CACHE_PATH for compiled kernels."
    return f"{file}: {why}. {advice if error.errno in _UNWRITABLE else ''}".rstrip()


def _end(message: str, status: int) -> NoReturn:
    print(f"sceniris-gym: {message}", file=sys.stderr)
    sys.exit(status)


def _target(out: Path | None, default: str | Path = "") -> Path:
    """Return the path of a result, after making sure that it can be written."""
    from sceniris_gym.tools.files import check_writable

    path = Path(default) if out is None else out
    check_writable(path)
    return path


def _compiled(scene: str, changes: Sequence[str], device: str | None) -> CompiledScene:
    from sceniris_gym.layout.compile import compile_scene

    return compile_scene(_config(scene, changes), device)


def _config(scene: str, changes: Sequence[str]) -> SceneConfig:
    from sceniris_gym.config.scene import SceneConfig

    return SceneConfig.load(scene, _overrides(changes))


def _overrides(changes: Sequence[str]) -> dict[str, Any]:
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


def _at_least(least: int, *, most: int = MOST_WORLDS, **counts: int) -> None:
    for name, count in counts.items():
        if not least <= count <= most:
            bound = f"at least {least}" if count < least else f"at most {most}"
            raise CountError(f"--{name.replace('_', '-')} {count}: should be {bound}.")


def _seed(seed: int) -> None:
    if not 0 <= seed < 1 << 64:
        raise SeedError(f"--seed {seed}: should be an integer from 0 to 2^64 - 1.")


def _listing(figures: dict[str, Any]) -> str:
    return "\n".join(f"{name:<24}{value}" for name, value in figures.items())


if __name__ == "__main__":
    main()
