"""The command line: `sceniris-gym <command>`. Results go to stdout, everything else to stderr."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from json import dumps
from math import radians
from pathlib import Path
from typing import Annotated, Any, Literal, ParamSpec

import tyro

import sceniris_gym
from sceniris_gym.commands.options import (
    Changes,
    Device,
    Flag,
    Json,
    OptionalScene,
    Out,
    Picture,
    Scene,
    Seed,
    Split,
    check_counts,
    check_seed,
    checked_target,
    compiled_scene,
    read_changes,
    scene_config,
)
from sceniris_gym.config.tier import Tier, TierWord
from sceniris_gym.errors import NotSupportedError, ScenirisError
from sceniris_gym.files import UNWRITABLE, as_json, check_picture, write_text
from sceniris_gym.progress import shown
from sceniris_gym.training.records import CONFIG
from sceniris_gym.training.settings import Options
from sceniris_gym.viewer.server import HOST, MOST_SHOWN, PORT, address, close_server, open_server

P = ParamSpec("P")
_MOST_LAYOUTS = 1_000_000_000  # of a data set, some hundred gigabytes


def _command(work: Callable[P, str]) -> Callable[P, str]:
    """Start Warp for a command, show its progress, and send what libraries print to stderr; stdout has the result."""

    @functools.wraps(work)
    def quiet(*args: P.args, **kwargs: P.kwargs) -> str:
        from sceniris_gym.device.kernel_log import start_warp

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

    figures = tool.demo(checked_target(out), device)
    return dumps(figures) if json else tool.report(figures)


@_command
def generate(
    scene: OptionalScene = None,
    n: Annotated[int | None, tyro.conf.arg(aliases=["-n"])] = None,
    out: Out = None,
    seed: Seed = 0,
    split: Split = "train",
    chunk: int | None = None,
    share: str | None = None,
    format_: Annotated[str | None, tyro.conf.arg(name="format", metavar="npz,usd,json")] = None,
    resume: Flag = False,
    verify: Flag = False,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Write a data set of layouts, together with their MuJoCo model; or verify one.

    Args:
        n: number of layouts
        out: folder for dataset.json, scene.zip and layouts-*.npy
        seed: row i has seed + i, episode 0
        split: training or evaluation layouts
        chunk: layouts made at once, which does not change them; by default a number that suits DEVICE
        share: R/K: write every K-th part; by default the share that torchrun or a Slurm array gives
        format_: one or several of these, beside layouts-*.npy
        resume: go on with the data set in the folder, if there is one
        verify: only compare the data set in the folder with its checksums
    """
    if out is None:
        raise NotSupportedError("generate: nowhere to write to. Give a folder: -o FOLDER.")
    if verify:
        if scene is not None or n is not None or resume or format_ is not None:
            raise NotSupportedError("generate: --verify reads the folder. Leave out SCENE, -n, --format and --resume.")
        from sceniris_gym.dataset.reader import verify as verified

        held = verified(out)
        found = {name: held[name] for name in ("scene", "hash", "split", "seed", "layouts")} | {"verified": True}
        return dumps(found) if json else f"{out}: {held['layouts']} layouts of '{held['scene']}', all files are whole"
    if scene is None or n is None:
        raise NotSupportedError("generate: nothing to make. Give a SCENE and a number of layouts, -n N.")
    check_counts(1, n=n, most=_MOST_LAYOUTS)
    check_counts(1, chunk=1 if chunk is None else chunk)
    check_seed(seed)
    from sceniris_gym.commands import generate as tool
    from sceniris_gym.dataset.formats import parse_formats
    from sceniris_gym.dataset.manifest import MANIFEST, SCENE
    from sceniris_gym.dataset.share import Share

    formats = () if format_ is None else parse_formats(format_)
    part = Share.current() if share is None else Share.parse(share)
    for file in (MANIFEST, SCENE):
        checked_target(out / file)
    compiled = compiled_scene(scene, changes, device or part.device)
    words = {"chunk": chunk, "share": part, "resume": resume, "formats": formats}
    figures = tool.generate(compiled, n, out, seed=seed, split=split, **words)
    return dumps(figures) if json else tool.report(figures)


@_command
def audit(
    scene: Scene,
    layouts: int = 1000,
    rejected: int = 1000,
    settled: int | None = None,
    seed: int = 0,
    save: Path | None = None,
    rows: Path | None = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Make layouts and audit them with FCL, MuJoCo C and shapely, which share no code with the generator.

    Args:
        layouts: layouts to judge
        rejected: rejected candidates to judge
        settled: layouts to step for 0.5 s; by default all
        save: write the rows to this .npz instead of judging them
        rows: judge the rows of such a file, on a CPU; make none
    """
    check_counts(1, layouts=layouts)
    check_counts(0, rejected=rejected, settled=settled or 0)
    check_seed(seed)
    from sceniris_gym.commands import audit as tool

    if rows is not None and save is not None:
        raise NotSupportedError("audit: --save and --rows are separate commands. Give one at a time.")
    if save is not None:
        checked_target(save)
        found = tool.save(compiled_scene(scene, changes, device), layouts, rejected, seed, save)
    elif rows is not None:
        found = tool.judge_file(scene_config(scene, changes), rows, settled)
    else:
        found = tool.judge(compiled_scene(scene, changes, device), layouts, rejected, settled, seed)
    return dumps(found) if json else _listing(found)


@_command
def bench(
    scene: Scene,
    num_envs: int = 4096,
    geometry: Literal["physics", "visual"] | None = None,
    seed: int = 0,
    picture: Picture = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Measure how fast layouts of a scene are made and its worlds are reset.

    Args:
        geometry: kind of geometry; by default the scene's own
    """
    check_counts(1, num_envs=num_envs)
    check_seed(seed)
    check_picture(picture)
    from sceniris_gym.commands import bench as tool

    overrides = read_changes(changes) | ({} if geometry is None else {"geometry": geometry})
    measured = tool.bench(scene, num_envs, device, seed, overrides, picture)
    return dumps(measured) if json else _listing(measured)


@_command
def replay(
    layout: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID")],
    scene: str | None = None,
    out: Path | None = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Make one layout again from its id, and show it as numbers and as a picture.

    Args:
        layout: scenehash:split:seed:episode
        scene: the layout's scene, if it is not a shipped one
        out: picture to write; by default in demo/
    """
    from sceniris_gym.commands import replay as tool

    picture = checked_target(out, tool.default_picture(layout))
    found = tool.shown(layout, None if scene is None else scene_config(scene, changes), picture, device)
    return dumps(found) if json else tool.report(found)


@_command
def check(
    scene: Scene,
    layouts: Annotated[int, tyro.conf.arg(aliases=["-n"])] = 1024,
    seed: int = 0,
    picture: Picture = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Say why a scene is hard: how many candidates were rejected, per object and cause.

    Args:
        layouts: layouts to make
    """
    check_counts(1, layouts=layouts)
    check_seed(seed)
    check_picture(picture)
    from sceniris_gym.commands import check as tool

    found = tool.check(compiled_scene(scene, changes, device), layouts, seed, picture)
    return dumps(found) if json else tool.report(found)


@_command
def reach(
    arm: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ARM")],
    build: Flag = False,
    poses: Path | None = None,
    out: Out = None,
    tier: TierWord | None = None,
    map_: Annotated[Path | None, tyro.conf.arg(name="map")] = None,
    scene: str | None = None,
    height: float = 0.1,
    step: float | None = None,
    tilt_step: float = 2.5,
    seed: Seed = 0,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Describe and draw what an arm reaches, build its map, or judge poses.

    Args:
        arm: name of a shipped arm, or its MJCF or URDF
        build: build the map; resumes a build that was stopped
        poses: .npy of TCP poses to judge, (N, 4, 4), base frame
        out: file to write: the map, the verdicts or the picture
        tier: tier to judge by; by default that of the arm
        map_: map file; by default the arm's own
        scene: draw the places that 'reachable' leaves to its objects
        height: height of the picture's top view, base frame [m]
        step: step of the map's grid [m]; by default 0.025, more for long arms
        tilt_step: tilt step of the map's grid [degrees]
        seed: seed of the map, or of the first layout
    """
    check_seed(seed)
    from sceniris_gym.commands import reach as tool

    asked = [f"--{word}" for word, value in (("build", build), ("poses", poses), ("scene", scene)) if value]
    if len(asked) > 1:
        raise NotSupportedError(f"reach: {' and '.join(asked)} are separate commands. Give one at a time.")
    overrides = read_changes(changes)
    if poses is not None:
        target, judged_by = checked_target(out, "reached.npy"), None if tier is None else Tier.of(tier)
        found = tool.judge(arm, map_, poses, target, judged_by, device, overrides)
    elif build:
        target, steps = checked_target(out, tool.default_map(arm)), {"step": step, "tilt_step": radians(tilt_step)}
        found = tool.build(arm, target, device, seed=seed, changes=overrides, **steps)
    elif scene is not None:
        target = checked_target(out, f"demo/reach_{Path(scene).stem}.png")
        found = tool.narrowed(arm, scene_config(scene, changes), target, device, seed=seed)
    else:
        target = checked_target(out, f"demo/reach_{Path(arm).stem}.png")
        found = tool.show(arm, map_, target, height, device, overrides)
    return dumps(found) if json else _listing(found)


def view(
    scene: OptionalScene = None,
    worlds: int = 1,
    seed: Seed = 0,
    episode: int = 0,
    split: Split = "train",
    env: str | None = None,
    policy: Annotated[str | None, tyro.conf.arg(metavar="POLICY")] = None,
    layouts: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="ID")] = (),
    host: str = HOST,
    port: int = PORT,
    allow_origin: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="ORIGIN")] = (),
    trust: Flag = False,
    device: Annotated[str | None, tyro.conf.arg(help="with --env: cpu, cuda:0, ...")] = None,
    changes: Changes = (),
) -> str:
    """Open a page that shows a scene or a policy at work: layouts, rejected candidates with the reasons, physics.

    The address of the page is printed at once. What is saved in the scene's file is shown at once. Ctrl-C ends it.

    Args:
        worlds: how many worlds, at most 64
        seed: world i has seed + i
        episode: how often the worlds were reset since they got the seed
        split: training or evaluation layouts
        env: instead of a scene: an environment, e.g. sceniris_gym/TabletopLift-v0, or your own as MODULE:ID
        policy: an rsl-rl checkpoint (.pt), an SB3 model (.zip), or module:function; by default random actions
        layouts: layout id to play, or a file with one a line; may be given several times
        host: address to listen on; 0.0.0.0 lets other machines in
        port: port to listen on; the next free one if it is in use
        allow_origin: address of the page in a browser, as in https://hub.example.org, if it is not this machine's
        trust: read a policy's .zip, which executes what is in it
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

    overrides = read_changes(changes)
    server = open_server(host, port, allow_origin)
    with ExitStack() as stack:
        stack.callback(close_server, server)
        print(address(server), flush=True)  # before anything that takes a while
        if server.get_port() != port:
            print(f"Port {port} is in use, so the page is at port {server.get_port()}.", file=sys.stderr, flush=True)
        stack.enter_context(_stdout_to_stderr())
        if scene is None:
            ids = command.read_ids(layouts)
            words = {"num": worlds, "split": split, "device": device, "changes": overrides, "trust": trust}
            command.view_env(server, str(env), policy, ids, **words)
        else:
            command.view_scene(server, scene, overrides, split=split, seed=seed, episode=episode, num=worlds)
    return ""


@_command
def import_(
    thing: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="THING")],
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])],
    scale: str | None = None,
    up: Literal["x", "y", "z"] | None = None,
    density: float = 500.0,
    tolerance: float | None = None,
    shell: Flag = False,
    jobs: int | None = None,
    device: Device = None,
    json: Json = False,
) -> str:
    """Make assets of meshes, URDF and USD: convex parts, mass, resting poses, grasps, a picture and a manifest.

    Args:
        thing: OBJ, STL, PLY, GLB, DAE, URDF or USD, or a folder
        out: MJCF file to write; for a folder of things a folder
        scale: metres for each unit, or m, cm, mm, in, ft
        up: the axis of the file that points up
        density: density where the file has no masses [kg/m^3]
        tolerance: how far convex parts may be from the surface [m]; by default 2 mm or 2%
        shell: take open surfaces for sheets without an inside
        jobs: things of a folder at a time; by default one for each core
    """
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
    model: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL")],
    out: Out = None,
    assets: Path | None = None,
    widen: float = 1.0,
    clutter: int = 0,
    device: Device = None,
    json: Json = False,
) -> str:
    """Write a first scene file from a model: its free bodies on what they stand on, its robot, and its supports.

    What cannot be placed is commented out, with the reason. The scene is tried before it is written. From a problem
    file of LIBERO (.bddl), write its scene, and beside it the folder of its model.

    Args:
        model: an MJCF or URDF file, or a problem file
        out: scene file to write; by default to stdout
        assets: with a problem file: the folder of LIBERO's models
        widen: with a problem file: the factor by which its regions grow
        clutter: with a problem file: the number of further objects in each layout
    """
    from sceniris_gym.commands import init as tool

    target = None if out is None else checked_target(out)
    if model.suffix.lower() == ".bddl":
        if target is None:
            raise NotSupportedError(f"init: the model of {model} needs a folder. Give a scene file: -o FILE.yaml.")
        from sceniris_gym.importers.libero.reader import read_bddl

        task = read_bddl(model, assets=assets, widen=widen, clutter=clutter)
        written = tool.write_task(task, target, device)
        return dumps(written) if json else _listing(written)
    if (assets, widen, clutter) != (None, 1.0, 0):
        raise NotSupportedError("init: --assets, --widen and --clutter belong to a problem file of LIBERO (.bddl).")
    scene = tool.init(model, device)
    if target is not None:
        write_text(target, tool.text(scene, target))
    elif not json:
        return tool.text(scene, None).rstrip()
    found = tool.summary(scene, target)
    return dumps(found) if json else tool.report(found)


@_command
def settle(
    scene: Scene,
    heap: str | None = None,
    n: Annotated[int, tyro.conf.arg(aliases=["-n"])] = 64,
    out: Out = None,
    seed: Seed = 0,
    changes: Changes = (),
    json: Json = False,
) -> str:
    """Settle things in a container by MuJoCo C, into a file of heaps that layouts are drawn from.

    Args:
        heap: which of the scene's heaps; by default the only one
        n: number of rows
        out: .npz to write; by default what the heap names
        seed: row i depends on it and on i alone
    """
    check_counts(1, n=n, most=1_000_000)
    check_seed(seed)
    from sceniris_gym.commands import settle as tool

    found = tool.settle(scene_config(scene, changes), heap, n, out, seed)
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
    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")],
    layouts: int = 4096,
    out: Out = None,
    task: str = "",
    trust: Flag = False,
    device: Device = None,
    json: Json = False,
) -> str:
    """Judge the policy of a training on layouts that it has not seen: valid ones, and ones placed without checks.

    Args:
        run: folder of a training, with its model.pt
        layouts: layouts of each kind
        out: JSON file to write: the verdict on every layout
        task: the task, as MODULE:ID if it is not of this package; by default the one that RUN names
        trust: read a checkpoint that holds more than weights, which executes what is in it
    """
    check_counts(1, layouts=layouts)
    target = None if out is None else checked_target(out)
    from sceniris_gym.commands import evaluate as tool

    found = tool.evaluate(run, layouts, device, target, task=task, trust=trust)
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
    except (ScenirisError, OSError) as error:
        message = str(error) if isinstance(error, ScenirisError) else _in_words(error)
        print(f"sceniris-gym: {message}", file=sys.stderr)
        sys.exit(2)


def _in_words(error: OSError) -> str:
    """Return an error of the operating system in words: the file, the reason, and a remedy."""
    file = "a file" if error.filename is None else str(error.filename)
    why = str(error) if error.strerror is None else error.strerror.lower()
    if error.filename is not None and _is_unwritable_cache(file):
        return (
            f"{file}: the folder for compiled kernels cannot be written: {why}. "
            "Set WARP_CACHE_PATH to a folder that you can write to."
        )
    advice = "Make room there, or give it another place: --out for results, WARP_CACHE_PATH for compiled kernels."
    return f"{file}: {why}. {advice if error.errno in UNWRITABLE else ''}".rstrip()


def _is_unwritable_cache(file: str) -> bool:
    """Return True if a file is Warp's kernel cache, or inside or above it, and nothing can be written there."""
    import warp as wp

    if not wp.config.kernel_cache_dir:
        return False
    cache, path = Path(wp.config.kernel_cache_dir), Path(file).absolute()
    concerned = path.is_relative_to(cache) or cache.is_relative_to(path)
    return concerned and not (cache.is_dir() and os.access(cache, os.W_OK))


def _listing(figures: dict[str, Any]) -> str:
    return "\n".join(f"{name:<24}{value}" for name, value in figures.items())
