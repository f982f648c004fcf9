"""Check of the limits of fixed tendons: no draw of joints takes a tendon beyond its own."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.plan import Plan
from sceniris_gym.scene.couplings import extremes

# Rounding by which a tendon may leave its limits.
_ROUNDING = 1e-6


def has_active_limits(mjm: mujoco.MjModel, tendon: int) -> bool:
    """Return whether MuJoCo enforces limits of a tendon."""
    disabled = int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT) | int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    return bool(mjm.tendon_limited[tendon]) and not mjm.opt.disableflags & disabled


def tendon_joints(mjm: mujoco.MjModel, tendon: int) -> dict[int, float]:
    """Return the factors of a fixed tendon's joints, by joint id; none for a spatial one."""
    adr = int(mjm.tendon_adr[tendon])
    wraps = range(adr, adr + int(mjm.tendon_num[tendon]))
    return {
        int(mjm.wrap_objid[w]): float(mjm.wrap_prm[w]) for w in wraps if mjm.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT
    }


def check_tendon_limits(plan: Plan) -> None:
    """Check that drawn joints and their followers keep fixed tendons within their limits.

    A tendon that the start pose has beyond its limits may be as far beyond them, and no farther.

    Raises:
        SceneKeyError: A tendon that would leave its limits.
    """
    scene, mjm = plan.scene, plan.scene.mjm
    drawn = {d.qposadr: d.intervals for o in plan.objects for d in o.joint_ranges}
    # the drawn joint that moves each joint, and the joint's position as a polynomial of that of the drawn one
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
                "smaller ranges, or take the limits out."
            )


def _shares(factors: Mapping[int, float], moving: Mapping[int, tuple[int, np.poly1d]]) -> dict[int, np.poly1d]:
    """Return the part of a tendon's length that each drawn joint decides, as a polynomial of its position."""
    shares: dict[int, np.poly1d] = {}
    for adr in factors.keys() & moving.keys():
        root, position = moving[adr]
        shares[root] = shares.get(root, np.poly1d([0.0])) + factors[adr] * position
    return shares
