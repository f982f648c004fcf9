"""Reads problem files of the LIBERO benchmark as scenes of this package."""
