"""Cubes that start inside something in mjlab's multi-cube lifting task, as it comes and with `PlaceLayouts`.

    python -m benchmarks.mjlab_overlaps                # 2, 4 and 6 cubes, 10,000 resets each; needs the extra mjlab

MuJoCo C is the judge: of every reset the deepest contact of any cube with anything counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import torch
import tyro
from mjlab.envs import ManagerBasedRlEnv
from mjlab.tasks.manipulation.config.yam.env_cfgs import (
    yam_multi_cube_seg_env_cfg,
)

from sceniris_gym.adapters.mjlab import PlaceLayoutsCfg, keep_layouts

NUM_ENVS = 1000
MOST = 1e-4
"""Depth [m] from which a contact is an overlap."""


@dataclass(frozen=True)
class Arguments:
    """Cubes, resets and device of the measurement."""

    cubes: tuple[int, ...] = (2, 4, 6)
    resets: int = 10_000
    device: str = "cpu"


def make_cfg(cubes: int, num_envs: int, *, placed: bool):
    """Return the cfg of the task without its camera, with the objects where the task or the layouts place them."""
    cfg = yam_multi_cube_seg_env_cfg(num_cubes=cubes)
    cfg.scene.num_envs, cfg.seed = num_envs, 0
    cfg.scene.sensors = tuple(sensor for sensor in cfg.scene.sensors or () if sensor.name != "camera_d405")
    del cfg.observations["camera"]
    if placed:
        drawn = cfg.commands["lift_height"].object_pose_range  # of the task itself
        region = {"box": [[drawn.x[0], drawn.y[0]], [drawn.x[1], drawn.y[1]]]}
        objects = {f"cube_{i}": {"on": "terrain", "region": region} for i in range(cubes)}
        cfg.events["layouts"] = PlaceLayoutsCfg(scene={"objects": objects})
        cfg.commands["lift_height"] = keep_layouts(cfg.commands["lift_height"])
    return cfg


def depths(env: ManagerBasedRlEnv, cubes: int) -> list[float]:
    """Return the deepest contact [m] of any cube in each environment, by MuJoCo C."""
    mjm = env.sim.mj_model
    own = {mjm.body(f"cube_{i}/cube").id for i in range(cubes)}
    data, found = mujoco.MjData(mjm), []
    state = {name: getattr(env.sim.wp_data, name).numpy() for name in ("qpos", "mocap_pos", "mocap_quat")}
    for world in range(env.num_envs):
        for name, values in state.items():
            getattr(data, name)[:] = values[world]
        mujoco.mj_fwdPosition(mjm, data)
        found.append(max([0.0, *(-c.dist for c in data.contact if own & set(mjm.geom_bodyid[c.geom].tolist()))]))
    return found


def main(arguments: Arguments) -> None:
    """Print a row for each number of cubes, without and with layouts."""
    for cubes in arguments.cubes:
        for placed in (False, True):
            env = ManagerBasedRlEnv(make_cfg(cubes, NUM_ENVS, placed=placed), arguments.device)
            found, fallbacks = [], 0
            while len(found) < arguments.resets:
                env.reset()
                found += depths(env, cubes)
                fallbacks += int(env.extras.get("layout", {}).get("fallback", torch.zeros(1)).sum())
            overlaps = [depth for depth in found if depth > MOST]
            what = "PlaceLayouts" if placed else "as it comes"
            print(
                f"{cubes} cubes, {what}: {len(overlaps)} of {len(found)} resets overlap, deepest "
                f"{1000.0 * max(found):.2f} mm, {fallbacks} from the bank",
                flush=True,
            )
            env.close()


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=__doc__))
