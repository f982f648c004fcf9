"""Imports objects: converts a mesh, URDF or USD file into an asset that scenes can place."""
