"""Contacts and constraint rows per world: how many a scene needs, and a check that the allocated memory suffices."""

from collections.abc import Collection

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.errors import ContactBudgetError
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.versions import OverflowType

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
    """Return how many bottom geoms the objects that stand on free objects have in total.

    The count of an object is limited to the number of geoms of its support.

    Args:
        scene: The scene.
        stood_on: Number of bottom geoms of the tree of each root body, shape (nbody,).
    """
    mjm, objects, found = scene.mjm, scene.config.objects, 0
    collides = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    pieces = np.bincount(mjm.body_rootid[mjm.geom_bodyid[collides]], minlength=mjm.nbody)
    for name, o in objects.items():
        owner = o.support.parent.partition("/")[0] if o.support is not None else ""
        if owner in objects and objects[owner].kind == "free":
            found += min(stood_on[scene.bodies[name]], pieces[scene.bodies[owner]])
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
