"""Curricula that run on the device. `LevelReplay` replays levels, and `ADR` moves the ranges of the scene's params.

A level is one layout, identified by its seed, episode and params. Each reset either replays a level from a buffer or
takes a fresh level. This is prioritized level replay (M. Jiang, E. Grefenstette, T. Rocktaeschel, "Prioritized Level
Replay", ICML 2021). The score of a level sets how often the level is replayed. You choose one of three scores. With
success rate p, the learnability is p (1 - p) (A. Rutherford et al., "No Regrets: Investigating and Improving Regret
Approximations for Curriculum Discovery", NeurIPS 2024), and the failure rate is 1 - p. A custom score comes from your
training, such as the regret or the value loss.
"""

from sceniris_gym.errors import refuses_old_imports
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.levels.sampler import LevelSampler

__all__ = ["ADR", "LevelReplay", "LevelSampler"]
__getattr__ = refuses_old_imports(__name__)
