"""`LiberoGoal`: the goal of a LIBERO problem file, evaluated in all worlds."""

from collections.abc import Callable

import torch
import warp as wp
from torch import Tensor

from sceniris_gym.importers.libero.kinds import moving
from sceniris_gym.importers.libero.places import INNER
from sceniris_gym.importers.libero.problem import Predicate, Problem, Region
from sceniris_gym.scene.support import subtree
from sceniris_gym.vector.bodies import ContactSensor
from sceniris_gym.vector.names import SCALAR, find_body, find_element
from sceniris_gym.vector.state import State

_WHERE = "LiberoGoal"
_BESIDE = 0.03  # greatest horizontal distance [m] between the origins of an object and its support
_ABOVE = 0.1  # greatest height [m] above the top of a site at which an object is on the site
_BELOW = 0.005  # greatest depth [m] below the top of a site at which an object is on the site
_UNDER = 0.01  # greatest depth [m] below the bottom of a site at which an object is in the site


class LiberoGoal:
    """Evaluates the predicates of a goal as LIBERO does, in torch operations without host synchronisation.

    - `On(a, b)`: a and b touch, b's origin is not above a's origin, and their horizontal distance is less than 3 cm.
    - `On(a, REGION)`: a's origin is within the site's rectangle, from 5 mm below its top to 10 cm above. Also, a
      touches the object with the site, unless that object is the work surface.
    - `In(a, REGION)`: a's origin is in the box around the site, extended by 1 cm downwards.
    - `Open` and `Turnon`: at least one joint is in the range of its positions in initial states with this predicate,
      or beyond this range. `Close` and `Turnoff`: all joints are in their ranges, or beyond them.

    Each origin is the body origin in LIBERO's model of the object. Contacts come from the last physics step, as in
    `ContactSensor`.

    Args:
        s: The worlds, with a scene from `read_bddl` or `sceniris-gym init`.
        problem: The problem file, from `read_bddl(...).problem` or `read_problem`.

    Raises:
        UnknownNameError: The scene lacks an object or a site of the goal, or a predicate does not apply to its object.
    """

    def __init__(self, s: State, problem: Problem) -> None:
        self._problem = problem
        self._xpos, self._qpos = wp.to_torch(s.data.xpos), wp.to_torch(s.data.qpos)
        self._site_pos, self._site_mat = wp.to_torch(s.data.site_xpos), wp.to_torch(s.data.site_xmat)
        self._tests = [self._test(s, predicate) for predicate in problem.goal]

    def __call__(self, s: State) -> Tensor:
        """Return the worlds in which all predicates hold, shape (num_envs,), bool."""
        return self.each(s).all(dim=1)

    def each(self, s: State) -> Tensor:
        """Return which predicates hold, in the order of the file, shape (num_envs, number of predicates), bool."""
        return torch.stack([test(s) for test in self._tests], dim=1)

    def _test(self, s: State, predicate: Predicate) -> Callable[[State], Tensor]:
        region = self._problem.regions.get(predicate.names[-1])
        if predicate.word not in ("On", "In"):
            return self._joints(s, predicate, region)
        if region is None:
            return self._on_thing(s, *predicate.names)
        return (self._on_site if predicate.word == "On" else self._in_site)(s, predicate.names[0], region)

    def _on_thing(self, s: State, name: str, other: str) -> Callable[[State], Tensor]:
        own, its = self._origin(s, name), self._origin(s, other)
        touch = self._touch(s, name, other)

        def test(s: State) -> Tensor:
            away = self._xpos[:, own] - self._xpos[:, its]
            return (away[:, 2] >= 0.0) & (away[:, :2].norm(dim=1) < _BESIDE) & touch(s)

        return test

    def _on_site(self, s: State, name: str, region: Region) -> Callable[[State], Tensor]:
        own, site, size = self._origin(s, name), *self._site(s, region)
        touch = None if region.boxes else self._touch(s, name, region.target)

        def test(s: State) -> Tensor:
            # LIBERO multiplies by the site's rotation matrix, not by its inverse
            away = self._xpos[:, own] - self._site_pos[:, site]
            away = (self._site_mat[:, site] @ away[:, :, None]).squeeze(2)
            height = away[:, 2] - size[2]
            above = (height > -_BELOW) & (height < _ABOVE) & (away[:, :2].abs() < size[:2]).all(dim=1)
            return above if touch is None else above & touch(s)

        return test

    def _in_site(self, s: State, name: str, region: Region) -> Callable[[State], Tensor]:
        own, site, size = self._origin(s, name), *self._site(s, region)
        lower = torch.tensor([0.0, 0.0, _UNDER], device=s.device)

        def test(s: State) -> Tensor:
            away, half = self._xpos[:, own] - self._site_pos[:, site], (self._site_mat[:, site] @ size).abs()
            return ((away > -half - lower) & (away < half)).all(dim=1)

        return test

    def _joints(self, s: State, predicate: Predicate, region: Region | None) -> Callable[[State], Tensor]:
        name, (low, high) = moving(self._problem, predicate)
        root = find_body(s.scene, name, _WHERE)
        bodies = subtree(s.mjm, root) if region is None else [int(s.mjm.site_bodyid[self._site(s, region)[0]])]
        joints = [j for j in range(s.mjm.njnt) if s.mjm.jnt_bodyid[j] in bodies and s.mjm.jnt_type[j] in SCALAR]
        columns = [int(s.mjm.jnt_qposadr[j]) for j in joints]
        tests: dict[str, Callable[[Tensor], Tensor]] = {
            "Open": lambda q: (q < high).any(dim=1),
            "Close": lambda q: (q > low).all(dim=1),
            "Turnon": lambda q: (q >= low).any(dim=1),
            "Turnoff": lambda q: (q < high).all(dim=1),
        }
        return lambda _: tests[predicate.word](self._qpos[:, columns])

    def _origin(self, s: State, name: str) -> int:
        return find_body(s.scene, f"{name}/{INNER}", _WHERE)

    def _site(self, s: State, region: Region) -> tuple[int, Tensor]:
        """Return the id of the site that represents a region, and the site's half sizes [m], shape (3,)."""
        site = find_element(s.scene, "site", f"{region.target}/{region.name}", _WHERE)
        return site, torch.tensor(s.mjm.site_size[site], dtype=torch.float32, device=s.device)

    def _touch(self, s: State, name: str, other: str) -> Callable[[State], Tensor]:
        """Return a test for contact between any parts of two objects."""
        parts = [[s.mjm.body(b).name for b in subtree(s.mjm, find_body(s.scene, n, _WHERE))] for n in (name, other)]
        touch = ContactSensor(s, *(list(filter(None, names)) for names in parts))
        return lambda s: touch(s).any(dim=2).any(dim=1)
