"""A first scene file for a model: its free bodies on what they stand on, its robot, and what else carries things."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR, ROBOT
from sceniris_gym.errors import ArmError, NotSupportedError
from sceniris_gym.geometry.pieces import Piece, extract_pieces
from sceniris_gym.importers.models.arms import FoundArm, find_arms
from sceniris_gym.importers.models.standing import (
    FoundSupport,
    geom_beneath,
    named_support,
    support_of,
    supports_of,
)
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.scene.adopt import HOME
from sceniris_gym.scene.assemble import compile_spec
from sceniris_gym.scene.model_files import load_model
from sceniris_gym.scene.support import subtree

# On a larger support things stay within this half edge [m] of where they stand at the start.
_LARGE, _AROUND = 2.0, 0.3
# What is as much higher than the lowest surface [m] is not the ground.
_RAISED = 0.05
_PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_./-]*")
# Words of YAML that are no strings.
_NOT_STRINGS = frozenset(("true", "false", "null", "yes", "no", "on", "off"))
_WIDTH = 100


@dataclass(frozen=True)
class Entry:
    """An object or the robot of the scene.

    Attributes:
        name: Its name; 'robot' for the robot.
        words: What the scene says of it; empty for a body that cannot be named at all.
        notes: What is said about it in comments above.
        why: Why it is commented out; "" if it is not.
    """

    name: str
    words: Mapping[str, Any]
    notes: tuple[str, ...] = ()
    why: str = ""

    def lines(self, indent: str) -> list[str]:
        """Return its lines of YAML."""
        text = f"{self.name}: {_flow(self.words)}" if self.words else ""
        said = [*self.notes, *([self.why] if self.why else [])]
        commented = [f"{indent}# {line}" for note in said for line in _wrapped(note)]
        return commented + ([f"{indent}{'# ' if self.why else ''}{text}"] if text else [])


@dataclass(frozen=True)
class FirstScene:
    """A first scene of a model.

    Attributes:
        model: The model's file.
        start: What is said of the start pose.
        robot: The robot, if there is one.
        objects: Its objects.
        supports: Everything that never moves and carries things, the largest first.
    """

    model: Path
    start: str
    robot: Entry | None
    objects: tuple[Entry, ...]
    supports: tuple[FoundSupport, ...]

    def words(self) -> dict[str, Any]:
        """Return the scene without what is commented out, as `SceneConfig.load` takes it."""
        found: dict[str, Any] = {"model": str(self.model.resolve())}
        if self.robot is not None and not self.robot.why:
            found[ROBOT] = dict(self.robot.words)
        return found | {"objects": {e.name: dict(e.words) for e in self.objects if not e.why}}

    def without(self, name: str, why: str) -> FirstScene:
        """Return the scene with an object, or the robot, commented out, and all objects that need it."""
        if name == ROBOT and self.robot is not None:
            return replace(self, robot=replace(self.robot, why=why))
        out = {name: why}
        for entry in self.objects:  # those that stand on others come after them
            carrier = str(entry.words.get("on", entry.words.get("in", ""))).partition("/")[0]
            if carrier in out and not entry.why:
                out[entry.name] = f"It stands on '{carrier}', which is commented out."
        return replace(self, objects=tuple(replace(e, why=out.get(e.name, e.why)) for e in self.objects))

    def with_note(self, name: str, note: str) -> FirstScene:
        """Return the scene with one more comment above an object or the robot."""
        if name == ROBOT and self.robot is not None:
            return replace(self, robot=replace(self.robot, notes=(*self.robot.notes, note)))
        noted = (replace(e, notes=(*e.notes, note)) if e.name == name else e for e in self.objects)
        return replace(self, objects=tuple(noted))

    def text(self, model: str) -> str:
        """Return the scene file.

        Args:
            model: The path of the model as the file names it.
        """
        lines = [
            "# A first scene, written from the model: try it with `sceniris-gym check`, and change what it says.",
            f"model: {_flow(model)}",
            *(f"# {line}" for line in _wrapped(self.start)),
        ]
        if self.robot is not None:
            lines += ["", *self.robot.lines("")]
        shown = [line for entry in self.objects for line in entry.lines("  ")]
        alive = any(not entry.why for entry in self.objects)
        lines += ["", "objects:" if alive else "objects: {}", *shown]
        if not self.objects:
            lines += ["  # The model has no body with a freejoint. Add things: `mug: {asset: mug, on: SUPPORT}`."]
        lines += ["", "# What things can stand on, as in `on: NAME`; the edges of its level surfaces, and their area:"]
        lines += [f"#   {_support_line(s)}" for s in self.supports]
        if not self.supports:
            lines += ["#   nothing that never moves and has a name: add `floor: {size: [2, 2]}`, and `on: floor`"]
        return "\n".join(lines) + "\n"


def first_scene(path: Path) -> FirstScene:
    """Read a model, and work out a first scene.

    Raises:
        SceneFileError: The file is missing, or MuJoCo cannot read or compile it.
        MeshError: A mesh that cannot be used for collision.
    """
    where = str(path)
    mjm = compile_spec(load_model(path, where), where)
    data = mujoco.MjData(mjm)
    key = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_KEY, HOME)
    data.qpos[:] = mjm.key_qpos[key] if key >= 0 else mjm.qpos0
    mujoco.mj_kinematics(mjm, data)
    start = (
        f"The start pose is {f'its keyframe {HOME!r}' if key >= 0 else 'qpos0, as it has no keyframe ' + repr(HOME)}."
    )
    pieces = extract_pieces(mjm, "physics", where=dict.fromkeys(range(mjm.nbody), where))
    arms = find_arms(mjm)
    roots = {arm.base for arm in arms}
    tops = [b for b in range(1, mjm.nbody) if mjm.body_parentid[b] == 0 and b not in roots]
    free = {name: b for name, b in _names(mjm, tops).items() if _is_free(mjm, b)}
    supports = supports_of(mjm, free, roots, pieces)
    entries = _Bodies(mjm, data, pieces, free, supports).entries()
    entries += [_not_free(mjm, b) for b in tops if _slides(mjm, b)]
    return FirstScene(path, start, _robot(mjm, data, arms), tuple(entries), tuple(supports))


@dataclass(frozen=True)
class _Bodies:
    """The free bodies of a model, with all that decides where they are placed."""

    mjm: mujoco.MjModel
    data: mujoco.MjData
    pieces: list[Piece]
    free: dict[str, int]
    supports: list[FoundSupport]

    def entries(self) -> list[Entry]:
        """An entry for each, what carries others first."""
        found = {name: self._entry(name, body) for name, body in self.free.items()}
        ordered: dict[str, Entry] = {}
        for name in found:
            chain = [name]
            while (carrier := _carrier(found[chain[-1]])) in found and carrier not in chain:
                chain.append(carrier)
            ordered |= {link: found[link] for link in reversed(chain) if link not in ordered}
        return list(ordered.values())

    def _entry(self, name: str, body: int) -> Entry:
        own = subtree(self.mjm, body)
        words: dict[str, Any] = {} if self.mjm.body(body).name == name else {"body": self.mjm.body(body).name}
        if not self.mjm.body(body).name:
            return Entry(name, {"on": "SUPPORT"}, why=f"Body {body} of the model has no name. Give it one.")
        if self._is_driven(own):
            return Entry(
                name, {**words, "on": "SUPPORT"}, why=f"'{name}' has actuators: it is a robot that moves freely."
            )
        geom = geom_beneath(self.mjm, self.data, body)
        named = None if geom is None else named_support(self.mjm, geom, self.free)
        support = None if named is None else support_of(*named, self.pieces)
        if support is not None and support.surfaces:
            return Entry(name, {**words, **self._standing(support, body)}, self._tilted(body))
        said = self._not_beneath(geom, named)
        if not self.supports:
            return Entry(name, {**words, "on": "SUPPORT"}, why=f"{said} Nothing else carries it, either.")
        ground = min(self._height(s) for s in self.supports)
        raised = [s for s in self.supports if self._height(s) > ground + _RAISED]
        largest = (raised or self.supports)[0]
        said += f" '{largest.name}' is the largest surface{' above the ground' if raised else ''}."
        return Entry(name, {**words, **self._standing(largest, body)}, (said, *self._tilted(body)))

    def _not_beneath(self, geom: int | None, named: tuple | None) -> str:
        """Why what is beneath a body in the start pose does not carry it in the scene."""
        if geom is None:
            return "Nothing is beneath it in the start pose."
        label = self.mjm.body(int(self.mjm.geom_bodyid[geom])).name
        if named is None:
            return (
                f"What is beneath it, geom {geom} of body '{label}', moves or has no name, so nothing can be put on it."
            )
        return f"'{named[0]}', which is beneath it, has no level surface of 2 cm or more in width."

    def _standing(self, support: FoundSupport, body: int) -> dict[str, Any]:
        """The words that place a body on a support."""
        words: dict[str, Any] = {"on" if support.open_above else "in": support.name}
        if support.is_endless or max(support.extent) > _LARGE:
            mat = self.data.xmat[support.body].reshape(3, 3)
            at = mat.T @ (self.data.xpos[body] - self.data.xpos[support.body])
            low, high = ([round(float(v + s * _AROUND), 2) + 0.0 for v in at[:2]] for s in (-1.0, 1.0))
            words["region"] = {"box": [low, high]}
        return words

    def _height(self, support: FoundSupport) -> float:
        """The height of its highest surface in the world [m]."""
        return float(self.data.xpos[support.body][2]) + support.surfaces[-1].height

    def _tilted(self, body: int) -> tuple[str, ...]:
        """A note if a body lies otherwise in the start pose than the model has it, which is how it will lie."""
        turn = self.data.xmat[body].reshape(3, 3)[2] @ _matrix(self.mjm.body_quat[body])[2]
        note = "It lies otherwise in the start pose than `qpos0` has it, which is how it is placed: see `orientation`."
        return (note,) if turn < np.cos(np.radians(5.0)) else ()

    def _is_driven(self, bodies: list[int]) -> bool:
        joints = np.flatnonzero(np.isin(self.mjm.jnt_bodyid, bodies))
        kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
        return bool(np.any(np.isin(self.mjm.actuator_trnid[np.isin(self.mjm.actuator_trntype, kinds), 0], joints)))


def _robot(mjm: mujoco.MjModel, data: mujoco.MjData, arms: list[FoundArm]) -> Entry | None:
    """The first arm of a model as its robot."""
    if not arms:
        return None
    arm = arms[0]
    name = mjm.body(arm.base).name
    others = [mjm.body(other.hand).name for other in arms[1:]]
    notes = [f"An arm of {len(arm.joints)} joints" + (", with fingers." if arm.fingers else ", without fingers.")]
    if others:
        notes.append(f"More arms end at {', '.join(map(repr, others))}.")
    if not name:
        return Entry(ROBOT, {"in_model": "NAME"}, tuple(notes), "Its root body has no name. Give it one.")
    tcp = arm.tcp(data).model_dump(exclude_defaults=True)
    tcp = {word: list(v) if isinstance(v, tuple) else v for word, v in tcp.items()}
    words = {"in_model": name, "tcp": next(iter(tcp.values())) if len(tcp) == 1 else tcp}
    return Entry(ROBOT, words, tuple(notes))


def reach_note(mjm: mujoco.MjModel, base: str, tcp: str) -> str:
    """Return what is said above a robot about `reachable`: that it works, or why it does not.

    Args:
        mjm: The model of the scene.
        base: The robot's root body.
        tcp: The site that is its tool centre point.
    """
    try:
        SerialArm.from_model(mjm, base, tcp)
    except (ArmError, NotSupportedError) as error:
        return f"`reachable` does not work with it: {error}"
    return "Check that +z of the `tcp` is its approach axis. Objects within its reach: `reachable: ik`."


def _names(mjm: mujoco.MjModel, bodies: Iterable[int]) -> dict[str, int]:
    """Names of objects by which bodies of the model go in a scene file; those without a name go by their number."""
    found: dict[str, int] = {}
    for body in bodies:
        parts = mjm.body(body).name.split("/")
        tail = parts[0] if len(parts) > 1 and parts[-1] in ("main", "root", "object", "base", "body") else parts[-1]
        name = re.sub(r"[^A-Za-z0-9_-]", "_", tail) or f"body_{body}"
        name = name if re.match(r"[A-Za-z_]", name) and name not in (FLOOR, ROBOT, "world") else f"thing_{name}"
        found[name if name not in found else f"{name}_{body}"] = body
    return found


def _is_free(mjm: mujoco.MjModel, body: int) -> bool:
    first = int(mjm.body_jntadr[body])
    return int(mjm.body_jntnum[body]) == 1 and mjm.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE


def _slides(mjm: mujoco.MjModel, body: int) -> bool:
    """Whether a body moves on slides of its own in place of a freejoint, and nothing drives them."""
    first, num = int(mjm.body_jntadr[body]), int(mjm.body_jntnum[body])
    slides = [j for j in range(first, first + num) if mjm.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE]
    return len(slides) >= 2 and not np.isin(mjm.actuator_trnid[:, 0], slides).any()


def _not_free(mjm: mujoco.MjModel, body: int) -> Entry:
    num = int(mjm.body_jntnum[body])
    why = f"Body '{mjm.body(body).name}' hangs on {num} joints of its own. Write <freejoint/> in their place."
    return Entry(next(iter(_names(mjm, [body]))), {"on": "SUPPORT"}, why=why)


def _carrier(entry: Entry) -> str:
    return str(entry.words.get("on", entry.words.get("in", ""))).partition("/")[0]


def _support_line(support: FoundSupport) -> str:
    if support.is_endless:
        return f"{_flow(support.name)}: endless; give a region"
    x, y = support.extent
    high = ", ".join(f"{s.height:.3g}" for s in support.surfaces)
    covered = "" if support.open_above else "; covered, so `in` in place of `on`"
    return f"{_flow(support.name)}: {x:.3g} x {y:.3g} m, {support.area:.3g} m2, at z = {high} m of its body{covered}"


def _flow(value: Any) -> str:
    """A value as YAML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {_flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, str):
        return value if _PLAIN.fullmatch(value) and value.lower() not in _NOT_STRINGS else json.dumps(value)
    return json.dumps(value)


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, break_long_words=False, break_on_hyphens=False)


def _matrix(quat: np.ndarray) -> np.ndarray:
    mat = np.zeros(9)
    mujoco.mju_quat2Mat(mat, quat)
    return mat.reshape(3, 3)
