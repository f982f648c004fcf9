"""Problem files of LIBERO: read as scenes, with their goals."""

from sceniris_gym.importers.libero.problem import Problem
from sceniris_gym.importers.libero.reader import LiberoTask, read_bddl
from sceniris_gym.vector.libero_goal import LiberoGoal

__all__ = ["LiberoGoal", "LiberoTask", "Problem", "read_bddl"]
