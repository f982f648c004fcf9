"""Problem files of LIBERO: read as scenes, with their goals."""

from sceniris_gym.importers.libero.problem import Problem
from sceniris_gym.importers.libero.reader import LiberoTask, read_bddl
from sceniris_gym.libero.states import read_states
from sceniris_gym.vector.libero_goal import LiberoGoal
from sceniris_gym.vector.libero_task import LiberoGoalTask

__all__ = ["LiberoGoal", "LiberoGoalTask", "LiberoTask", "Problem", "read_bddl", "read_states"]
