"""Writes a first scene file for a MuJoCo model: `sceniris-gym init`."""
