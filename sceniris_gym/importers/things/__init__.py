"""The importer of things: a mesh, a URDF or a USD file becomes an asset that scenes can place."""
