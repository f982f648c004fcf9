"""Is there a joint solution within limits, for a TCP pose, within 1 mm and 0.5 degrees? The truth about three arms.

It shares no code with reach/. All branches come in closed form; a Panda's seventh joint is swept. A solution that the
closed form gives within limits decides. Where there is none, the branches that come closest are moved, within limits,
towards the *set* of poses within the tolerances: so poses just out of reach count as reached, as they should.
Every yes has joints, which stand within limits and tolerances by forward kinematics.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from tests.oracle import closed_forms

POS_TOL, ROT_TOL = 1.0e-3, np.radians(0.5)
SWEEPS = (90, 480)  # steps over the Panda's seventh joint: first for all poses, then for those that are left
SEGMENTS = 4  # of a sweep; each gives its closest joints of every branch
CLOSEST = 16  # of these are moved
CHUNK = 250  # poses that are worked on at once


@dataclass(frozen=True, eq=False)
class Screws:
    """An arm as screws in the base's frame with all joints at zero, and its limits."""

    axis: np.ndarray  # (n, 3)
    anchor: np.ndarray  # (n, 3) [m]
    tcp: np.ndarray  # (4, 4)
    lower: np.ndarray
    upper: np.ndarray

    @classmethod
    def from_model(cls, mjm: mujoco.MjModel, base: str, count: int, tcp: str = "tcp") -> Screws:
        """Take axes and the TCP from MuJoCo with 'joint1' and so on at zero. The base stands at the origin."""
        data = mujoco.MjData(mjm)
        named = {mjm.joint(i).name.rpartition("/")[2]: i for i in range(mjm.njnt)}  # with or without the arm's prefix
        joints = [named[f"joint{i + 1}"] for i in range(count)]
        data.qpos[mjm.jnt_qposadr[joints]] = 0.0
        mujoco.mj_kinematics(mjm, data)
        assert not data.xpos[mjm.body(base).id].any()
        site = {mjm.site(i).name.rpartition("/")[2]: i for i in range(mjm.nsite)}[tcp]
        pose = np.eye(4)
        pose[:3, :3] = data.site_xmat[site].reshape(3, 3)
        pose[:3, 3] = data.site_xpos[site]
        return cls(data.xaxis[joints].copy(), data.xanchor[joints].copy(), pose, *mjm.jnt_range[joints].T)

    def forward(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rotations (M, 3, 3) and positions (M, 3) of the TCP, and its Jacobian (M, 6, n), base frame."""
        turn, pos = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
        axes, origins = [], []
        for i, (axis, anchor) in enumerate(zip(self.axis, self.anchor, strict=True)):
            axes.append(turn @ axis)
            origins.append(turn @ anchor + pos)
            cross = np.cross(np.eye(3), axis)
            sine, versine = np.sin(q[:, i])[:, None, None], 1.0 - np.cos(q[:, i])[:, None, None]
            turn = turn @ (np.eye(3) + sine * cross + versine * (cross @ cross))
            pos = origins[-1] - turn @ anchor
        at = turn @ self.tcp[:3, 3] + pos
        jacobian = [np.concatenate([np.cross(a, at - o), a], axis=1) for a, o in zip(axes, origins, strict=True)]
        return turn @ self.tcp[:3, :3], at, np.stack(jacobian, axis=2)

    def errors(self, poses: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return distances [m] and angles [rad] of the TCP at joints (M, n) from poses (M, 4, 4)."""
        turn, at, _ = self.forward(q)
        return np.linalg.norm(poses[:, :3, 3] - at, axis=1), np.linalg.norm(_rotation(turn, poses), axis=1)

    def near_middle(self, q: np.ndarray) -> np.ndarray:
        """Add full turns to joints so that they violate their limits least."""
        middle = 0.5 * (self.lower + self.upper)
        return q - 2.0 * np.pi * np.round((q - middle) / (2.0 * np.pi))

    def violation(self, q: np.ndarray) -> np.ndarray:
        """Return the most by which any joint is out of its limits [rad], shape (...)."""
        return np.maximum(np.maximum(self.lower - q, q - self.upper), 0.0).max(axis=-1)


class ExactIk:
    """The truth about one arm: 'panda', 'ur5e' or 'heron', with the tool and the limits that the model gives it."""

    def __init__(self, mjm: mujoco.MjModel, name: str) -> None:
        self.name = name
        self.screws = Screws.from_model(mjm, name, 7 if name == "panda" else 6)
        self._from_tcp = np.linalg.inv(np.linalg.inv(closed_forms.last_frame_at_zero(name)) @ self.screws.tcp)

    def reachable(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return for TCP poses, shape (N, 4, 4), in the base's frame: the truth, joints, and whether they are exact.

        Truth and exactness are bool, shape (N,); joints are (N, n), NaN where there are none.
        """
        found = np.full((len(poses), len(self.screws.lower)), np.nan)
        exact = np.zeros(len(poses), bool)
        for begin in range(0, len(poses), CHUNK):
            part = slice(begin, begin + CHUNK)
            found[part], exact[part] = self._chunk(poses[part])
        return ~np.isnan(found[:, 0]), found, exact

    def solutions(self, pose: np.ndarray) -> np.ndarray:
        """Return the exact solutions within limits for a pose (4, 4), shape (K, n): for six joints all, up to turns."""
        q, excess = next(self._branches(pose[None] @ self._from_tcp, SWEEPS[0]))
        q = self.screws.near_middle(q)
        return q[self.screws.violation(q) + excess < 1e-9]

    def _chunk(self, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = np.full((len(poses), len(self.screws.lower)), np.nan)
        left = np.arange(len(poses))
        q, score = np.empty((len(poses), 0, found.shape[1])), np.empty((len(poses), 0))
        for steps in SWEEPS if self.name == "panda" else (1,):
            q, score = self._closest(poses[left], steps)
            solved = score[:, 0] < 1e-9
            found[left[solved]] = q[solved, 0]
            left, q, score = left[~solved], q[~solved], score[~solved]
        exact = ~np.isnan(found[:, 0])
        far, off = self.screws.errors(poses[exact], found[exact])
        assert (far < 1e-6).all() and (off < 1e-6).all(), "a closed form is wrong"
        for k in range(min(CLOSEST, q.shape[1])):
            pending = np.flatnonzero(np.isnan(found[left, 0]))
            moved, ok = self._move(poses[left[pending]], q[pending, k])
            found[left[pending[ok]]] = moved[ok]
        return found, exact

    def _closest(self, poses: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return joints of the branches that violate least, (N, C, n), closest first, and by how much, (N, C)."""
        best_q, best_score = [], []
        for q, excess in self._branches(poses @ self._from_tcp, steps):
            q = self.screws.near_middle(q)
            score = self.screws.violation(q) + excess
            best = score.argmin(axis=1)[:, None]  # over a segment of the sweep; every branch for itself
            best_q.append(np.take_along_axis(q, best[..., None], axis=1)[:, 0])
            best_score.append(np.take_along_axis(score, best, axis=1)[:, 0])
        q, score = np.concatenate(best_q, axis=1), np.concatenate(best_score, axis=1)
        order = score.argsort(axis=1)
        return np.take_along_axis(q, order[..., None], axis=1), np.take_along_axis(score, order, axis=1)

    def _branches(self, last: np.ndarray, steps: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield branches, (N, S, C, n), and their excess, (N, S, C), of segments of the sweep with S steps each."""
        if self.name != "panda":
            q, excess = getattr(closed_forms, self.name)(last)
            yield q[:, None], excess[:, None]
            return
        for segment in np.array_split(np.linspace(self.screws.lower[6], self.screws.upper[6], steps), SEGMENTS):
            q, excess = closed_forms.panda(np.repeat(last, len(segment), axis=0), np.tile(segment, len(last)))
            shape = (len(last), len(segment))
            yield q.reshape(*shape, *q.shape[1:]), excess.reshape(*shape, q.shape[1])

    def _move(self, poses: np.ndarray, q: np.ndarray, iterations: int = 60) -> tuple[np.ndarray, np.ndarray]:
        """Move joints (M, n) within limits towards the poses within tolerance of those asked.

        Least squares of the distance to that set, in units of the tolerances. Returns joints, and who arrived.
        """
        q = np.clip(q, self.screws.lower, self.screws.upper)
        ok = np.zeros(len(q), bool)
        active = np.arange(len(q))
        unit = np.repeat([1.0 / POS_TOL, 1.0 / ROT_TOL], 3)
        for k in range(iterations):
            turn, at, jacobian = self.screws.forward(q[active])
            wanted = poses[active]
            e = unit * np.concatenate([wanted[:, :3, 3] - at, _rotation(turn, wanted)], axis=1)
            size = np.linalg.norm(e.reshape(-1, 2, 3), axis=2)
            arrived = (size < 1.0).all(axis=1)
            ok[active[arrived]] = True
            go = ~arrived & ((size.max(axis=1) < 30.0) | (k < 15))  # the others are not going to arrive
            active, e, size, jacobian = active[go], e[go], size[go], jacobian[go]
            if len(active) == 0:
                break
            beyond = np.maximum(1.0 - 0.999 / np.maximum(size, 1e-9), 0.0)
            e = e * np.repeat(beyond, 3, axis=1)
            jacobian = unit[:, None] * jacobian
            down = np.einsum("mij,mi->mj", jacobian, e)
            now = q[active]
            stuck = ((now <= self.screws.lower) & (down < 0.0)) | ((now >= self.screws.upper) & (down > 0.0))
            jacobian = np.where(stuck[:, None, :], 0.0, jacobian)
            damping = (1e-3 + 0.1 * (e * e).sum(axis=1))[:, None, None] * np.eye(6)
            y = np.linalg.solve(jacobian @ np.swapaxes(jacobian, 1, 2) + damping, e[..., None])
            step = (np.swapaxes(jacobian, 1, 2) @ y)[..., 0]
            step *= np.minimum(0.5 / np.maximum(np.abs(step).max(axis=1), 1e-12), 1.0)[:, None]
            q[active] = np.clip(now + step, self.screws.lower, self.screws.upper)
        return q, ok


def _rotation(turn: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return rotation vectors [rad] from orientations (M, 3, 3) to those of poses (M, 4, 4), shape (M, 3)."""
    delta = poses[:, :3, :3] @ np.swapaxes(turn, 1, 2)
    twice = np.stack(
        [delta[:, 2, 1] - delta[:, 1, 2], delta[:, 0, 2] - delta[:, 2, 0], delta[:, 1, 0] - delta[:, 0, 1]], axis=1
    )
    sine = 0.5 * np.linalg.norm(twice, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(delta, axis1=1, axis2=2) - 1.0))
    return 0.5 * twice * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[:, None]
