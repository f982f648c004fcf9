"""Grasps of objects, and the gripper that they are for."""
