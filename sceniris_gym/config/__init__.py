"""The scene language: what a scene file may say, how it is read, and what errors say about it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
