"""The hash that identifies a scene. It covers the scene file, and all parts of the referenced files that shape layouts.

A model from files is identified by the contents of the files, so its hash is the same for every version of MuJoCo. A
model in memory is identified by its compiled arrays, which differ in their last digits between versions.
"""

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.config.loader import SHIPPED_NAME, shipped
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.reach.map import map_file
from sceniris_gym.scene.model_files import MODEL_FOLDERS, file_of, model_tree

_NO_MATTER = frozenset(
    ("camera", "light", "texture", "material", "visual", "statistic", "size", "sensor", "skin", "custom", "text")
)
"""Elements of MJCF that do not affect layouts."""
_SEEN_IN_URDF = frozenset(("visual", "material"))
"""Elements that are geoms without collisions in a URDF, if the compiler keeps them."""
_OPTIONS = frozenset(("gravity", "o_margin"))
"""Attributes of `option` that affect layouts. The others only affect the simulation. All flags of `option` count."""
_LOOKS = frozenset(("rgb1", "rgb2", "material", "texcoord", "texuniform"))
"""Attributes that only affect appearance. `rgba` also affects layouts: with `geometry: visual`, invisible geoms are no
obstacles."""
_SEEN = frozenset(("camera", "light", "texture", "material"))
"""Elements of MJCF that affect pictures. They count in scenes whose appearance or physics is drawn."""

_ARRAYS = (
    *("body_parentid", "body_pos", "body_quat", "body_ipos", "body_mass", "body_mocapid", "body_gravcomp"),
    *("jnt_type", "jnt_bodyid", "jnt_qposadr", "jnt_pos", "jnt_axis", "jnt_limited", "jnt_range", "qpos0"),
    *("geom_type", "geom_bodyid", "geom_size", "geom_pos", "geom_quat", "geom_dataid", "geom_group", "geom_rgba"),
    *("geom_contype", "geom_conaffinity", "geom_margin", "geom_gap", "pair_geom1", "pair_geom2", "pair_margin"),
    *("pair_gap", "exclude_signature", "mesh_vert", "mesh_face", "mesh_vertadr", "mesh_faceadr", "site_bodyid"),
    *("site_pos", "site_quat", "site_size", "eq_type", "eq_obj1id", "eq_obj2id", "eq_active0", "eq_data"),
    *("tendon_adr", "tendon_num", "tendon_limited", "tendon_range", "tendon_stiffness", "tendon_lengthspring"),
    *("wrap_type", "wrap_objid", "wrap_prm"),
)
"""Arrays of a MjModel that affect layouts."""
_LAW = "standing 1"
"""Version of the rules for standing free objects. Raise it when a change gives other layouts for the same words."""
_LAW_ARRAYS = (
    *("geom_solref", "geom_solimp", "geom_solmix", "geom_priority", "pair_solref", "pair_solimp", "body_inertia"),
    *("jnt_stiffness", "qpos_spring", "dof_frictionloss", "dof_armature", "actuator_gainprm", "actuator_biasprm"),
)
"""Additional arrays of a MjModel that these rules read."""
_CLEAR_LAW = "free grasps 1"
"""Version of the rules of `reachable: clear`. Raise it when a change gives other layouts for the same words."""
_ROOT_LAW = "furniture by roots 1"
"""Version of the rules of `beside` for open furniture. Raise it when other layouts follow from the same words."""
_NAMED = (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_JOINT, mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtObj.mjOBJ_SITE)


def scene_hash(config: SceneConfig, mjm: mujoco.MjModel, home_qpos: np.ndarray) -> str:
    """Return the hash of a scene: 16 hexadecimal digits. Equal scenes have equal hashes in every process and folder.

    The hash covers all values in the scene that differ from their defaults, the files of its model and its assets, the
    rows of heaps, and the arm's reachability map if objects are `reachable`. It leaves out file names and the scene's
    `cameras`. If `randomize` draws nothing, it also leaves out cameras, lights and appearance in the files. It leaves
    out solver options. But in scenes where an object could fall, it covers the options that affect standing objects.

    Args:
        config: The scene as written.
        mjm: The compiled model. Its arrays are hashed if the scene's `model` is in memory.
        home_qpos: The start pose, shape (nq,).
    """
    digest = hashlib.sha256(config.canonical().encode())
    drawn = config.is_randomized
    if config.has_model_in_memory:
        every = [name for name in dir(mjm) if isinstance(getattr(mjm, name), np.ndarray)]
        counts = (mjm.nbody, mjm.njnt, mjm.ngeom, mjm.nsite)
        names = [mujoco.mj_id2name(mjm, kind, i) for kind, n in zip(_NAMED, counts, strict=True) for i in range(n)]
        digest.update(repr(names).encode())
        option = np.hstack([mjm.opt.gravity, mjm.opt.disableflags, mjm.opt.enableflags, mjm.opt.o_margin])
        for array in (home_qpos, option, *(getattr(mjm, name) for name in (every if drawn else _ARRAYS))):
            digest.update(repr(array.shape).encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    elif config.model is not None:
        _update_from_file(digest.update, config.model, drawn)
    contents: dict[str, list[bytes]] = {}
    for name, part in {**config.all_robots, **config.objects}.items():
        if part.asset is not None:
            if part.asset not in contents:
                is_shipped = SHIPPED_NAME.fullmatch(part.asset)
                file = shipped("assets", ".xml")[part.asset] if is_shipped else Path(part.asset)
                _update_from_file(contents.setdefault(part.asset, []).append, file, drawn)
            digest.update(b"".join([f"{name}:".encode(), *contents[part.asset]]))
    for heap in config.heaps.values():
        rows = Path(heap.rows) if heap.rows is not None else None
        digest.update(rows.read_bytes() if rows is not None and rows.is_file() else b"")
    if any(part.reachable for part in config.objects.values()):
        for robot in config.all_robots.values():
            path = map_of(robot)  # the arm's reach affects the layouts
            digest.update(path.read_bytes() if path is not None and path.is_file() else b"")
    if any(part.reachable in ("clear", "path") for part in config.objects.values()):
        digest.update(_CLEAR_LAW.encode())
    if any(config.joined_by_root(name, r) for name, part in config.objects.items() for r in part.relations):
        digest.update(_ROOT_LAW.encode())
    if _could_fall(config):
        digest.update(_LAW.encode())
        # MuJoCo raises the time constants of contacts to at least two time steps.
        least, time = 2.0 * mjm.opt.timestep, mjm.geom_solref[:, 0]
        raised = least if ((time > 0.0) & (time < least)).any() else 0.0
        option = np.hstack([raised, mjm.opt.o_solref, mjm.opt.o_solimp])
        for array in (option, *(getattr(mjm, name) for name in _LAW_ARRAYS if config.has_model_in_memory)):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _could_fall(config: SceneConfig) -> bool:
    """Return whether the scene has an object that has to stand, but could fall.

    This is true if such an object is on a free object, has drawn joints, or may overhang an edge.
    """
    filling = {name for heap in config.heaps.values() for name in heap.of}
    for name, part in config.objects.items():
        if part.support is None or not part.has_to_stand or name in filling:
            continue
        owner = config.objects.get(config.presence.carrier(name))
        is_floor = part.support.parent == FLOOR and config.floor is not None
        is_carried = owner is not None and owner.kind == "free"
        if is_carried or part.joints or (part.ratio_on_support < 1.0 and not is_floor):
            return True
    return False


def map_of(robot: RobotConfig) -> Path | None:
    """Return a robot's reachability map: the file named in the scene, or the map of a shipped asset."""
    if robot.map is not None:
        return Path(robot.map)
    return map_file(robot.asset) if robot.asset is not None and SHIPPED_NAME.fullmatch(robot.asset) else None


def _update_from_file(update: Callable[[bytes], None], path: Path, drawn: bool) -> None:
    """Pass the contents of a model file and of its referenced files to `update`, without appearance unless `drawn`."""
    root = model_tree(path, path.parent, set())
    keeps_visuals = root.tag == "robot" and any(c.get("discardvisual") == "false" for c in root.iter("compiler"))
    no_matter = _NO_MATTER - _SEEN if drawn else _NO_MATTER
    for token in _tokens(root, no_matter - _SEEN_IN_URDF if keeps_visuals else no_matter, drawn):
        update(token.encode() + b"\0")
    for part in ("collision", "visual") if keeps_visuals else ("collision",):
        for mesh in root.iterfind(f".//{part}//mesh[@filename]"):  # of a URDF
            source = file_of(mesh.attrib["filename"], path.parent)
            update(source.read_bytes() if source is not None else b"")
    folders = [path.parent / c.attrib[f] for c in root.iter("compiler") for f in MODEL_FOLDERS if f in c.attrib]
    for element in root.iter():
        if element.tag in no_matter or "file" not in element.attrib:
            continue
        name = element.attrib["file"]
        places = (folder / n for folder in (*folders, path.parent) for n in (name, Path(name).name))
        found = next((place for place in places if place.is_file()), None)
        if found is not None and element.tag == "model":
            _update_from_file(update, found, drawn)
        elif found is not None:
            update(found.read_bytes())


def _tokens(element: ElementTree.Element, no_matter: frozenset[str], drawn: bool) -> Iterator[str]:
    """Yield the names and attributes of an XML element and its children, except parts that do not affect layouts.

    Attributes are in alphabetical order. Children with a tag in `no_matter` are left out.
    """
    if element.tag in no_matter:
        return
    yield element.tag
    left_out = MODEL_FOLDERS if drawn else (*MODEL_FOLDERS, *_LOOKS)
    for name, value in sorted(element.attrib.items()):
        if name not in left_out and (element.tag != "option" or name in _OPTIONS):
            yield f"{name}={' '.join(value.split())}"
    for child in element:
        yield from _tokens(child, no_matter, drawn)
    yield "end"
