"""Layouts as MJCF for stock MuJoCo: a model of each row, with only the objects that are present.

The scene is written as MJCF once. For each row, the elements of absent objects are removed from this text, so MuJoCo
does not compile the scene again.
"""

import io
import re
import zipfile
from collections.abc import Collection, Sequence
from xml.etree import ElementTree

import numpy as np

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.adopt import HOME
from sceniris_gym.scene.layout_table import COLUMNS
from sceniris_gym.scene.model_files import MODEL_FOLDERS, zipped
from sceniris_gym.scene.parking import SLAB
from sceniris_gym.sim.rest import close_grippers, controls_at_start, scene_rest
from sceniris_gym.sim.versions import actuator_controls

_TREES = ("default", "asset", "worldbody")
# Kinds of elements, and the attributes and types that name them. A number may follow, as in 'body1'.
_KINDS = {"body": ("body", "xbody", "target", "subtree"), "joint": ("joint", "jointinparent")}
_KINDS |= {"freejoint": _KINDS["joint"], "site": ("site", "refsite", "cranksite", "slidersite", "sidesite")}


def part_bytes(compiled: CompiledScene, rows: np.ndarray) -> bytes:
    """Return the bytes of a zip file with a model of each row, `layout_0.xml` and so on, and the files that they name.

    A variant has the name of its object, and a joint of a variant that is in `parts` the name of the part. The only
    keyframe, `home`, is the layout, with controls that hold it.
    """
    scene, mjm, file, used = compiled.scene, compiled.mjm, io.BytesIO(), set[str]()
    assert scene.spec is not None  # `DatasetWriter` rejects a MjModel
    rest, owners = scene_rest(scene, "cpu"), compiled.config.owners
    close_grippers(rest, compiled, mjm)
    start = rows["start"] if "start" in (rows.dtype.names or ()) else COLUMNS["start"].blanks(len(rows))
    held = controls_at_start(rest, start, rows["present"], rows["qpos"])
    parts = {mjm.joint(i).name: f"{owners[one]}/{local}" for one in owners for local, i in scene.joints(one).items()}
    variant = re.compile(f"({'|'.join(map(re.escape, owners))})(?![^/])")
    bodies = np.repeat(mjm.jnt_bodyid, np.diff([*mjm.jnt_qposadr, mjm.nq]))  # of each number in qpos
    with zipfile.ZipFile(io.BytesIO(zipped(scene.spec))) as whole, zipfile.ZipFile(file, "w") as archive:
        *files, model = whole.namelist()
        text = whole.read(model)
        for i, row in enumerate(rows):
            absent = [name for name, there in zip(compiled.slots, row["present"], strict=True) if not there]
            root, gone = ElementTree.fromstring(text), [body for name in absent for body in scene.subtree(name)]
            acts = _remove(root, absent, {mjm.body(scene.bodies[name]).name for name in absent})
            mocap = ~np.isin(np.flatnonzero(mjm.body_mocapid >= 0), gone)
            state = {"qpos": row["qpos"][~np.isin(bodies, gone)]}
            state |= {"mpos": row["mocap_pos"][mocap], "mquat": row["mocap_quat"][mocap]}
            state["ctrl"] = held[i, : mjm.nu][np.repeat(acts, actuator_controls(mjm)[1])]
            state["act"] = held[i, mjm.nu :][np.repeat(acts, mjm.actuator_actnum)]
            key = {word: " ".join(map(str, values.ravel().tolist())) for word, values in state.items()}
            ElementTree.SubElement(ElementTree.SubElement(root, "keyframe"), "key", key, name=HOME)
            for element in root.iter():
                for word, value in list(element.attrib.items()):
                    if word in (*MODEL_FOLDERS, "nkey"):  # files are next to the model
                        del element.attrib[word]
                    elif word.startswith("file"):
                        used.add(value)
                    elif element.tag == "joint" and word == "name" and element.get("type") != "free":
                        element.set(word, parts.get(value, value))
                    elif (found := variant.match(value)) is not None:
                        element.set(word, owners.get(found[0], found[0]) + value[found.end() :])
            ElementTree.indent(root)
            archive.writestr(zipfile.ZipInfo(f"layout_{i}.xml"), ElementTree.tostring(root))
        for name in (name for name in files if name in used):
            archive.writestr(zipfile.ZipInfo(name), whole.read(name))
    return file.getvalue()


def _remove(root: ElementTree.Element, absent: Sequence[str], bodies: Collection[str]) -> np.ndarray:
    """Remove absent objects, all elements that refer to them, the parking ground and the keyframes.

    Args:
        root: The scene.
        absent: The names of the objects.
        bodies: The names of their bodies.

    Returns:
        For each actuator, whether it stays: bool, shape (n,).
    """
    prefixes, actuators = tuple(f"{name}/" for name in absent), root.findall("actuator/*")
    inside = [e for body in root.iter("body") if body.get("name") in bodies for e in body.iter()]
    gone = {("geom", SLAB), *((kind, e.get("name")) for e in inside for kind in _KINDS.get(e.tag, (e.tag,)))}
    for kind, parent in [(top.tag, e) for top in root for e in (top.iter() if top.tag in _TREES else [top])]:
        for child in list(parent):
            name = child.get("class" if child.tag == "default" else "name", "")
            named: set[tuple[str | None, str | None]] = {(child.tag, name)} if kind in _TREES else set()
            for e in [child] if kind in _TREES else child.iter():
                named |= {(word.rstrip("12"), value) for word, value in e.attrib.items()}
                named |= {(e.get("objtype"), e.get("objname")), (e.get("reftype"), e.get("refname"))}
            if name.startswith(prefixes) or not gone.isdisjoint(named):
                parent.remove(child)
                gone.add((kind, name))
    for keyframe in root.findall("keyframe"):
        root.remove(keyframe)
    left = set(root.findall("actuator/*"))
    return np.array([actuator in left for actuator in actuators], bool)
