"""How things are held: what a gripper can do, and grasps for it."""
