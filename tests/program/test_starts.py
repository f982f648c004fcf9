"""Kinds of starts by the numbers of the plan, and refusals that need the model."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.grasping.grip import Grip
from sceniris_gym.program.device_reach import StartPose
from sceniris_gym.program.plan import Plan, build_plan
from sceniris_gym.program.starts import plan_grips, plan_starts
from sceniris_gym.scene.build import build_model
from tests.layout.starting import HANDLE, HELD, PLACED, SCENE


def plan_of(**words: Any) -> Plan:
    """Return the plan of the scene with other words."""
    return build_plan(build_model(SceneConfig.load({**SCENE, **words})))


def test_kinds_have_the_numbers_of_the_plan():
    """Poses, grasps of the right object, joints by index and address, markers by placement order."""
    plan = plan_of()
    kinds = plan_starts(plan, plan_grips(plan))
    assert kinds["pose"].tolist() == [
        *(StartPose.HOME, StartPose.PREGRASP, StartPose.STANDING, StartPose.LIFTED, StartPose.HELD),
        *(StartPose.HOME, StartPose.STANDING),
    ]
    names = [grasp.name for target in plan.reaching.targets for grasp in target.grasp_set.grasps]
    assert {names[i].split(" ")[0] for i in np.flatnonzero(kinds["grasp"][HANDLE])} == {"grasp_upper_handle"}
    low, high = kinds["arm_range"][HELD].T
    assert np.flatnonzero(low <= high).tolist() == list(range(7))
    low, high = kinds["draw_range"][HANDLE].T
    (drawn,) = np.flatnonzero(low <= high)
    upper = plan.scene.mjm.joint("cabinet/upper")
    assert [r.qposadr for o in plan.objects for r in o.joint_ranges][drawn] == upper.qposadr[0]
    assert (low[drawn], high[drawn]) == pytest.approx((0.8 * upper.range[1], upper.range[1]))
    order = [o.name for o in plan.objects]
    goals = [order.index("goal") if name == "apple" else -1 for name in order]
    assert kinds["marker"][PLACED].tolist() == goals
    placed = [name for name in order if name in SCENE["objects"]]
    assert placed[:2] == ["goal", "apple"]  # before those that could be in the way


WRONG: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "a grasp of another name": (
        {"robot": "grasp", "of": "cabinet", "grasp": "uper*"},
        UnknownNameError,
        "start.0.grasp",
    ),
    "a joint that is not drawn": ({"joints": {"cabinet/lower": {"fraction": [0, 1]}}}, SceneKeyError, "cabinet.joints"),
    "a joint of the arm that is none": (
        {"robot": "grasp", "of": "block", "robot_joints": {"elbow": {"noise": 0.1}}},
        UnknownNameError,
        "start.0.robot_joints",
    ),
    "joints of the gripper alone": (
        {"robot": "grasp", "of": "block", "robot_joints": {"finger*": {"noise": 0.1}}},
        SceneKeyError,
        "joints of the arm (joint1, joint2",
    ),
}


@pytest.mark.parametrize(("kind", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_kind_that_does_not_fit_the_model_is_refused(kind: dict, error: type[ScenirisError], says: str):
    """With the path of its key."""
    plan = plan_of(start=[kind])
    with pytest.raises(error) as caught:
        plan_starts(plan, plan_grips(plan))
    assert says in str(caught.value)


def test_a_tool_without_fingers_is_refused():
    """By the name of its robot."""
    objects = deepcopy(SCENE["objects"])
    plan = plan_of(objects=objects, start=[{"robot": "grasp", "of": "block"}])
    one = plan.reaching.arms[0]
    object.__setattr__(one, "gripper", one.gripper._replace(qposadr=np.zeros(0, int)))
    with pytest.raises(NotSupportedError, match="tool of 'robot' has no fingers"):
        plan_grips(plan)


def test_a_target_on_which_nothing_closes_is_refused():
    """By its name, and for what it would have to do."""
    plan = plan_of(start=[{"robot": "grasp", "of": "block"}])
    grips = tuple(Grip(grip.share, grip.pos) for grip in plan_grips(plan))
    with pytest.raises(SceneKeyError, match=r"start\.0: .* hold 'block' from both sides .* should drive all fingers"):
        plan_starts(plan, grips)


def test_grasps_are_proven_with_the_worst_that_is_drawn():
    """A block that the fingers hold is refused if they may be too slippery for the heaviest that it may be."""
    objects, kind = deepcopy(SCENE["objects"]), {"robot": "grasp", "of": "block", "lift": [0.05, 0.2]}
    objects["block"]["randomize"] = {"mass": {"scale": [0.5, 2]}, "friction": {"scale": [0.02, 1]}}
    robot = {**SCENE["robot"], "randomize": {"friction": {"scale": [0.02, 1]}, "forcerange": {"scale": [0.8, 1]}}}
    plan = plan_of(objects=objects, start=[kind], robot=robot)
    with pytest.raises(SceneKeyError, match=r"start\.0: .* hold 'block' upright in the air .* narrower draws"):
        plan_starts(plan, plan_grips(plan))
