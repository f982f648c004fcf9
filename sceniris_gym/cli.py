"""The command line: `sceniris-gym COMMAND`. Results go to stdout, messages to stderr."""

import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial, wraps
from math import radians
from pathlib import Path
from typing import Annotated, Literal, ParamSpec

import tyro

import sceniris_gym
from sceniris_gym.commands.answer import Answer, answer, each_once, in_words, join_warnings, listing, print_text
from sceniris_gym.commands.options import (
    LAYOUTS,
    OUT,
    Changes,
    Demos,
    Device,
    Evaluation,
    Flag,
    Json,
    Layouts,
    NumEnvs,
    OptionalScene,
    Out,
    Picture,
    Scene,
    Seed,
    Split,
    check_numbers,
    checked_target,
    compiled_scene,
    parsed,
    read_ids,
    scene_config,
)
from sceniris_gym.config.bounds import COUNT, MOST_WORLDS
from sceniris_gym.config.settings import read_changes
from sceniris_gym.config.tier import Tier, TierWord
from sceniris_gym.dataset.lerobot import MANIFEST
from sceniris_gym.errors import ArgumentError, NotSupportedError, ScenirisError, check_names
from sceniris_gym.files import check_new, check_picture, redirected, write_text
from sceniris_gym.progress import shown
from sceniris_gym.training.settings import CONFIG, Options
from sceniris_gym.viewer.server import HOST, MOST_SHOWN, PORT, show_page

P = ParamSpec("P")
Port = Annotated[int, range(1, 1 << 16)]


def _command(work: Callable[P, Answer]) -> Callable[P, Answer]:
    """Wrap a command: start Warp, show a progress bar, and send output of libraries to stderr."""

    @wraps(work)
    def quiet(*args: P.args, **kwargs: P.kwargs) -> Answer:
        from sceniris_gym.device.kernel_log import start_warp

        start_warp()
        join_warnings()
        with redirected(1, 2), shown(quiet=bool(kwargs.get("json"))):
            return work(*args, **kwargs)

    return quiet


@_command
def demo(out: Annotated[Path, OUT] = Path("demo/layouts.png"), device: Device = None, json: Json = False) -> Answer:
    """Reset 64 worlds of the shipped scene 'mid' three times, print figures, and draw 16 of the worlds.

    Args:
        out: picture to write
    """
    from sceniris_gym.commands import demo as tool

    return answer(tool.demo(checked_target(out), device), json, tool.report)


@_command
def generate(
    scene: OptionalScene = None,
    layouts: Annotated[int | None, LAYOUTS, range(1, 1_000_000_001)] = None,  # some hundred gigabytes
    out: Out = None,
    seed: Seed = 0,
    split: Split = "train",
    chunk: Annotated[int | None, COUNT] = None,
    shard: Annotated[str | None, tyro.conf.arg(metavar="R/K")] = None,
    format_: Annotated[str | None, tyro.conf.arg(name="format", metavar="npz,usd,json,mjcf")] = None,
    resume: Flag = False,
    verify: Flag = False,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Write a data set of layouts with their MuJoCo model, or verify one.

    Args:
        out: folder for dataset.json, scene.zip and layouts-*.npy
        chunk: number of layouts made at once, by default chosen for DEVICE. The layouts do not depend on it
        shard: write only every K-th part, starting with part R. By default, torchrun or a Slurm array sets R and K
        format_: formats in which each part is also written, in addition to .npy. Separate several by commas
        resume: continue the data set in the folder, if it exists
        verify: compare the files in the folder with their checksums. The exit status is 1 if a file is damaged
    """
    if out is None:
        raise NotSupportedError("generate: the folder to write to is missing. Give -o FOLDER.")
    from sceniris_gym.commands import generate as tool

    if verify:
        if scene is not None or layouts is not None or resume or format_ is not None:
            raise NotSupportedError("generate: --verify checks a folder. Leave out SCENE, -n, --format and --resume.")
        return answer(tool.verify(out), json, tool.report_of_files)
    if scene is None or layouts is None:
        raise NotSupportedError("generate: the scene or the number of layouts is missing. Give both: SCENE -n N.")
    from sceniris_gym.dataset.formats import parse_formats
    from sceniris_gym.dataset.manifest import MANIFEST, SCENE, DatasetPlan
    from sceniris_gym.dataset.shard import Shard

    formats = () if format_ is None else parse_formats(format_)
    part = Shard.current() if shard is None else Shard.parse(shard)
    for file in (MANIFEST, SCENE):
        checked_target(out / file)
    compiled = compiled_scene(scene, changes, device or part.device)
    plan = DatasetPlan.of(compiled, layouts, seed, split, formats)
    return answer(tool.generate(compiled, plan, out, part, chunk=chunk, resume=resume), json, tool.report)


@_command
def audit(
    scene: Scene,
    layouts: Layouts = 1000,
    rejected: Annotated[int, range(MOST_WORLDS + 1)] = 1000,
    settled: Annotated[int | None, range(MOST_WORLDS + 1)] = None,
    seed: Seed = 0,
    split: Split = "train",
    save: Path | None = None,
    load: Path | None = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Audit layouts with FCL, MuJoCo C and shapely, independently of the generator's code.

    The exit status is 1 if a layout is invalid.

    Args:
        rejected: number of rejected candidates to judge
        settled: number of layouts to simulate for 0.5 s, by default all
        save: write layouts and candidates to this .npz instead of judging them
        load: judge the layouts and candidates in this file, which --save wrote. This runs on a CPU
    """
    from sceniris_gym.commands import audit as tool
    from sceniris_gym.program.compiled import upload_scene
    from sceniris_gym.scene.build import build_model

    if load is not None and save is not None:
        raise NotSupportedError("audit: --save and --load cannot be combined. Give one of them.")
    if load is not None:
        compiled = upload_scene(build_model(scene_config(scene, changes)), "cpu")
        return answer(tool.judge_rows(compiled, tool.load_rows(compiled, load), settled), json, tool.report)
    if save is not None:
        checked_target(save)
    compiled = compiled_scene(scene, changes, device)
    rows = tool.make_rows(compiled, layouts, rejected, seed, split)
    if save is not None:
        return answer(tool.save_rows(compiled, rows, save), json)
    return answer(tool.judge_rows(compiled, rows, settled), json, tool.report)


@_command
def bench(
    scene: Scene,
    num_envs: NumEnvs = 4096,
    geometry: Literal["physics", "visual"] | None = None,
    seed: Seed = 0,
    picture: Picture = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Measure how fast layouts of a scene are made, and how fast worlds are reset.

    Args:
        geometry: kind of geometry, by default from the scene file
    """
    check_picture(picture)
    from sceniris_gym.commands import bench as tool

    given = changes if geometry is None else (*changes, f"geometry={geometry}")
    return answer(tool.bench(scene_config(scene, given), num_envs, device, seed, picture), json)


@_command
def replay(
    layouts: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="ID|FILE")],
    scene: str | None = None,
    out: Out = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Make layouts again from their ids, and show them as numbers and as one picture.

    Args:
        layouts: scenehash:split:seed:episode, or a file with one id per line
        scene: scene of the layouts, needed if it is not a shipped scene
        out: picture to write, by default in demo/
    """
    from sceniris_gym.commands import replay as tool

    ids = read_ids(layouts)
    if not ids:
        raise NotSupportedError("replay: the layout id is missing. Give an id, or a file with one id per line.")
    picture = checked_target(out, tool.default_picture(ids))
    found = tool.shown(ids, None if scene is None else scene_config(scene, changes), picture, device)
    return answer(found, json, tool.report)


@_command
def check(
    scene: Scene,
    layouts: Layouts = 1024,
    seed: Seed = 0,
    split: Split = "train",
    strict: Flag = False,
    picture: Picture = None,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Check whether all objects of a scene find a place, and count the rejected candidates by object and cause.

    The exit status is 1 if fewer than half of the layouts are valid.

    Args:
        strict: also exit with status 1 if too many worlds get a layout from the fallback bank
    """
    check_picture(picture)
    from sceniris_gym.commands import check as tool

    found = tool.judge(scene_config(scene, changes), device, layouts, seed, picture, split, strict=strict)
    return answer(found, json, partial(tool.report, scene=scene, changes=changes))


@_command
def reach(
    arm: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ARM")],
    build: Flag = False,
    poses: Path | None = None,
    out: Out = None,
    tier: TierWord | None = None,
    map_: Annotated[Path | None, tyro.conf.arg(name="map")] = None,
    height: float = 0.1,
    step: float | None = None,
    tilt_step: float = 2.5,
    seed: Seed = 0,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Describe and draw the reach of an arm, build its map, or judge poses.

    Args:
        arm: name of a shipped arm, or its MJCF or URDF
        build: build the map, or resume a stopped build
        poses: .npy of TCP poses to judge, (N, 4, 4), base frame
        out: file to write: the map, the verdicts or the picture
        tier: reachability test to judge with, by default the arm's default test
        map_: map file, by default the arm's own file
        height: height of the picture's top view, base frame [m]
        step: step of the map's grid [m], by default 0.025, or more for long arms
        tilt_step: tilt step of the map's grid [degrees]
        seed: seed of the map
    """
    from sceniris_gym.commands import reach as tool

    if build and poses is not None:
        raise NotSupportedError("reach: --build and --poses cannot be combined. Give one of them.")
    given = tool.read_arm(arm, read_changes(changes))
    if poses is not None:
        target, judged_by = checked_target(out, "reached.npy"), None if tier is None else Tier.of(tier)
        found = tool.judge(given, map_, poses, target, judged_by, device)
    elif build:
        target, steps = checked_target(out, tool.default_map(arm)), {"step": step, "tilt_step": radians(tilt_step)}
        found = tool.build(given, target, device, seed=seed, **steps)
    else:
        target = checked_target(out, f"demo/reach_{Path(arm).stem}.png")
        found = tool.show(given, map_, target, height, device)
    return answer(found, json)


def view(
    scene: OptionalScene = None,
    num_envs: Annotated[NumEnvs, range(1, MOST_SHOWN + 1)] = 1,
    seed: Seed = 0,
    episode: Annotated[int, range(2**31)] = 0,
    split: Split | None = None,
    env: str | None = None,
    policy: Annotated[str | None, tyro.conf.arg(metavar="POLICY")] = None,
    layout: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="ID|FILE")] = (),
    host: str = HOST,
    port: Port = PORT,
    allow_origin: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="ORIGIN")] = (),
    trust: Flag = False,
    device: Annotated[str | None, tyro.conf.arg(metavar="STR", help="cpu, cuda:0, ..., for SCENE default: cpu")] = None,
    changes: Changes = (),
) -> Answer:
    """Show a scene or a running policy in the browser: layouts, rejected candidates with the reasons, physics.

    The command first prints the address to open. When you save the scene file, the browser shows the change at once.
    Ctrl-C exits.

    Args:
        episode: number of resets since the worlds were seeded
        split: training or evaluation layouts, by default the split of the --layout ids, or train if there are none
        env: environment instead of a scene, e.g. sceniris_gym/TabletopLift-v0, or your own as MODULE:ID
        policy: an rsl-rl checkpoint (.pt), an SB3 model (.zip), or module:function, by default random actions
        layout: id of a layout to play, a file with one id per line, or rows of `suite run` (.jsonl), for failed cases
        host: address to listen on, 0.0.0.0 for all addresses of this machine
        port: port to listen on. If it is in use, the next free port is taken
        allow_origin: address under which a browser on another machine opens the page, e.g. https://hub.example.org
        trust: read a policy's .zip, although this executes code in the file
    """
    if (scene is None) == (env is None):
        raise NotSupportedError("view: give either a SCENE or --env, as in 'sceniris-gym view mid'.")
    if env is None and (policy or layout):
        raise NotSupportedError("view: --policy and --layout need --env. Leave them out, or give --env.")
    if env is not None and (seed or episode):
        raise NotSupportedError("view: --seed and --episode need a SCENE. With --env, choose layouts by --layout.")
    from sceniris_gym.viewer import command

    if len(layout) == 1 and layout[0].endswith(".jsonl"):
        from sceniris_gym.suites.running import failures

        widened, failed = failures(Path(layout[0]), split)
        changes, layout = (*widened, *changes), tuple(failed)
    overrides, ids = read_changes(changes), read_ids(layout)
    if scene is None:
        options = {"num_envs": num_envs, "split": split, "device": device, "overrides": overrides, "trust": trust}
        make = partial(command.view_env, env=str(env), policy=policy, ids=ids, **options)
    else:
        where = {"split": split or "train", "seed": seed, "episode": episode, "num": num_envs}
        make = partial(command.view_scene, scene=scene, changes=overrides, device=device or "cpu", **where)
    return show_page(make, scene or str(env), host, port, allow_origin)


def play(
    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")], host: str = HOST, port: Port = PORT
) -> Answer:
    """Show in the browser how a policy of this package plays its task, in one world that MuJoCo C simulates.

    The command first prints the address to open. Ctrl-C exits.

    Args:
        name: clutter_extract or tabletop_lift
        host: address to listen on, 0.0.0.0 for all addresses of this machine
        port: port to listen on. If it is in use, the next free port is taken
    """
    from sceniris_gym.viewer import command

    return show_page(partial(command.play, name=name), name, host, port)


@_command
def import_(
    thing: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="THING")],
    out: Annotated[Path, OUT],
    scale: str | None = None,
    up: Literal["x", "y", "z"] | None = None,
    density: float = 500.0,
    tolerance: float | None = None,
    max_parts: Annotated[int | None, COUNT] = None,
    shell: Flag = False,
    jobs: Annotated[int | None, COUNT] = None,
    device: Device = None,
    json: Json = False,
) -> Answer:
    """Make assets from meshes, URDF and USD: convex parts, mass, resting poses, grasps, a picture and a manifest.

    Args:
        thing: OBJ, STL, PLY, GLB, DAE, URDF or USD file, or a folder of them
        out: MJCF file to write, or the output folder if THING is a folder
        scale: metres per unit, or m, cm, mm, in, ft
        up: the file's axis that points up
        density: density of parts without a mass in the file [kg/m^3]
        tolerance: largest distance of convex parts from the surface [m], by default 2% of the mesh's longest side, but
            at least 2 mm
        max_parts: largest number of convex parts of a link, by default 32. The tolerance grows until they suffice. With
            --tolerance, it does not grow, and the default is 160
        shell: treat open surfaces as sheets without an inside
        jobs: number of files of a folder to import in parallel, by default one per core
    """
    from sceniris_gym.commands import import_things as tool
    from sceniris_gym.importers.things.importer import Options
    from sceniris_gym.importers.things.units import ask_on_terminal

    options = Options(scale, up, density, tolerance, shell, max_parts)
    if thing.is_dir():
        return answer(tool.import_many(thing, out, options, jobs, device), json)
    checked_target(out)
    return answer(tool.import_one(thing, out, options, None if json else ask_on_terminal(), device), json, tool.report)


@_command
def furniture(
    num: Annotated[int, range(1, 10_001)] = 64,
    out: Annotated[Path, OUT] = Path("furniture"),
    seed: Seed = 0,
    height: float = 0.9,
    turning: Flag = False,
    json: Json = False,
) -> Answer:
    """Write kitchen furniture with drawn sizes: base units that join into rows, counters and wall units.

    Args:
        num: number of units
        out: folder for the units and manifest.json
        height: height of the worktops [m]
        turning: handles of doors and flaps turn
    """
    from sceniris_gym.commands import furniture as tool

    return answer(tool.write(out, num, seed, height, turning), json)


@_command
def init(
    model: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL")],
    out: Out = None,
    assets: Path | None = None,
    widen: float = 1.0,
    clutter: int = 0,
    robot: str | None = None,
    arena: Flag = False,
    device: Device = None,
    json: Json = False,
) -> Answer:
    """Write a first scene file for a model: its free bodies as objects on their supports, and its robot.

    All supports are listed as comments. Before writing, the command makes layouts of the scene. Objects that cannot be
    placed are commented out in the file, with the reason.
    A problem file of LIBERO (.bddl) becomes a scene file and a folder with its model. A folder of problem files becomes
    a folder of scenes. The exit status is 1 if a problem file is refused.

    Args:
        model: an MJCF or URDF file, a problem file, or a folder of problem files
        out: scene file to write, by default stdout, or the output folder if MODEL is a folder
        assets: folder of LIBERO's models, for a problem file
        widen: factor for the size of the regions of a problem file
        clutter: number of additional objects in each layout of a problem file
        robot: arm for a problem file, at the place of LIBERO's arm: panda, ur5e or heron
        arena: also add LIBERO's cameras and what they see to a problem file: floor, walls, furniture, mount of the arm
    """
    from sceniris_gym.commands import init as tool

    target = None if out is None else checked_target(out)
    options = {"assets": assets, "widen": widen, "clutter": clutter, "robot": robot, "arena": arena}
    if model.is_dir() or model.suffix.lower() == ".bddl":
        found = tool.write_problems(model, target, options, device)
        return answer(found, json, tool.report_of_suite if model.is_dir() else listing)
    if tuple(options.values()) != (None, 1.0, 0, None, False):
        needed = "need a problem file of LIBERO (.bddl) as MODEL."
        raise NotSupportedError(f"init: --assets, --widen, --clutter, --robot and --arena {needed}")
    check_new(target, "init")
    scene = tool.init(model, device)
    if target is not None:
        write_text(target, scene.text(target))
    elif not json:
        return Answer(scene.text().rstrip())
    return answer(tool.summary(scene, target), json, tool.report)


def new_task(
    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")],
    robot: str | None = None,
    target: str | None = None,
    out: Out = None,
    json: Json = False,
) -> Answer:
    """Write a first scene file and a first task: NAME.yaml and NAME.py.

    Args:
        name: a module name in lower case, such as pick_can
        robot: arm of the package, or its MJCF or URDF, by default panda
        target: object to grasp, of the package or an MJCF or URDF file, by default orange
        out: folder of the two files, by default the working folder
    """
    from sceniris_gym.commands import new_task as tool

    return answer(tool.new_task(name, out or Path(), robot, target), json)


@_command
def settle(
    scene: Scene,
    heap: str | None = None,
    rows: Annotated[int, range(1, 1_000_001)] = 64,
    out: Out = None,
    seed: Seed = 0,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Settle the objects of a heap in their container with MuJoCo C, and write the settled poses to a file.

    Each row of the file is one settled heap. A layout takes the poses of its heap from one row.

    Args:
        heap: heap of the scene, needed if it has several heaps
        rows: number of rows
        out: .npz to write, by default the path that the scene file gives for the heap's rows
    """
    from sceniris_gym.commands import settle as tool

    return answer(tool.settle(scene_config(scene, changes), heap, rows, out, seed), json, tool.report)


@_command
def train(options: Annotated[Options, tyro.conf.arg(name="")], json: Json = False) -> Answer:
    """Train a policy for a task with rsl-rl's PPO (extra `rsl-rl`), and evaluate the policy on unseen layouts."""
    check_numbers(Options, vars(options))
    checked_target(options.out / CONFIG)
    from sceniris_gym.commands import train as tool

    return answer(tool.train(options, quiet=json), json, tool.report)


@_command
def evaluate(options: Annotated[Evaluation, tyro.conf.arg(name="")], json: Json = False) -> Answer:
    """Evaluate the policy of a training on unseen layouts: valid layouts, and layouts placed without checks."""
    check_numbers(Evaluation, vars(options))
    for file in filter(None, (options.out, options.failed)):
        checked_target(file)
    from sceniris_gym.commands import evaluate as tool

    return answer(tool.evaluate(options), json, partial(tool.report, options=options))


@_command
def demos(options: Annotated[Demos, tyro.conf.arg(name="")], json: Json = False) -> Answer:
    """Write demonstrations of a task: the arm follows its path to a grasp, closes the gripper, and lifts the object.

    The exit status is 1 if too few episodes end in success.
    """
    check_numbers(Demos, vars(options))
    checked_target(options.out / MANIFEST)
    from sceniris_gym.commands import demos as tool

    return answer(tool.demos(options), json, tool.report)


@_command
def suite_make(
    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")],
    out: Annotated[Path, OUT] = Path("suite.jsonl"),
    axes: Annotated[str, tyro.conf.arg(metavar="AXIS,AXIS,...")] = "",
    grades: Annotated[int, range(1, 6)] = 5,  # the last factors are 0.25 and 1.75
    cases: Annotated[int, range(1, MOST_WORLDS // 4)] = 40,
    cumulative: Flag = False,
    device: Device = None,
    changes: Changes = (),
    json: Json = False,
) -> Answer:
    """Make a suite: cases of a task that change one axis at a time, in grades.

    Args:
        task: a registered task, or your own as MODULE:ID
        out: file to write, one line per case
        axes: robot, clutter, joint, variant, mass, friction, light, camera, shift, turn, by default all that the task
            has without shift and turn
        grades: number of grades
        cases: number of cases for each axis and grade
        cumulative: also make cases that change the params of all axes at once
    """
    from sceniris_gym.commands import suite as tool

    checked_target(out)
    options = {"grades": grades, "number": cases, "cumulative": cumulative, "device": device, "changes": changes}
    return answer(tool.make_suite(task, axes, out, **options), json)


@_command
def suite_run(
    suite: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="SUITE")],
    policy: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="POLICY")],
    out: Annotated[Path, OUT] = Path("rows.jsonl"),
    num_envs: NumEnvs = 1024,
    trust: Flag = False,
    device: Device = None,
    json: Json = False,
) -> Answer:
    """Run a policy on each case of a suite once. The same command continues after an interruption.

    Args:
        suite: file of a suite, or the name of a shipped one: clutter_extract, drawer_pick or tabletop_lift_any
        policy: folder of a run, rsl-rl checkpoint or TorchScript (.pt), ONNX (.onnx), SB3 model (.zip), module:function
        out: file to write, one line per case
        trust: read a policy's .zip, or import the suite's MODULE:ID, although this executes their code
    """
    from sceniris_gym.commands import suite as tool

    options = {"num_envs": num_envs, "trust": trust, "device": device}
    return answer(tool.run_suite(suite, policy, out, **options), json, tool.report)


@_command
def suite_compare(
    a: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ROWS")],
    b: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ROWS")],
    measure: Literal["success", "success_once"] = "success",
    picture: Annotated[Path | None, tyro.conf.arg(help="PNG to write: shares over grades (extra `plots`)")] = None,
    json: Json = False,
) -> Answer:
    """Compare two policies case by case: difference with interval, McNemar's exact test, number of cases needed.

    Args:
        measure: success at the last step, or at any step
    """
    check_picture(picture)
    from sceniris_gym.commands import suite as tool

    return answer(tool.compare_suites(a, b, measure, picture), json, tool.report)


@_command
def suite_film(
    rows: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="ROWS")],
    out: Annotated[Path, OUT] = Path("films"),
    failed: Flag = False,
    trust: Flag = False,
    device: Device = None,
    json: Json = False,
) -> Answer:
    """Write videos of the cases in a file of rows, 16 cases each, with axis and id (extra `video`).

    Args:
        out: folder of the MP4 files
        failed: only cases without success
        trust: as in `suite run`
    """
    from sceniris_gym.commands import suite as tool

    return answer(tool.film_suite(rows, out, failed=failed, device=device, trust=trust), json)


@_command
def compile_(
    names: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="SCENE|TASK")],
    num_envs: NumEnvs = 16,
    render: Flag = False,
    device: Device = None,
    json: Json = False,
) -> Answer:
    """Compile scenes and all kernels that their resets and steps need, before they are used.

    Args:
        names: scenes (names of shipped scenes, or paths), and tasks (registered, or your own as MODULE:ID)
        render: also compile the kernels of a task's `render`
    """
    if not names:
        raise ArgumentError("compile: the scene or task is missing. Give at least one, as in 'compile mid'.")
    from sceniris_gym.commands import compile as tool

    return answer(tool.compile_all(names, num_envs, device, render=render), json)


ABOUT = "Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments."
_SCENES = (demo, generate, audit, bench, replay, check, compile_, reach)
_ALL = (*_SCENES, import_, furniture, init, new_task, settle, train, evaluate, demos, view, play)
_SUITES = (suite_make, suite_run, suite_compare, suite_film)
COMMANDS = {command.__name__.rstrip("_").replace("_", "-"): command for command in _ALL}
COMMANDS |= {command.__name__.replace("_", " "): command for command in _SUITES}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command.

    The exit status is 1 after a bad verdict. It is 2 after a ScenirisError or an OSError, and the error's message goes
    to stderr.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if arguments == ["--version"]:
        print(f"sceniris-gym {sceniris_gym.__version__}")
        return
    about = f"{ABOUT} Version {sceniris_gym.__version__} (--version)."
    try:
        with warnings.catch_warnings():
            warnings.showwarning = each_once()
            if arguments and not arguments[0].startswith("-"):  # so that usage errors name this command's --help
                words = 2 if arguments[0] == "suite" else 1
                check_names("command", [name := " ".join(arguments[:words])], "sceniris-gym", COMMANDS)
                said = parsed(name, COMMANDS[name], arguments[words:])()
            else:
                said = tyro.extras.subcommand_cli_from_dict(
                    COMMANDS, prog="sceniris-gym", description=about, args=arguments
                )
    except (ScenirisError, OSError) as error:
        message = str(error) if isinstance(error, ScenirisError) else in_words(error)
        print(f"error: {message}", file=sys.stderr)
        sys.exit(2)
    print_text(said.text)
    if not said.ok:
        sys.exit(1)
