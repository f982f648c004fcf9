"""`CompiledScene`: a frozen scene with all data that resets need, precomputed on a device."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import SupportsIndex

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.fields import as_integer, short
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import AUTO
from sceniris_gym.device.fixed import RefusesOldNames
from sceniris_gym.errors import ArgumentError, NotSupportedError
from sceniris_gym.geometry.colliders import collect_colliders, collider_arrays
from sceniris_gym.geometry.pieces import ROUND
from sceniris_gym.program.checks import constraints, objects, oddities, places, simulation, standing
from sceniris_gym.program.device import Program, fill_struct
from sceniris_gym.program.device_bank import Bank, empty_bank
from sceniris_gym.program.device_conditions import Conditions
from sceniris_gym.program.device_reach import Starts
from sceniris_gym.program.device_statics import Statics
from sceniris_gym.program.pack.objects import fill_views
from sceniris_gym.program.pack.program import ARM_LISTS, pack_conditions, pack_program, pack_starts, pack_statics
from sceniris_gym.program.pack.relations import cut_pieces, most_sides
from sceniris_gym.program.plan import Plan, build_plan, placement_order, slot_names
from sceniris_gym.program.reach import Reaching
from sceniris_gym.scene.model import SceneModel

CHECKS: tuple[Callable[[Plan], None], ...] = (
    constraints.check_constraints,
    objects.check_followers,
    constraints.check_tendon_limits,
    places.check_rough_shapes,
    objects.check_supports,
    places.check_distances,
    simulation.check_pairs_fit,
    objects.check_relations,
    standing.check_standing,
    places.check_parking,
    simulation.check_solver,
    oddities.warn_of_oddities,
    objects.check_reach,
)
"""All checks of a scene, in the order in which they reject it or warn about it."""
FEWEST_ATTEMPTS = 10
"""The lowest number of attempts that `attempts: auto` tries."""
USER_SPLITS = ("train", "eval")
"""The splits that a user can choose. The same seed gives independent layouts in each split."""
MOST_EPISODES = (1 << 31) - 1
"""Number of episodes of a seed, counted in 32 bits. A world has the episode -1 before its first layout, and 0 after the
last one."""
_PARAM = r"[^=,:]+=(?:[0-9a-f]{8})+"
PARTS = rf"{_PARAM}(?:,{_PARAM})*"
"""Regular expression of the fifth part of a layout id."""
# Number of lanes of a warp. On a GPU, they test one candidate together.
_WARP = 32


def check_split(split: object, where: str, valid: Collection[str] = USER_SPLITS) -> None:
    """Refuse a split that is not in `valid`. `where` names the function in the message.

    Raises:
        ArgumentError: The split is unknown.
    """
    if split not in valid:
        raise ArgumentError(f"{where}: unknown split {short(split)}. Valid: {', '.join(USER_SPLITS)}.")


@dataclass(frozen=True)
class CompiledScene(RefusesOldNames):
    """A frozen scene on one device, without a batch dimension.

    Attributes:
        scene: The compiled model, and the bodies of its named objects and robots.
        device: Warp's name of the device, e.g. "cuda:0".
        program: The placement program on the device.
        reaching: The arms that have to reach objects, and these objects. None if no object has `reachable`.
        statics: Feet, contacts and loads on the device, None if no object can fall.
        conditions: Conditions of group members on the device, None if no group or object depends on another.
        starts: The kinds of starts (entries of `start` in the scene file) on the device. None without `start`.
        bank: The fallback bank of valid layouts, empty until `compile_scene` fills it.
        home_qpos: Start pose, shape (nq,).
        home_xpos, home_xquat: Poses of all bodies in the start pose, shapes (nbody, 3) and (nbody, 4) wxyz.
        sides: Greatest number of half-planes of one object, added up over all pieces of its relations.
        pieces: Greatest number of pieces into which relations cut the region of one object.
        meshes: The device meshes of `program`.
    """

    scene: SceneModel
    device: str
    program: Program
    reaching: Reaching | None
    statics: Statics | None
    conditions: Conditions | None
    starts: Starts | None
    bank: Bank
    home_qpos: np.ndarray
    home_xpos: np.ndarray
    home_xquat: np.ndarray
    sides: int
    pieces: int
    meshes: tuple[wp.Mesh, ...]

    def __repr__(self) -> str:
        return f"<CompiledScene '{self.config.name}' on {self.device}>"

    @cached_property
    def plan(self) -> Plan:
        """The placement program on the host, built on first access because resets do not need it."""
        return build_plan(self.scene)

    @property
    def config(self) -> SceneConfig:
        """The configuration of the scene, as the user wrote it."""
        return self.scene.config

    @property
    def mjm(self) -> mujoco.MjModel:
        """The compiled model."""
        return self.scene.mjm

    @property
    def sim_mjm(self) -> mujoco.MjModel:
        """The model for simulation, with one body for all variants of an object. Without variants, it is `mjm`."""
        return self.scene.sim.mjm

    @property
    def hash(self) -> str:
        """The hash of the scene. Each layout id begins with this hash."""
        return self.scene.hash

    def layout_id(self, seed: SupportsIndex, episode: SupportsIndex, split: str = "train", params: str = "") -> str:
        """Return `scenehash:split:seed:episode`, the id of a layout of this scene for `sceniris-gym replay`.

        Args:
            seed: 64-bit integer of any library. Negative numbers are read as two's complement.
            episode: Number of resets since the world got its seed, 0 for the first layout.
            split: "train" or "eval".
            params: The params that differ from the scene file, as `ParamTable.text` writes them. They become a fifth
                part of the id.

        Raises:
            ArgumentTypeError: The seed or the episode is not an integer.
            ArgumentError: The seed has more than 64 bits, the split is unknown, the episode is out of range, or the
                params do not have this form. A world without a layout has episode -1, which has no id.
        """
        number, count = as_integer(seed, "layout_id: seed"), as_integer(episode, "layout_id: episode")
        if not -(2**63) <= number < 2**64:
            raise ArgumentError(f"layout_id: seed={short(number)} should be an integer of 64 bits.")
        if not 0 <= count < MOST_EPISODES:
            raise ArgumentError(
                f"layout_id: episode={short(count)} should be from 0 to 2^31 - 2. "
                "A world has no layout before its first reset."
            )
        check_split(split, "layout_id")
        if params != "" and not re.fullmatch(PARTS, str(params)):
            raise ArgumentError(f"layout_id: params should be text such as 'name=3f800000', got {short(params)}.")
        return f"{self.hash}:{split}:{number % 2**64}:{count}{f':{params}' if params else ''}"

    @property
    def home_state(self) -> dict[str, np.ndarray]:
        """The start pose as fields of a device struct, by name: joint positions, and poses of all bodies."""
        return {"qpos": self.home_qpos, "body_pos": self.home_xpos, "body_quat": self.home_xquat}

    @property
    def object_names(self) -> tuple[str, ...]:
        """Names of all objects, in the order of the scene file."""
        return tuple(self.config.objects)

    @cached_property
    def placed(self) -> tuple[str, ...]:
        """Objects with a drawn pose or joints, and robots with a drawn base or joints, by name in placement order."""
        return tuple(placement_order(self.scene))

    @property
    def slots(self) -> tuple[str, ...]:
        """Names for the columns of `Layouts.present`: all objects in the order of the scene file, then the robots."""
        return slot_names(self.config)

    @property
    def related(self) -> bool:
        """True if the region of at least one object differs between worlds."""
        return bool(self.program.obj_cutnum.numpy().any())

    @property
    def attempts(self) -> int:
        """Greatest number of candidates of one object before the search for a layout restarts.

        It is `attempts` of the scene file. If `attempts` is `auto`, compilation chose the number.
        """
        return int(self.program.attempts)


def refuse_starts(compiled: CompiledScene, where: str) -> None:
    """Reject a scene that has `start`, for callers that cannot close the fingers of a gripper.

    Raises:
        NotSupportedError: The scene has `start`.
    """
    if compiled.starts is not None:
        raise NotSupportedError(
            f"{where}: the scene '{compiled.config.name}' has 'start', which {where} cannot apply: it does not close "
            "fingers. Use SceneVectorEnv or ResetRandomizer, or remove 'start' from the scene file."
        )


def refuse_draws(compiled: CompiledScene, where: str, instead: str) -> None:
    """Reject a scene with `randomize`, for callers that do not draw physics and appearance.

    Args:
        compiled: The scene.
        where: The beginning of the error.
        instead: The text after "draw by" in the error: another way to draw physics and appearance with this caller.

    Raises:
        NotSupportedError: The scene has `randomize`.
    """
    draws = compiled.scene.sim.draws
    if draws:
        raise NotSupportedError(
            f"{where}: the scene '{compiled.config.name}' has 'randomize' ({draws[0].name}), which {where} does not "
            f"draw. Remove it from the scene file and draw by {instead}, or use SceneVectorEnv or ResetRandomizer."
        )


def upload_scene(scene: SceneModel, device: str) -> CompiledScene:
    """Check a scene and upload it to a device. The bank stays empty until `layout.compile.compile_scene` fills it.

    Raises:
        ScenirisError: `build_plan` or one of `CHECKS` rejects the scene.
    """
    plan = build_plan(scene)
    for check in CHECKS:
        check(plan)
    return upload_plan(plan, device)


def upload_plan(plan: Plan, device: str, *, starts: bool = True) -> CompiledScene:
    """Upload a plan to a device, without checks and with an empty bank.

    If `starts` is false, the result has no kinds of starts.
    """
    scene = plan.scene
    is_visual = scene.config.geometry == "visual"
    colliders = collect_colliders(plan.pieces, is_visual, device)
    lanes = _WARP if wp.get_device(device).is_cuda else 1
    arrays = pack_program(plan, colliders, lanes) | collider_arrays(colliders)
    fill_views(plan, {name: arrays.pop(name) for name in ARM_LISTS}, device)
    program = Program()  # pyrefly: ignore[missing-argument]
    program.visual = is_visual
    program.face_vertadr = 0
    if is_visual and any(p.type in ROUND for p in plan.pieces):  # triangles are tested as hulls against round pieces
        program.face_vertadr = len(arrays["vert"])
        corners = np.stack([arrays[name] for name in ("face_a", "face_b", "face_c")], axis=1)
        arrays["vert"] = np.concatenate([arrays["vert"], corners.reshape(-1, 3)])
    found = pack_starts(plan, arrays["bound_qpos"], device) if starts else None
    program.nobject, program.ngiven = len(plan.objects), 0
    program.ngroup = len(scene.config.presence.draws)
    program.attempts = FEWEST_ATTEMPTS if scene.config.attempts == AUTO else scene.config.attempts
    program.restarts = scene.config.restarts
    program.restart_rate = 0.5
    fill_struct(Program, program, arrays, device)
    return CompiledScene(
        scene=scene,
        device=device,
        program=program,
        reaching=plan.reaching if plan.reaching.arms else None,
        statics=pack_statics(plan, device),
        conditions=pack_conditions(scene.config.presence, plan.slots, device),
        starts=found,
        bank=empty_bank(device),
        home_qpos=scene.home_qpos.astype(np.float32),
        home_xpos=plan.scene.home.xpos.astype(np.float32),
        home_xquat=plan.scene.home.xquat.astype(np.float32),
        sides=most_sides(plan),
        pieces=max(map(cut_pieces, plan.objects), default=0),
        meshes=tuple(c.mesh for c in colliders if c.mesh is not None),
    )
