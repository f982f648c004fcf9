"""Adds solver options, the floor, lights and the overview camera to a scene."""

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.scene_words import Floor
from sceniris_gym.geometry.rotations import quaternion

OVERVIEW = "overview"


def set_options(spec: mujoco.MjSpec) -> None:
    """Set solver options for manipulation. With the same options, all scenes use the same compiled kernels."""
    option = spec.option
    option.timestep = 0.005  # 4 substeps make a 50 Hz control step and resolve contacts (solref 0.02 s)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # stable with the stiff position actuators of arms
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # with impratio: objects do not creep out of a gripper
    option.impratio = 10.0
    option.iterations = 20  # Newton needs 2 to 5 to converge, and the bounds keep one bad world from stalling all
    # MuJoCo's default. With 20, line searches of MuJoCo C end too early for objects that land on many corners at once:
    # 12 of 100 books on their spines fell over or jumped by a centimetre. Batches have a separate bound.
    option.ls_iterations = 50
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]


def add_floor(spec: mujoco.MjSpec, floor: Floor) -> None:
    """Add the plane 'floor' to the world: infinite for contacts, drawn in the size of the workspace."""
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.62, 0.64, 0.66],
        rgb2=[0.56, 0.58, 0.60],
        width=256,
        height=256,
    )
    textures = [""] * mujoco.mjtTextureRole.mjNTEXROLE
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    # texuniform: squares of 0.2 m for any size of the floor
    spec.add_material(name="floor", textures=textures, texuniform=True, texrepeat=[5.0, 5.0], specular=0.1)
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[floor.size[0] / 2.0, floor.size[1] / 2.0, 0.05],
        material="floor",
        friction=[0.8, 0.005, 0.0001],
    )


def add_light(spec: mujoco.MjSpec) -> None:
    """Add a soft sky and a lamp from the front left. The camera's headlight fills the shadows."""
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.70, 0.76, 0.82],
        width=64,
        height=384,
    )
    spec.worldbody.add_light(
        name="lamp",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[-1.0, -1.5, 3.0],
        dir=[0.3, 0.4, -0.87],
        diffuse=[0.6, 0.6, 0.58],
        specular=[0.2, 0.2, 0.2],
        castshadow=True,
    )


def add_camera(spec: mujoco.MjSpec, position: np.ndarray, axes: np.ndarray, fovy: float) -> None:
    """Add the camera 'overview'.

    Args:
        spec: The scene.
        position: Position of the camera [m], shape (3,).
        axes: Axes of the camera, the columns right, up and backward, shape (3, 3).
        fovy: Vertical field of view [degrees].
    """
    spec.worldbody.add_camera(name=OVERVIEW, pos=position, quat=quaternion(axes), fovy=fovy)
