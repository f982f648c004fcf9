"""Refusal of constraints that layouts would break: welds, connects and tendons that something drawn pulls at."""

from __future__ import annotations

import copy
from collections.abc import Iterable

import mujoco
import numpy as np

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.program.checks.tendon_limits import has_active_limits, tendon_joints
from sceniris_gym.scene.couplings import active_equalities, equality_label
from sceniris_gym.scene.model import SceneModel

KEPT = 1e-4
"""By how much [m or rad] the start pose may miss a constraint: keyframes are written with few digits."""

_LOOPS = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
_FLEXES = (mujoco.mjtEq.mjEQ_FLEX, mujoco.mjtEq.mjEQ_FLEXVERT, mujoco.mjtEq.mjEQ_FLEXSTRAIN)


def check_constraints(scene: SceneModel) -> None:
    """Check that every layout keeps the model's equalities, and does not stretch spatial tendons that would mind.

    Equalities of joints are not looked at: what they tie follows. Limits of fixed tendons are judged in
    `tendon_limits.py`, where it is known from what joints are drawn.

    Raises:
        NotSupportedError: A weld, connect or tendon that layouts would break, or that the start pose breaks.
    """
    drawn = _Drawn(scene)
    where, mjm = scene.config.where, scene.mjm
    checked = []
    for eq in active_equalities(mjm):
        kind, label = mujoco.mjtEq(int(mjm.eq_type[eq])), equality_label(mjm, eq)
        if kind in _LOOPS:
            _check_loop(where, label, drawn, *_ends(mjm, eq))
            checked.append(eq)
        elif kind == mujoco.mjtEq.mjEQ_TENDON:
            tendons = [int(t) for t in (mjm.eq_obj1id[eq], mjm.eq_obj2id[eq]) if t >= 0]
            _check_tendons(where, label, drawn, tendons)
            checked.append(eq)
        elif kind in _FLEXES:
            flex = int(mjm.eq_obj1id[eq])
            name = mujoco.mj_id2name(mjm, mujoco.mjtObj.mjOBJ_FLEX, flex) or flex
            raise NotSupportedError(
                f"{where}: {label}: flex '{name}' cannot be placed. Take it out, or use rigid bodies."
            )
    _check_start(scene, checked)
    for tendon in range(mjm.ntendon):
        _check_spatial(where, drawn, tendon)


class _Drawn:
    """What differs between layouts: poses of objects, drawn joints and what follows them.

    Attributes:
        mjm: The model.
        owner: The object or robot of each body, "world" for what belongs to none.
        joints: The joints that differ.
        above: What moves each body, as a set of joint ids and names of objects.
    """

    def __init__(self, scene: SceneModel) -> None:
        mjm = scene.mjm
        self.mjm = mjm
        self.joints = {joint for name in scene.bodies for joint in scene.moving_joints(name)}
        self.owner = ["world"] * mjm.nbody
        for name in scene.bodies:
            for body in scene.subtree(name):
                self.owner[body] = name
        roots = {root: name for name, root in scene.bodies.items()}
        self.above: list[frozenset[int | str]] = [frozenset()]
        for body in range(1, mjm.nbody):
            own: set[int | str] = {joint for joint in _joints_of(mjm, body) if joint in self.joints}
            name = roots.get(body)
            if name in scene.config.parts and scene.config.parts[name].is_placed:
                own.add(name)
            self.above.append(self.above[mjm.body_parentid[body]] | own)

    def apart(self, bodies: Iterable[int]) -> frozenset[int | str]:
        """What moves some of the bodies, but not all of them."""
        sets = [self.above[body] for body in bodies]
        return frozenset.union(*sets) - frozenset.intersection(*sets) if sets else frozenset()

    def names(self, joints: Iterable[int | str]) -> str:
        """Joints as errors name them."""
        return ", ".join(f"'{self.mjm.joint(j).name}'" for j in sorted(j for j in joints if isinstance(j, int)))


def _check_loop(where: str, label: str, drawn: _Drawn, a: int, b: int) -> None:
    """Check a weld or a connect of two bodies."""
    apart = drawn.apart((a, b))
    if not apart:
        return
    first, second = (drawn.mjm.body(body).name for body in (a, b))
    if drawn.owner[a] != drawn.owner[b]:
        raise NotSupportedError(
            f"{where}: {label} ties body '{first}' to body '{second}', but layouts draw the pose of one without the "
            f"other ({_owners(drawn, a, b)}). Take the equality out, or make both parts of one asset."
        )
    raise NotSupportedError(
        f"{where}: {label} ties body '{first}' to body '{second}', and drawing {drawn.names(apart)} would break it. "
        f"Leave these joints out of the 'joints' of '{drawn.owner[a]}', or take the equality out."
    )


def _check_tendons(where: str, label: str, drawn: _Drawn, tendons: list[int]) -> None:
    """Check the equality of one or two tendons."""
    names = " and ".join(f"'{drawn.mjm.tendon(t).name}'" for t in tendons)
    moving = frozenset[int | str]().union(*(_stretched_by(drawn, t) for t in tendons))
    joints = drawn.names(moving)
    what = f"joints {joints}" if joints else "the poses of " + _quoted({str(name) for name in moving})
    if moving:
        raise NotSupportedError(
            f"{where}: {label} of tendon {names} would be broken by drawing {what}. Leave that out of the scene file, "
            "or couple the joints by <equality><joint>, which layouts follow."
        )


def _check_spatial(where: str, drawn: _Drawn, tendon: int) -> None:
    """Check that a spatial tendon is not stretched by draws if it has limits, nor between objects if it is a spring."""
    mjm = drawn.mjm
    limited, springs = has_active_limits(mjm, tendon), not mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_SPRING
    stretched = drawn.apart(_bodies_of(mjm, tendon))
    pulls = limited or (springs and bool(np.any(mjm.tendon_stiffness[tendon])))
    if tendon_joints(mjm, tendon) or not stretched or not pulls:
        return
    owners, name = {drawn.owner[body] for body in _bodies_of(mjm, tendon)}, mjm.tendon(tendon).name
    if len(owners) > 1:
        raise NotSupportedError(
            f"{where}: tendon '{name}' has limits or stiffness and runs between {_quoted(owners)}, which layouts draw "
            "apart from each other. Take it out, or make all of them parts of one asset."
        )
    if limited:
        raise NotSupportedError(
            f"{where}: tendon '{name}' is spatial and has limits, and drawing {drawn.names(stretched)} changes its "
            f"length. Leave these joints out of the 'joints' of {_quoted(owners)}, or take the limits out."
        )


def _check_start(scene: SceneModel, equalities: list[int]) -> None:
    """Check that the start pose keeps equalities, by MuJoCo's own account."""
    if not equalities:
        return
    alone = copy.copy(scene.mjm)
    alone.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)  # things may lie on top of each other
    data = mujoco.MjData(alone)
    data.qpos[:] = scene.home_qpos
    mujoco.mj_fwdPosition(alone, data)
    for eq in equalities:
        rows = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (data.efc_id == eq)
        missed = float(np.abs(data.efc_pos[rows]).max(initial=0.0))
        if missed > KEPT:
            raise NotSupportedError(
                f"{scene.config.where}: {equality_label(alone, eq)} is missed by {missed:.3g} m or rad in the start "
                f"pose, and should be kept to {KEPT:g}. Correct the keyframe 'home', or take the equality out."
            )


def _ends(mjm: mujoco.MjModel, eq: int) -> tuple[int, int]:
    """The two bodies of a weld or a connect."""
    ends = int(mjm.eq_obj1id[eq]), int(mjm.eq_obj2id[eq])
    if mjm.eq_objtype[eq] == mujoco.mjtObj.mjOBJ_SITE:
        return int(mjm.site_bodyid[ends[0]]), int(mjm.site_bodyid[ends[1]])
    return ends


def _stretched_by(drawn: _Drawn, tendon: int) -> frozenset[int | str]:
    """What changes the length of a tendon: drawn joints, or poses of objects."""
    joints = tendon_joints(drawn.mjm, tendon)
    if joints:
        return frozenset(drawn.joints.intersection(joints))
    return drawn.apart(_bodies_of(drawn.mjm, tendon))


def _bodies_of(mjm: mujoco.MjModel, tendon: int) -> list[int]:
    """The bodies that a spatial tendon runs along."""
    wrap = mujoco.mjtWrap
    sites = _wrapped(mjm, tendon, wrap.mjWRAP_SITE)
    geoms = _wrapped(mjm, tendon, wrap.mjWRAP_SPHERE) + _wrapped(mjm, tendon, wrap.mjWRAP_CYLINDER)
    return [int(b) for b in (*mjm.site_bodyid[sites], *mjm.geom_bodyid[geoms])]


def _wrapped(mjm: mujoco.MjModel, tendon: int, kind: mujoco.mjtWrap) -> list[int]:
    adr = int(mjm.tendon_adr[tendon])
    wraps = range(adr, adr + int(mjm.tendon_num[tendon]))
    return [int(mjm.wrap_objid[w]) for w in wraps if mjm.wrap_type[w] == kind]


def _joints_of(mjm: mujoco.MjModel, body: int) -> range:
    return range(int(mjm.body_jntadr[body]), int(mjm.body_jntadr[body] + mjm.body_jntnum[body]))


def _owners(drawn: _Drawn, a: int, b: int) -> str:
    return " and ".join(f"'{drawn.owner[body]}'" for body in (a, b))


def _quoted(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in sorted(names))
