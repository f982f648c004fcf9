"""Arms that tests of reach/ read: the assets, and small ones written here for what those do not have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from sceniris_gym.reach.arm import SerialArm

ASSETS = Path(__file__).parents[2] / "assets"
INERTIA = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'


def model(*, base: str = "", chain: str, extra: str = "") -> mujoco.MjModel:
    """Compile an arm whose base body 'base' has the attributes and content given; `extra` is outside the world."""
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><worldbody><body name="base" {base}>{chain}</body></worldbody>'
        f"{extra}</mujoco>"
    )


def link(content: str, **attributes: str) -> str:
    """Write a body with a mass."""
    words = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    return f"<body {words}>{INERTIA}{content}</body>"


def hinge(axis: str = "0 0 1", range: str | None = "-2 2", **attributes: str) -> str:
    """Write a hinge, limited unless `range` is None."""
    return _joint("hinge", axis, range, attributes)


def slide(axis: str = "0 0 1", range: str | None = "-0.3 0.4", **attributes: str) -> str:
    """Write a slide, limited unless `range` is None."""
    return _joint("slide", axis, range, attributes)


def site(pos: str = "0 0 0.1", **attributes: str) -> str:
    """Write the TCP."""
    words = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    return f'<site name="tcp" pos="{pos}" {words}/>'


def _joint(kind: str, axis: str, range: str | None, attributes: dict[str, str]) -> str:
    words = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    limits = f'range="{range}"' if range else ""
    return f'<joint type="{kind}" axis="{axis}" {words} {limits}/>'


def _asset(name: str) -> tuple[mujoco.MjModel, str]:
    return mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml")), name


def _gantry() -> tuple[mujoco.MjModel, str]:
    """Three slides in one body, references, joints off their body's origin, a base that is turned and moved."""
    wrist = link(
        hinge("0 0 1", "-3 3", ref="0.3")
        + link(
            hinge("0 1 0.2", "-1.5 1.5", pos="0 0.02 0") + link(hinge("1 0 0") + site(quat="0 1 0 0"), pos="0 0 -0.1"),
            pos="0 0.05 -0.1",
            quat="0.9 0.1 0.3 -0.2",
        ),
        pos="0 0 -0.1",
    )
    rails = slide("1 0 0") + slide("0 1 0", "-0.2 0.6", ref="0.1") + slide("0 0.1 -1", "0 0.7", pos="0.3 0 0")
    base = 'mocap="true" pos="0.4 -0.2 0.7" quat="0.5 0.1 -0.7 0.2"'
    return model(base=base, chain=link(rails + wrist, pos="0.1 0 0.9", quat="0.8 0 0.3 0")), "base"


def _universal() -> tuple[mujoco.MjModel, str]:
    """Two and three hinges in a body, one with a reference and all but one off the body's origin."""
    shoulder = hinge("0 0 1", pos="0.02 0 0", ref="-0.4") + hinge("0 1 0", pos="0 0 0.05")
    wrist = hinge("1 0 0", pos="0 0.01 0") + hinge("0 1 0", pos="0.01 0 0", ref="0.7") + hinge("0 0.6 0.8")
    return model(
        base='pos="1 2 3" quat="0 1 0 0"', chain=link(shoulder + link(wrist + site(), pos="0.3 0 0.2"))
    ), "base"


def _endless() -> tuple[mujoco.MjModel, str]:
    """A SCARA on a base that moves freely; its first and last hinge have no limits."""
    hand = link(hinge("0 0 1", None) + site(quat="0 1 0 0"))
    arm = link(
        hinge("0 0 1", None)
        + link(hinge(range="-2.5 2.5") + link(slide("0 0 -1", "0 0.3") + hand, pos="0.25 0 0"), pos="0.3 0 0"),
        pos="0 0 0.4",
    )
    return model(chain="<freejoint/>" + INERTIA + arm), "base"


def _rooted() -> tuple[mujoco.MjModel, str]:
    """A hinge and a slide in the root body itself, which is placed and turned."""
    root = hinge(pos="0.01 0 0", ref="0.2") + slide() + INERTIA
    return model(
        base='pos="1 2 3" quat="0.8 0.1 0 -0.5"', chain=root + link(hinge("0 1 0") + site(), pos="0.3 0 0")
    ), "base"


MODELS: dict[str, Callable[[], tuple[mujoco.MjModel, str]]] = {
    "panda": lambda: _asset("panda"),
    "ur5e": lambda: _asset("ur5e"),
    "heron": lambda: _asset("heron"),
    "gantry": _gantry,
    "universal": _universal,
    "endless": _endless,
    "rooted": _rooted,
}
"""Makers of models, each with the name of its base body; the TCP is the site 'tcp'."""


def tcp_poses(mjm: mujoco.MjModel, arm: SerialArm, joints: np.ndarray) -> np.ndarray:
    """Return MuJoCo's poses of the TCP in the base's frame at joints (N, n), shape (N, 4, 4)."""
    data = mujoco.MjData(mjm)
    poses = np.tile(np.eye(4), (len(joints), 1, 1))
    for pose, q in zip(poses, joints, strict=True):
        data.qpos[arm.qposadr] = q
        mujoco.mj_kinematics(mjm, data)
        base = data.xmat[arm.base_body].reshape(3, 3)
        pose[:3, :3] = base.T @ data.site_xmat[arm.tcp_site].reshape(3, 3)
        pose[:3, 3] = base.T @ (data.site_xpos[arm.tcp_site] - data.xpos[arm.base_body])
    return poses
