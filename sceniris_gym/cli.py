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
from typing import Annotated, Any, Literal, NoReturn, ParamSpec

import tyro

import sceniris_gym
from sceniris_gym.commands.options import (
    Changes,
    Device,
    Json,
    Picture,
    Scene,
    check_counts,
    check_seed,
    checked_target,
    compiled_scene,
    read_changes,
    scene_config,
)
from sceniris_gym.config.tier import Tier, TierWord
from sceniris_gym.errors import NotSupportedError, ScenirisError
from sceniris_gym.training.records import CONFIG, as_json
from sceniris_gym.training.settings import Options
from sceniris_gym.viewer.server import HOST, MOST_SHOWN, PORT

P = ParamSpec("P")
_UNWRITABLE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG})
_MOST_LAYOUTS = 1_000_000_000  # of a data set, some hundred gigabytes


def _command(work: Callable[P, str]) -> Callable[P, str]:
    """Send everything that libraries print during a command to stderr, and show there how far it is.

    Stdout is for the result.
    """

    @functools.wraps(work)
    def quiet(*args: P.args, **kwargs: P.kwargs) -> str:
        from sceniris_gym.commands.bars import shown
        from sceniris_gym.commands.warp_start import start_warp

        start_warp()
        with _stdout_to_stderr(), shown(quiet=bool(kwargs.get("json"))):
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
    from sceniris_gym.commands import demo as tool

    checked_target(out)
    figures = tool.demo(out, device)
    return dumps(figures) if json else tool.report(figures)


@_command
def generate(
    scene: Annotated[
        str | None, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE", help="name of a shipped scene, or a path")
    ] = None,
    n: Annotated[int | None, tyro.conf.arg(aliases=["-n"], help="number of layouts")] = None,
    out: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], help="folder for dataset.json, scene.zip and layouts-*.npy")
    ] = None,
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"], help="row i has seed + i, episode 0")] = 0,
    split: Annotated[Literal["train", "eval"], tyro.conf.arg(help="training or evaluation layouts")] = "train",
    chunk: Annotated[
        int | None, tyro.conf.arg(help="layouts made at once, which does not change them; by default what suits DEVICE")
    ] = None,
    share: Annotated[
        str | None, tyro.conf.arg(help="R/K: write every K-th part; by default as torchrun or a Slurm array say")
    ] = None,
    format_: Annotated[
        str | None,
        tyro.conf.arg(name="format", metavar="npz,usd,json", help="one or several of these, beside layouts-*.npy"),
    ] = None,
    resume: Annotated[
        bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="go on with the data set in the folder, if there is one")
    ] = False,
    verify: Annotated[
        bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="only compare the data set in the folder with its sums")
    ] = False,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Write a data set of layouts, together with their MuJoCo model; or verify one."""
    if out is None:
        raise NotSupportedError("generate: nowhere to write to. Give a folder: -o FOLDER.")
    if verify:
        if scene is not None or n is not None or resume or format_ is not None:
            raise NotSupportedError("generate: --verify reads the folder. Leave out SCENE, -n, --format and --resume.")
        return _verified(out, json)
    if scene is None or n is None:
        raise NotSupportedError("generate: nothing to make. Give a SCENE and a number of layouts, -n N.")
    check_counts(1, n=n, most=_MOST_LAYOUTS)
    check_counts(1, chunk=1 if chunk is None else chunk)
    check_seed(seed)
    from sceniris_gym.dataset.formats import check_formats, parse_formats
    from sceniris_gym.dataset.share import Share

    formats = () if format_ is None else parse_formats(format_)
    check_formats(formats)
    part = Share.current() if share is None else Share.parse(share)
    from sceniris_gym.commands import generate as tool
    from sceniris_gym.dataset.manifest import MANIFEST, SCENE

    for file in (MANIFEST, SCENE):
        checked_target(out / file)
    compiled = compiled_scene(scene, changes, device or part.device)
    words = {"chunk": chunk, "share": part, "resume": resume, "formats": formats}
    figures = tool.generate(compiled, n, out, seed=seed, split=split, **words)
    if json:
        return dumps(figures)
    if not figures["complete"]:
        return f"{out}: {figures['missing_parts']} of {figures['parts']} parts are left for the other processes"
    made = f"{n} layouts of '{compiled.config.name}' written to {out}, {figures['valid']:.2%} valid"
    return f"{made}; the first one is {figures['first_id']}"


def _verified(folder: Path, json: bool) -> str:
    """Verify a data set, and say what it is."""
    from tqdm import tqdm

    from sceniris_gym.dataset.reader import verify

    with tqdm(unit="layout", unit_scale=True, file=sys.stderr) as bar:
        held = verify(folder, bar.update)
    found = {name: held[name] for name in ("scene", "hash", "split", "seed", "layouts")} | {"verified": True}
    return dumps(found) if json else f"{folder}: {held['layouts']} layouts of '{held['scene']}', all files are whole"


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
    check_counts(1, layouts=layouts)
    check_counts(0, rejected=rejected, settled=settled or 0)
    check_seed(seed)
    from sceniris_gym.commands import audit as tool

    if rows is not None:
        if save is not None:
            raise NotSupportedError("audit: --save and --rows are separate commands. Give one at a time.")
        from sceniris_gym.program.compiled import upload_scene
        from sceniris_gym.scene.model import build_model

        compiled = upload_scene(build_model(scene_config(scene, changes)), "cpu")
        found = tool.judge_rows(compiled, tool.load_rows(compiled, rows), settled)
        return dumps(found) if json else _listing(found)
    target = None if save is None else checked_target(save)
    compiled = compiled_scene(scene, changes, device)
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
    scene: Scene,
    num_envs: int = 4096,
    geometry: Annotated[
        Literal["physics", "visual"] | None, tyro.conf.arg(help="kind of geometry; by default the scene's own")
    ] = None,
    seed: int = 0,
    picture: Picture = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Measure how fast layouts of a scene are made and its worlds are reset."""
    check_counts(1, num_envs=num_envs)
    check_seed(seed)
    from sceniris_gym.commands import bench as tool
    from sceniris_gym.files import check_picture

    if picture is not None:
        check_picture(picture)

    overrides = read_changes(changes) | ({} if geometry is None else {"geometry": geometry})
    measured = tool.bench(scene, num_envs, device, seed, overrides, picture)
    return dumps(measured) if json else _listing(measured)


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
    from sceniris_gym.commands import replay as tool
    from sceniris_gym.layout.compile import compile_scene
    from sceniris_gym.pictures.render import captioned, save

    name = tool.LayoutId.parse(layout)
    picture = checked_target(out, tool.default_picture(layout))
    config = None if scene is None else scene_config(scene, changes)
    compiled = compile_scene(tool.find_scene(name.scene, config), device)
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
    check_counts(1, layouts=layouts)
    check_seed(seed)
    from sceniris_gym.commands import check as tool
    from sceniris_gym.files import check_picture

    if picture is not None:
        check_picture(picture)
    found = tool.check(compiled_scene(scene, changes, device), layouts, seed, picture)
    return dumps(found) if json else tool.report(found)


@_command
def reach(
    arm: Annotated[
        str, tyro.conf.Positional, tyro.conf.arg(metavar="ARM", help="name of a shipped arm, or its MJCF or URDF")
    ],
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
    check_seed(seed)
    from sceniris_gym.commands import reach as tool

    asked = [f"--{word}" for word, value in (("build", build), ("poses", poses), ("scene", scene)) if value]
    if len(asked) > 1:
        raise NotSupportedError(f"reach: {' and '.join(asked)} are separate commands. Give one at a time.")
    if poses is not None:
        found = tool.judge(
            arm,
            map_,
            poses,
            checked_target(out, "reached.npy"),
            None if tier is None else Tier.of(tier),
            device,
            read_changes(changes),
        )
    elif build:
        target = checked_target(out, tool.default_map(arm))
        words = {"seed": seed, "changes": read_changes(changes)}
        found = tool.build(arm, target, device, step=step, tilt_step=radians(tilt_step), **words)
    elif scene is not None:
        target = checked_target(out, f"demo/reach_{Path(scene).stem}.png")
        found = tool.narrowed(arm, scene_config(scene, changes), target, device, seed=seed)
    else:
        found = tool.show(
            arm, map_, checked_target(out, f"demo/reach_{Path(arm).stem}.png"), height, device, read_changes(changes)
        )
    return dumps(found) if json else _listing(found)


def view(
    scene: Annotated[
        str | None, tyro.conf.Positional, tyro.conf.arg(metavar="SCENE", help="name of a shipped scene, or a path")
    ] = None,
    worlds: Annotated[int, tyro.conf.arg(help="how many worlds, at most 64")] = 1,
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"], help="world i has seed + i")] = 0,
    episode: Annotated[int, tyro.conf.arg(help="how often the worlds were reset since they got the seed")] = 0,
    split: Annotated[Literal["train", "eval"], tyro.conf.arg(help="training or evaluation layouts")] = "train",
    env: Annotated[
        str | None, tyro.conf.arg(help="instead of a scene: an environment, e.g. sceniris_gym/TabletopLift-v0")
    ] = None,
    policy: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="POLICY",
            help="who plays it: an rsl-rl checkpoint (.pt), an SB3 model (.zip), or module:function; else at random",
        ),
    ] = None,
    layouts: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(metavar="ID", help="layout id to play, or a file with one a line; may be given several times"),
    ] = (),
    host: Annotated[str, tyro.conf.arg(help="address to listen on; 0.0.0.0 lets other machines in")] = HOST,
    port: Annotated[int, tyro.conf.arg(help="port to listen on; the next free one if it is in use")] = PORT,
    device: Annotated[str | None, tyro.conf.arg(help="with --env: cpu, cuda:0, ...")] = None,
    changes: Changes = (),
) -> str:
    """Open a page that shows a scene, or a policy at work: layouts, why candidates are rejected, physics.

    The address of the page is printed at once. What is saved in the scene's file is shown at once. Ctrl-C ends it.
    """
    if (scene is None) == (env is None):
        raise NotSupportedError("view: should have either a SCENE or --env, as in 'sceniris-gym view mid'.")
    if env is None and (policy or layouts or device):
        raise NotSupportedError("view: --policy, --layouts and --device belong to --env. Leave them out, or the SCENE.")
    if env is not None and (seed or episode):
        raise NotSupportedError("view: --seed and --episode belong to a SCENE. Choose an environment's by --layouts.")
    check_counts(1, most=MOST_SHOWN, worlds=worlds)
    check_counts(1, most=65535, port=port)
    check_seed(seed)
    check_counts(0, most=2**31 - 1, episode=episode)
    from sceniris_gym.viewer import command
    from sceniris_gym.viewer.server import address, opened_page

    overrides = read_changes(changes)
    with opened_page(host, port) as server:
        print(address(server), flush=True)  # before anything that takes a while
        if server.get_port() != port:
            print(f"Port {port} is in use, so the page is at port {server.get_port()}.", file=sys.stderr, flush=True)
        with _stdout_to_stderr():
            if env is not None:
                ids = command.read_ids(layouts)
                words = {"num": worlds, "split": split, "device": device, "changes": overrides}
                command.view_env(server, env, policy, ids, **words)
            else:
                assert scene is not None
                command.view_scene(server, scene, overrides, split=split, seed=seed, episode=episode, num=worlds)
    return ""


@_command
def import_(
    thing: Annotated[
        Path,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="THING", help="OBJ, STL, PLY, GLB, DAE, URDF or USD, or a folder"),
    ],
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], help="MJCF file to write; for a folder of things a folder")],
    scale: Annotated[str | None, tyro.conf.arg(help="metres for each unit, or m, cm, mm, in, ft")] = None,
    up: Annotated[Literal["x", "y", "z"] | None, tyro.conf.arg(help="the axis of the file that points up")] = None,
    density: Annotated[float, tyro.conf.arg(help="density where the file has no masses [kg/m^3]")] = 500.0,
    tolerance: Annotated[
        float | None, tyro.conf.arg(help="how far convex parts may be from the surface [m]; by default 2 mm or 2%%")
    ] = None,
    shell: Annotated[
        bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="open surfaces are sheets without inside")
    ] = False,
    jobs: Annotated[
        int | None, tyro.conf.arg(help="of a folder: things at a time; by default one for each core")
    ] = None,
    device: Device = None,
    json: Json = False,
) -> str:
    """Make assets of meshes, URDF and USD: convex parts, mass, resting poses, grasps, a picture and a manifest."""
    from sceniris_gym.commands import import_things as tool
    from sceniris_gym.importers.things.importer import Options
    from sceniris_gym.importers.things.units import ask_on_terminal

    check_counts(1, jobs=1 if jobs is None else jobs)
    options = Options(scale, up, density, tolerance, shell)
    if thing.is_dir():
        found = tool.import_many(thing, out, options, jobs, device)
        return dumps(found) if json else _listing(found)
    checked_target(out)
    found = tool.import_one(thing, out, options, None if json else ask_on_terminal(), device)
    return dumps(found) if json else tool.report(found)


@_command
def init(
    model: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL", help="an MJCF or URDF file")],
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"], help="scene file to write; by default to stdout")] = None,
    device: Device = None,
    json: Json = False,
) -> str:
    """Write a first scene file from a model: its free bodies on what they stand on, its robot, and its supports.

    What cannot be placed is commented out, with the reason. The scene is tried before it is written.
    """
    from sceniris_gym.commands import init as tool

    target = None if out is None else checked_target(out)
    scene = tool.init(model, device)
    if target is not None:
        tool.write(scene, target)
    elif not json:
        return tool.text(scene, None).rstrip()
    found = tool.summary(scene, target)
    return dumps(found) if json else tool.report(found)


@_command
def settle(
    scene: Scene,
    heap: Annotated[str | None, tyro.conf.arg(help="which of the scene's heaps; by default the only one")] = None,
    n: Annotated[int, tyro.conf.arg(aliases=["-n"], help="number of rows")] = 64,
    out: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], help=".npz to write; by default what the heap names")
    ] = None,
    seed: Annotated[int, tyro.conf.arg(aliases=["-s"], help="row i depends on it and on i alone")] = 0,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Settle things in a container by MuJoCo C, into a file of heaps that layouts are drawn from."""
    check_counts(1, n=n, most=1_000_000)
    check_seed(seed)
    from tqdm import tqdm

    from sceniris_gym.commands import settle as tool

    with tqdm(total=n, unit="heap", file=sys.stderr, disable=json or not sys.stderr.isatty()) as bar:
        found = tool.settle(scene_config(scene, changes), heap, n, out, seed, lambda done, of: bar.update())
    return dumps(found) if json else tool.report(found)


@_command
def train(options: Annotated[Options, tyro.conf.arg(name="")], json: Json = False) -> str:
    """Train a task with rsl-rl's PPO (extra `rsl-rl`), and judge its policy on layouts that it has not seen."""
    check_counts(1, num_envs=options.num_envs, layouts=options.layouts, every=options.every)
    check_counts(0, most=2**31 - 1, seed=options.seed)
    checked_target(options.out / CONFIG)
    from sceniris_gym.commands import train as tool

    found = tool.train(options, quiet=json)
    return as_json(found) if json else tool.report(found)


@_command
def evaluate(
    run: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN", help="folder of a training, with its model.pt")
    ],
    layouts: Annotated[int, tyro.conf.arg(help="layouts of each kind")] = 4096,
    out: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], help="JSON file to write: the verdict on every layout")
    ] = None,
    device: Device = None,
    json: Json = False,
) -> str:
    """Judge the policy of a training on layouts that it has not seen: valid ones, and ones placed without checks."""
    check_counts(1, layouts=layouts)
    target = None if out is None else checked_target(out)
    from sceniris_gym.commands import evaluate as tool

    found = tool.evaluate(run, layouts, device, target)
    return as_json(found) if json else tool.report(found)


ABOUT = "Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments."
COMMANDS = {
    command.__name__.rstrip("_"): command
    for command in (demo, generate, audit, bench, replay, check, reach, import_, init, settle, train, evaluate, view)
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command.

    A ScenirisError or an OSError ends it with a message on stderr and exit status 2.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    if list(arguments) == ["--version"]:
        print(f"sceniris-gym {sceniris_gym.__version__}")
        return
    about = f"{ABOUT} Version {sceniris_gym.__version__} (--version)."
    try:
        print(tyro.extras.subcommand_cli_from_dict(COMMANDS, prog="sceniris-gym", description=about, args=arguments))
    except ScenirisError as error:
        _end(str(error), 2)
    except OSError as error:
        _end(_in_words(error), 2)
    except KeyboardInterrupt:  # where it is not run as the program
        _end("interrupted", 128 + signal.SIGINT)


def _in_words(error: OSError) -> str:
    """Say which file an error of the operating system is about, and what helps."""
    file = "a file" if error.filename is None else str(error.filename)
    why = str(error) if error.strerror is None else error.strerror.lower()
    if error.filename is not None and _is_unwritable_cache(file):
        return (
            f"{file}: the folder for compiled kernels cannot be written: {why}. "
            "Set WARP_CACHE_PATH to a folder that you can write to."
        )
    advice = "Make room there, or give it another place: --out for results, WARP_CACHE_PATH for compiled kernels."
    return f"{file}: {why}. {advice if error.errno in _UNWRITABLE else ''}".rstrip()


def _is_unwritable_cache(file: str) -> bool:
    """Whether a file is Warp's cache of kernels, inside of it or above it, and nothing can be written there."""
    import warp as wp

    if not wp.config.kernel_cache_dir:
        return False
    cache, path = Path(wp.config.kernel_cache_dir), Path(file).absolute()
    concerned = path.is_relative_to(cache) or cache.is_relative_to(path)
    return concerned and not (cache.is_dir() and os.access(cache, os.W_OK))


def _end(message: str, status: int) -> NoReturn:
    print(f"sceniris-gym: {message}", file=sys.stderr)
    sys.exit(status)


def _listing(figures: dict[str, Any]) -> str:
    return "\n".join(f"{name:<24}{value}" for name, value in figures.items())
