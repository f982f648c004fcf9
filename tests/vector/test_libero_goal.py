"""Goals of LIBERO's problem files in worlds: each predicate where it holds and where it does not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
import torch
from torch import Tensor

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.importers.libero.reader import LiberoTask, read_bddl
from sceniris_gym.vector.libero_goal import LiberoGoal
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.importers.libero.problems import KITCHEN, STACK, write

pytestmark = pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
GOAL = "(And (On akita_black_bowl_1 plate_1) (Close wooden_cabinet_1_top_region))"


class Watch(Task):
    """A task without actions that puts things into place after each reset."""

    substeps = 1

    def __init__(self, task: LiberoTask, poses: Mapping[str, Tensor], joints: Mapping[str, Tensor]) -> None:
        self.task, self.poses, self.joints = task, poses, joints

    def bind(self, s: State) -> None:
        """Make the goal."""
        self.goal = LiberoGoal(s, self.task.problem)

    def observe(self, s: State) -> Observation:
        """Show the predicates."""
        return {"policy": {"each": self.goal.each(s).float()}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return no reward."""
        return {"none": torch.zeros(s.num_envs, device=s.device)}

    def success(self, s: State) -> Tensor:
        """Return the worlds in which the goal is reached."""
        return self.goal(s)

    def apply(self, s: State, action: Tensor) -> None:
        """Do nothing."""

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Put things into place."""
        for name, place in self.poses.items():
            s.put_pose(name, torch.cat([place, torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(len(place), 1)], 1), mask)
        for name, qpos in self.joints.items():
            s.put_joints(name, qpos[:, None], mask)


def seen(path: Path, poses: Mapping[str, list], joints: Mapping[str, list]) -> tuple[list, list]:
    """Return, after a physics step, which predicates hold in each world, and where the goal is reached."""
    task = read_bddl(path)
    places = {name: torch.tensor(place) for name, place in poses.items()}
    watch = Watch(task, places, {name: torch.tensor(qpos) for name, qpos in joints.items()})
    n = len(next(iter([*poses.values(), *joints.values()])))
    watch.action_size = 1
    env = SceneVectorEnv(watch, n, scene=task.scene, device="cpu")
    env.reset(seed=0)
    obs, _, _, _, info = env.step(torch.zeros(n, 1))
    env.close()
    return (obs["policy"] > 0.5).tolist(), info["success"].tolist()


def problem(folder: Path, goal: str) -> Path:
    """Write the kitchen with another goal."""
    return write(folder, KITCHEN, **{GOAL: goal})


def test_one_thing_is_on_another_one_if_it_touches_and_is_over_its_middle(tmp_path: Path):
    """A bowl on a plate; the same too far aside, and above it without contact."""
    height, plate = 0.9 + 0.0185, [0.3, 0.4, 0.9]
    bowls = [[0.3, 0.4, height], [0.3, 0.435, height], [0.3, 0.4, height + 0.05]]
    each, success = seen(
        problem(tmp_path, GOAL),
        {"plate_1": [plate] * 3, "akita_black_bowl_1": bowls},
        {"wooden_cabinet_1/top_level": [0.002, 0.002, 0.002]},
    )
    assert each == [[True, True], [False, True], [False, True]]
    assert success == [True, False, False]


def test_things_are_on_a_site_of_a_fixture_or_a_rectangle(tmp_path: Path):
    """Over the site and in contact with the stove; over the rectangle of the table, in its own size."""
    goal = "(And (On plate_1 flat_stove_1_cook_region) (On akita_black_bowl_1 kitchen_table_bowl_region))"
    path = problem(tmp_path, goal)
    each, _ = seen(
        path,
        {
            "plate_1": [[-0.05, 0.3, 0.945], [-0.05, 0.3, 1.0], [0.1, 0.3, 0.9]],
            "akita_black_bowl_1": [[-0.1, 0.0, 0.9025], [-0.085, 0.015, 0.95], [-0.07, 0.0, 0.91]],
        },
        {},
    )
    assert each == [[True, True], [False, True], [False, False]]


def test_a_thing_is_in_a_region_if_its_origin_is(tmp_path: Path):
    """Inside of a basket, above it, and beside it."""
    each, _ = seen(
        write(tmp_path, STACK), {"akita_black_bowl_1": [[0.21, 0.0, 0.05], [0.21, 0.0, 0.2], [0.4, 0.0, 0.05]]}, {}
    )
    assert each == [[True], [False], [False]]


def test_joints_decide_what_is_open_and_on(tmp_path: Path):
    """Beyond the near end of the range that the start draws from; of a fixture any joint, or all."""
    top, cabinet, stove = "wooden_cabinet_1_top_region", "wooden_cabinet_1", "flat_stove_1"
    joints = {
        "wooden_cabinet_1/top_level": [-0.15, 0.004, -0.05, 0.004],
        "wooden_cabinet_1/middle_level": [0.004, 0.004, -0.15, 0.004],
        "wooden_cabinet_1/bottom_level": [0.004, 0.004, 0.004, 0.004],
        "flat_stove_1/button": [0.6, 0.4, 0.6, -0.004],
    }
    is_open, is_closed = (
        seen(problem(tmp_path, f"(And ({moved} {top}) ({moved} {cabinet}) ({turned} {stove}))"), {}, joints)[0]
        for moved, turned in (("Open", "Turnon"), ("Close", "Turnoff"))
    )
    assert is_open == [[True, True, True], [False, False, False], [False, True, True], [False, False, False]]
    assert is_closed == [[False, False, False], [True, True, False], [False, False, False], [True, True, True]]


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ("(Open flat_stove_1)", "unknown fixture for Open 'flat_stove_1'. Valid: wooden_cabinet_1"),
        ("(On plate_1 flat_stove_1_knob)", "unknown site 'flat_stove_1/knob'"),
    ],
)
def test_goals_that_no_world_can_reach_are_refused(goal: str, message: str, tmp_path: Path):
    """With the line, and the names that would do."""
    text = KITCHEN.replace(GOAL, goal).replace("(cook_region", "(knob (:target flat_stove_1)) (cook_region")
    task = read_bddl(write(tmp_path, text))
    with pytest.raises(UnknownNameError, match=r"problem\.bddl:|LiberoGoal") as raised:
        SceneVectorEnv(Watch(task, {}, {}), 1, scene=task.scene, device="cpu")
    assert message in str(raised.value)
