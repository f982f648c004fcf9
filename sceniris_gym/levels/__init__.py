"""Curricula over layouts, which run on the device. `LevelReplay` replays levels, and `ADR` moves intervals of params.

A level is one layout, identified by its seed, episode and params. Each reset either replays a level from a buffer or
takes a fresh level. This is prioritized level replay (M. Jiang, E. Grefenstette, T. Rocktaeschel, "Prioritized Level
Replay", ICML 2021). The score of a level sets how often the level is replayed. It is the learnability p (1 - p), where
p is the success rate (A. Rutherford et al., "No Regrets: Investigating and Improving Regret Approximations for
Curriculum Discovery", NeurIPS 2024), the failure rate 1 - p, or a custom score from the training, such as the regret or
the value loss.
"""

from sceniris_gym.errors import refuses_old_imports
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.levels.sampler import LevelSampler

__all__ = ["ADR", "LevelReplay", "LevelSampler"]
__getattr__ = refuses_old_imports(__name__)
