"""Checks of a scene, all of which run before it is uploaded."""
