"""Anything that any kernel may use: poses, random numbers, launches."""
