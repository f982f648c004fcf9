"""Data sets of layouts on disk. Many processes write the parts, and readers map them into memory."""
