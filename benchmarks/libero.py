"""Read LIBERO's problem files, make layouts of their scenes, and count penetrations, beside LIBERO's own rule.

    python -m benchmarks.libero FILES --assets ASSETS --layouts 1000 --out results/libero.jsonl

FILES is a folder that has problem files (.bddl) below it, ASSETS that of LIBERO's models. For each file the scene is
compiled, and layouts are made by the generator and by a sampler written after LIBERO's: each thing is drawn in its
rectangle again until its circle is clear of all circles before, 5,000 times at most; fixtures are never checked; things
start a little above their support. Both are drawn with the same models and headings. MuJoCo C judges both: a layout
penetrates if parts of two different things overlap. Contacts with the work surface do not count in LIBERO's layouts, as
it sinks some fixtures into it. With `--states`, LIBERO's folder `init_files`, the states that it stores for evaluation
are judged too, objects against objects, as these files do not say where fixtures are. Prints a line of JSON for each
file, then the sums. Lines that the file has already are kept.

    python -m benchmarks.libero FOLDER --things "stable_hope_objects/*/*.xml" --out results/things.jsonl

With `--things`, FOLDER has MJCF files of objects, of LIBERO or of others. The files of a pattern are variants of one
slot, which stands beside a can, with `orientation: stable` if an error advises it. A refused file is left out, with the
error. Each layout is judged on MuJoCo C's own model of the file, a floor and the can: `penetrate` counts layouts with
bodies over 0.1 mm in each other, and `moved` layouts in which the object moves by more than 1 cm in half a second.
"""

from __future__ import annotations

import json
import math
import re
import time
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
import tyro
from scipy.spatial.transform import Rotation

from benchmarks.foreign_arms import tell_row
from sceniris_gym.errors import ModelWarning, ScenirisError
from sceniris_gym.importers.libero.kinds import OBJECTS, ROTATION, WORKSPACES
from sceniris_gym.importers.libero.reader import LiberoTask, read_bddl
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable

TRIES = 5000
DEEP = 0.001  # m; penetrations of more than this are also counted
HERE = Path(__file__).parents[1]
_COUNTED = ("layouts", "penetrate", "deep")
_REPEATS = 5  # batches of layouts that are timed
_LIFT = 0.01  # height over its support at which LIBERO lets go of a thing [m]
_SINK = {"living_room_table": -0.014, "floor": -0.025}  # the same of fixtures, where it is not -4 cm
_ROUNDED = ("table", "floor")  # work surfaces on which circles keep within the rectangle, or what that leaves


@dataclass(frozen=True)
class Options:
    """Options of a run.

    Attributes:
        files: folder with problem files, or with objects
        things: patterns of MJCF files in the folder; without them, problem files are measured
        assets: folder of LIBERO's models; without it, boxes
        states: folder with LIBERO's stored states
        layouts: layouts of each scene and kind
        every: read every file, and compile only each N-th
        seed: seed of the first layout
        out: file for the results
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    files: tyro.conf.Positional[Path]
    things: tuple[str, ...] = ()
    assets: Path | None = None
    states: Path | None = None
    layouts: int = 1000
    every: int = 1
    seed: int = 0
    out: Path = Path("results/libero.jsonl")
    device: str | None = None


class NoPlaceError(Exception):
    """Raised when a thing has found no place in all its tries."""


@dataclass
class Placed:
    """A thing that has its pose.

    Attributes:
        pos: Its origin [m], world frame.
        yaw: Its heading [rad].
        radius: Radius of its circle [m].
        top, bottom: Its ends over its origin [m].
    """

    pos: np.ndarray
    yaw: float
    radius: float
    top: float
    bottom: float


class CircleSampler:
    """Draws scenes by regions and circles, after LIBERO's samplers."""

    def __init__(self, task: LiberoTask, compiled: CompiledScene, seed: int) -> None:
        self.problem, self.mjm, self.home = task.problem, compiled.mjm, compiled.scene.home_qpos
        self.data, self.random = mujoco.MjData(self.mjm), np.random.default_rng(seed)
        self.surface, kind = next((n, k) for n, k in self.problem.fixtures.items() if k in WORKSPACES)
        self.origin, self.sink, self.rounded = (
            np.array(WORKSPACES[kind].origin),
            _SINK.get(kind, -0.04),
            kind in _ROUNDED,
        )
        self.circles = {name: self._circle(name) for name in task.scene.objects}
        self.joints = [
            (int(self.mjm.joint(f"{name}/{joint}").qposadr[0]), config.range)
            for name, part in task.scene.objects.items()
            for joint, config in part.joints.items()
            if config.range is not None
        ]
        places = [p for p in self.problem.init if p.word in ("On", "In")]
        kinds = ("surface", "site", "thing")  # in this order; what is in a site comes after what is on one
        self.places = sorted(places, key=lambda p: (kinds.index(self._kind(p.names[1])), p.word == "In"))

    def draw(self) -> LayoutTable:
        """Return one scene.

        Raises:
            NoPlaceError: A thing has found no place in all its tries.
        """
        placed: dict[str, Placed] = {}
        self.data.qpos[:] = self.home
        for adr, (low, high) in self.joints:
            self.data.qpos[adr] = self.random.uniform(low, high)
        mujoco.mj_kinematics(self.mjm, self.data)
        for predicate in self.places:
            name, target = predicate.names
            radius, top, bottom = self.circles[name]
            for _ in range(TRIES):
                at, checked = self._at(name, target, predicate.word, placed)
                new = Placed(at, self._yaw(name, target), radius, top, bottom)
                if not checked or all(_clear(new, other) for other in placed.values()):
                    placed[name] = new
                    break
            else:
                raise NoPlaceError(name)
        return self._row(placed)

    def _kind(self, target: str) -> str:
        region = self.problem.regions.get(target)
        return "thing" if region is None else "surface" if region.target == self.surface else "site"

    def _at(self, name: str, target: str, word: str, placed: dict[str, Placed]) -> tuple[np.ndarray, bool]:
        """Draw the origin of a thing [m]; also return whether it has to be clear of others."""
        radius, _, bottom = self.circles[name]
        kind, lift = self._kind(target), np.array([0.0, 0.0, -bottom])
        if kind == "surface":
            box = np.array(self.problem.regions[target].boxes[0]).reshape(2, 2)
            is_fixture = name in self.problem.fixtures
            if self.rounded and not is_fixture:
                box = box + [[radius], [-radius]]  # of a small rectangle the sides then change places
            xy = box[0] + self.random.uniform(size=2) * (box[1] - box[0])
            return self.origin + lift + [*xy, self.sink if is_fixture else _LIFT], not is_fixture
        if kind == "thing":
            other = placed[target]
            return other.pos + lift + [0.0, 0.0, other.top + _LIFT], False
        region = self.problem.regions[target]
        site, other = self.mjm.site(f"{region.target}/{region.name}").id, placed[region.target]
        half = np.zeros(2) if word == "In" else 0.5 * self.mjm.site_size[site, :2] - radius
        middle = _turned(self._from_root(site, region.target), other.yaw)
        above = 0.0 if word == "In" else other.top
        return other.pos + middle + lift + [*self.random.uniform(-1.0, 1.0, 2) * half, above], True

    def _yaw(self, name: str, target: str) -> float:
        if name in self.problem.fixtures:
            return self.random.uniform(*self.problem.regions[target].yaw)
        return math.radians(self.random.uniform(*OBJECTS[self.problem.objects[name]].yaw))

    def _from_root(self, site: int, name: str) -> np.ndarray:
        """Return the place of a site in the frame of its thing [m], with the joints as they are drawn."""
        root = self.mjm.body(name).id
        return self.data.xmat[root].reshape(3, 3).T @ (self.data.site_xpos[site] - self.data.xpos[root])

    def _circle(self, name: str) -> tuple[float, float, float]:
        """Return radius, top and bottom of a thing [m], which are sites of LIBERO's models."""
        found = [
            mujoco.mj_name2id(self.mjm, mujoco.mjtObj.mjOBJ_SITE, f"{name}/{word}_site")
            for word in ("horizontal_radius", "top", "bottom")
        ]
        if min(found) < 0:
            return 0.025, 0.04, -0.06
        radius, top, bottom = self.mjm.site_pos[found]
        return float(radius[0]), float(top[2]), float(bottom[2])

    def _row(self, placed: dict[str, Placed]) -> LayoutTable:
        qpos, mocap = self.data.qpos.copy(), (np.zeros((self.mjm.nmocap, 3)), np.zeros((self.mjm.nmocap, 4)))
        for name, one in placed.items():
            body, quat = self.mjm.body(name), [math.cos(0.5 * one.yaw), 0.0, 0.0, math.sin(0.5 * one.yaw)]
            if body.mocapid[0] >= 0:
                mocap[0][body.mocapid[0]], mocap[1][body.mocapid[0]] = one.pos, quat
            else:
                adr = int(self.mjm.jnt_qposadr[body.jntadr[0]])
                qpos[adr : adr + 7] = [*one.pos, *quat]
        return LayoutTable.from_states(qpos[None], mocap[0][None], mocap[1][None], np.ones((1, len(placed)), bool))


def _clear(new: Placed, old: Placed) -> bool:
    """Return whether two circles are apart, or the new one is above the old one."""
    apart = math.dist(new.pos[:2], old.pos[:2]) > new.radius + old.radius
    return apart or new.pos[2] - old.pos[2] > old.top - new.bottom


def _turned(pos: np.ndarray, yaw: float) -> np.ndarray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([c * pos[0] - s * pos[1], s * pos[0] + c * pos[1], pos[2]])


def stored_states(task: LiberoTask, mjm: mujoco.MjModel, file: Path) -> LayoutTable:
    """Return the states of a file of LIBERO's `init_files`, with all fixtures out of the way.

    A row has the time, nine joints of the arm, and the poses of objects by class, in the order of the problem file.
    """
    states = np.asarray(torch.load(file, weights_only=False))
    by_class: dict[str, list[str]] = {}
    for name, kind in task.problem.objects.items():
        by_class.setdefault(kind, []).append(name)
    qpos = np.tile(mjm.qpos0, (len(states), 1))
    for number, name in enumerate(name for names in by_class.values() for name in names):
        pose = states[:, 10 + 7 * number : 17 + 7 * number]
        turn = Rotation.from_quat(ROTATION[OBJECTS[task.problem.objects[name]].up], scalar_first=True)
        upright = Rotation.from_quat(pose[:, 3:], scalar_first=True) * turn.inv()
        adr = int(mjm.jnt_qposadr[mjm.body(name).jntadr[0]])
        qpos[:, adr : adr + 7] = np.hstack([pose[:, :3], upright.as_quat(scalar_first=True)])
    away, unit = np.array([0.0, 0.0, -50.0]), np.array([1.0, 0.0, 0.0, 0.0])
    mocap = np.tile(away, (len(states), mjm.nmocap, 1)), np.tile(unit, (len(states), mjm.nmocap, 1))
    return LayoutTable.from_states(qpos, *mocap, np.ones((len(states), len(task.scene.objects)), bool))


def penetrations(mjm: mujoco.MjModel, tables: list[LayoutTable], things: Iterable[str] = ()) -> dict[str, Any]:
    """Return how many layouts have two things in each other by MuJoCo C, and the pair that most of them have.

    Args:
        mjm: The model.
        tables: Layouts.
        things: The bodies whose contacts count; all if empty.
    """
    data, root = mujoco.MjData(mjm), mjm.body_rootid[mjm.geom_bodyid]
    bodies = [mjm.body(name).id for name in things] or range(mjm.nbody)
    found = {"penetrate": 0, "deep": 0}
    pairs: dict[str, int] = {}
    for table in tables:
        for qpos, pos, quat in zip(table.qpos, table.mocap_pos, table.mocap_quat, strict=True):
            data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos, pos, quat
            mujoco.mj_kinematics(mjm, data)
            mujoco.mj_collision(mjm, data)
            ends = root[data.contact.geom]
            counts = (ends[:, 0] != ends[:, 1]) & np.isin(ends, bodies).all(axis=1) & (data.contact.dist < 0.0)
            found["penetrate"] += bool(counts.any())
            found["deep"] += bool((data.contact.dist[counts] < -DEEP).any())
            for pair in {tuple(sorted(pair)) for pair in ends[counts].tolist()}:
                names = " ".join(mjm.body(body).name for body in pair)
                pairs[names] = pairs.get(names, 0) + 1
    return {**found, "pair": max(pairs, key=pairs.__getitem__, default="")}


def measure(file: Path, options: Options, compiles: bool) -> dict[str, Any]:
    """Return the figures of one problem file."""
    found: dict[str, Any] = {"file": f"{file.parent.name}/{file.stem}", "boxes": ""}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        task = read_bddl(file, assets=options.assets)
        found["boxes"] = "; ".join(str(w.message) for w in told if isinstance(w.message, ModelWarning))
        if not compiles:
            return found
        begin = time.perf_counter()
        try:
            compiled = compile_scene(task.scene, options.device)
        except ScenirisError as error:
            return {**found, "refused": str(error)}
        found["compile_s"] = round(time.perf_counter() - begin, 2)
    generator = LayoutGenerator(compiled, options.layouts, seed=options.seed)
    generator.generate()
    table = generator.table()
    begin = time.perf_counter()
    for _ in range(_REPEATS):
        generator.generate()
    generator.layouts.status.cpu().numpy()  # waits for the device
    rate = _REPEATS * options.layouts / (time.perf_counter() - begin)
    sampler = CircleSampler(task, compiled, options.seed)
    begin, theirs, failed = time.perf_counter(), [], 0
    for _ in range(options.layouts):
        try:
            theirs.append(sampler.draw())
        except NoPlaceError:
            failed += 1
            if failed == 3 and not theirs:  # a file without any place would take minutes
                break
    their_rate = len(theirs) / (time.perf_counter() - begin)
    found["ours"] = {"layouts": len(table), "valid": int(table.valid.sum()), **penetrations(compiled.mjm, [table])}
    found["circles"] = {
        "layouts": len(theirs),
        "no_place": failed,
        **penetrations(compiled.mjm, theirs, task.scene.objects),
    }
    if options.states is not None:
        stored = stored_states(task, compiled.mjm, options.states / file.parent.name / f"{file.stem}.pruned_init")
        judged = penetrations(compiled.mjm, [stored], task.problem.objects)
        found["stored"] = {"layouts": len(stored), **judged}
    return {**found, "rate": round(rate), "circle_rate": round(their_rate)}


def measure_things(pattern: str, options: Options) -> dict[str, Any]:
    """Return the figures of the MJCF files of a pattern as variants of one slot."""
    names = {"_".join((path.parent.name, path.stem)): path for path in sorted(options.files.glob(pattern))}
    variants: dict[str, dict[str, str]] = {name: {"asset": str(path)} for name, path in names.items()}
    refused, compiled = {}, None
    place = {"on": "floor", "region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}}
    begin = time.perf_counter()
    while variants and compiled is None:
        objects = {"thing": {**place, "variants": variants}, "can": {**place, "asset": "can"}}
        try:
            compiled = compile_scene({"floor": {"size": [2.0, 2.0]}, "objects": objects}, options.device)
        except ScenirisError as error:
            told = re.search(r"thing/([\w-]+)", str(error))
            if told is None or told[1] not in variants:
                raise
            if "orientation: stable" in str(error) and "orientation" not in variants[told[1]]:
                variants[told[1]]["orientation"] = "stable"
            else:
                refused[told[1]] = str(error)[:300]
                del variants[told[1]]
    found: dict[str, Any] = {"things": pattern, "files": len(names), "accepted": len(variants), "refused": refused}
    found["stable"] = [name for name, words in variants.items() if "orientation" in words]
    if compiled is None:
        return found
    found["compile_s"] = round(time.perf_counter() - begin, 1)
    generator = LayoutGenerator(compiled, options.layouts, seed=options.seed)
    generator.generate()
    table = generator.table()
    own, judged = {name: own_model(names[name]) for name in variants}, {"penetrate": [], "moved": []}
    for row in np.flatnonzero(table.valid).tolist():
        (name,) = (name for name in variants if table.present[row, compiled.slots.index(f"thing/{name}")])
        mjm, data = own[name], mujoco.MjData(own[name])
        for body, ours in (("thing", f"thing/{name}"), ("can", "can")):
            adr, joint = compiled.mjm.jnt_qposadr[compiled.mjm.body(ours).jntadr[0]], mjm.body(body).jntadr[0]
            data.qpos[mjm.jnt_qposadr[joint] :][:7] = table.qpos[row, adr : adr + 7]
        mujoco.mj_forward(mjm, data)
        before = data.body("thing").xpos.copy()
        judged["penetrate"] += [name] * bool((data.contact.dist < -1e-4).any())
        mujoco.mj_step(mjm, data, round(0.5 / mjm.opt.timestep))
        judged["moved"] += [name] * bool(np.linalg.norm(data.body("thing").xpos - before) > 0.01)
    counts = {word: dict(zip(*np.unique(named, return_counts=True), strict=True)) for word, named in judged.items()}
    return found | {"valid": int(table.valid.sum())} | {k: {n: int(c) for n, c in v.items()} for k, v in counts.items()}


def own_model(path: Path) -> mujoco.MjModel:
    """Return MuJoCo's model of a file's object, named "thing", with a can and a floor."""
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2.0, 2.0, 0.1])
    for name, file in (("thing", path), ("can", HERE / "assets" / "can.xml")):
        child = mujoco.MjSpec.from_file(str(file))
        body = spec.worldbody.add_frame().attach_body(child.worldbody.first_body(), f"{name}:", "")
        if not body.joints:
            body.add_freejoint()
        body.name = name
    return spec.compile()


def main(options: Options) -> None:
    """Measure all files that the results lack, and print the sums."""
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for pattern in options.things:
        tell_row(measure_things(pattern, options), options.out)
    if options.things:
        return
    lines = options.out.read_text().splitlines() if options.out.is_file() else []
    done = {line["file"]: line for line in map(json.loads, lines)}
    for number, file in enumerate(sorted(options.files.rglob("*.bddl"))):
        if f"{file.parent.name}/{file.stem}" in done:
            continue
        found = measure(file, options, number % options.every == 0)
        done[found["file"]] = found
        tell_row(found, options.out)
    print(json.dumps(summary(list(done.values()))))


def summary(found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the sums over all files."""
    made = [one for one in found if "ours" in one]

    def total(kind: str, key: str) -> int:
        return sum(one[kind][key] for one in made)

    return {
        "read": len(found),
        "with_boxes": sum(bool(one["boxes"]) for one in found),
        "compiled": len(made),
        "refused": {one["file"]: one["refused"] for one in found if "refused" in one},
        "ours": {key: total("ours", key) for key in ("layouts", "valid", "penetrate", "deep")},
        "circles": {key: total("circles", key) for key in ("layouts", "no_place", "penetrate", "deep")},
        "stored": {key: sum(one["stored"][key] for one in made if "stored" in one) for key in _COUNTED},
        "penetrating_scenes": {
            kind: sum(one[kind]["penetrate"] > 0 for one in made if kind in one) for kind in ("circles", "stored")
        },
        "rate_median": float(np.median([one["rate"] for one in made])) if made else None,
        "circle_rate_median": float(np.median([one["circle_rate"] for one in made])) if made else None,
    }


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
