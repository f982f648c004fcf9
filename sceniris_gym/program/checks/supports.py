"""Check of supports: they stand upright, have the cover that 'inside' asks for, and end somewhere."""

from __future__ import annotations

import numpy as np

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.surfaces import UPRIGHT


def check_supports(plan: Plan) -> None:
    """Check that objects can stand on what the scene file names as their support.

    Raises:
        NotSupportedError: A support that leans at home: surfaces are level in the frame of their body.
        SceneKeyError: An object inside the floor, or on an endless plane without a region.
    """
    config = plan.scene.config
    for o in plan.objects:
        if o.config.support is None or o.support is None:
            continue
        word, parent, region = o.config.support.word, o.config.support.parent, o.config.region
        where, up = f"{config.where}: {config.key(o.name)}.{word}", plan.scene.home.xmat[o.support.body][8]
        if o.support.is_floor and word == "inside":
            raise SceneKeyError(f"{where}: nothing covers the floor. Write 'on: floor'.")
        if up < UPRIGHT:
            lean = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
            raise NotSupportedError(
                f"{where}: the z axis of '{parent}' leans by {lean:.3g} degrees at home, and things are placed on "
                "level surfaces only. Give the support a body whose z axis points up."
            )
        is_endless = any(s.is_endless for surfaces in o.surfaces for s in surfaces)
        if is_endless and (region is None or region.fraction is not None):
            raise SceneKeyError(
                f"{where}: the plane '{parent}' is endless. Say where on it objects are placed, as in "
                f"{config.key(o.name)}.region: {{box: [[-0.3, -0.3], [0.3, 0.3]]}}."
            )
