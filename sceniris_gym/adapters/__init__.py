"""Adapters for training libraries, each with an extra of its name."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, {"jax", "mjlab", "newton", "rsl_rl", "sb3"})
