"""Draws the worlds of the viewer side by side on a grid, with mjviser. Also the window of an environment."""

from __future__ import annotations

import copy
import math
import sys
import time
from collections.abc import Collection, Mapping
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.plan import slot_names
from sceniris_gym.scene.assemble import MARK_GROUP
from sceniris_gym.scene.backdrop import OVERVIEW
from sceniris_gym.scene.draws import COLOUR_ROLES, mean_colours, nominal_values
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.overview import FOVY, VISIBLE_GROUPS, Overview, camera_axes, frame, framed
from sceniris_gym.viewer.server import MOST_SHOWN, address, close_server, light, open_server

if TYPE_CHECKING:
    import viser

    from sceniris_gym.layout.layouts import Layouts
    from sceniris_gym.program.compiled import CompiledScene
    from sceniris_gym.scene.layout_table import LayoutTable
    from sceniris_gym.sim.batch import Batch

_GAP = 0.12  # between worlds, as a fraction of their size
_FLOOR = (0.80, 0.83, 0.86, 1.0)
_ENDLESS = 4.0  # m, width of a drawn plane without sizes
_ASPECT = 1.2
_ALIKE = 0.25  # users' cameras stay if the scene's bounds move by less than this fraction of its size
_FEW = 8
"""If there are at most so many worlds, all are drawn with all triangles, and with drawn textures."""
_FAR, _COARSE = 2.0, 0.2
"""Worlds that are more than `_FAR` scene sizes away are drawn with the fraction `_COARSE` of their triangles."""
_MANY = 1000
"""A body with fewer triangles, such as a board or a box, is always drawn with all of them."""
# The place of hidden bodies [m], out of view of all cameras.
_AWAY = np.array([0.0, 0.0, -1.0e5])
_GAMMA = 2.2  # mjviser takes linear colours only for meshes with textures
# Geoms whose textures mjviser draws. An enum is not equal to a number of NumPy.
_TEXTURED = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD))


class Worlds:
    """Draws worlds of one model side by side.

    Args:
        server: The viser server of the page.
        scene: The scene. A modified copy of its model is drawn, see `drawn_model`.
        num: Number of worlds.
    """

    def __init__(self, server: viser.ViserServer, scene: SceneModel, num: int) -> None:
        from mjviser import ViserMujocoScene

        self.mjm, self.num, self._server = scene.mjm, num, server
        mjm = scene.mjm
        overview = Overview(scene.config, mjm, scene.home_qpos)
        self._seen = overview.seen(framed(mjm))
        self.low, self.high = self._seen.min(axis=0), self._seen.max(axis=0)
        self.size = float((self.high - self.low).max())
        size = np.ptp(overview.seen(), axis=0)[:2]
        if scene.config.floor is not None:
            size = np.maximum(size, scene.config.floor.size)
        self.origins = grid_origins(num, (1.0 + _GAP) * size)
        drawn = drawn_model(mjm)
        painted = painted_geoms(scene, drawn)
        drawn.geom_rgba[painted, 3] = 0.0  # mjviser leaves them out, because its meshes have one colour in all worlds
        self._painted: dict[int, Any] = {}  # of each geom, the handle of the meshes of all worlds
        self._textured: dict[tuple[int, int], Any] = {}  # of each geom and world, a handle
        with server.atomic():
            self._scene = ViserMujocoScene(server, drawn, num_envs=num)
            for geom in painted:
                if num <= _FEW and drawn.geom_matid[geom] >= 0:
                    self._textured |= {(geom, i): self._add(geom, only) for i, only in enumerate(np.eye(num))}
                else:
                    self._painted[geom] = self._add(geom)
            if num > _FEW:
                for group in self._scene._mesh_groups:
                    many = _triangles(mjm, int(group.body_ids[0])) >= _MANY
                    group.handle.lod = ((_FAR * self.size, _COARSE),) if many else "off"
            light(server)  # replaces the lights of mjviser before the page draws with them
        self._scene.camera_tracking_enabled = False
        self._xpos, self._xmat = np.zeros((num, mjm.nbody, 3)), np.zeros((num, mjm.nbody, 3, 3))

    def put(
        self, i: int, data: Any, hidden: Collection[int] = (), moved: Mapping[int, np.ndarray] | None = None
    ) -> None:
        """Set the state of world `i`, without sending it to the page.

        Args:
            i: The world.
            data: An MjData with current kinematics, or any object with xpos and xmat.
            hidden: Bodies that are not drawn.
            moved: Body -> offset [m] from the body's position to its drawing, shape (3,).
        """
        self._xpos[i] = data.xpos + self.origins[i]
        self._xmat[i] = np.reshape(data.xmat, (-1, 3, 3))
        for body in hidden:
            self._xpos[i, body] = _AWAY
        for body, offset in (moved or {}).items():
            self._xpos[i, body] += offset

    def _add(self, geom: int, scales: np.ndarray | None = None) -> Any:
        """Add a geom whose colour differs between worlds, and return its handle. mjviser moves and hides it.

        `scales` are the scales of the geom in all worlds, for a mesh with a texture. A geom with scale 0 is invisible.
        """
        from mjviser.conversions import merge_geoms
        from mjviser.scene import _MeshGroup

        scene, groups, mesh = self._server.scene, self._scene._mesh_groups, merge_geoms(self.mjm, [geom])
        body, group, name = self.mjm.geom_bodyid[geom], int(self.mjm.geom_group[geom]), f"/bodies/painted{len(groups)}"
        poses = np.tile([1.0, 0.0, 0.0, 0.0], (self.num, 1)), np.zeros((self.num, 3))
        if scales is None:
            handle: Any = scene.add_batched_meshes_simple(name, mesh.vertices, mesh.faces, *poses)
        else:
            handle = scene.add_batched_meshes_trimesh(name, mesh, *poses, batched_scales=scales)
        handle.visible = group in VISIBLE_GROUPS
        groups.append(_MeshGroup(handle, np.array([body]), group, None))
        return handle

    def paint(self, compiled: CompiledScene, table: LayoutTable) -> None:
        """Give geoms the colours and textures that the layouts of all worlds draw. `table` has a row for each world."""
        if not self._painted and not self._textured:
            return
        from mjviser.conversions import merge_geoms

        from sceniris_gym.commands.replay import drawn  # only some scenes need mujoco_warp here

        rows = [table[i : i + 1] for i in range(self.num)]
        models = [drawn_model(drawn(compiled, row)[0], textures=bool(self._textured)) for row in rows]
        colours = np.stack([mjm.geom_rgba for mjm in models])
        for geom, handle in self._painted.items():
            handle.batched_colors = (255.0 * colours[:, geom, :3]).round().astype(np.uint8)
            handle.batched_opacities = colours[:, geom, 3].astype(np.float32)
        for (geom, i), handle in self._textured.items():
            handle.glb_data = merge_geoms(models[i], [geom]).export(file_type="glb")

    def is_like(self, other: Worlds) -> bool:
        """Return True if `other` has the same number of worlds, and a scene with nearly the same bounds."""
        most = _ALIKE * (other.high - other.low).max()
        ends = np.abs(np.stack([self.low - other.low, self.high - other.high]))
        return self.num == other.num and bool(ends.max() <= most)

    def send(self) -> None:
        """Send the states of all worlds to the page."""
        self._scene.update_from_arrays(self._xpos, self._xmat)

    def show_visuals(self, visible: bool) -> None:
        """Show or hide the visual geometry of all worlds. The viewer hides it to show only the collision geometry."""
        for group in VISIBLE_GROUPS:
            self._scene.geom_groups_visible[group if group < 3 else 2] = visible
        self._scene._sync_visibilities()

    def aim(self, open_pages: bool = True) -> None:
        """Set the view of the page so that all worlds are visible, except scenery, as from the camera 'overview'.

        Browser windows that are opened later start with this view. With `open_pages`, windows that are open now also
        change to this view.
        """
        points = (self._seen[None] + self.origins[:, None]).reshape(-1, 3)
        eye, axes = frame(points, view_direction(self.mjm), FOVY, _ASPECT)
        middle = points.mean(axis=0)
        look_at = eye - axes[:, 2] * float((eye - middle) @ axes[:, 2])
        clients = self._server.get_clients().values() if open_pages else ()
        for camera in (self._server.initial_camera, *(client.camera for client in clients)):
            camera.fov, camera.position, camera.look_at = math.radians(FOVY), eye, look_at


class Window:
    """Shows the worlds of an environment on a page in real time, at most the first 64.

    Args:
        scene: The scene, with all variants. Absent variants are hidden.
        num: Number of worlds in the environment's batch.
        server: The viser server of the page. If None, a page is opened, and its address is printed to stderr.

    Attributes:
        worlds: The worlds on the page.

    Raises:
        MissingExtraError: viser or mjviser is not installed.
    """

    def __init__(self, scene: SceneModel, num: int, server: viser.ViserServer | None = None) -> None:
        self.num = min(num, MOST_SHOWN)
        self.server = open_server() if server is None else server
        if server is None:
            print(f"sceniris_gym: the environment is shown at {address(self.server)}", file=sys.stderr, flush=True)
        self.worlds = Worlds(self.server, scene, self.num)
        self.worlds.aim()
        self._simulated = scene.sim_bodies
        self._bodies = [scene.subtree(name) for name in slot_names(scene.config)]
        self._due = time.monotonic()

    def show(self, batch: Batch, layouts: Layouts, seconds: float) -> None:
        """Show the current state of the worlds, and wait until `seconds` have passed since the last call.

        Args:
            batch: The worlds. The call waits until their device has finished its work.
            layouts: The layouts of the worlds. Objects that are absent in them are hidden.
            seconds: Time that was simulated since the last call [s].
        """
        data = batch.data
        xpos, xmat = (array.numpy()[:, self._simulated] for array in (data.xpos, data.xmat))
        present = layouts.view.present.numpy()
        for i in range(self.num):
            absent = [body for slot in np.flatnonzero(present[i] == 0) for body in self._bodies[slot]]
            self.worlds.put(i, SimpleNamespace(xpos=xpos[i], xmat=xmat[i]), absent)
        self.worlds.send()
        now = time.monotonic()
        self._due = max(self._due + seconds, now - seconds)  # a slow machine does not hurry to catch up
        time.sleep(max(self._due - now, 0.0))

    def close(self) -> None:
        """Stop the server of the page."""
        close_server(self.server)


def view_direction(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the unit vector from a scene to its camera 'overview', shape (3,). Without this camera, use a default."""
    camera = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_CAMERA, OVERVIEW)
    return camera_axes(np.array([0.5, -1.0, 1.0]))[:, 2] if camera < 0 else matrix(mjm.cam_quat[camera])[:, 2]


def grid_origins(num: int, size: np.ndarray) -> np.ndarray:
    """Return the origins [m] of worlds on a grid around 0, row by row from the back left, shape (num, 3).

    `size` are the distances [m] of neighbours in x and y, shape (2,).
    """
    columns = math.ceil(math.sqrt(num))
    rows = math.ceil(num / columns)
    i, j = np.divmod(np.arange(num), columns)
    return np.stack([(j - 0.5 * (columns - 1)) * size[0], (0.5 * (rows - 1) - i) * size[1], np.zeros(num)], axis=1)


def drawn_model(mjm: mujoco.MjModel, textures: bool = True) -> mujoco.MjModel:
    """Return a copy of a model that mjviser draws completely for every world.

    From the model itself, mjviser would draw static bodies in one world only, planes as one endless grid, and geoms in
    the colour of their material, even if a geom has a separate colour. mjviser would also leave out the textures of
    primitives: in the copy, these primitives have the mean colour of their texture, and without `textures` meshes, too.
    mjviser would also ask for the poses of mocap bodies separately. Another reason for the copy is that mjviser changes
    the model's `vis`.
    """
    drawn = copy.copy(mjm)
    drawn.geom_rgba[:], means = nominal_values(mjm, "geom_rgba"), mean_colours(mjm)
    for geom in np.flatnonzero(mjm.geom_matid >= 0):
        material = mjm.geom_matid[geom]
        drawn.mat_rgba[material, :3] = drawn.geom_rgba[geom, :3] ** _GAMMA
        plain = not textures or (mjm.mat_texid[material, COLOUR_ROLES] < 0).all()
        if plain or mjm.geom_type[geom] not in _TEXTURED:
            drawn.geom_matid[geom], drawn.geom_rgba[geom] = -1, means[geom]
    drawn.body_weldid[drawn.body_weldid == 0] = drawn.body_mocapid[:] = -1
    drawn.geom_group[drawn.geom_group == MARK_GROUP] = 2
    planes = drawn.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    drawn.geom_rgba[planes] = _FLOOR
    drawn.geom_size[planes & (drawn.geom_size[:, 0] <= 0.0), :2] = _ENDLESS / 2.0
    return drawn


def painted_geoms(scene: SceneModel, drawn: mujoco.MjModel) -> list[int]:
    """Return the visible geoms of a `drawn_model`, except planes, whose colours differ between layouts of the scene."""
    changed = np.zeros(drawn.ngeom, bool)
    for draw in scene.draws:
        if draw.word.field == "geom_rgba":
            changed[draw.rows] = True
        elif draw.word.field in ("mat_rgba", "mat_texid"):
            changed |= np.isin(scene.mjm.geom_matid, draw.rows)
    changed &= (drawn.geom_rgba[:, 3] > 0.0) & (drawn.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    return np.flatnonzero(changed).tolist()


def _triangles(mjm: mujoco.MjModel, body: int) -> int:
    """Return the number of triangles of a body's visible meshes."""
    seen = (mjm.geom_bodyid == body) & np.isin(mjm.geom_group, VISIBLE_GROUPS)
    return int(mjm.mesh_facenum[mjm.geom_dataid[seen & (mjm.geom_type == mujoco.mjtGeom.mjGEOM_MESH)]].sum())


def body_mesh(mjm: mujoco.MjModel, geoms: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return one mesh of the visible geoms among `geoms`, which belong to one body. None if no geom is visible.

    Planes are left out. The mesh has vertices in the body's frame [m], shape (n, 3), and faces, shape (m, 3).
    """
    from mjviser.conversions import merge_geoms

    seen = [int(g) for g in geoms if mjm.geom_group[g] in VISIBLE_GROUPS and mjm.geom_rgba[g, 3] > 0.0]
    seen = [g for g in seen if mjm.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE]
    if not seen:
        return None
    mesh = merge_geoms(mjm, seen)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)
