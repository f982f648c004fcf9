"""Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments.

`__init__.pyi` lists the public names. Each is imported on first use, so `import sceniris_gym` does not load torch, warp
or mujoco.
"""

import lazy_loader

from sceniris_gym import errors, registration

__version__ = "0.2.0.dev0"
_MODULES = {"adapters", "cli", "config", "levels", "libero", "pictures", "reach"}  # `import *` leaves them out
_public, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = [name for name in _names if name not in _MODULES]  # pyrefly: ignore[unresolvable-dunder-all]


def _found(name: str) -> object:
    """Return a public object or module. For a class that only `errors` has, raise an ImportError with the full name."""
    if name.endswith(("Error", "Warning")) and name in vars(errors) and name not in __all__:
        raise ImportError(f"{__name__}: '{name}' is now errors.{name}.")
    return _public(name)


__getattr__ = errors.refuses_old_imports(__name__, _found)
registration.register_envs()
