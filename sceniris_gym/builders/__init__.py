"""Assets that are built from drawn sizes."""
