"""Objects dropped onto their supports in MuJoCo C, away from all other objects."""

import copy
from collections.abc import Mapping

import mujoco
import numpy as np

from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.scene.couplings import follow
from sceniris_gym.scene.model import SceneModel

DROP_SECONDS = 0.5
"""Duration of a drop [s]."""
STILL = 0.01
"""Greatest motion [m] of a standing object during a drop."""
# Inertia [kg or kg m^2] that holds joints in place. With 1e9 in a hinge, rounding tips the body below it.
_HELD = 1.0e6


def held(mjm: mujoco.MjModel, joints: np.ndarray, bodies: np.ndarray) -> mujoco.MjModel:
    """Return a copy of a model where masked joints (njnt,) cannot move and masked bodies (nbody,) do not collide."""
    model = copy.copy(mjm)
    model.geom_contype[bodies[mjm.geom_bodyid]] = model.geom_conaffinity[bodies[mjm.geom_bodyid]] = 0
    model.dof_armature[joints[mjm.dof_jntid]] = _HELD
    return model


def only(mjm: mujoco.MjModel, o: PlacedObject) -> mujoco.MjModel:
    """Return a copy of a model where only an object moves, and collides only with itself and its support."""
    others = ~np.isin(np.arange(mjm.nbody), [*o.bodies, int(o.ground or 0)])
    return held(mjm, ~np.isin(mjm.jnt_bodyid, o.bodies), others)


def point(data: mujoco.MjData, body: int, at: np.ndarray) -> np.ndarray:
    """Return the world positions [m] of points of a body. `at` has the points in the body's frame [m], (..., 3)."""
    return data.xpos[body] + (data.xmat[body].reshape(3, 3) @ at.T).T


def drop(
    mjm: mujoco.MjModel, scene: SceneModel, o: PlacedObject, i: int, height: float, state: Mapping[int, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Let a free object fall onto the middle of its support. Return the pose of its root before and after, (7,) each.

    Args:
        mjm: The model to simulate, with the joints of the scene.
        scene: The scene.
        o: The object.
        i: Number of its stable pose.
        height: Height [m] of the root over the surface.
        state: Positions of drawn joints, by address in qpos.
    """
    home, ground, surface, pose = scene.home, int(o.ground or 0), o.surfaces[i][0], o.stable_poses[i]
    at = np.array([*surface.region.representative_point().coords[0], surface.height + height])
    start = point(home, ground, at) - [*(matrix(pose.quat) @ pose.pivot)[:2], 0.0]
    data, adr = mujoco.MjData(mjm), int(mjm.jnt_qposadr[mjm.body_jntadr[o.bodies[0]]])
    data.qpos[:], data.ctrl[:] = home.qpos, scene.home_ctrl
    data.qpos[adr : adr + 7] = before = np.array([*start, *pose.quat])
    data.qpos[list(state)] = list(state.values())
    follow(o.followers, data.qpos)
    mujoco.mj_step(mjm, data, round(DROP_SECONDS / mjm.opt.timestep))
    return before, data.qpos[adr : adr + 7].copy()


def moved(before: np.ndarray, after: np.ndarray, at: np.ndarray) -> float:
    """Return how far [m] a point moves with its body. `at` is in the body's frame, and the body's poses are (7,)."""
    return float(np.linalg.norm(after[:3] - before[:3] + (matrix(after[3:]) - matrix(before[3:])) @ at))
