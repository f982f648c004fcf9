"""Equalities of joints and bodies, as plans and devices take them."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from sceniris_gym.scene.couplings import Coupling


def joined_bodies(mjm: mujoco.MjModel, eq: int) -> tuple[int, ...]:
    """Return the two bodies that a weld or a connect joins; none for other equalities."""
    if mujoco.mjtEq(int(mjm.eq_type[eq])) not in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        return ()
    ends = [int(mjm.eq_obj1id[eq]), int(mjm.eq_obj2id[eq])]
    is_site = mjm.eq_objtype[eq] == mujoco.mjtObj.mjOBJ_SITE
    return tuple(mjm.site_bodyid[ends].tolist() if is_site else ends)


def coupling_arrays(couplings: Sequence[Coupling]) -> dict[str, np.ndarray]:
    """Return the fields `follow_*` of a device struct."""
    return {
        "follow_driveradr": np.array([c.driver_adr for c in couplings], int),
        "follow_qposadr": np.array([c.adr for c in couplings], int),
        "follow_coef": np.reshape([(c.origin, c.offset, *c.coef) for c in couplings], (-1, 6)).astype(float),
    }
