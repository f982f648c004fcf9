"""Checks of constraints that layouts could break: welds, connects, spatial tendons, and limits of fixed tendons."""

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.program.device import ObjectKind
from sceniris_gym.program.plan import Plan
from sceniris_gym.reach.arm import joined_bodies
from sceniris_gym.scene.couplings import active_equalities, equality_errors, equality_label, extremes

KEPT = 1e-4
"""Greatest allowed error [m or rad] of an equality in the start pose. Keyframes in files are rounded to few digits."""

_FLEXES = (mujoco.mjtEq.mjEQ_FLEX, mujoco.mjtEq.mjEQ_FLEXVERT, mujoco.mjtEq.mjEQ_FLEXSTRAIN)
# Tolerance of a tendon's limits for rounding.
_ROUNDING = 1e-6


def check_constraints(plan: Plan) -> None:
    """Check that every layout keeps the model's equalities, and the lengths of limited and stiff spatial tendons.

    Equalities of joints need no check, because a layout moves the coupled joints together. `check_tendon_limits` checks
    the limits of fixed tendons.

    Raises:
        NotSupportedError: Layouts or the start pose would break a weld, a connect or a tendon.
    """
    drawn, where, mjm = _Drawn(plan), plan.scene.config.where, plan.scene.mjm
    (missed,) = equality_errors(mjm, plan.scene.home_qpos[None])
    for eq in active_equalities(mjm):
        kind, label = mujoco.mjtEq(int(mjm.eq_type[eq])), f"{where}: {equality_label(mjm, eq)}"
        if bodies := joined_bodies(mjm, eq):
            _check_loop(label, drawn, *bodies)
        elif kind == mujoco.mjtEq.mjEQ_TENDON:
            tendons = [int(t) for t in (mjm.eq_obj1id[eq], mjm.eq_obj2id[eq]) if t >= 0]
            names = " and ".join(f"'{mjm.tendon(t).name}'" for t in tendons)
            moving = frozenset[int | str]().union(*(drawn.stretching(t) for t in tendons))
            joints = drawn.names(moving)
            what = f"joints {joints}" if joints else "the poses of " + _quoted({str(name) for name in moving})
            if moving:
                raise NotSupportedError(
                    f"{label} of tendon {names} would be broken by drawing {what}. Remove these draws from the scene "
                    "file, or replace the equality by an <equality><joint>, which layouts can keep."
                )
        elif kind in _FLEXES:
            flex = int(mjm.eq_obj1id[eq])
            name = mujoco.mj_id2name(mjm, mujoco.mjtObj.mjOBJ_FLEX, flex) or flex
            raise NotSupportedError(f"{label}: flex '{name}' cannot be placed. Replace the flex by rigid bodies.")
        if kind != mujoco.mjtEq.mjEQ_JOINT and missed[eq] > KEPT:
            raise NotSupportedError(
                f"{label} is violated by {missed[eq]:.3g} m or rad in the start pose, which "
                f"should be at most {KEPT:g}. Correct the keyframe 'home', or remove the equality."
            )
    for tendon in range(mjm.ntendon):
        _check_spatial(where, drawn, tendon)


class _Drawn:
    """The movers of a plan: placed objects, drawn joints, and joints that follow drawn joints.

    A mover changes the poses of bodies from layout to layout.

    Attributes:
        mjm: The model.
        owners: The object or robot that contains a body, or "world", by body id.
        joints: Ids of the drawn and following joints.
        above: For each body, the movers that change the body's pose, as joint ids and object names.
    """

    def __init__(self, plan: Plan) -> None:
        self.mjm = mjm = plan.scene.mjm
        self.owners = dict.fromkeys(range(mjm.nbody), "world") | plan.scene.owners
        self.joints = {joint for o in plan.objects for joint in plan.scene.moving_joints(o.name)}
        placed = {o.bodies[0]: o.name for o in plan.objects if o.kind != ObjectKind.STATIC}
        self.above: list[frozenset[int | str]] = [frozenset()]
        for body in range(1, self.mjm.nbody):
            adr, num = int(self.mjm.body_jntadr[body]), int(self.mjm.body_jntnum[body])
            own: set[int | str] = {joint for joint in range(adr, adr + num) if joint in self.joints}
            if body in placed:
                own.add(placed[body])
            self.above.append(self.above[self.mjm.body_parentid[body]] | own)

    def apart(self, bodies: Iterable[int]) -> frozenset[int | str]:
        """Return the movers that move some of the bodies, but not all of them."""
        sets = [self.above[body] for body in bodies]
        return frozenset.union(*sets) - frozenset.intersection(*sets) if sets else frozenset()

    def stretching(self, tendon: int) -> frozenset[int | str]:
        """Return the movers that change the length of a tendon."""
        joints = tendon_joints(self.mjm, tendon)
        return frozenset(self.joints.intersection(joints)) if joints else self.apart(_bodies_of(self.mjm, tendon))

    def names(self, joints: Iterable[int | str]) -> str:
        """Return the quoted names of the joints in `joints`, without the objects, for errors."""
        return ", ".join(f"'{self.mjm.joint(j).name}'" for j in sorted(j for j in joints if isinstance(j, int)))


def _check_loop(label: str, drawn: _Drawn, a: int, b: int) -> None:
    """Check that layouts do not move the two bodies of a weld or a connect relative to each other."""
    apart = drawn.apart((a, b))
    if not apart:
        return
    first, second = (drawn.mjm.body(body).name for body in (a, b))
    if drawn.owners[a] != drawn.owners[b]:
        raise NotSupportedError(
            f"{label} ties body '{first}' to body '{second}', but layouts move them separately, because they belong to "
            f"'{drawn.owners[a]}' and '{drawn.owners[b]}'. Remove the equality, or make both bodies parts of one asset."
        )
    raise NotSupportedError(
        f"{label} ties body '{first}' to body '{second}', but drawing {drawn.names(apart)} would break it. Leave these "
        f"joints out of the 'joints' of '{drawn.owners[a]}', or remove the equality."
    )


def _check_spatial(where: str, drawn: _Drawn, tendon: int) -> None:
    """Check that layouts do not stretch a spatial tendon that is limited, or stiff and between two objects."""
    mjm = drawn.mjm
    limited, springs = has_active_limits(mjm, tendon), not mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_SPRING
    stretched = drawn.stretching(tendon)
    pulls = limited or (springs and bool(np.any(mjm.tendon_stiffness[tendon])))
    if tendon_joints(mjm, tendon) or not stretched or not pulls:
        return
    owners, name = {drawn.owners[body] for body in _bodies_of(mjm, tendon)}, mjm.tendon(tendon).name
    if len(owners) > 1:
        raise NotSupportedError(
            f"{where}: tendon '{name}' has limits or stiffness and runs between {_quoted(owners)}, which layouts move "
            "separately. Remove the tendon, or make these objects parts of one asset."
        )
    if limited:
        raise NotSupportedError(
            f"{where}: tendon '{name}' is spatial and has limits, and drawing {drawn.names(stretched)} changes its "
            f"length. Leave these joints out of the 'joints' of {_quoted(owners)}, or remove the limits."
        )


def _bodies_of(mjm: mujoco.MjModel, tendon: int) -> list[int]:
    """Return the bodies along a spatial tendon."""
    wrap, adr, num = mujoco.mjtWrap, int(mjm.tendon_adr[tendon]), int(mjm.tendon_num[tendon])
    kinds, ids = mjm.wrap_type[adr : adr + num], mjm.wrap_objid[adr : adr + num]
    geoms = ids[np.isin(kinds, [int(wrap.mjWRAP_SPHERE), int(wrap.mjWRAP_CYLINDER)])]
    return [*mjm.site_bodyid[ids[kinds == wrap.mjWRAP_SITE]].tolist(), *mjm.geom_bodyid[geoms].tolist()]


def _quoted(names: Iterable[str]) -> str:
    """Return quoted names for errors."""
    return ", ".join(f"'{name}'" for name in sorted(names))


def has_active_limits(mjm: mujoco.MjModel, tendon: int) -> bool:
    """Return whether a tendon has limits that MuJoCo enforces."""
    disabled = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    return bool(mjm.tendon_limited[tendon]) and not mjm.opt.disableflags & disabled


def tendon_joints(mjm: mujoco.MjModel, tendon: int) -> dict[int, float]:
    """Return the coefficients of a fixed tendon by joint id. For a spatial tendon, the dict is empty."""
    adr = int(mjm.tendon_adr[tendon])
    wraps = range(adr, adr + int(mjm.tendon_num[tendon]))
    return {
        int(mjm.wrap_objid[w]): float(mjm.wrap_prm[w]) for w in wraps if mjm.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT
    }


def check_tendon_limits(plan: Plan) -> None:
    """Check that drawn joints and their followers keep each fixed tendon within the tendon's limits.

    If a tendon is already beyond a limit in the start pose, draws may take it as far beyond as the start pose does.

    Raises:
        SceneKeyError: Draws would take a tendon beyond its limits.
    """
    scene, mjm = plan.scene, plan.scene.mjm
    drawn = {d.qposadr: d.intervals for o in plan.objects for d in o.joint_ranges}
    # for each moving joint, the drawn joint that moves it, and its position as a polynomial of that joint's position
    moving = {adr: (adr, np.poly1d([1.0, 0.0])) for adr in drawn}
    for c in (c for o in plan.objects for c in o.followers):
        root, position = moving[c.driver_adr]
        moving[c.adr] = root, np.poly1d((*reversed(c.coef), c.offset))(position - c.origin)
    for tendon in range(mjm.ntendon):
        factors = {int(mjm.jnt_qposadr[j]): factor for j, factor in tendon_joints(mjm, tendon).items()}
        shares, lengths = _shares(factors, moving), {adr: f * scene.home_qpos[adr] for adr, f in factors.items()}
        if not has_active_limits(mjm, tendon) or not shares:
            continue
        parts = [[extremes(share, *part) for part in drawn[root]] for root, share in shares.items()]
        ends = [(min(low for low, _ in found), max(high for _, high in found)) for found in parts]
        still, home = sum(lengths[adr] for adr in lengths.keys() - moving.keys()), sum(lengths.values())
        low, high = (still + sum(bounds) for bounds in zip(*ends, strict=True))
        least, most = mjm.tendon_range[tendon]
        if low < min(least, home) - _ROUNDING or high > max(most, home) + _ROUNDING:
            names = ", ".join(f"'{mjm.joint(j).name}'" for j in range(mjm.njnt) if mjm.jnt_qposadr[j] in shares)
            raise SceneKeyError(
                f"{scene.config.where}: drawing {names} would make tendon '{mjm.tendon(tendon).name}' {low:.4g} to "
                f"{high:.4g} long, which should be inside its limits [{least:g}, {most:g}]. Draw these joints from "
                "smaller ranges, or remove the limits of the tendon."
            )


def _shares(factors: Mapping[int, float], moving: Mapping[int, tuple[int, np.poly1d]]) -> dict[int, np.poly1d]:
    """Return the contribution of each drawn joint to a tendon's length, as a polynomial of the joint's position."""
    shares: dict[int, np.poly1d] = {}
    for adr in factors.keys() & moving.keys():
        root, position = moving[adr]
        shares[root] = shares.get(root, np.poly1d([0.0])) + factors[adr] * position
    return shares
