"""Grasps of objects, and the gripper that performs them."""
