"""Check of joints that follow drawn ones: they belong to the same object and stay within their limits."""

from __future__ import annotations

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.program.plan import Plan

# Rounding [m or rad] by which a joint may leave its limits.
_ROUNDING = 1e-6


def check_followers(plan: Plan) -> None:
    """Check that drawn joints move joints of their own object only, and none of these beyond its limits.

    Raises:
        NotSupportedError: A joint of another object would follow.
        SceneKeyError: A joint would leave its limits.
    """
    config, mjm = plan.scene.config, plan.scene.mjm
    for o in plan.objects:
        where, own = f"{config.where}: {config.key(o.name)}.joints", plan.scene.joints(o.name).values()
        spans = o.spans
        for c in o.followers:
            (low, high), (least, most) = spans[c.adr], c.limits
            follower, driver = (mjm.joint(j).name for j in (c.follower, c.driver))
            if c.follower not in own:
                raise NotSupportedError(
                    f"{where}: joint '{driver}' is drawn, and {c.label} makes joint '{follower}' follow it, which is "
                    f"not part of '{o.name}'. Make both part of one asset, leave '{driver}' out, or take the equality "
                    "out."
                )
            if low < least - _ROUNDING or high > most + _ROUNDING:
                raise SceneKeyError(
                    f"{where}: {c.label} makes joint '{follower}' follow '{driver}' to positions from {low:.4g} to "
                    f"{high:.4g}, which should be inside its limits [{least:g}, {most:g}]. Draw '{driver}' from a "
                    "smaller range."
                )
