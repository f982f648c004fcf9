"""The words of a scene file in one world, as device code."""
