"""Reachability of an arm: forward and inverse kinematics, and precomputed maps that resets look up."""
