"""Importers of files of other programs: models, scenes of other packages, and things as meshes, URDF and USD."""
