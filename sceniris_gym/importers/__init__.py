"""Importers of foreign files: MuJoCo models, LIBERO problems, and objects as meshes, URDF or USD."""
