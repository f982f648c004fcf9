"""Problem files of LIBERO, read as scenes of this package."""
