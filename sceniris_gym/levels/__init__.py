"""`Levels`: the choice of each world's next layout by what earlier episodes on it gave, on the device.

A level is a layout by its seed and episode. With a probability a world's next level is replayed out of a buffer, else
it is a fresh one: prioritised level replay (M. Jiang, E. Grefenstette, T. Rocktaeschel, "Prioritized Level Replay",
ICML 2021). A level is replayed by its score: by learnability p (1 - p) with the rate of success p (A. Rutherford et
al., "No Regrets: Investigating and Improving Regret Approximations for Curriculum Discovery", NeurIPS 2024), by the
rate of failure, or by what a training gives, such as regret or the loss of values.
"""

from sceniris_gym.levels.choice import Levels, Ranges
from sceniris_gym.levels.sampler import LevelSampler

__all__ = ["LevelSampler", "Levels", "Ranges"]
