"""The simulation: batches of worlds, the masked write of layouts, and the randomizer for your own mujoco_warp loop."""
