"""The reach targets of a scene on the host, with their grasps and tiers, and the arms that reach them."""

import json
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.robot import RobotConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import ArmError, MapError, UnknownNameError
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.grasping.grasps import Graspable, GraspSet
from sceniris_gym.grasping.gripper import Gripper
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.grips import firmest, tested_grips
from sceniris_gym.program.placed_object import PlacedObject, obstacles
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.map import ReachMap, build_command, default_tier
from sceniris_gym.scene.identity import map_of
from sceniris_gym.scene.model import SceneModel


class ReachTarget(NamedTuple):
    """An object with `reachable` in the scene file, which an arm should reach in each layout.

    Attributes:
        name: The object.
        number: Its index in placement order.
        arm: Index in `Reaching.arms` of the arm that has to reach it.
        late: Whether it is placed before the base of its arm, so its test comes late.
        early: Whether each object that is placed later must leave at least one grasp of this target free.
        tier: The test that decides whether it is reachable.
        on_path: Whether layouts have paths to it: all of them for the tier `path`, or those of a kind of start.
        margin: Least distance [m] on its path.
        grasp_set: Its grasps.
    """

    name: str
    number: int
    arm: int
    late: bool
    early: bool
    tier: Tier
    on_path: bool
    margin: float
    grasp_set: GraspSet


@dataclass(frozen=True)
class ReachingArm:
    """An arm with reach targets.

    Attributes:
        robot: Name of its robot, 'robot' for a single robot.
        arm: The arm.
        gripper: Its gripper.
        map: The arm's map, or None.
        view: The struct for device code, with this arm and the reach targets of all arms. `pack.objects` fills it.
    """

    robot: str
    arm: SerialArm
    gripper: Gripper
    map: ReachMap | None
    view: Reach = field(repr=False, default_factory=Reach)  # pyrefly: ignore[no-matching-overload]


class Reaching(NamedTuple):
    """The arms of a scene with reach targets, and all these targets.

    Attributes:
        arms: The arms, in the order of their robots in the scene file.
        targets: The reach targets, in placement order.
    """

    arms: tuple[ReachingArm, ...]
    targets: tuple[ReachTarget, ...]

    def arm_of(self, target: ReachTarget) -> ReachingArm:
        """Return the arm that has to reach a target."""
        return self.arms[target.arm]

    @property
    def njoint(self) -> int:
        """The number of joints of the arm with the most joints."""
        return max(len(one.arm.joints) for one in self.arms)

    @property
    def on_path(self) -> bool:
        """True if layouts have paths."""
        return any(target.on_path for target in self.targets)

    @property
    def staged(self) -> bool:
        """True if a reach target has to be tested after placing, due to its tier or because its arm is placed later."""
        return not all(target.tier.needs_map and not target.late for target in self.targets)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the targets, in the order of the columns of `Layouts.grasp`."""
        return tuple(target.name for target in self.targets)


def plan_reaching(scene: SceneModel, objects: list[PlacedObject], pieces: list[Piece]) -> Reaching:
    """Find the arms of a scene with reach targets, their maps and the grasps of the targets.

    The key `reachable` of an object names the tier of its test. If this tier needs a map, and the arm's map is missing
    or not accurate enough, the tier `ik` is used instead.

    Args:
        scene: The scene.
        objects: The objects of its plan, in placement order.
        pieces: All obstacles.

    Raises:
        ArmError: A robot is not a serial arm.
        UnknownNameError: A robot has no site `tcp`, or an object has no grasp with a name that `grasp` selects.
        MapError: A map belongs to another arm, or is damaged.
        GraspError: The gripper cannot grasp an object.
        NotSupportedError, SceneKeyError: It cannot hold an object with `firm`.
    """
    config = scene.config
    asked = {i: config.robot_for(o.name) for i, o in enumerate(objects) if o.config.reachable}
    arms: dict[str, ReachingArm] = {}
    for robot in (name for name in config.all_robots if name in asked.values()):
        arm, (own, _) = robot_arm(scene, robot), scene.home_of(robot)
        gripper = Gripper.from_model(own.mjm, arm, own.home_qpos, pieces if own is scene else obstacles(own))
        arms[robot] = ReachingArm(robot, arm, gripper, load_map(arm, config.all_robots[robot], config.where))
    targets, numbers = [], {o.name: i for i, o in enumerate(objects)}
    begun = {name for start in config.start if start.robot == "path" for name in start.targets(config.variants)}
    for i, robot in asked.items():
        o, one, base = objects[i], arms[robot], numbers.get(robot, -1)
        default = default_tier(one.arm, one.map)
        tier = Tier.MAP if o.config.reachable is True else Tier.of(str(o.config.reachable))
        tier = tier if default.needs_map or not tier.needs_map else default
        grasps = Graspable(scene, o.name, pieces, one.gripper, one.arm.turns_tool).grasp_set(o.stable_poses)
        if o.config.firm:
            key = f"{config.where}: {config.key(o.name)}.firm"
            grips = tested_grips(scene, one.arm, one.gripper, o, grasps, ["lifts"], key)
            every = np.ones(len(grips), bool)
            grasps = grasps.among(firmest(grips, "lifts", every, key, o.name, "Without 'firm', it may slip.") > 0.0)
        late = i < base and objects[base].config.is_placed
        early = tier >= Tier.CLEAR and base < i < len(objects) - 1
        on_path, number = tier == Tier.PATH or o.name in begun, [*arms].index(robot)
        targets.append(ReachTarget(o.name, i, number, late, early, tier, on_path, o.config.margin, grasps))
    return Reaching(tuple(arms.values()), tuple(targets))


def robot_arm(scene: SceneModel, name: str = ROBOT) -> SerialArm:
    """Return the serial arm of a robot, from the robot's root body to its tool centre point.

    Raises:
        ArmError: The robot is not a serial arm, or has no site `tcp` and the scene file does not name another.
    """
    robot = scene.config.all_robots[name]
    where = f"{scene.config.where}: {robot.key}"
    home, name = scene.home_of(name)
    try:
        return SerialArm.from_model(home.mjm, home.config.all_robots[name].name, home.tcps[name])
    except ArmError as error:  # in its own file, the robot's names have no prefix
        text = str(error)
        if robot.asset is not None:
            text = text.replace(f"in_model: {robot.name}/", "in_model: ").replace(f"'{robot.name}/", "'")
        raise ArmError(f"{where}: {text}") from None
    except UnknownNameError:  # only without `tcp`: with it, the scene has the site
        mjm, inside = home.mjm, home.subtree(name)
        sites = [mjm.site(i).name for i in range(mjm.nsite) if int(mjm.site_bodyid[i]) in inside]
        own = [full.removeprefix(f"{robot.name}/") for full in sites or [mjm.body(body).name for body in inside]]
        fix = f"Write 'tcp: NAME', with the name between the fingertips: {', '.join(own)}."
        raise ArmError(f"{scene.config.where}: {robot.section}: the arm has no site 'tcp'. {fix}") from None


def load_map(arm: SerialArm, robot: RobotConfig, where: str) -> ReachMap | None:
    """Return the map of an arm: the map that the scene file names, the shipped map of a shipped asset, or None.

    Raises:
        MapError: The map belongs to another arm, or is damaged. The error begins with `where`.
    """
    path = map_of(robot)
    if path is None:
        return None
    try:
        return ReachMap.load(path, arm, f"Build it: {build_command(*asset_and_words(robot), path)}.")
    except MapError as error:
        raise MapError(f"{where}: {robot.key if robot.map is None else f'{robot.section}.map'}: {error}") from None


def asset_and_words(robot: RobotConfig) -> tuple[str, str]:
    """Return the arguments of `build_command` for a robot: the asset, and the options that set the TCP."""
    file, words = robot.asset or robot.name, robot.model_dump(mode="json", exclude_unset=True).get("tcp")
    if words is None:
        return file, ""
    return file, f"--set 'robot.tcp={words['site'] if words.get('site') == words.get('body') else json.dumps(words)}'"
