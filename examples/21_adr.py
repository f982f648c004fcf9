"""Automatic domain randomisation: the region of a cube grows while episodes at its edges succeed."""

import mujoco
import tyro

import sceniris_gym
from sceniris_gym import ADR

NAME = "objects.cube.region"
MJCF = """
<mujoco>
  <worldbody>
    <light pos="0 -1 3" dir="0 .3 -1"/>
    <geom name="ground" type="plane" size=".6 .6 .1" rgba=".7 .7 .7 1"/>
    <body name="cube" pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05" mass=".1" rgba=".9 .5 .1 1"/></body>
  </worldbody>
</mujoco>
"""
OBJECTS = {"cube": {"on": "ground", "region": {"box": [[-0.4, -0.4], [0.4, 0.4]]}}}


class Near(sceniris_gym.Task):
    """Task that succeeds if the cube is at most 0.2 m from the origin along x, at any place along y."""

    def apply(self, s: sceniris_gym.State, action) -> None:
        """Ignore actions: the task has no actuators."""

    def observe(self, s: sceniris_gym.State):
        """Return the pose of the cube."""
        return {"policy": {"cube": s.pose("cube")}}

    def reward(self, s: sceniris_gym.State, action):
        """Return a reward of 0."""
        return {"near": 0.0 * s.pose("cube")[:, 0]}

    def success(self, s: sceniris_gym.State):
        """Return in which worlds the cube is near enough, shape (num_envs,), bool."""
        return s.pose("cube")[:, 0].abs() < 0.2


def main(num_envs: int = 256, steps: int = 200, device: str | None = None) -> None:
    """Take steps in all worlds, and print the growing region."""
    scene = {"model": mujoco.MjSpec.from_string(MJCF), "objects": OBJECTS}
    adr = ADR({NAME: [[-0.05, -0.05], [0.05, 0.05]]}, delta=0.05, boundary_fraction=1.0, queue_length=64)
    kwargs = {"scene": scene, "device": device, "max_episode_steps": 2, "curriculum": adr}
    envs = sceniris_gym.SceneVectorEnv(Near, num_envs, **kwargs)
    sampler = envs.randomizer.levels
    assert sampler is not None
    envs.reset(seed=0)
    for step in range(steps):
        envs.step(envs.action_space.sample())
        if step % (steps // 4) == 0 or step == steps - 1:
            low_x, low_y, high_x, high_y = sampler.ranges[NAME]
            print(f"step {step}: x from {low_x:.2f} to {high_x:.2f} m, y from {low_y:.2f} to {high_y:.2f} m")


if __name__ == "__main__":
    tyro.cli(main)
