"""The shipped assets: one MJCF file each, their meshes, and the scripts that made them."""
