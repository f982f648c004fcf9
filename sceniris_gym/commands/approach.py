"""The reach of an arm for `init`: shares within reach, other approach axes of the hand, and regions of objects."""

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np
import shapely

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.robot import TcpConfig
from sceniris_gym.errors import ArmError, NotSupportedError
from sceniris_gym.geometry.rotations import matrix, of_angles, quaternion
from sceniris_gym.grasping.grasps import tcp_axes
from sceniris_gym.importers.models.first_scene import FirstScene, carrier_name, flow
from sceniris_gym.importers.models.found import FoundSupport
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.reach.solve import solve

_LAYOUTS, _RESTARTS = 16, 16
_YAWS, _TILTS = range(0, 360, 60), (0.0, 45.0)  # degrees, of approaches to an object, the first yaw away from the arm
_TURNS = ((0, 0), (0, 180), (0, 90), (0, -90), (90, 0), (-90, 0))  # roll and pitch in degrees, all six axes
# An axis is named if it brings this much more within reach.
_BETTER = 0.1
# The ground is tried in a grid of this number of points each way, at this height [m].
_POINTS, _ABOVE = 17, 0.02
_SELDOM = 0.5  # an object that is within reach less often gets a region


class Approach:
    """The places to which inverse kinematics brings the TCP of a scene's robot from above, at any yaw.

    After `notes`, they are those of the better `tcp`, if there is one.

    Args:
        compiled: The scene, with a robot `in_model` that has a `tcp`.

    Raises:
        ArmError, NotSupportedError: `reachable` does not work with the robot.
    """

    def __init__(self, compiled: CompiledScene) -> None:
        self._compiled, self._home, self._arm = compiled, compiled.scene.home, robot_arm(compiled.scene)
        self._axis = self._home.xanchor[compiled.mjm.jnt_qposadr == self._arm.qposadr[0]][0]
        self._length, self._turn = float(np.linalg.norm(self._arm.link_pos[1:], axis=1).sum()), np.eye(3)

    def notes(self, names: Sequence[str], ground: FoundSupport | None = None) -> tuple[str, ...]:
        """Return comments for the scene file: how to use `reachable`, and a better `tcp` if there is one.

        Args:
            names: The free objects. Without objects, places on the ground count instead.
            ground: The support of these places, or None for the height 0.
        """
        tcp = self._compiled.config.all_robots[ROBOT].tcp
        assert tcp is not None
        mjm, what = self._compiled.mjm, "objects" if names else f"places on the ground within {self._length:.2g} m"
        places = self.places(names) if names else self._grid(ground)[1].reshape(-1, 3)
        kind = "site" if tcp.site in [mjm.site(i).name for i in range(mjm.nsite)] else "body"
        name, mat = getattr(tcp, kind), self._home.site_xmat[self._arm.tcp_site].reshape(3, 3)
        from_tool = mat.T @ getattr(self._home, kind)(name).xmat.reshape(3, 3)
        own, turns, shares = tcp.turns[:2], {}, {}
        for turn in dict.fromkeys((own, *_TURNS)):
            turns[turn] = self._turn = from_tool @ matrix(of_angles(np.radians([*turn, 0.0])))
            shares[turn] = self.reached(places).mean()
        best = max(shares, key=shares.__getitem__)
        note = f"{shares[own]:.0%} of the {what} are within reach from above"
        if shares[best] > shares[own] + _BETTER:
            words = TcpConfig.model_validate({kind: name, "offset": tcp.offset, "roll": best[0], "pitch": best[1]})
            note += f", but {shares[best]:.0%} with `tcp: {flow(words.model_dump(mode='json', exclude_defaults=True))}`"
        else:
            best = own
        self._turn = turns[best]
        use = "Check that +z of the `tcp` is the approach axis. To keep an object within reach: `reachable: ik`."
        return use, f"{note}."

    def places(self, names: Sequence[str]) -> np.ndarray:
        """Return the positions [m] of objects in some layouts, shape (n, 3)."""
        mjm, bodies = self._compiled.mjm, self._compiled.scene.bodies
        adr = [int(mjm.jnt_qposadr[mjm.body_jntadr[bodies[name]]]) for name in names]
        return make_table(self._compiled, _LAYOUTS, 0).qpos[:, np.add.outer(adr, range(3))].reshape(-1, 3)

    def reached(self, places: np.ndarray) -> np.ndarray:
        """Return which places [m], shape (n, 3), the TCP reaches, shape (n,), bool."""
        base, at = self._home.xmat[self._arm.base_body].reshape(3, 3), self._home.xpos[self._arm.base_body]
        away = np.degrees(np.arctan2(*(places - self._axis)[:, 1::-1].T))
        poses = [
            [*place, *quaternion(base.T @ tcp_axes(first + yaw, tilt) @ self._turn.T)]
            for place, first in zip((places - at) @ base, away, strict=True)
            for yaw in _YAWS
            for tilt in _TILTS
        ]
        _, is_reached = solve(self._arm, np.array(poses), self._compiled.device, restarts=_RESTARTS)
        return np.any(is_reached.reshape(len(places), -1), axis=1)

    def box(self, support: FoundSupport | None) -> list[list[float]] | None:
        """Return the `box` of a region on a support, in which the TCP reaches all points of a grid. None for no box."""
        xy, places = self._grid(support)
        ok = self.reached(places.reshape(-1, 3)).reshape(_POINTS, _POINTS)
        if support is not None:
            ok &= shapely.contains_xy(shapely.union_all([s.outline for s in support.surfaces]), *np.moveaxis(xy, 2, 0))
        spans = [slice(first, last + 1) for first, last in combinations(range(_POINTS), 2)]
        largest = max((xy[box] for box in product(spans, spans) if ok[box].all()), key=np.size, default=None)
        return None if largest is None else np.round([largest[0, 0], largest[-1, -1]], 3).tolist()

    def _grid(self, support: FoundSupport | None) -> tuple[np.ndarray, np.ndarray]:
        """Return points around the arm on a support: x and y in its frame, and positions in the world [m]."""
        body, top = (0, 0.0) if support is None else (support.body, support.surfaces[-1].height)
        pos, mat = self._home.xpos[body], self._home.xmat[body].reshape(3, 3)
        steps = np.linspace(-self._length, self._length, _POINTS)
        xy = (mat.T @ (self._axis - pos))[:2] + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1)
        return xy, pos + np.dstack([xy, np.full(xy.shape[:2], top + _ABOVE)]) @ mat.T


def add_reach(scene: FirstScene, compiled: CompiledScene) -> bool:
    """Add comments about the robot's reach to a scene, and regions to objects that are seldom within reach.

    Returns:
        True if an object got a region.
    """
    assert scene.robot is not None
    try:
        approach = Approach(compiled)
    except (ArmError, NotSupportedError) as error:
        scene.robot.notes += (f"`reachable` does not work with it: {error}",)
        return False
    entries, ground = [entry for entry in scene.objects if not entry.why], next(iter(scene.supports), None)
    scene.robot.notes += approach.notes([entry.name for entry in entries], ground)
    scene.near = None if entries else approach.box(ground)
    supports, found = {support.name: support for support in scene.supports}, False
    for entry in entries:
        support = supports.get(carrier_name(entry))
        is_rare = support is not None and approach.reached(approach.places([entry.name])).mean() < _SELDOM
        if is_rare and (box := approach.box(support)) is not None:
            entry.words["region"], found = {"box": box}, True
    return found
