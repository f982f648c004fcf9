"""Reachability of an arm: forward and inverse kinematics, and precomputed maps that resets look up."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
