"""Functions for all kernels: poses, angles, random numbers, thread blocks, and sequences of launches."""
