"""Simulation: batches of worlds, writers of layouts, and the randomizer for your own mujoco_warp loop."""

from sceniris_gym.collecting import uncollected

with uncollected():
    import mujoco_warp as mujoco_warp
