"""Time of a control step with jointed furniture that differs between worlds, against fixed and parked furniture.

    python -m benchmarks.slots_cost --slots 8 --worlds 4096 --device cuda:0

Every world has a row of cabinets, cupboards and chests, twelve objects at rest on and in front of it, and a Panda that
holds its home pose. Three models simulate it:

- `fixed`: all worlds have the same row.
- `slots`: a unit of the row is a slot, which is a tree with the joints of all variants. Rows of the Model's fields
  select a variant in each world. Joints without a counterpart in the variant have no mass and stay at exactly 0.
- `parked`: every unit has all variants, and two of the three are parked far away.

Each world of `slots` and `parked` has the pieces of `fixed` in another order, except for world 0, which has the same
order. The physics has the options of KitchenReset-v0 unless `--awake` keeps all bodies awake.

A line for each model has the control step's time [ms] as median, least and greatest of rounds in which the models take
turns. `rate_over_fixed` is the time of `fixed` in the same round over this time. `nacon`, `ncollision`, `nefc`,
`solver_niter` and `nv_awake` (0 with `--awake`) describe a world after the timing, as mean and greatest (`_max`),
and `before` has them before the timing. `moved` is the largest change of an object's qpos during the timing, `unused`
the largest |qpos| of an unused joint, and `seconds` the time to make and settle the model, with compilation of kernels.
`--kitchen` adds KitchenReset-v0 with zero actions: the environment's step and its physics. The exit status is 1 if
contacts or rows did not fit, if a state is not finite, or if an unused joint moved.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import tyro
import warp as wp
from mujoco_warp._src.warp_util import EventTracer

from benchmarks.timing import spread
from sceniris_gym.config.scene_words import Floor
from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.errors import ContactBudgetError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.scene.backdrop import add_floor, set_options
from sceniris_gym.sim.batch import LINE_SEARCH, check_budget, put_simulated, updater, with_options
from sceniris_gym.sim.versions import silence_iterations
from sceniris_gym.training.task_scenes import make_env, scene_of

KitchenReset = importlib.import_module("sceniris_gym.envs.kitchen_reset").KitchenReset
ASSETS = Path(__file__).parents[1] / "assets"
VARIANTS = {"cabinet": 0.5, "cupboard": 0.8, "chest": 0.1122}
"""Furniture, and the height of its top [m]."""
ON_TOP = ("can", "mug", "tin", "glass", "bottle", "bowl", "cereal_box", "lemon")
"""Objects on furniture. The others, and those without a unit, are on the floor."""
THINGS = (*ON_TOP, "plate", "pan", "book", "banana")
SETTLE = 25
"""Control steps before the timing (0.5 s)."""
BACK = 0.8
"""Position of the row behind the origin [m]."""
_SPACING, _PARKED, _DROP = 0.7, 50.0, 5.0e-4  # [m]
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_CLASS = ("type", "contype", "conaffinity", "condim", "priority", "group")  # these have one row for all worlds
_SEEN = ("geom_matid", "geom_rgba")  # steps do not read these
# Not a "simple" body, whose mass matrix would be diagonal.
_INERTIA = {"mass": 1.0, "ipos": [0.01, 0.02, 0.03], "fullinertia": [0.01, 0.011, 0.012, 0.001, 0.002, 0.003]}
# The solver's tolerance is relative to the trace of the mass matrix, so unused joints have little inertia.
_UNUSED = {
    "body": {"mass": 0.0, "inertia": 0.0, "subtreemass": 0.0},
    "dof": {"armature": 1.0e-6, "frictionloss": 0.0, "damping": 0.0, "invweight0": 1.0},
    "geom": {"margin": -1.0e6, "dataid": -1},
}

Point = tuple[float, float, float]
Rows = dict[str, np.ndarray]


@dataclass(frozen=True)
class Options:
    """Options of the measurement.

    Attributes:
        slots: pieces of furniture in a world
        worlds: number of worlds
        rounds: turns that are counted
        steps: control steps of a turn
        nconmax: contacts per world, of which landing objects need 160, and resting ones 64
        njmax: constraint rows per world
        awake: keep all bodies awake
        broadphase: MuJoCo-Warp's broad phase, by default its own choice
        kitchen: also time KitchenReset-v0
        profile: also print the time of each stage of a step on a GPU, without a graph
        json: print lines of JSON
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    slots: int = 8
    worlds: int = 4096
    rounds: int = 7
    steps: int = 20
    nconmax: int = 256
    njmax: int = 1024
    awake: bool = False
    broadphase: Literal["NXN", "SAP_TILE", "SAP_SEGMENTED"] | None = None
    kitchen: bool = False
    profile: bool = False
    json: bool = False
    device: str | None = None


def numbered(items: list[Any]) -> list[tuple[Any, int]]:
    """Return each item with the number of equal items before it."""
    return [(item, items[:i].count(item)) for i, item in enumerate(items)]


def attach(spec: mujoco.MjSpec, asset: str, name: str, pos: Point) -> mujoco.MjsBody:
    """Attach an asset, and return its root."""
    asset_spec = mujoco.MjSpec.from_file(str(ASSETS / f"{asset}.xml"))
    spec.attach(asset_spec, f"{name}/", frame=spec.worldbody.add_frame(pos=pos))
    return spec.body(f"{name}/{asset}")


def empty() -> mujoco.MjSpec:
    """Return a scene with the floor and the package's options."""
    spec = mujoco.MjSpec()
    set_options(spec)
    add_floor(spec, Floor(size=(16.0, 16.0)))
    return spec


class Piece:
    """A variant in its own model.

    Attributes:
        mjm: its model
        bodies: its root at key "root", and its moving bodies by joint type and number
    """

    def __init__(self, name: str) -> None:
        spec = empty()
        attach(spec, name, name, (0.0, 0.0, 0.0)).mocap = True
        self.mjm = spec.compile()
        root = self.mjm.body(f"{name}/{name}").id
        moving = np.flatnonzero(self.mjm.body_parentid == root)
        types = self.mjm.jnt_type[self.mjm.body_jntadr[moving]].tolist()
        self.bodies: dict[Any, int] = {"root": root, **dict(zip(numbered(types), moving.tolist(), strict=True))}

    def geoms(self, part: Any) -> dict[Any, int]:
        """Return the geoms of a body by their class and number, or {} if the variant lacks the body."""
        geoms = np.flatnonzero(self.mjm.geom_bodyid == self.bodies.get(part, -1)).tolist()
        classes = [tuple(int(getattr(self.mjm, f"geom_{word}")[geom]) for word in _CLASS) for geom in geoms]
        return dict(zip(numbered(classes), geoms, strict=True))

    def mesh(self, geom: int) -> str:
        """Return the name of a geom's mesh."""
        return self.mjm.mesh(int(self.mjm.geom_dataid[geom])).name


class Slot:
    """The tree that all variants share: a root, and bodies by joint type and number."""

    def __init__(self) -> None:
        self.pieces = [Piece(name) for name in VARIANTS]
        self.parts = ["root", *sorted({part for piece in self.pieces for part in piece.bodies if part != "root"})]
        self.geoms: dict[Any, dict[Any, tuple[Piece, int]]] = {part: {} for part in self.parts}
        for part in self.parts:
            for piece in self.pieces:
                self.geoms[part] = {key: (piece, geom) for key, geom in piece.geoms(part).items()} | self.geoms[part]

    def add_meshes(self, spec: mujoco.MjSpec) -> None:
        """Add the meshes of all variants. MuJoCo makes hulls only of meshes with a geom that can collide."""
        for name, piece in zip(VARIANTS, self.pieces, strict=True):
            for mesh in mujoco.MjSpec.from_file(str(ASSETS / f"{name}.xml")).meshes:
                spec.add_mesh(name=f"{name}/{mesh.name}", file=str(ASSETS / "meshes" / mesh.file), scale=mesh.scale)
            solid = np.flatnonzero((piece.mjm.geom_type == _MESH) & (piece.mjm.geom_contype != 0))
            for mesh in sorted({piece.mesh(geom) for geom in solid.tolist()}):
                spec.worldbody.add_geom(type=_MESH, meshname=mesh, contype=1 << 30, conaffinity=0, mass=0.0)

    def add(self, spec: mujoco.MjSpec, name: str, pos: Point) -> None:
        """Add a slot."""
        root = spec.worldbody.add_body(name=f"{name}/root", pos=pos, mocap=True, explicitinertial=True, **_INERTIA)
        for part in self.parts:
            body = root
            if part != "root":
                body = root.add_body(name=f"{name}/{part}", explicitinertial=True, **_INERTIA)
                body.add_joint(type=part[0], axis=[0, 0, 1], range=[-1, 1], limited=True, frictionloss=1.0)
            for (kind, _), (piece, geom) in self.geoms[part].items():
                added = body.add_geom(size=[0.01] * 3, **dict(zip(_CLASS, kind, strict=True)))
                if kind[0] == _MESH:
                    added.meshname = piece.mesh(geom)

    def write(self, mjm: mujoco.MjModel, rows: Rows, name: str, worlds: np.ndarray, piece: Piece) -> list[int]:
        """Write a variant into the rows of some worlds, and return the addresses of unused joint positions."""
        own, unused = piece.mjm, []
        for part in self.parts:
            body, source = mjm.body(f"{name}/{part}").id, piece.bodies.get(part, -1)
            copies = [("body", body, source)]
            if part != "root":
                pairs = [(m, m.body_jntadr[b], m.body_dofadr[b]) for m, b in ((mjm, body), (own, source))]
                (_, joint, dof), (_, jnt_source, dof_source) = pairs
                qpos, qpos_source = mjm.jnt_qposadr[joint], own.jnt_qposadr[jnt_source]
                unused += [qpos] if source < 0 else []
                found = [("jnt", joint, jnt_source), ("dof", dof, dof_source), ("qpos", qpos, qpos_source)]
                copies += found if source >= 0 else [("dof", dof, -1)]
            geoms = piece.geoms(part)
            copies += [
                ("geom", mjm.body_geomadr[body] + i, geoms.get(key, -1)) for i, key in enumerate(self.geoms[part])
            ]
            for prefix, index, element in copies:
                for field, values in rows.items():
                    kind, _, word = field.partition("_")
                    if kind.removesuffix("0") == prefix and element >= 0:
                        values[worlds, index] = getattr(own, field)[element].reshape(values.shape[2:])
                    elif kind == prefix and word in _UNUSED[prefix]:
                        values[worlds, index] = _UNUSED[prefix][word]
            for key, geom in geoms.items():
                if own.geom_dataid[geom] >= 0:
                    index = mjm.body_geomadr[body] + [*self.geoms[part]].index(key)
                    rows["geom_dataid"][worlds, index] = mjm.mesh(piece.mesh(geom)).id
        return unused


def row_fields() -> list[str]:
    """Return the fields of the Model that have a row for each world in `slots`."""
    fields = {name: getattr(field.type, "shape", None) or "" for name, field in mjw.Model.__dataclass_fields__.items()}
    starts = ("body_", "jnt_", "dof_", "geom_", "qpos")
    return [
        name for name, shape in fields.items() if shape[:1] == ("*",) and name.startswith(starts) and name not in _SEEN
    ]


def arrangement(slots: int, worlds: int) -> np.ndarray:
    """Return the number of the variant of each unit in each world, shape (worlds, slots)."""
    cycle = np.arange(slots) % len(VARIANTS)
    return np.vstack([cycle, np.random.default_rng(0).permuted(np.tile(cycle, (worlds - 1, 1)), axis=1)])


class Worlds:
    """Worlds of one model, at rest.

    Args:
        kind: "fixed", "slots" or "parked"
        options: options of the measurement
        variant: number of the variant of each unit in each world, shape (worlds, units)
        filled: whether there are objects and an arm

    Attributes:
        about: facts about the model
        data: Data of the worlds
        unused: whether a joint position is not used in a world, shape (worlds, nq)
        step: takes a control step, in a graph on a GPU
    """

    def __init__(self, kind: str, options: Options, variant: np.ndarray, *, filled: bool = True) -> None:
        start, count, slot = time.perf_counter(), variant.shape[1], Slot()
        self.variant = np.tile(variant[0], (len(variant), 1)) if kind == "fixed" else variant
        self.spots = [(_SPACING * (i - (count - 1) / 2), BACK, 0.0) for i in range(count)]
        self.mjm = mjm = with_options(self._spec(kind, slot, filled).compile(), dict(KitchenReset.options))
        mjm.opt.enableflags = 0 if options.awake else mjm.opt.enableflags
        self.unused = np.zeros((len(variant), mjm.nq), bool)
        with wp.ScopedDevice(options.device):
            self.model = put_simulated(mjm, kind)
            self.model.opt.ls_iterations = LINE_SEARCH
            silence_iterations(self.model)
            if options.broadphase is not None:
                self.model.opt.broadphase = mjw.BroadphaseType[options.broadphase]
            row_bytes = self._write_rows(slot) if kind == "slots" else 0
            pool, most = options.nconmax * len(variant), options.nconmax * max(len(variant) // 4, 16)
            room = {"naconmax": pool, "naccdmax": min(pool, most), "njmax": options.njmax}  # as in Batch
            self.data = mjw.make_data(mjm, len(variant), **room)
            self._place(kind, filled)
        self._update = updater(())
        self.step = LaunchSequence(self.launch_step, self.model.qpos0.device).replay
        for _ in range(SETTLE if filled else 0):
            self.step()
        wp.synchronize()
        self.about = {"kind": kind, "nbody": mjm.nbody, "ngeom": mjm.ngeom, "nv": mjm.nv, "row_bytes": row_bytes}
        self.about["pairs"] = len(self.model.nxn_geom_pair_filtered)
        self.about["seconds"] = round(time.perf_counter() - start, 1)

    def _spec(self, kind: str, slot: Slot, filled: bool) -> mujoco.MjSpec:
        spec = empty()
        if kind == "slots":
            slot.add_meshes(spec)
        for i, spot in enumerate(self.spots):
            if kind == "slots":
                slot.add(spec, f"unit{i}", spot)
            else:
                for name in VARIANTS if kind == "parked" else [[*VARIANTS][self.variant[0, i]]]:
                    attach(spec, name, f"unit{i}_{name}", spot).mocap = True
        if filled:
            attach(spec, "panda", "panda", (0.0, -0.5, 0.0)).quat = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
        for name in THINGS if filled else ():
            attach(spec, name, name, (0.0, 0.0, 0.0)).add_freejoint()
        return spec

    def launch_step(self) -> None:
        """Launch a control step, as Batch does."""
        for _ in range(KitchenReset.substeps):
            mjw.step(self.model, self.data)
        self._update(self.model, self.data)

    def _write_rows(self, slot: Slot) -> int:
        """Give every world its variants, and return the bytes of a world's rows."""
        m, worlds = self.model, len(self.variant)
        rows = {field: np.repeat(getattr(m, field).numpy()[:1], worlds, axis=0) for field in row_fields()}
        for i, column in enumerate(self.variant.T):
            for number, piece in enumerate(slot.pieces):
                chosen = np.flatnonzero(column == number)
                self.unused[chosen[:, None], slot.write(self.mjm, rows, f"unit{i}", chosen, piece)] = True
        rows["body_subtreemass"][:, 0] = rows["body_mass"].sum(axis=1)
        for field, values in rows.items():
            array: Any = wp.array(values, dtype=getattr(m, field).dtype)
            array._is_batched = True  # the mark that mujoco_warp sets on its batched arrays
            setattr(m, field, array)
        return sum(values[0].nbytes for values in rows.values())

    def _place(self, kind: str, filled: bool) -> None:
        """Park pieces, set the arm to its home pose, and put objects on the units and on the floor before them."""
        mjm, qpos, mocap = self.mjm, self.data.qpos.numpy(), self.data.mocap_pos.numpy()
        for i, column in enumerate(self.variant.T if kind == "parked" else ()):
            for number, name in enumerate(VARIANTS):
                body = mjm.body_mocapid[mjm.body(f"unit{i}_{name}/{name}").id]
                mocap[column != number, body] = _PARKED + 2.0 * i, _PARKED + 2.0 * number, 0.0
        self.data.mocap_pos.assign(mocap)
        if not filled:
            return
        home = mujoco.MjModel.from_xml_path(str(ASSETS / "panda.xml"))
        first = mjm.joint("panda/joint1").qposadr[0]
        qpos[:, first : first + home.nq] = home.key_qpos[0]
        high = min(len(ON_TOP), len(self.spots))
        for i, name in enumerate(THINGS):
            first = mjm.jnt_qposadr[mjm.body(f"{name}/{name}").jntadr[0]]
            qpos[:, first : first + 3] = 0.4 * (i - high - (len(THINGS) - high - 1) / 2), 0.25, _DROP
            if i < high:
                unit = i * len(self.spots) // high
                qpos[:, first : first + 2] = self.spots[unit][:2]
                qpos[:, first + 2] += np.array([*VARIANTS.values()])[self.variant[:, unit]]
        self.data.qpos.assign(qpos)
        self.data.ctrl.assign(np.tile(home.key_ctrl[0], (len(qpos), 1)))

    def things(self) -> np.ndarray:
        """Return the qpos of all objects, shape (worlds, objects, 7)."""
        free = self.mjm.jnt_qposadr[self.mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        return self.data.qpos.numpy()[:, np.add.outer(free, np.arange(7))]

    def counts(self) -> dict[str, float]:
        """Return contacts, constraint rows, solver iterations and awake degrees of freedom of a world."""
        d = self.data
        found = {name: round(float(getattr(d, name).numpy()[0]) / d.nworld, 2) for name in ("nacon", "ncollision")}
        for name in ("nefc", "solver_niter", "nv_awake"):
            values = getattr(d, name).numpy()
            found |= {name: round(float(values.mean()), 2), f"{name}_max": int(values.max())}
        return found

    def failure(self) -> str | None:
        """Return the reason why the worlds are wrong, or None."""
        qpos = self.data.qpos.numpy()
        if not np.isfinite(qpos).all() or qpos[self.unused].any():
            return "a position is not finite, or an unused joint moved"
        try:
            check_budget(self.model, self.data)
        except ContactBudgetError as error:
            return str(error)
        return None


def kitchen_steps(options: Options) -> dict[str, Callable[[], Any]]:
    """Return the steps of KitchenReset-v0 with zero actions: the environment's step, and its physics."""
    compiled = compile_scene(scene_of("KitchenReset-v0", reachable=True), options.device)
    envs = make_env("KitchenReset-v0", options.worlds, compiled)
    envs.reset(seed=0)
    # pyrefly: ignore[no-matching-overload]
    action = torch.zeros(envs.action_space.shape, device=envs.device)
    return {"kitchen": lambda: envs.step(action), "kitchen physics": envs.batch.step}


def tell(line: dict[str, Any], options: Options) -> None:
    """Print a line."""
    print(json.dumps(line) if options.json else "  ".join(f"{k} {v}" for k, v in line.items()), flush=True)


def profile(worlds: Worlds, options: Options) -> None:
    """Print the time of each stage of a control step [ms], launched without a graph."""
    with wp.ScopedDevice(options.device), EventTracer() as tracer:
        worlds.launch_step()
        wp.synchronize()
        left = [("", tracer.trace())]
    while left:
        path, stages = left.pop()
        for name, (times, parts) in stages.items():
            tell({"kind": worlds.about["kind"], "stage": path + name, "ms": round(sum(times), 3)}, options)
            left.append((f"{path}{name}/", parts))


def clock(step: Callable[[], Any], steps: int) -> float:
    """Return the mean time of `steps` calls [ms]."""
    wp.synchronize()
    start = time.perf_counter()
    for _ in range(steps):
        step()
    wp.synchronize()
    return 1e3 * (time.perf_counter() - start) / steps


def main(options: Options) -> None:
    """Make the worlds, let them take turns, and print a line for each kind.

    Raises:
        SystemExit: with status 1, if a result is wrong
    """
    made: dict[str, Worlds] = {}
    for kind in ("fixed", "slots", "parked"):
        made[kind] = Worlds(kind, options, arrangement(options.slots, options.worlds))
        print(f"{kind}: ready after {made[kind].about['seconds']} s", file=sys.stderr, flush=True)
    steps: dict[str, Callable[[], Any]] = {kind: worlds.step for kind, worlds in made.items()}
    steps |= kitchen_steps(options) if options.kitchen else {}
    times: dict[str, list[float]] = {kind: [] for kind in steps}
    before, begun = ({kind: look(worlds) for kind, worlds in made.items()} for look in (Worlds.counts, Worlds.things))
    with torch.inference_mode():
        for turn in range(options.rounds + 1):  # the first turn warms up
            for kind in steps if turn % 2 else reversed(steps):
                times[kind].append(clock(steps[kind], options.steps))
    failures = []
    for kind, values in times.items():
        ms, ratio = np.array(values[1:]), np.divide(times["fixed"], values)[1:]
        line: dict[str, Any] = {"ms": spread(ms), "steps_per_s": round(1e3 * options.worlds / float(np.median(ms)))}
        line["rate_over_fixed"] = spread(ratio, 3)
        if kind in made:
            worlds = made[kind]
            line |= worlds.about | worlds.counts() | {"before": before[kind]}
            line["moved"] = float(np.abs(worlds.things() - begun[kind]).max())
            line["unused"] = float(np.abs(worlds.data.qpos.numpy()[worlds.unused]).max(initial=0.0))
            line["failure"] = worlds.failure()
            failures += [line["failure"]] if line["failure"] else []
        tell({"kind": kind, **line}, options)
    for worlds in made.values() if options.profile else ():
        profile(worlds, options)
    raise SystemExit(int(bool(failures)))


if __name__ == "__main__":
    main(tyro.cli(Options))
