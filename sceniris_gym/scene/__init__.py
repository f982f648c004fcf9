"""Scenes on the host: the MuJoCo model that is assembled from a scene file, and tables of its layouts."""
