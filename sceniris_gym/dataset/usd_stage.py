"""Layouts as USD: a stage with the scene's geometry, and for each part a stage that refers to the first stage.

In the stage of a part, time i is row i. Stages are z up, in metres. Every body is an Xform below its parent's Xform,
and an object of the scene is `/World/<name>`. The stages are for viewing and have no physics. `scene.zip` holds the
physics. Importing this module needs usd-core, which `formats.check_formats` checks for.
"""

import tempfile
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

from sceniris_gym.dataset.manifest import SCENE_USD
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.draws import mean_colours
from sceniris_gym.scene.parking import SLAB
from sceniris_gym.scene.poses import body_poses, product, rotated

WORLD = "/World"
_SEEN_GROUPS = 3  # MuJoCo shows lower groups. This and higher groups are colliders, which USD calls guides
_ENDLESS = 10.0  # m, half the edge of a plane without end
_SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_PRIMITIVES = {mujoco.mjtGeom.mjGEOM_SPHERE: "Sphere", mujoco.mjtGeom.mjGEOM_ELLIPSOID: "Sphere"}
_PRIMITIVES |= {mujoco.mjtGeom.mjGEOM_CAPSULE: "Capsule", mujoco.mjtGeom.mjGEOM_CYLINDER: "Cylinder"}
_PRIMITIVES |= {mujoco.mjtGeom.mjGEOM_BOX: "Cube"}


def scene_bytes(compiled: CompiledScene) -> bytes:
    """Return the stage of the scene as the bytes of a .usdc file: all bodies with geometry, at the start pose."""
    mjm, paths = compiled.mjm, body_paths(compiled)
    layer = _new_layer()
    stage = Usd.Stage.Open(layer)
    UsdGeom.Xform.Define(stage, WORLD)
    pos, quat = compiled.home_xpos.astype(float), compiled.home_xquat.astype(float)
    pos, quat = _seen_from(pos[mjm.body_parentid], quat[mjm.body_parentid], pos, quat)
    for body in range(1, mjm.nbody):
        xform = UsdGeom.Xform.Define(stage, paths[body])
        _place(xform, pos[body], quat[body])
        xform.GetPrim().SetCustomDataByKey("mujoco:body", mjm.body(body).name)
    taken, colours = set(paths), mean_colours(mjm)
    for geom in (geom for geom in range(mjm.ngeom) if mjm.geom(geom).name != SLAB):
        kind = mujoco.mjtGeom(int(mjm.geom_type[geom])).name.removeprefix("mjGEOM_").lower()
        body = int(mjm.geom_bodyid[geom])
        name = _local(mjm, body, mjm.geom(geom).name) or f"{kind}_{geom}"
        _define_geom(stage, mjm, geom, _free_path(f"{paths[body]}/", name, taken), colours[geom])
    return _exported(layer)


def part_bytes(compiled: CompiledScene, rows: np.ndarray) -> bytes:
    """Return the stage of a part as the bytes of a .usdc file. It refers to `scene.usdc` in the same folder.

    Time i is row i. The stage sets the poses of bodies and makes absent objects invisible. `/World` gets the attributes
    `layout:seed`, `layout:episode` and `layout:valid`. Bodies get the attributes `joint:NAME` [rad or m].
    """
    mjm, paths = compiled.mjm, body_paths(compiled)
    layer = _new_layer()
    layer.subLayerPaths.append(f"./{SCENE_USD}")
    layer.startTimeCode, layer.endTimeCode = 0.0, float(len(rows) - 1)
    types = Sdf.ValueTypeNames
    for name, kind in (("seed", types.UInt64), ("episode", types.Int), ("valid", types.Bool)):
        _write(layer, WORLD, f"layout:{name}", kind, rows[name].tolist(), custom=True)
    states = (rows["qpos"], rows["mocap_pos"], rows["mocap_quat"])
    for body in np.flatnonzero((mjm.body_jntnum > 0) | (mjm.body_mocapid >= 0)).tolist():
        pos, quat = _seen_from(*body_poses(mjm, int(mjm.body_parentid[body]), *states), *body_poses(mjm, body, *states))
        _write(layer, paths[body], "xformOp:translate", types.Double3, [Gf.Vec3d(*v) for v in pos.tolist()])
        _write(layer, paths[body], "xformOp:orient", types.Quatd, [Gf.Quatd(*v) for v in quat.tolist()])
        for joint in range(mjm.body_jntadr[body], mjm.body_jntadr[body] + mjm.body_jntnum[body]):
            if mujoco.mjtJoint(int(mjm.jnt_type[joint])) in _SCALAR:
                name, values = _local(mjm, body, mjm.joint(joint).name), rows["qpos"][:, mjm.jnt_qposadr[joint]]
                _write(layer, paths[body], f"joint:{name}", types.Float, values.tolist(), custom=True)
    for slot, name in enumerate(compiled.slots):
        if not rows["present"][:, slot].all():
            seen = ["inherited" if present else "invisible" for present in rows["present"][:, slot]]
            _write(layer, paths[compiled.scene.bodies[name]], "visibility", types.Token, seen)
    return _exported(layer)


def body_paths(compiled: CompiledScene) -> list[str]:
    """Return the USD path of each body, by body id.

    An object or a robot has its name in the path. Bodies below have their names without the prefix of the object.
    """
    mjm = compiled.mjm
    names = {body: name for name, body in compiled.scene.bodies.items()}
    paths, taken = [WORLD], {WORLD}
    for body in range(1, mjm.nbody):
        parent = int(mjm.body_parentid[body])
        name = names.get(body) or _local(mjm, parent, mjm.body(body).name) or f"body_{body}"
        paths.append(_free_path(f"{paths[parent]}/", name, taken))
    return paths


def _local(mjm: mujoco.MjModel, body: int, name: str) -> str:
    """Return the name of a body as a USD identifier, without the prefix of the object that the body belongs to."""
    prefix = mjm.body(body).name.partition("/")[0] + "/"
    return Tf.MakeValidIdentifier(name.removeprefix(prefix)) if name else ""


def _free_path(folder: str, name: str, taken: set[str]) -> str:
    """Return the path of `name` in `folder`, with a number if the path is taken. Add the path to `taken`."""
    path = first = folder + Tf.MakeValidIdentifier(name)
    number = 1
    while path in taken:
        path, number = f"{first}_{number}", number + 1
    taken.add(path)
    return path


def _new_layer() -> Any:
    """Return an empty layer with the default prim, the unit of length and the up axis."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.defaultPrim = WORLD[1:]
    layer.pseudoRoot.SetInfo("metersPerUnit", 1.0)
    layer.pseudoRoot.SetInfo("upAxis", "Z")
    return layer


def _seen_from(
    parent_pos: np.ndarray, parent_quat: np.ndarray, pos: np.ndarray, quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return poses in the frame of the parent, shapes (n, 3) and (n, 4) wxyz."""
    back = parent_quat * [1.0, -1.0, -1.0, -1.0]
    return rotated(pos - parent_pos, back), product(back, quat)


def _write(layer: Any, prim: str, name: str, kind: Any, values: list, *, custom: bool = False) -> None:
    """Write an attribute: one sample per row, or only a default value if all samples are equal."""
    spec = Sdf.CreatePrimInLayer(layer, prim)
    attribute = Sdf.AttributeSpec(spec, name, kind, Sdf.VariabilityVarying, custom)
    if all(value == values[0] for value in values):
        attribute.default = values[0]
        return
    for i, value in enumerate(values):
        layer.SetTimeSample(attribute.path, float(i), value)


def _place(xform: Any, pos: np.ndarray, quat: np.ndarray, scale: np.ndarray | None = None) -> None:
    xform.AddTranslateOp().Set(Gf.Vec3d(*pos.tolist()))
    # USD converts quaternions to angles by the arc cosine, which loses angles below 0.02 degrees in single precision.
    xform.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(*quat.tolist()))
    if scale is not None:
        xform.AddScaleOp().Set(Gf.Vec3f(*scale.tolist()))


def _define_geom(stage: Any, mjm: mujoco.MjModel, geom: int, path: str, rgba: np.ndarray) -> None:
    """Add a geom of the model to the stage, at the USD path `path` and with the colour `rgba`, shape (4,)."""
    kind, size = mujoco.mjtGeom(int(mjm.geom_type[geom])), mjm.geom_size[geom]
    scale = size if kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID) else None
    if kind in _PRIMITIVES:  # by default, a cube has edges of 2, a sphere a radius of 1, and others the axis Z
        shape = getattr(UsdGeom, _PRIMITIVES[kind]).Define(stage, path)
        if scale is None:
            shape.CreateRadiusAttr(float(size[0]))
        if kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
            shape.CreateHeightAttr(2.0 * float(size[1]))
    else:
        shape = UsdGeom.Mesh.Define(stage, path)
        vertices, faces = _triangles(mjm, geom, kind)
        shape.CreatePointsAttr(vertices.astype(np.float32))
        shape.CreateFaceVertexCountsAttr([3] * len(faces))
        shape.CreateFaceVertexIndicesAttr(faces.ravel().astype(np.int32))
        shape.CreateSubdivisionSchemeAttr("none")
        shape.CreateDoubleSidedAttr(True)
    shape.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(shape, 0.0))
    _place(shape, mjm.geom_pos[geom], mjm.geom_quat[geom], scale)
    shape.CreateDisplayColorAttr([tuple(rgba[:3].tolist())])
    shape.CreateDisplayOpacityAttr([float(rgba[3])])
    if mjm.geom_group[geom] >= _SEEN_GROUPS:
        shape.CreatePurposeAttr("guide")


def _triangles(mjm: mujoco.MjModel, geom: int, kind: mujoco.mjtGeom) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices [m] and the faces of a mesh, a plane or a height field, in the frame of the geom."""
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        x, y = np.where(mjm.geom_size[geom, :2] > 0.0, mjm.geom_size[geom, :2], _ENDLESS)
        return np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    data = int(mjm.geom_dataid[geom])
    if kind != mujoco.mjtGeom.mjGEOM_HFIELD:
        vert, face = mjm.mesh_vertadr[data], mjm.mesh_faceadr[data]
        return mjm.mesh_vert[vert : vert + mjm.mesh_vertnum[data]], mjm.mesh_face[face : face + mjm.mesh_facenum[data]]
    nrow, ncol, adr = int(mjm.hfield_nrow[data]), int(mjm.hfield_ncol[data]), int(mjm.hfield_adr[data])
    sx, sy, height, _ = mjm.hfield_size[data]
    x, y = np.meshgrid(np.linspace(-sx, sx, ncol), np.linspace(-sy, sy, nrow))
    z = height * mjm.hfield_data[adr : adr + nrow * ncol]
    corner = (np.arange(nrow - 1)[:, None] * ncol + np.arange(ncol - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + ncol + 1])
    upper = np.column_stack([corner, corner + ncol + 1, corner + ncol])
    return np.column_stack([x.ravel(), y.ravel(), z]), np.concatenate([lower, upper])


def _exported(layer: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layer.usdc"
        layer.Export(str(path))
        return path.read_bytes()
