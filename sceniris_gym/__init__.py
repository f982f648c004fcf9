"""Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments.

`__init__.pyi` lists the public names. Each is imported on first use, so `import sceniris_gym` does not load torch, warp
or mujoco.
"""

import lazy_loader

from sceniris_gym import registration

__version__ = "0.2.0.dev0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

registration.register_envs()
