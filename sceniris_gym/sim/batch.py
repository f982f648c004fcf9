"""`Batch`: many worlds in one mujoco_warp Model and Data, with memory for contacts and a function for control steps."""

import copy
import logging
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.fixed import Fixed
from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.errors import ContactBudgetError, NotSupportedError, as_names, check_names
from sceniris_gym.layout.masks import as_count
from sceniris_gym.program.checks.simulation import array_bytes, check_worlds
from sceniris_gym.scene.draws import drawn_fields
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.model_fields import ModelFields, owner, widen, with_followers
from sceniris_gym.sim.variants import fields_of_variants
from sceniris_gym.sim.versions import OverflowType, room_for_dofs, silence_iterations

# Geoms of these types need little scratch memory: at most 16 iterations for a pair of boxes, and no lists of polygons.
_PRIMITIVES = [int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("PLANE", "SPHERE", "CAPSULE", "BOX")]
# Geoms carry a body tree together if their lowest points differ by less than this [m].
_SAME_HEIGHT = 0.002


def default_budget(mjm: mujoco.MjModel, scene: SceneModel | None = None) -> tuple[int, int]:
    """Return numbers of contacts and constraint rows per world (nconmax, njmax) that leave room for a busy scene.

    Contacts: 16, plus four for each body that can move and collide, plus four for each geom at the bottom of such a
    body (a plate may have a dozen such geoms). If the body stands on a free object, each bottom geom may touch several
    geoms of that object, and adds six instead of four. Stacked plates had up to 5.5 contacts per geom.

    Constraint rows: a pyramidal contact has one row for each edge of its friction pyramid, and an elliptic contact one
    row for each dimension. Each limit and each friction loss adds one row, and each equality adds six.

    Args:
        mjm: The simulated model.
        scene: The scene of the model. For an object that may lie on another side, the bottom is the side with the most
            geoms. Of an object with variants, only the variant with the most bottom geoms counts. If `scene` is
            None, the bottom geoms are counted with each object in its pose in the model.
    """
    moving = np.unique(mjm.geom_bodyid[(mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)])
    moving = [b for b in moving if mjm.body_weldid[b] != 0 or mjm.body_mocapid[b] >= 0]
    stood_on, across = _geoms_stood_on(mjm, ()), 0
    if scene is not None:
        stood_on = _geoms_stood_on(scene.mjm, {scene.bodies[n] for n, o in scene.config.objects.items() if o.is_turned})
        for members in scene.config.variants.values():
            stood_on[sorted((scene.bodies[member] for member in members), key=lambda body: stood_on[body])[:-1]] = 0
        across = _geoms_across(scene, stood_on)
    nconmax = 16 + 4 * (len(moving) + int(stood_on.sum())) + 2 * across
    condim = int(max(mjm.geom_condim, default=1))
    pyramidal = mjm.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL
    rows_per_contact = max(1, 2 * (condim - 1)) if pyramidal else condim
    limits = int(mjm.jnt_limited.sum() + mjm.tendon_limited.sum())
    friction = int((mjm.dof_frictionloss > 0).sum() + (mjm.tendon_frictionloss > 0).sum())
    return nconmax, rows_per_contact * nconmax + limits + friction + 6 * mjm.neq


def _geoms_across(scene: SceneModel, stood_on: np.ndarray) -> int:
    """Return the total number of bottom geoms of all objects that stand on free objects.

    An object counts with at most as many geoms as its support has.

    Args:
        scene: The scene.
        stood_on: Number of bottom geoms of the tree of each root body, shape (nbody,).
    """
    mjm, objects, found = scene.mjm, scene.config.objects, 0
    collides = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    pieces = np.bincount(mjm.body_rootid[mjm.geom_bodyid[collides]], minlength=mjm.nbody)
    for name in objects:
        below = scene.config.presence.carrier(name)
        if below and objects[below].kind == "free":
            found += min(stood_on[scene.bodies[name]], pieces[scene.bodies[below]])
    return int(found)


def _geoms_stood_on(mjm: mujoco.MjModel, turned: Collection[int]) -> np.ndarray:
    """Return the number of bottom geoms of each kinematic tree of moving bodies, at the root body's id, shape (nbody,).

    The geoms are counted with the tree in its pose in the model. If the root is in `turned`, the tree is also turned so
    that each side of each of its geoms faces down, and the largest count is returned.
    """
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    collides = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    geoms = np.flatnonzero(collides & (mjm.body_weldid[mjm.geom_bodyid] != 0))
    roots, mats = mjm.body_rootid[mjm.geom_bodyid[geoms]], data.geom_xmat[geoms].reshape(-1, 3, 3)
    center, half = mjm.geom_aabb[geoms, :3], mjm.geom_aabb[geoms, 3:]
    most = np.zeros(mjm.nbody, int)
    for root in np.unique(roots):
        mine = roots == root
        axes = mats[mine if root in turned else []].transpose(0, 2, 1).reshape(-1, 3)
        ups = np.concatenate([[[0.0, 0.0, 1.0]], axes, -axes])
        down = ups @ mats[mine]  # each direction in the frame of each geom, shape (ngeom, nup, 3)
        bottom = data.geom_xpos[geoms[mine]] @ ups.T
        bottom += (down * center[mine, None]).sum(2) - (np.abs(down) * half[mine, None]).sum(2)
        most[root] = (bottom < bottom.min(axis=0) + _SAME_HEIGHT).sum(axis=0).max()
    return most


def check_budget(m: mjw.Model, d: mjw.Data) -> None:
    """Check that contacts and constraint rows fit the allocated memory. Waits for the device.

    Runs kinematics and collision detection for the current state, and reads the overflow flags of earlier steps.

    Raises:
        ContactBudgetError: Contacts or rows did not fit. The message names the argument to increase and its new value.
    """
    with wp.ScopedDevice(d.qpos.device):
        mjw.kinematics(m, d)
        mjw.com_pos(m, d)
        mjw.collision(m, d)
    contacts = max(int(d.nacon.numpy()[0]), int(d.ncollision.numpy()[0]))
    flags = int(np.bitwise_or.reduce(d.overflow.numpy()))
    contact_flags = OverflowType.BROADPHASE | OverflowType.NARROWPHASE | OverflowType.CCD
    if contacts > d.naconmax or flags & contact_flags:
        raise ContactBudgetError("nconmax", d.naconmax // d.nworld, contacts // d.nworld + 1)
    if flags & OverflowType.NEFC:
        raise ContactBudgetError("njmax", d.njmax, int(d.nefc.numpy().max()))


NEEDS: dict[str, tuple[Callable[[mjw.Model, mjw.Data], None], ...]] = {
    "kinematics": (mjw.kinematics,),
    "velocity": (mjw.kinematics, mjw.com_pos, mjw.com_vel),
    "contacts": (mjw.kinematics, mjw.com_pos, mjw.collision),
    "sensors": (mjw.forward,),
    "dynamics": (mjw.forward,),
}
"""Quantities that a step or a reset can update, and the functions that compute them."""

MANY_PAIRS = 1 << 15
"""With more pairs of geoms that may collide, sorting the geoms along an axis takes less time than testing all pairs."""

LINE_SEARCH = 20
"""Limit of line-search iterations. It is below MuJoCo's default, because one slow world stalls the whole batch."""

# Maximum number of contacts or constraint rows per world. Higher numbers need gigabytes for a single world.
_MOST_ROWS = 1 << 20


def updater(needs: Iterable[str]) -> Callable[[mjw.Model, mjw.Data], None]:
    """Return a function that updates kinematics and the quantities named in `needs`, which are keys of NEEDS.

    Raises:
        UnknownNameError: A need is not a key of NEEDS.
    """
    needs = ["kinematics", *as_names(needs, "needs")]
    check_names("need", needs, "needs", NEEDS)
    stages = list(dict.fromkeys(stage for name in needs for stage in NEEDS[name]))
    if mjw.forward in stages:  # a forward pass contains all the others
        return mjw.forward

    def update(m: mjw.Model, d: mjw.Data) -> None:
        for stage in stages:
            stage(m, d)

    return update


def put_simulated(mjm: mujoco.MjModel, where: str) -> mjw.Model:
    """Return a model as a `mujoco_warp.Model` on Warp's current device.

    Raises:
        NotSupportedError: The model has a feature that MuJoCo-Warp lacks. The message begins with `where`.
    """
    try:
        model = mjw.put_model(mjm)
    except NotImplementedError as error:
        raise NotSupportedError(f"{where}: MuJoCo-Warp cannot simulate the model: {error} Remove it.") from None
    if len(model.nxn_geom_pair_filtered) > MANY_PAIRS and model.opt.broadphase == mjw.BroadphaseType.NXN:
        model.opt.broadphase = mjw.BroadphaseType.SAP_TILE
    return model


def with_options(mjm: mujoco.MjModel, options: Mapping[str, Any]) -> mujoco.MjModel:
    """Return a copy of the model with `options` written into its MjOption. Without options, return the model itself.

    Raises:
        UnknownNameError: MjOption has no such field.
    """
    if not options:
        return mjm
    check_names("option", options, "options", [name for name in dir(mjm.opt) if not name.startswith("_")])
    mjm = copy.copy(mjm)
    for name, value in options.items():
        setattr(mjm.opt, name, value)
    return mjm


def _world_bytes(scene: SceneModel, m: mjw.Model, one: mjw.Data) -> int:
    """Return the bytes of a world: its Data, its rows of model fields, and the scratch memory of a step.

    A step finds contacts and then solves for accelerations, so only the larger of the two scratch memories counts.

    Args:
        scene: The scene with all variants.
        m: The Model. Its fields have one row for all worlds.
        one: Data of one world.
    """
    mjm = scene.sim.mjm
    shared = fields_of_variants(scene)  # these have a second array of nominal values
    drawn = {each for name in drawn_fields(scene.sim.draws) for each in with_followers(name)}
    rows = sum(getattr(owner(m, name), name).capacity for name in (*shared, *shared, *drawn.difference(shared)))
    solid = mjm.geom_type[(mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)]
    pair = 3100 if np.isin(solid, _PRIMITIVES).all() else 2400 + 132 * m.opt.ccd_iterations
    solver = 24 * one.njmax + 8 * (getattr(one, "nvmax", 0) or m.nv) ** 2
    data = array_bytes(one, one.contact, one.efc, rows=(1, one.naconmax))
    return data + rows + max(one.naconmax // 4 * pair, solver)


class Batch(Fixed):
    """Many worlds of one scene that step together.

    Args:
        scene: The scene.
        nworld: Number of worlds.
        device: Warp device, or None for Warp's current device.
        nconmax: Contacts per world. All worlds share a pool of nworld * nconmax. None takes the number from
            `default_budget`.
        njmax: Constraint rows per world. None takes the number from `default_budget`.
        nvmax: Maximum number of awake degrees of freedom in a world, if bodies sleep. None means no limit.
        needs: Quantities to update after every control step: "velocity", "contacts", "sensors" or "dynamics".
        substeps: Physics steps in a control step.
        options: Values of MjOption's fields by name. They replace the scene's values.
        graph: If true, the control step is captured into a graph, which later steps replay.
        beside: What the caller makes for the same worlds, as `parts` of `check_worlds`.

    Attributes:
        scene: The simulated scene. All variants of an object share one body in this scene.
        full_scene: The scene that the caller passed, with all variants.
        model: mujoco_warp Model.
        data: mujoco_warp Data.
        fields: The ModelFields: fields of `model` that have a row for each world.
        memory: The WorldMemory of the worlds, with the parts in `beside`. It is logged at level INFO.
        step: Takes one control step in all worlds: `substeps` physics steps, then an update of kinematics and `needs`.
            Without the update, xpos would be one substep older than qpos.
        update: Updates kinematics and `needs` in all worlds.

    Raises:
        UnknownNameError: MjOption has no such field.
        ArgumentError: `nconmax`, `njmax` or `nvmax` is not a positive integer, or is too large.
        NotSupportedError: MuJoCo-Warp cannot simulate the model with these options.
        MemoryLimitError: The device has too little memory for this number of worlds.
        FixedError: Raised on assignment to an attribute that captured graphs already use.
    """

    _FIXED = ("scene", "full_scene", "nworld", "device", "model", "data", "fields", "substeps", "step", "update")
    _ARGUMENTS = ("nconmax", "njmax", "nvmax", "needs", "options", "graph")

    def __init__(
        self,
        scene: SceneModel,
        nworld: int,
        device: str | None = None,
        *,
        nconmax: int | None = None,
        njmax: int | None = None,
        nvmax: int | None = None,
        needs: Iterable[str] = (),
        substeps: int = 1,
        options: Mapping[str, Any] | None = None,
        graph: bool = True,
        beside: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.full_scene = scene
        self.scene, self.nworld, self.device = scene.sim, nworld, wp.get_device(device)
        mjm = with_options(self.scene.mjm, options or {})
        where, (contacts, rows) = scene.config.where, default_budget(mjm, scene)
        most = min(_MOST_ROWS, (1 << 31) // nworld - 1)
        for name, value, end in (("nconmax", nconmax, most), ("njmax", njmax, most), ("nvmax", nvmax, mjm.nv)):
            if value is not None:
                as_count(value, name, most=end)
        nconmax, njmax = nconmax or contacts, njmax or rows
        naconmax = nworld * nconmax
        # A pair of convex geoms takes up to 7 kB of scratch memory. Many worlds share room for a quarter of their
        # contacts. A few worlds may need room for all.
        naccdmax = min(naconmax, max(naconmax // 4, 16 * nconmax))
        with wp.ScopedDevice(self.device):
            self.model = put_simulated(mjm, where)
            if scene.config.model is None:  # a user's own model keeps its options
                self.model.opt.ls_iterations = LINE_SEARCH
            # solvers often reach their iteration limits, and a warning at every step would flood stdout
            silence_iterations(self.model)
            room = {"nconmax": nconmax, "njmax": njmax} | room_for_dofs(nvmax)
            own = 0, _world_bytes(scene, self.model, mjw.make_data(mjm, 1, **room))
            self.memory = check_worlds(where, nworld, str(self.device), own, *beside)
            logging.getLogger(__name__).info("%s: %s.", where, self.memory)
            for name in fields_of_variants(scene):
                widen(self.model, name, nworld)
            self.data = mjw.make_data(mjm, nworld, naccdmax=naccdmax, **room)
        self.fields = ModelFields(scene, self.model, self.data, grow=True)
        self.substeps, self._update = substeps, partial(updater(needs), self.model, self.data)
        update = LaunchSequence(self._update, self.device, graph=graph)
        update.ahead = self._launch_step  # the kernels of both are compiled together
        self.update = update.replay
        self.step = LaunchSequence(self._launch_step, self.device, graph=graph).replay

    def _launch_step(self) -> None:
        for _ in range(self.substeps):
            mjw.step(self.model, self.data)
        self._update()
