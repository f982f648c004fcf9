"""Training with PPO, on the tasks of this package and on your tasks."""

import lazy_loader

from sceniris_gym.errors import refuses_old_imports

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__getattr__ = refuses_old_imports(__name__, _public)
