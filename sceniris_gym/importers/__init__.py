"""Importers of what was made for other programs: scenes of other packages, and things as meshes, URDF and USD."""
