"""Data sets of layouts on disk: parts that many processes write, and that are read back through memory maps."""
