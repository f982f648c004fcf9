"""Pictures of layouts from mujoco_warp's ray caster, without OpenGL, on a CPU or a GPU.

The poses of geoms, cameras and lights come from MuJoCo C, so that only the ray caster's kernels have to be compiled.
Compiling them takes 8 s on one CPU core, once.
"""

import copy
from collections.abc import Sequence
from pathlib import Path

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from PIL import Image, ImageDraw, ImageFont

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.files import replacing
from sceniris_gym.pictures.context import Looks, Shot, in_model_order, picture_context
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.overview import VISIBLE_GROUPS, frame, framed, geom_corners
from sceniris_gym.scene.parking import is_parked

CAMERA = "overview"
SIZE = (480, 360)  # pixels
VIEW = (0.4, -1.0, 2.0)  # from the scene to the eye: ahead, a little to the right, and well above
_SAMPLES = 2  # rays per pixel along each axis
_APRON = 1.6  # m of ground drawn around the floor, which is an infinite plane drawn at the size of the workspace
_GAP, _STRIP = 6, 22  # pixels between tiles, and below each tile for its caption
_INK, _PAPER = (40, 44, 50), (255, 255, 255)


def render(
    mjm: mujoco.MjModel, table: LayoutTable, *, size: tuple[int, int] = SIZE, device: str | None = None
) -> np.ndarray:
    """Render all layouts with one camera.

    The camera is as near as possible, but sees all visible geoms of all layouts, except scenery (`framed`).

    Args:
        mjm: The model. Its camera 'overview' gives the field of view.
        table: The layouts.
        size: Width and height of a picture [pixels].
        device: Warp's name of the device, None for Warp's default.

    Returns:
        Pictures, uint8, shape (nrow, height, width, 3).

    Raises:
        UnknownNameError: The model has no camera 'overview'.
    """
    width, height = size
    with wp.ScopedDevice(device):
        wide = _with_apron(mjm)
        looks = {"render_skybox": True, "enable_backface_culling": False, "samples_per_pixel": _SAMPLES}
        shots = in_model_order(mjm, {CAMERA: Shot(size)}, "render")
        context = picture_context(wide, len(table), shots, Looks(shadows=True), (), **looks)
        m, d = mjw.put_model(wide), mjw.make_data(wide, nworld=len(table))
        camera, (poses, corners) = mjm.camera(CAMERA).id, _seen(mjm, table)
        eye, axes = frame(corners, np.array(VIEW), mjm.cam_fovy[camera], width / height)
        poses["cam_xpos"][:, camera], poses["cam_xmat"][:, camera] = eye, axes.reshape(9)
        for name, values in poses.items():
            field = getattr(d, name)
            field.assign(values.reshape(field.shape + tuple(getattr(field.dtype, "_shape_", ()))))
        mjw.refit_bvh(m, d, context)
        mjw.render(m, d, context)
        pixels = wp.zeros((len(table), height, width), dtype=wp.vec3)
        mjw.get_rgb(context, 0, pixels)
        return (pixels.numpy() * 255.0 + 0.5).astype(np.uint8)


def contact_sheet(pictures: np.ndarray, captions: Sequence[str]) -> Image.Image:
    """Arrange pictures (n, height, width, 3) above their captions, in rows of up to four, or a square of over 16."""
    height, width = pictures.shape[1:3]
    columns = max(min(4, len(pictures)), int(np.ceil(len(pictures) ** 0.5)))
    nrow = -(-len(pictures) // columns)
    cell = np.array([width + _GAP, height + _STRIP + _GAP])
    sheet = Image.new("RGB", (int(columns * cell[0] + _GAP), int(nrow * cell[1] + _GAP)), _PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=14)
    for i, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        x, y = (int(_GAP + n * c) for n, c in zip((i % columns, i // columns), cell, strict=True))
        sheet.paste(Image.fromarray(picture), (x, y))
        draw.text((x + 2, y + height + 2), caption, _INK, font)
    return sheet


def captioned(
    mjm: mujoco.MjModel, table: LayoutTable, captions: Sequence[str], *, device: str | None = None
) -> Image.Image:
    """Render layouts as one contact sheet, or a single layout as one larger picture."""
    size = SIZE if len(table) > 1 else (2 * SIZE[0], 2 * SIZE[1])
    return contact_sheet(render(mjm, table, size=size, device=device), captions)


def save(image: Image.Image, path: Path) -> None:
    """Write a PNG. An error leaves no partial file."""
    with replacing(path) as temporary:
        image.save(temporary, format="PNG", optimize=True)


def _with_apron(mjm: mujoco.MjModel) -> mujoco.MjModel:
    """Return the model with a larger floor, so that objects at the floor's edge do not seem to float."""
    floor = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_GEOM, FLOOR)
    if floor < 0 or mjm.geom_type[floor] != mujoco.mjtGeom.mjGEOM_PLANE or not mjm.geom_size[floor, 0] > 0:
        return mjm
    wide = copy.copy(mjm)
    wide.geom_size[floor, :2] += _APRON
    return wide


def _seen(mjm: mujoco.MjModel, table: LayoutTable) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Return what a picture shows of all layouts.

    Returns:
        The arrays of MjData that the ray caster reads, by name, shape (nrow, ...), and the corners [m] of the bounding
        boxes of the visible geoms, world frame, shape (n, 3). The corners leave out geoms of absent objects, which are
        parked far away and would make everything else a few pixels wide, and grounds and scenery if there are other
        geoms.
    """
    data, corners = mujoco.MjData(mjm), []
    names = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")
    poses = {name: np.empty((len(table), *getattr(data, name).shape)) for name in names}
    visible = np.isin(mjm.geom_group, VISIBLE_GROUPS)
    solid = visible & framed(mjm)
    geoms = np.flatnonzero(solid if solid.any() else visible)
    for i in range(len(table)):
        table.put(data, i)
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        mujoco.mj_camlight(mjm, data)
        for name in names:
            poses[name][i] = getattr(data, name)
        corners.append(geom_corners(mjm, data, geoms[~is_parked(data.geom_xpos[geoms])]))
    return poses, np.concatenate(corners)
