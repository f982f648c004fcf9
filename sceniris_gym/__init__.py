"""Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments.

The public names are those of `__init__.pyi`, imported on first use: `import sceniris_gym` loads neither torch, warp nor
mujoco.
"""

import lazy_loader

from sceniris_gym import registration

__version__ = "0.2.0.dev0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

registration.register_envs()
