"""`LiberoGoalTask`: the task of a LIBERO problem file, with its instruction and its goal."""

from torch import Tensor

from sceniris_gym.importers.libero.problem import Problem
from sceniris_gym.vector.libero_goal import LiberoGoal
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task


class LiberoGoalTask(Task):
    """The task of a problem file. The reward is 1 in worlds that reach the goal, and their episodes end, as in LIBERO.

    Observations are the joint positions of the robots, and the poses of the objects and fixtures that `obj_of_interest`
    and the goal name. `info["language"]` has the instruction, in lower case as in LIBERO. A subclass may override any
    method.

    Args:
        problem: The problem file, from `read_bddl(...).problem` or `read_problem`.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.language = problem, problem.language.lower()

    def bind(self, s: State) -> None:
        """Prepare the goal and the names of observed objects."""
        problem, scene = self.problem, s.scene
        self.goal = LiberoGoal(s, problem)
        names = [*problem.of_interest, *(name for predicate in problem.goal for name in predicate.names)]
        targets = [problem.regions[name].target if name in problem.regions else name for name in names]
        self._observed = [name for name in dict.fromkeys(targets) if name in scene.bodies]
        self._robots = [name for name in scene.config.all_robots if name in scene.bodies]

    def observe(self, s: State) -> Observation:
        """Return joint positions [m or rad] of the robots, and poses of objects and fixtures, as in `State.pose`."""
        joints = {name: s.qpos(name) for name in self._robots}
        return {"policy": joints | {name: s.pose(name) for name in self._observed}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return 1 for worlds that reach the goal."""
        return {"goal": self.goal(s).float()}

    def success(self, s: State) -> Tensor:
        """Return the worlds that reach the goal."""
        return self.goal(s)

    def terminated(self, s: State) -> Tensor:
        """Return the worlds that reach the goal."""
        return self.goal(s)
