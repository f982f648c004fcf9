"""Settles heaps with MuJoCo C: objects fall into a container until they lie still inside."""

import copy

import mujoco
import numpy as np

from sceniris_gym.config.groups import HeapConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.rotations import product
from sceniris_gym.progress import tell
from sceniris_gym.scene.heaps import DEEPEST, STILL, HeapRows, filled_body, rigid_part, rigid_thing, settled_with
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.overview import upright_box
from sceniris_gym.scene.support import subtree

# Longest time that objects may take to come to rest, and time that they then have to lie still [s].
_FALL, _LIE = 8.0, 0.5
# Objects that move by this distance [m] do not lie still.
_MOVED = 1e-3
# Attempts per row before the container counts as too small.
_TRIES = 20
# Inertia of all joints outside the heap's objects [kg or kg m^2]. Their positions are restored after every step. With a
# million or more, next to objects of some grams, MuJoCo's solver does not converge.
_HELD = 1e3


def settle(scene: SceneModel, name: str, num: int, seed: int) -> HeapRows:
    """Settle heaps of a scene, and report the progress.

    Objects fall in a random order and random orientations, each from above the previous object. A heap is accepted if
    all objects come to rest inside the bounds of the container, penetrate by less than `DEEPEST`, and lie still.

    Args:
        scene: The scene.
        name: The heap.
        num: Number of heaps.
        seed: Row i depends only on the seed and on i.

    Raises:
        SceneKeyError: The container cannot hold the objects.
    """
    heap, where = scene.config.heaps[name], f"{scene.config.where}: heaps.{name}"
    drop = _Drop(scene, heap, where)
    rows = []
    for i in range(num):
        rng = np.random.default_rng([seed, i])
        data = next((found for _ in range(_TRIES) if (found := drop.dropped(rng)) is not None), None)
        if data is None:
            raise SceneKeyError(
                f"{where}: '{heap.fill}' does not hold all {len(heap.of)} objects: in {_TRIES} attempts, at least one "
                "did not come to rest inside. Use fewer or smaller objects, or a larger container."
            )
        mat, back = data.xmat[drop.body].reshape(3, 3), np.array([1.0, -1.0, -1.0, -1.0]) * data.xquat[drop.body]
        quats = np.array([product(back, data.xquat[thing]) for thing in drop.things])
        rows.append(((data.xpos[drop.things] - data.xpos[drop.body]) @ mat, quats))
        tell("heaps", i + 1, num)
    pos, quat = (np.array([row[k] for row in rows]) for k in range(2))
    return HeapRows(heap.of, pos, quat, settled_with(scene, heap, where))


class _Drop:
    """A simulation of the objects of a heap as they fall into their container.

    Attributes:
        mjm: The model, in which only the container and the heap's objects collide.
        home: The model's start pose, shape (nq,).
        held, held_qpos: Entries of qvel and qpos that stay fixed, as masks of shapes (nv,) and (nq,).
        body: The container's body.
        things: Root bodies of the objects.
        low, high: Bounds of the container in the world [m], shape (3,) each.
        sizes: The largest distance of each object's geoms from its root [m].
    """

    def __init__(self, scene: SceneModel, heap: HeapConfig, where: str) -> None:
        self.mjm = mjm = copy.copy(scene.mjm)
        self.home, self.body = scene.home_qpos, filled_body(scene, heap, where)
        self.things = [scene.bodies[name] for name in heap.of]
        container = rigid_part(mjm, self.body)
        own = [b for name in heap.of for b in rigid_thing(scene, name, where)]
        outside = ~np.isin(mjm.geom_bodyid, [*container, *own])
        mjm.geom_contype[outside] = mjm.geom_conaffinity[outside] = 0
        self.held, self.held_qpos = ~np.isin(mjm.dof_bodyid, own), np.ones(mjm.nq, bool)
        self.held_qpos[mjm.jnt_qposadr[mjm.body_jntadr[self.things]][:, None] + np.arange(7)] = False
        mjm.dof_armature[self.held] = _HELD
        # A diverging heap should fail the checks, not silently restart from the model's pose.
        mjm.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        mujoco.mj_setConst(mjm, mujoco.MjData(mjm))
        mjm.stat.meaninertia = scene.mjm.stat.meaninertia  # the scale of the solver's tolerances
        walls = [b for b in subtree(mjm, self.body) if b in container]
        collides = ~outside & (mjm.geom_contype + mjm.geom_conaffinity > 0)
        geoms = np.flatnonzero(np.isin(mjm.geom_bodyid, walls) & collides)
        if not len(geoms):
            raise SceneKeyError(
                f"{where}.fill: '{heap.fill}' has no geoms that collide, so no object can lie in it. Add geoms that "
                "collide."
            )
        self.low, self.high = upright_box(mjm, scene.home, geoms)
        root = mjm.body_rootid[mjm.geom_bodyid]
        away = np.linalg.norm(scene.home.geom_xpos - scene.home.xpos[root], axis=1) + mjm.geom_rbound
        self.sizes = np.array([away[root == thing].max(initial=0.01) for thing in self.things])

    def dropped(self, rng: np.random.Generator) -> mujoco.MjData | None:
        """Drop the objects, and return the state once all of them are at rest in the container.

        Return None if an object falls past the container, or does not come to rest.
        """
        mjm, data = self.mjm, mujoco.MjData(self.mjm)
        data.qpos[:] = self.home
        height = self.high[2]
        for i in rng.permutation(len(self.things)):
            size = self.sizes[i]
            inner = np.maximum(0.5 * (self.high - self.low) - size, 0.0)[:2]
            height += size
            adr = int(mjm.jnt_qposadr[mjm.body_jntadr[self.things[i]]])
            data.qpos[adr : adr + 2] = 0.5 * (self.low + self.high)[:2] + inner * rng.uniform(-1.0, 1.0, 2)
            data.qpos[adr + 2] = height
            rotation = rng.normal(size=4)
            data.qpos[adr + 3 : adr + 7] = rotation / np.linalg.norm(rotation)
            height += size
        for step in range(int(_FALL / mjm.opt.timestep)):
            self._step(data)
            if step % 50 == 0 and (data.xipos[self.things, 2] < self.low[2] - 0.1).any():
                return None  # an object is below the container
            if step % 50 == 0 and step * mjm.opt.timestep > 0.5 and self._is_still(data):
                break
        return data if self._lies(data) else None

    def _lies(self, data: mujoco.MjData) -> bool:
        """Return whether the objects are in the container, hardly penetrate, and stay in place after a start at rest.

        A layout stores only poses. The test therefore starts without velocities and without forces of earlier steps.
        """
        tried = mujoco.MjData(self.mjm)
        tried.qpos[:] = data.qpos.astype(np.float32)  # the precision of layouts
        mujoco.mj_kinematics(self.mjm, tried)
        before = tried.xpos[self.things].copy()
        for _ in range(int(_LIE / self.mjm.opt.timestep)):
            self._step(tried)
        mujoco.mj_kinematics(self.mjm, data)
        mujoco.mj_collision(self.mjm, data)
        moved = np.linalg.norm(tried.xpos[self.things] - before, axis=1).max()
        centers, top = data.xipos[self.things], self.high + np.outer(self.sizes, [0.0, 0.0, 1.0])  # may stick out
        inside = ((centers >= self.low) & (centers <= top)).all()
        deepest = -min(data.contact.dist, default=0.0)
        return bool(self._is_still(tried) and moved < _MOVED and deepest < DEEPEST and inside)

    def _step(self, data: mujoco.MjData) -> None:
        """Step the objects, and hold all other joints."""
        mujoco.mj_step(self.mjm, data)
        data.qvel[self.held] = 0.0
        data.qpos[self.held_qpos] = self.home[self.held_qpos]

    def _is_still(self, data: mujoco.MjData) -> bool:
        """Return whether all objects of the heap move slower than `STILL`."""
        dofs = self.mjm.jnt_dofadr[self.mjm.body_jntadr[self.things]]
        return all(np.abs(data.qvel[d : d + 3]).max() < STILL for d in dofs)
