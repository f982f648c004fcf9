"""Checks of a scene before it is uploaded."""
