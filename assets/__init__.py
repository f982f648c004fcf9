"""The shipped assets: an MJCF file per asset, the meshes, and the scripts that generate them."""
