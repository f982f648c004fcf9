"""Reach of an arm: forward and inverse kinematics, and maps that are built once and looked up at resets."""
