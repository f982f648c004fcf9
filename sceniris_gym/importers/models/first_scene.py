"""Writes a first scene file for a model. The file has the model's robot, its free bodies, and a list of supports."""

import json
import os
import re
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR, ROBOT
from sceniris_gym.errors import InfeasibleSceneError, ScenirisError
from sceniris_gym.geometry.pieces import ROUGH, Piece, extract_pieces
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.geometry.supports import COS_MAX_TILT
from sceniris_gym.importers.models.fixtures import joint_draws
from sceniris_gym.importers.models.found import FoundArm, FoundSupport, find_arms, support_beneath, supports_of
from sceniris_gym.reach.arm import carrier_of
from sceniris_gym.scene.adopt import HOME, driven_joints, free_from_slides
from sceniris_gym.scene.assemble import compile_spec
from sceniris_gym.scene.model_files import load_model
from sceniris_gym.scene.support import subtree

# On a support with a longer edge [m], an object stays in a square of this half edge [m] around its start position.
_LARGE, _AROUND = 2.0, 0.3
# A surface more than this far above the lowest surface [m] is not the ground.
_RAISED = 0.05
_WHOLLY, _STABLE = "ratio_on_support", "'orientation: stable'"
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")
# Words that YAML reads as booleans or null, unless they are quoted.
_NOT_STRINGS = frozenset(("true", "false", "null", "yes", "no", "on", "off"))
_WIDTH = 100


@dataclass
class Entry:
    """An entry of the scene file for an object or the robot.

    Attributes:
        name: Name of the object, or 'robot'.
        words: The keys and values below this name in the scene file.
        notes: Comments above the entry.
        why: Why the entry is commented out, or "" if it is active.
    """

    name: str
    words: dict[str, Any]
    notes: tuple[str, ...] = ()
    why: str = ""

    def lines(self, indent: str) -> list[str]:
        """Return the entry as lines of YAML."""
        lines = [f"# {line}" for note in (*self.notes, self.why) for line in _wrapped(note)]
        if self.words:
            lines.append(f"{'# ' if self.why else ''}{self.name}: {flow(self.words)}")
        return [indent + line for line in lines]


@dataclass
class FirstScene:
    """A first scene of a model, before it is written as a scene file.

    Attributes:
        model: File of the model.
        start: A sentence about the start pose, which becomes a comment.
        home: Keyframe of the start pose. None for the default: the keyframe 'home', or `qpos0`.
        robot: Entry of the robot, or None if the model has no arm.
        objects: Entries of the objects. A support comes before the objects on it.
        fixtures: The static bodies with joints that can be drawn. A comment has an entry for each of them.
        supports: Static bodies and geoms with level surfaces, largest first. A comment lists them.
        near: Corners of a region that the arm reaches, for a scene without objects, or None.
    """

    model: Path
    start: str
    home: str | None
    robot: Entry | None
    objects: list[Entry]
    fixtures: list[Entry]
    supports: list[FoundSupport]
    near: list[list[float]] | None = None

    def words(self) -> dict[str, Any]:
        """Return the active entries as a scene for `SceneConfig.load`."""
        found: dict[str, Any] = {"model": str(self.model.resolve())} | ({"home": self.home} if self.home else {})
        if self.robot is not None and not self.robot.why:
            found[ROBOT] = self.robot.words
        return found | {"objects": {e.name: e.words for e in self.objects if not e.why}}

    def comment_out(self, name: str, why: str) -> None:
        """Comment out the entry `name`: the robot, or an object. Objects on this object are commented out too."""
        if name == ROBOT and self.robot is not None:
            self.robot.why = why
        out = {name: why}
        for entry in self.objects:  # supports come before the objects on them
            if (carrier := carrier_name(entry)) in out and not entry.why:
                out[entry.name] = f"It stands on '{carrier}', which is commented out."
            entry.why = out.get(entry.name, entry.why)

    def relax(self, name: str, error: ScenirisError) -> bool:
        """Let an object that falls over lie, or one without a place overhang its support. Return whether it changed."""
        crowded, note = isinstance(error, InfeasibleSceneError) or _WHOLLY in str(error), ""
        for entry in (entry for entry in self.objects if entry.name == name):
            if _STABLE in str(error) and "orientation" not in entry.words:
                entry.words["orientation"] = "stable"
                note = "It falls or rolls over in its pose of `qpos0`, so it is in any of its stable poses."
            elif crowded and entry.words.pop(_WHOLLY, 0):
                note = f"It may overhang its support: `{_WHOLLY}: 1` finds no place."
            entry.notes += (note,) * bool(note)
        return bool(note)

    def text(self, out: Path | None = None) -> str:
        """Return the scene file, with the path of its model relative to the folder of `out`, if `out` is given."""
        model = self.model if out is None else os.path.relpath(self.model.resolve(), out.resolve().parent)
        lines = [
            "# A first scene, generated from the model. Test it with `sceniris-gym check`, then edit it.",
            f"model: {flow(str(model))}",
            *(f"# {line}" for line in _wrapped(self.start)),
            *([f"home: {flow(self.home)}"] if self.home else []),
        ]
        if self.robot is not None:
            lines += ["", *self.robot.lines("")]
        shown = [line for entry in self.objects for line in entry.lines("  ")]
        lines += ["", "objects: {}" if all(entry.why for entry in self.objects) else "objects:", *shown]
        if not self.objects:
            mug = {"asset": "mug", "on": next((s.name for s in self.supports), FLOOR)}
            mug |= {"region": {"box": self.near}, "reachable": "ik"} if self.near else {}
            lines += ["  # The model has no body with a freejoint. Add objects:", f"  # mug: {flow(mug)}"]
        if self.fixtures:
            lines += ["", "  # Joints that layouts can draw, if you remove the # (and the {} of empty `objects`):"]
            lines += [f"  # {entry.name}: {flow(entry.words)}" for entry in self.fixtures]
        lines += ["", "# Supports, as in `on: NAME`, with the size and area of their level surfaces:"]
        lines += [f"#   {_support_line(s)}" for s in self.supports]
        if not self.supports:
            lines += ["#   The model has no static, named support: add `floor: {size: [2, 2]}`, and use `on: floor`."]
        return "\n".join(lines) + "\n"


def first_scene(path: Path) -> FirstScene:
    """Read a model, and propose a scene with its arm, its free bodies and its supports.

    Raises:
        SceneFileError: The file is missing, or MuJoCo cannot read or compile it.
        MeshError: A mesh cannot be used for collision.
    """
    where = str(path)
    spec = load_model(path, where)
    for body in spec.worldbody.bodies:
        free_from_slides(spec, body, where)
    mjm = compile_spec(spec, where)
    data = mujoco.MjData(mjm)
    names = [mjm.key(i).name for i in range(mjm.nkey)]
    attached = [name for name in names if name.rpartition("/")[2] == HOME]  # attached models prefix the name
    home, *others = [HOME] if HOME in names else attached or (names if len(names) == 1 else [None])
    data.qpos[:] = mjm.qpos0 if home is None else mjm.key(home).qpos
    mujoco.mj_kinematics(mjm, data)
    start = f"qpos0, as it has no keyframe '{HOME}'" if home is None else f"its keyframe '{home}'"
    start += f", of {', '.join(map(repr, (home, *others)))}" if others else ""
    pieces = extract_pieces(mjm, "physics", where=dict.fromkeys(range(mjm.nbody), where))
    pieces = [p for p in pieces if mjm.geom_type[p.geom] not in ROUGH]  # which are no supports
    tops = np.flatnonzero(mjm.body_parentid == 0)[1:].tolist()
    joints = {b: mjm.jnt_type[mjm.jnt_bodyid == b].tolist() for b in tops}
    arms = find_arms(mjm, (b for b in tops if mujoco.mjtJoint.mjJNT_FREE not in joints[b]))
    roots = {arm.base for arm in arms}
    tops = np.setdiff1d(tops, [*roots, *mjm.flex_vertbodyid, *mjm.flex_nodebodyid]).tolist()
    free = {name: b for name, b in _names(mjm, tops).items() if joints[b] == [mujoco.mjtJoint.mjJNT_FREE]}
    supports = [s for s in supports_of(mjm, free, roots, pieces) if data.xmat[s.body][8] >= COS_MAX_TILT]
    entries = _Bodies(mjm, data, pieces, free, supports).entries()
    entries += [_not_free(mjm, b) for b in tops if _slides(mjm, b)]
    still = [b for b in tops if mujoco.mjtJoint.mjJNT_FREE not in joints[b] and not _slides(mjm, b)]
    fixtures = [entry for name, b in _names(mjm, still).items() for entry in _drawn(mjm, name, subtree(mjm, b))]
    named, (robot, drive) = None if home == HOME else home, _robot(mjm, data, arms)
    fixtures += drive
    return FirstScene(path, f"The start pose is {start}.", named, robot, entries, fixtures, supports)


@dataclass(frozen=True)
class _Bodies:
    """Makes an entry for each free body of a model. The body goes onto the support below it in the start pose.

    If a scene cannot use this support, the body goes onto the largest surface above the ground.
    """

    mjm: mujoco.MjModel
    data: mujoco.MjData
    pieces: list[Piece]
    free: dict[str, int]
    supports: list[FoundSupport]

    def entries(self) -> list[Entry]:
        """Return an entry for each free body. A body that supports others comes before them."""
        found = {name: self._entry(name, body) for name, body in self.free.items()}
        ordered: dict[str, Entry] = {}
        for name in found:
            chain = [name]
            while (carrier := carrier_name(found[chain[-1]])) in found and carrier not in chain:
                chain.append(carrier)
            ordered |= {link: found[link] for link in reversed(chain) if link not in ordered}
        return list(ordered.values())

    def _entry(self, name: str, body: int) -> Entry:
        own_name = self.mjm.body(body).name
        words: dict[str, Any] = {} if own_name == name else {"body": own_name}
        if np.isin(self.mjm.jnt_bodyid[driven_joints(self.mjm)], subtree(self.mjm, body)).any():
            arm, _ = _robot(self.mjm, self.data, find_arms(self.mjm, [body]))
            use = flow({"in_model": own_name, "tcp": "SITE"} if arm is None else arm.words)
            why = f"'{name}' has actuators: it is a robot with a free base, as in `robot: {use}`."
            return Entry(name, {**words, "on": "SUPPORT"}, why=why)
        support = support_beneath(self.mjm, self.data, body, self.free, self.pieces)
        if support is not None and support.surfaces and self.data.xmat[support.body][8] >= COS_MAX_TILT:
            return Entry(name, {**words, **self._standing(support, body)}, self._tilted(body))
        said = "Beneath it is no static geom or object with a name and a level surface at least 2 cm wide."
        if not self.supports:
            return Entry(name, {**words, "on": "SUPPORT"}, why=f"{said} The model has no other support.")
        heights = [self.data.xpos[s.body][2] + s.surfaces[-1].height for s in self.supports]
        raised = [s for s, height in zip(self.supports, heights, strict=True) if height > min(heights) + _RAISED]
        largest = (raised or self.supports)[0]
        said += f" '{largest.name}' is the largest surface{' above the ground' if raised else ''}."
        return Entry(name, {**words, **self._standing(largest, body)}, (said, *self._tilted(body)))

    def _standing(self, support: FoundSupport, body: int) -> dict[str, Any]:
        """Return the keys that place a body on a support. If the support has edges, the body may not overhang them."""
        words: dict[str, Any] = {"on" if support.open_above else "in": support.name}
        if support.is_endless or max(support.extent) > _LARGE:
            away = self.data.xpos[body] - self.data.xpos[support.body]
            at = away @ self.data.xmat[support.body].reshape(3, 3)[:, :2]
            words["region"] = {"box": [[round(float(v + s), 2) + 0.0 for v in at] for s in (-_AROUND, _AROUND)]}
        return words if support.is_endless else {**words, _WHOLLY: 1}

    def _tilted(self, body: int) -> tuple[str, ...]:
        """Return a note if a body is tilted in the start pose relative to `qpos0`. Layouts ignore this tilt."""
        upright = self.data.xmat[body].reshape(3, 3)[2] @ matrix(self.mjm.body_quat[body])[2]
        note = "The start pose tilts it, but layouts place it upright as in `qpos0`. To change that, see `orientation`."
        return (note,) if upright < np.cos(np.radians(5.0)) else ()


def _robot(mjm: mujoco.MjModel, data: mujoco.MjData, arms: list[FoundArm]) -> tuple[Entry | None, list[Entry]]:
    """Return the robot's entry for the first of `arms`, or None without an arm, and an entry for a base that drives."""
    if not arms:
        return None, []
    arm, *others = arms
    carrier = carrier_of(mjm, arm.hand, arm.base) or arm.base
    below = [b for b in subtree(mjm, arm.base) if b not in subtree(mjm, carrier)]
    arm = replace(arm, joints=tuple(j for j in arm.joints if mjm.jnt_bodyid[j] not in below))
    notes = [f"An arm of {len(arm.joints)} joints, {'with' if arm.fingers else 'without'} fingers."]
    notes.append("To put it on a table, write `robot: {asset: FILE, base: [x, y, z]}`, without `in_model` and `model`.")
    if others:
        notes.append(f"More arms end at {', '.join(repr(mjm.body(other.hand).name) for other in others)}.")
    tcp = arm.tcp(data).model_dump(mode="json", exclude_defaults=True)
    words = {"in_model": mjm.body(carrier).name, "tcp": next(iter(tcp.values())) if len(tcp) == 1 else tcp}
    return Entry(ROBOT, words, tuple(notes)), _drawn(mjm, next(iter(_names(mjm, below))), below) if below else []


def _names(mjm: mujoco.MjModel, bodies: Iterable[int]) -> dict[str, int]:
    """Return a mapping: object name -> body. An object is named after its body, or after the body's id."""
    found: dict[str, int] = {}
    for body in bodies:
        parts = mjm.body(body).name.split("/")
        tail = parts[0] if len(parts) > 1 and parts[-1] in ("main", "root", "object", "base", "body") else parts[-1]
        name = re.sub(r"[^A-Za-z0-9_-]", "_", tail) or f"body_{body}"
        name = name if re.match(r"[A-Za-z_]", name) and name not in (FLOOR, ROBOT, "world") else f"thing_{name}"
        found[name if name not in found else f"{name}_{body}"] = body
    return found


def _slides(mjm: mujoco.MjModel, body: int) -> bool:
    """Return whether a body imitates a freejoint with two or more slide joints that have no actuators."""
    slides = np.flatnonzero((mjm.jnt_bodyid == body) & (mjm.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE))
    return len(slides) >= 2 and not np.isin(driven_joints(mjm), slides).any()


def _not_free(mjm: mujoco.MjModel, body: int) -> Entry:
    moves = f"Body '{mjm.body(body).name}' moves on {mjm.body_jntnum[body]} separate joints."
    return Entry(next(iter(_names(mjm, [body]))), {"on": "SUPPORT"}, why=f"{moves} Write <freejoint/> in their place.")


def _drawn(mjm: mujoco.MjModel, name: str, bodies: list[int]) -> list[Entry]:
    """Return an entry that draws the joints of a static body, or none. The body is the first of `bodies`."""
    own, draws = mjm.body(bodies[0]).name, joint_draws(mjm, bodies)
    words = ({} if own == name else {"body": own}) | {"kind": "static", "joints": draws}
    return [Entry(name, words)] if draws else []


def carrier_name(entry: Entry) -> str:
    """Return the name of the support or object on which an entry stands, without the name of a part."""
    return str(entry.words.get("on", entry.words.get("in", ""))).partition("/")[0]


def _support_line(support: FoundSupport) -> str:
    if support.is_endless:
        return f"{flow(support.name)}: endless; give a region"
    x, y = support.extent
    high = ", ".join(f"{s.height:.3g}" for s in support.surfaces)
    covered = "" if support.open_above else "; covered, so write `in` instead of `on`"
    return f"{flow(support.name)}: {x:.3g} x {y:.3g} m, {support.area:.3g} m2, at z = {high} m of its body{covered}"


def flow(value: Any) -> str:
    """Format a value as YAML on one line."""
    if isinstance(value, Mapping):
        keys = {k: k if _PLAIN.fullmatch(k) else json.dumps(k) for k in value}
        return "{" + ", ".join(f"{keys[k]}: {flow(v)}" for k, v in value.items()) + "}"
    is_plain = isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _NOT_STRINGS
    return value if is_plain else json.dumps(value)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, break_long_words=False, break_on_hyphens=False)
