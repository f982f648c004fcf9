"""Curricula over layouts, on the device: `LevelReplay` replays levels, and `ADR` moves the intervals of params.

A level is one layout, identified by its seed, episode and params. Each reset replays a level from a buffer or takes a
fresh level: prioritized level replay (M. Jiang, E. Grefenstette, T. Rocktaeschel, "Prioritized Level Replay", ICML
2021). A score weights the levels: learnability p (1 - p) with the success rate p (A. Rutherford et al., "No Regrets:
Investigating and Improving Regret Approximations for Curriculum Discovery", NeurIPS 2024), the failure rate, or custom
scores from the training, such as regret or the loss of values.
"""

from sceniris_gym.errors import refuses_old_imports
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.levels.sampler import LevelSampler

__all__ = ["ADR", "LevelReplay", "LevelSampler"]
__getattr__ = refuses_old_imports(__name__)
