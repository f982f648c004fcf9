"""The reach stage of a reset: it follows placing, and finds joints for grasps of the tiers `ik` and `clear`."""
