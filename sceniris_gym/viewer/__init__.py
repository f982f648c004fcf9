"""Scenes, layouts and policies in the browser. viser makes the page, and mjviser draws the worlds."""
