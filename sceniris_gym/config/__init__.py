"""The scene language: the keys and values of a scene file, how the file is read, and its error messages."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
