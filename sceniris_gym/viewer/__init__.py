"""Scenes, layouts and policies in the browser: a page made with viser, of worlds that mjviser draws."""
