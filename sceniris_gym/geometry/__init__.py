"""The geometry of a scene: pieces of objects, support surfaces, stable poses, and trees of boxes."""
