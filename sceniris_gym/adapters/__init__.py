"""Adapters for training libraries. Each needs the package extra of the same name, such as `sceniris-gym[jax]`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, {"jax", "mjlab", "newton", "rsl_rl", "sb3"})
