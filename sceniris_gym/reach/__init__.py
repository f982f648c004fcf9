"""Reach of an arm: forward and inverse kinematics, and maps that are built once and looked up at resets."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
