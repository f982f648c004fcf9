"""Packers: each turns a part of a Plan into flat arrays of the device."""
