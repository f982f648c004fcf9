"""Other people's files, read as scenes of this package."""
