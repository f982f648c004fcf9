"""First images of 10,000 episodes against rays of MuJoCo C, and images of the same episodes in other batches.

python -m tests.stress.first_images --device cpu                     # some minutes
python -m tests.stress.first_images --device cuda:0 --resets 10000

prints how many first images show their own layout and how many the layout before, then the share of pixels that differ
between the same episodes in batches of other sizes and orders. The first has to be all of them, the second nearly none.
"""

from __future__ import annotations

import argparse
import json

import mujoco
import numpy as np
import torch
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.vector.vector_env import SceneVectorEnv

TASK = "sceniris_gym.envs.tabletop_reach_pixels:TabletopReachPixels"
CAMERA, SIZE = "front", (16, 16)
IMAGES = {CAMERA: {"size": SIZE, "data": ("rgb", "depth", "segmentation")}}
WORLDS, STEPS = 500, 100
CLOSE, LEAST = 0.004, 0.96
"""Error of a depth that counts as the same [m], and the least share of the pixels: rays at edges may differ."""


class Rays:
    """Depths of a picture by MuJoCo C."""

    def __init__(self, mjm: mujoco.MjModel) -> None:
        self.mjm, self.data, self.camera = mjm, mujoco.MjData(mjm), mjm.camera(CAMERA).id
        width, height = SIZE
        edge = np.tan(np.radians(mjm.cam_fovy[self.camera]) / 2.0) / (height / 2.0)
        y, x = np.divmod(np.arange(width * height), width)
        rays = np.stack([(x + 0.5 - width / 2) * edge, (height / 2 - y - 0.5) * edge, -np.ones(len(x))], axis=1)
        self.lengths = np.linalg.norm(rays, axis=1)
        self.rays = rays / self.lengths[:, None]
        self.groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)

    def depths(self, qpos: np.ndarray) -> np.ndarray:
        """Return the depth of each pixel in a state [m], 0 where nothing is, shape (pixels,)."""
        d, count = self.data, len(self.rays)
        d.qpos[:] = qpos
        mujoco.mj_kinematics(self.mjm, d)
        mujoco.mj_camlight(self.mjm, d)
        turned = self.rays @ d.cam_xmat[self.camera].reshape(3, 3).T
        hit, far = np.zeros(count, np.int32), np.zeros(count)
        for i, ray in enumerate(turned):
            far[i] = mujoco.mj_ray(self.mjm, d, d.cam_xpos[self.camera], ray, self.groups, 1, -1, hit[:1], None)
        return np.where(far >= 0.0, far / self.lengths, 0.0)


def first_images(envs: SceneVectorEnv, resets: int) -> dict[str, int]:
    """Let all worlds end their episodes again and again, and compare the first image of each new one."""
    rays = Rays(envs.compiled.mjm)
    envs.reset(seed=0)
    action = torch.zeros(envs.action_space.shape, device=envs.device)  # pyrefly: ignore[no-matching-overload]
    found = {"first images": 0, "show their layout": 0, "show the layout before": 0}
    before = envs.batch.data.qpos.numpy()
    while found["first images"] < resets:
        envs.state.elapsed.fill_(STEPS - 1)
        observation, *_, truncated, _ = envs.step(action)
        assert truncated.all()
        qpos = envs.batch.data.qpos.numpy()
        seen = observation["images"][CAMERA]["depth"].cpu().numpy().reshape(envs.num_envs, -1)
        for i in range(envs.num_envs):
            shown, stale = (np.mean(np.abs(seen[i] - rays.depths(q[i])) < CLOSE) for q in (qpos, before))
            found["first images"] += 1
            found["show their layout"] += int(shown >= LEAST)
            found["show the layout before"] += int(stale >= LEAST and stale > shown)
        before = qpos
    return found


def other_batches(envs: SceneVectorEnv, other: SceneVectorEnv) -> dict[str, float]:
    """Return the share of pixels of each kind that differ where the same episodes run in another batch and order."""
    seeds = np.arange(other.num_envs)
    first = envs.reset(seed=list(range(envs.num_envs)))[0]["images"][CAMERA]
    other.reset(seed=[int(seed) + 10_000 for seed in seeds])
    order = np.random.default_rng(0).permutation(seeds)
    for part in np.array_split(order, 7):
        mask = np.isin(seeds, part)
        second = other.reset(seed=[int(order[i]) for i in seeds], options={"reset_mask": mask})[0]["images"][CAMERA]
    rows = torch.from_numpy(order).to(envs.device)
    # pyrefly: ignore[unbound-name]
    return {kind: float((first[kind][rows] != second[kind]).any(dim=3).float().mean()) for kind in first}


def main() -> None:
    """Print both lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--resets", type=int, default=10_000)
    words = parser.parse_args()
    wp.config.quiet = True
    compiled = compile_scene("tabletop_reach", words.device)
    envs, other = (
        SceneVectorEnv(
            TASK,
            worlds,
            scene=compiled,
            images=IMAGES,
            max_episode_steps=STEPS,
            sim_config={"nconmax": 40, "njmax": 160},
        )
        for worlds in (WORLDS, WORLDS // 3)
    )
    print(json.dumps({"device": words.device, **first_images(envs, words.resets)}), flush=True)
    print(json.dumps({"device": words.device, "pixels that differ": other_batches(envs, other)}), flush=True)


if __name__ == "__main__":
    main()
