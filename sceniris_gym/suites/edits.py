"""Edits of nominal layouts: free objects shifted or rotated on their supports.

An edit is written as params, which fix each object at its edited place. The generator then makes the edited layout with
all checks of the scene, and the layout's id suffices to make it again.
"""

from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.scene_params import Param, scene_params
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause, OrientationType
from sceniris_gym.progress import tell
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.poses import body_poses, product, rotated
from sceniris_gym.suites.suite import Case

STEPS = {"shift": 0.03, "turn": float(np.radians(18.0))}
"""Shift [m] and rotation [rad] of each object per grade, by axis."""
TRIES = 8
"""Number of random edits of a layout. If all of them fail, the layout is refused."""
_HALF = 1.0e-5
"""Half the width of the box that fixes an object [m]."""
_EXACT = 1.0e-4
"""Tolerance of places [m and rad]."""
_COLUMNS = {"shift": slice(0, 2), "turn": slice(3, 4)}
"""Columns of a place that an axis changes."""
_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])


class _Object(NamedTuple):
    """A placed object or robot: its name, the bodies of its root and its support, and its pivot in its root's frame.

    `pins` are the params that fix its region and its yaw, by axis. `joints` are the params that fix its joints, each
    with the joint's address in qpos. `moves` is whether edits move the object on its support.
    """

    name: str
    body: int
    ground: int
    pivot: np.ndarray
    pins: dict[str, Param]
    joints: list[tuple[Param, int]]
    moves: bool

    @property
    def middle(self) -> float:
        """The middle of its yaw [rad]."""
        return float(self.pins["turn"].default.mean()) if "turn" in self.pins else 0.0


class Editor:
    """Edits the nominal layouts of one scene.

    Args:
        compiled: The scene.
        nominal: Values of params in nominal layouts, by name.
        number: Number of nominal layouts.
        seed: Seed of the first layout.
        split: Split of the layouts.

    Attributes:
        params: The params in `nominal`, and the params that edits set.

    Raises:
        ArgumentError: The scene has starts, or no object that can be moved.
    """

    def __init__(
        self, compiled: CompiledScene, nominal: Mapping[str, Any], number: int, seed: int, split: str = "eval"
    ) -> None:
        if compiled.config.start:
            raise ArgumentError("--axes shift, turn: the scene should have no 'start'.")
        self._objects = _objects(compiled)
        if not any(one.moves for one in self._objects):
            raise ArgumentError("--axes shift, turn: the scene should have a free object with a box and a yaw to draw.")
        pins = [pin for one in self._objects for pin in (*one.pins.values(), *(param for param, _ in one.joints))]
        names = (*nominal, *(pin.name for pin in pins))
        self._generator, self._seed = LayoutGenerator(compiled, number, seed=seed, split=split, params=names), seed
        self._generator.set_params(nominal)
        self._generator.generate()
        self._table, self.params = self._generator.table(), self._generator.layouts.params
        self._nominal = self._places(self._table)
        self._hinges = compiled.mjm.jnt_qposadr[compiled.mjm.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)]

    def edits(self, axis: str, grade: int, number: int) -> tuple[list[Case], Counter[str]]:
        """Return at most `number` cases, and the number of layouts without an edit by cause.

        Edits with few tags are preferred, then the first layouts. `axis` is a key of STEPS.
        """
        generator, names = self._generator, [one.name for one in self._objects]
        moves = np.array([[one.moves] for one in self._objects])
        found, refused, random = dict[int, Case](), dict[int, str](), np.random.default_rng([grade, *axis.encode()])
        for _ in range(TRIES):
            left = self._table.valid & [i not in found or bool(found[i].tags) for i in range(generator.nworld)]
            if not left.any() or sum(not case.tags for case in found.values()) >= number:
                break
            wanted, clipped = self._moved(axis, STEPS[axis] * grade, random)
            generator.set_params(self._pins(wanted))
            generator.reseed(seed=self._seed)
            generator.generate(left)
            made, rejected = generator.table(), generator.layouts.view.row_rejections.numpy()
            by, wrong = _around(wanted - self._nominal, 0.0), _around(self._places(made) - wanted, 0.0)
            moved, away = (np.abs(difference).max(axis=2) > _EXACT for difference in (by, wrong))
            hinges = np.abs(made.qpos - self._table.qpos)[:, self._hinges] > _EXACT
            redrawn = (away & ~moves).any(axis=0) | hinges.any(axis=1)
            moved &= ~(away & moves).any(axis=0)
            for i in np.flatnonzero(left).tolist():
                if made.valid[i] and moved[:, i].any():
                    xy, turn = by[:, i, :2].tolist(), np.degrees(by[:, i, 3]).tolist()
                    edits = {
                        names[k]: {axis: (xy if axis == "shift" else turn)[k]} for k in np.flatnonzero(moved[:, i])
                    }
                    tags = ("clipped",) * int(clipped[i]) + ("redrawn",) * int(redrawn[i])
                    text = self.params.text(made.param[i])
                    name = generator.compiled.layout_id(self._seed + i, 0, made.split, text)
                    case = Case(0, name, axis, grade, tags, edits)
                    found[i] = min(found.get(i, case), case, key=lambda one: len(one.tags))
                else:
                    k, cause = np.unravel_index(rejected[i].argmax(), rejected[i].shape)
                    why = "no object has room" if made.valid[i] else f"{names[k]}: {Cause(cause).name.lower()}"
                    refused[i] = f"{axis} {grade}: {why}"
            tell(f"{axis} {grade}", min(number, len(found)), number)
        chosen = sorted(found, key=lambda i: (len(found[i].tags), found[i].tags, i))[:number]
        return [found[i] for i in chosen], Counter(why for i, why in refused.items() if i not in found)

    def _places(self, table: LayoutTable) -> np.ndarray:
        """Return each object's pivot [m], heading [rad] and vertical, shape (nobject, nrow, 7), NaN for absent objects.

        The vertical is in the frame of the object's root, and the rest in the frame of its support.
        """
        found, compiled = [], self._generator.compiled
        for one in self._objects:
            (pos, quat), (origin, frame) = (
                body_poses(compiled.mjm, body, table.qpos, table.mocap_pos, table.mocap_quat)
                for body in (one.body, one.ground)
            )
            quat = product(frame * _INVERSE, quat)
            pivot = rotated(pos - origin, frame * _INVERSE) + rotated(one.pivot, quat)
            x, up = rotated(np.eye(3)[0], quat), rotated(np.eye(3)[2], quat * _INVERSE)
            heading = _around(np.arctan2(x[:, 1], x[:, 0]), one.middle)
            place = np.column_stack([pivot, heading, up])
            found.append(np.where(table.present[:, [compiled.slots.index(one.name)]], place, np.nan))
        return np.stack(found)

    def _moved(self, axis: str, by: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return edited places, and whether a region or yaw shortens an edit of a row, shape (nrow,)."""
        wanted, clipped = self._nominal.copy(), np.zeros(self._nominal.shape[1], bool)
        for place, one in zip(wanted, self._objects, strict=True):
            angle = random.uniform(0.0, 2.0 * np.pi, len(place))
            if one.moves:
                (low, high), at = one.pins[axis].default.reshape(2, -1), place[:, _COLUMNS[axis]]
                away = np.stack([np.cos(angle), np.sin(angle)], axis=1)
                to = at + by * (away if axis == "shift" else np.sign(away[:, :1]))
                at[:] = to if axis == "turn" and high[0] - low[0] > 2.0 * np.pi - _EXACT else to.clip(low, high)
                clipped |= (np.abs(to - at) > 0.0).any(axis=1)
        return wanted, clipped

    def _pins(self, places: np.ndarray) -> dict[str, np.ndarray]:
        """Return the params that fix all present objects at their places, by name, one row per layout."""
        pins = {}
        for place, one in zip(places, self._objects, strict=True):
            place[:, 3] = _around(place[:, 3], one.middle)
            fixed = [(param, place[:, _COLUMNS[axis]]) for axis, param in one.pins.items()]
            for param, at in (*fixed, *((param, self._table.qpos[:, [adr]]) for param, adr in one.joints)):
                (low, high), half = param.default.reshape(2, -1), _HALF * (param.form == "box")
                ends = [np.maximum(at.clip(low, high) - half, low), np.minimum(at.clip(low, high) + half, high)]
                pins[param.name] = np.where(np.isnan(place[:, :1]), param.default, np.hstack(ends))
        return pins


def _objects(compiled: CompiledScene) -> list[_Object]:
    """Return the objects and robots with a drawn pose or joints. A support comes before the objects on it."""
    scene, program, config, found = compiled.scene, compiled.program, compiled.config, list[_Object]()
    params = {name: one for name, one in scene_params(compiled).items() if isinstance(one, Param)}
    ground, first, pivots = (getattr(program, f).numpy() for f in ("obj_ground", "obj_stableadr", "stable_pivot"))
    single, moving = program.obj_stablenum.numpy() == 1, set[str | None]()
    turned = (program.obj_with.numpy() < 0) & (program.obj_orientation.numpy() == OrientationType.YAW)
    for i, name in enumerate(compiled.placed):
        part, key, carried = config.parts.get(name), config.key(name), scene.owners.get(int(ground[i])) in moving
        fits = {"shift": ("region", single[i] and ground[i] >= 0), "turn": ("orientation.yaw", turned[i])}
        pins = {axis: params[f"{key}.{w}"] for axis, (w, fit) in fits.items() if fit and f"{key}.{w}" in params}
        named = {f"{key}.joints.{joint}": scene.mjm.jnt_qposadr[j] for joint, j in scene.joints(name).items()}
        joints = [(params[joint], adr) for joint, adr in named.items() if joint in params]
        moves = part is not None and part.kind == "free" and len(pins) == len(fits)
        moving |= {name} if moves or carried else set()
        pivot = pivots[first[i]] if single[i] else np.zeros(3)
        where = scene.bodies[name], max(int(ground[i]), 0)
        found.append(_Object(name, *where, pivot, pins, joints, moves and not carried))
    return found


def _around(angle: np.ndarray, middle: float) -> np.ndarray:
    """Return angles [rad] as numbers at most half a turn from the middle."""
    return middle + np.remainder(angle - middle + np.pi, 2.0 * np.pi) - np.pi
