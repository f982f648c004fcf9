"""Packers: each converts a part of a Plan into flat device arrays."""
