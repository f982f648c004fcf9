"""Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments.

`__init__.pyi` lists the public names. Each is imported on first use, so `import sceniris_gym` does not load torch, warp
or mujoco.
"""

import lazy_loader

from sceniris_gym import registration
from sceniris_gym.errors import new_name

__version__ = "0.2.0.dev0"
_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """Return a public name. For an old name, raise an error with the new name."""
    if new := new_name(name, [*__all__, "libero"]):
        raise ImportError(f"{__name__}:{new}")
    return _public(name)


registration.register_envs()
