"""`Readings`: the worlds as a task reads them, by name, as torch tensors in the robot's base frame."""

from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.device.fixed import RefusesOldNames
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.program.plan import slot_names
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.versions import actuator_controls
from sceniris_gym.vector import rotations
from sceniris_gym.vector.base_frame import base_frame
from sceniris_gym.vector.names import SLIDE, Joints, find_body, find_element, find_free_dof, find_joints, unknown
from sceniris_gym.vector.parts import JointReading, PartGrasps
from sceniris_gym.vector.statistics import finite_rows
from sceniris_gym.vector.variants import Boxes, TargetGrasps, VariantView


class Readings(RefusesOldNames):
    """Methods with which a task reads the worlds. The subclass `State` adds the methods that write to the worlds."""

    def __init__(self, batch: Batch, layouts: Layouts, split: str = "train", variants: Tensor | None = None) -> None:
        self.num_envs, self.scene, self.mjm = batch.nworld, batch.scene, batch.scene.mjm
        self.data, self._layouts, self._split = batch.data, layouts, split
        self._batch = batch
        self.dt = batch.substeps * float(self.mjm.opt.timestep)
        self.device = torch.device(wp.device_to_torch(batch.device))
        self.elapsed = torch.zeros(self.num_envs, dtype=torch.int32, device=self.device)
        self._elapsed = wp.from_torch(self.elapsed)
        self.seed, self.episode, self.start = layouts.seed, layouts.episode, layouts.start
        self.layout_status, self.layout_param = layouts.status, layouts.param
        d = batch.data
        self.ctrl = wp.to_torch(d.ctrl)
        self.control_range = torch.tensor(self.mjm.actuator_ctrlrange, dtype=torch.float32, device=self.device)
        self._qpos, self._qvel, self._act = wp.to_torch(d.qpos), wp.to_torch(d.qvel), wp.to_torch(d.act)
        self._xpos, self._xquat = wp.to_torch(d.xpos), wp.to_torch(d.xquat)
        self._site_xpos = wp.to_torch(d.site_xpos)
        self._xanchor, self._xaxis = wp.to_torch(d.xanchor), wp.to_torch(d.xaxis)
        self._base = base_frame(self.scene, self.device, self._xpos, self._xquat)
        self.variants = VariantView(batch.full_scene, variants, self.device)
        self._kept: dict[tuple[Hashable, ...], Any] = {}

    @property
    def finite(self) -> Tensor:
        """Worlds whose positions, velocities, activations and controls are all finite, shape (num_envs,), bool."""
        return finite_rows((self._qpos, self._qvel, self._act, self.ctrl))

    def pose(self, name: str) -> Tensor:
        """Return position [m] and orientation (wxyz) of a body, shape (num_envs, 7)."""
        body = find_body(self.scene, name, "State.pose")
        return self._base.pose(self._xpos[:, body], self._xquat[:, body])

    def present(self, names: Sequence[str]) -> Tensor:
        """Return which objects are present, shape (num_envs, len(names)), bool."""

        def find() -> Tensor:
            objects = list(self.scene.config.objects)
            check_names("object", names, f"scene '{self.scene.config.name}': State.present", objects)
            columns = (*slot_names(self.variants.scene.config), *self.variants.names)
            return self._index([columns.index(name) for name in names])

        present = self._layouts.present
        columns = self._once(find, "present", *names)
        if self.variants.names:
            present = torch.cat([present, self.variants.present], dim=1)
        return present[:, columns] > 0

    def variant(self, name: str, *, one_hot: bool = False) -> Tensor:
        """Return the present variant of an object, numbered as in the scene file, or -1 if the object is absent.

        Args:
            name: An object with variants.
            one_hot: Instead of the variant's number, return a row for each world, with 1 in the column of this variant
                and 0 elsewhere. A world without the object has only zeros.

        Returns:
            Shape (num_envs,), int64, or with `one_hot` shape (num_envs, number of variants), float32.

        Raises:
            UnknownNameError: The scene has no such object with variants.
        """
        if name not in self.variants.names:
            raise unknown(self.scene, "object with variants", name, "State.variant", self.variants.names)
        number = self.variants.number(name)
        if not one_hot:
            return number
        columns = torch.arange(len(self.variants.scene.config.variants[name]), device=self.device)
        return (number[:, None] == columns).float()

    def extent(self, name: str) -> Tensor:
        """Return the edge lengths [m] of the smallest box around a body, along the body's axes, shape (num_envs, 3).

        The box contains the colliding geoms of the body, but not the geoms of its child bodies. If the object has
        variants, the geoms are the present variant's.

        Raises:
            UnknownNameError: The scene has no such body.
            NotSupportedError: The body has no geom that collides.
        """
        lower, upper = self._once(lambda: Boxes(self.variants, [name], "State.extent"), "extent", name).corners()
        return (upper - lower).reshape(-1, 3).expand(self.num_envs, 3)

    def poses(self, names: Sequence[str]) -> Tensor:
        """Return the poses of several bodies, each as in `pose`, shape (num_envs, len(names), 7)."""
        bodies = self._once(
            lambda: self._index([find_body(self.scene, n, "State.poses") for n in names]), "poses", *names
        )
        return self._base.pose(self._xpos[:, bodies], self._xquat[:, bodies])

    def site(self, name: str) -> Tensor:
        """Return position [m] and orientation (wxyz) of a site, shape (num_envs, 7)."""

        def find() -> tuple[int, int, Tensor]:
            number = find_element(self.scene, "site", name, "State.site")
            return number, int(self.mjm.site_bodyid[number]), self._base.seen(self.mjm.site_quat[number])

        site, body, seen = self._once(find, "site", name)
        return self._base.pose(self._site_xpos[:, site], self._xquat[:, body], seen)

    def velocity(self, name: str) -> Tensor:
        """Return linear [m/s] and angular [rad/s] velocity of a free object, shape (num_envs, 6)."""
        return self.velocities((name,))[:, 0]

    def velocities(self, names: Sequence[str]) -> Tensor:
        """Return the velocities of several free objects, each as in `velocity`, shape (num_envs, len(names), 6)."""

        def find() -> tuple[Tensor, Tensor]:
            bodies = [find_body(self.scene, name, "State.velocity") for name in names]
            dofs = [[find_free_dof(self.scene, name, "State.velocity") + i for i in range(6)] for name in names]
            return self._index(bodies), self._index(dofs).reshape(-1, 6)

        bodies, dofs = self._once(find, "velocities", *names)
        linear, angular = self._qvel[:, dofs].split(3, dim=-1)
        # in MuJoCo, the angular velocity of a free joint is in the body's frame
        angular = rotations.rotate(self._xquat[:, bodies], angular)
        return self._base.vectors(linear, angular)

    def qpos(self, name: Joints) -> Tensor:
        """Return positions [m or rad] of the hinges and slides inside an object or a robot, or of one joint.

        Shape (num_envs, number of joints). Joints have the order of the model, or of `name` if it is a tuple of joint
        ids.
        """
        return self._qpos[:, self._span("qpos", name)]

    def qvel(self, name: Joints) -> Tensor:
        """Return velocities [m/s or rad/s] of the joints whose positions `qpos` returns, in the same shape."""
        return self._qvel[:, self._span("qvel", name)]

    def joint(self, name: str, joint: str) -> Tensor:
        """Return the position [m or rad] of a joint, and its share of the joint's range, shape (num_envs, 2).

        The share is from 0 to 1. It is NaN for a joint without limits. Both numbers are NaN in worlds where the present
        variant of the object lacks the joint.

        Args:
            name: An object or a robot.
            joint: A slide or a hinge by its name inside it, or one of the object's `parts`, which may be another joint
                in each variant.

        Raises:
            UnknownNameError: The scene has no such object, or no variant has such a joint.
        """
        reading = self._once(lambda: JointReading(self.variants, name, joint, "State.joint"), "part", name, joint)
        return reading.read(self._qpos, wp.to_torch(self._batch.model.jnt_range))

    def grasp(self, name: str, *, part: str | None = None) -> Tensor:
        """Return the TCP pose of the grasp with which the arm reaches an object, shape (num_envs, 7).

        Position [m] and orientation (wxyz). The gripper approaches along the +z axis of this pose, and its fingers
        close along the +y axis. The layout determines the grasp, and the pose moves with the object. It is NaN in
        worlds where the object is absent, or where its present variant does not have to be reachable.

        Args:
            name: The object.
            part: A joint, as in `joint`. The result then has the poses of all grasp sites `grasp_*` on the bodies that
                the joint moves, shape (num_envs, n, 7), NaN where the present variant has fewer than n. The object need
                not be reachable. A gripper that is rotated by 180 degrees about an approach axis grasps as well.

        Raises:
            UnknownNameError: The scene has no such reachable object, or no such part.
            ArgumentError: The part has no grasp sites.
        """
        if part is not None:
            grasps = self._once(lambda: PartGrasps(self.variants, name, part, "State.grasp"), "at", name, part)
            return grasps.pose(self._base, self._xpos, self._xquat)
        return self._target(name, "grasp").pose(self._base, self._xpos, self._xquat)

    def grasp_qpos(self, name: str) -> Tensor:
        """Return the arm's joint positions [rad or m] for `grasp` at the object's start pose, shape (num_envs, joints).

        The result is NaN where `grasp` is NaN. It is also NaN for objects whose tier of `reachable` is below `ik`,
        because such a tier only uses the arm's reachability map.
        """
        return self._target(name, "grasp_qpos").joints("grasp_qpos")

    def pregrasp_qpos(self, name: str) -> Tensor:
        """Return the arm's joint positions [rad or m] at the pre-grasp, shape (num_envs, joints).

        The pre-grasp is 8 cm before the grasp, along the approach. The result is NaN where `grasp_qpos` is NaN. It is
        also NaN for objects whose tier of `reachable` is not `clear` or `path`.
        """
        return self._target(name, "pregrasp_qpos").joints("pregrasp_qpos")

    def path(self, name: str) -> tuple[Tensor, Tensor]:
        """Return a path of the arm's joints to `grasp` at the object's start pose, as corners and their number.

        The path is a polyline from the arm's drawn home pose over up to two vias to the pre-grasp and the grasp, with
        the fingers open. It keeps clear of the layout.

        Returns:
            Corners [rad or m], shape (num_envs, 5, joints): home, two vias, pre-grasp, grasp. A via that is not used
            repeats the pre-grasp. Their number without such repetitions, 3 to 5, shape (num_envs,), int32. NaN and 0
            where the layout has no path to the object: it is absent, or only some kinds of `start` have paths.

        Raises:
            UnknownNameError: The scene has no such reachable object.
            ArgumentError: No layout has a path to the object.
        """
        target = self._target(name, "path")
        if not target.has_path:
            raise ArgumentError(f"State.path: '{name}' should have 'reachable: path' in the scene file.")
        return target.path()

    def jacobian(self, site: str, name: Joints) -> Tensor:
        """Return the Jacobian of a site, shape (num_envs, 6, number of joints): three linear, then three angular rows.

        The Jacobian times the joint velocities is the site's linear [m/s] and angular [rad/s] velocity in the robot's
        base frame. The column of a hinge is (a x (p - o), a) for its axis a, its anchor o and the site's position p.
        The column of a slide is (a, 0). Joints that do not carry the site have columns of zeros.

        Args:
            site: The site.
            name: The joints, as in `qpos`.
        """
        number = find_element(self.scene, "site", site, "State.jacobian")
        joints, kinds = self._once(lambda: self._jacobian_columns(number, name), "jacobian", site, name)
        axis, arm = self._xaxis[:, joints], self._site_xpos[:, None, number] - self._xanchor[:, joints]
        linear = torch.linalg.cross(axis, arm)
        if kinds is not None:
            hinge, slide = kinds
            linear, axis = hinge * linear + slide * axis, hinge * axis
        return self._base.vectors(linear, axis).transpose(1, 2)

    def actuator(self, name: str) -> int:
        """Return the column of an actuator in `ctrl`."""
        return int(actuator_controls(self.mjm)[0][find_element(self.scene, "actuator", name, "State.actuator")])

    def _target(self, name: str, method: str) -> TargetGrasps:
        where = f"State.{method}"
        return self._once(lambda: TargetGrasps(self._layouts, self.variants, name, where), "grasps", name)

    def _once(self, make: Callable[[], Any], *key: Hashable) -> Any:
        """Return the result of `make()`. Later calls with the same key return the stored result."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _index(self, numbers: list) -> Tensor:
        return torch.tensor(numbers, dtype=torch.int64, device=self.device)

    def _span(self, array: str, name: Joints) -> slice | Tensor:
        def find() -> slice | Tensor:
            adr = self.mjm.jnt_qposadr if array == "qpos" else self.mjm.jnt_dofadr
            return as_columns([int(adr[j]) for j in find_joints(self.scene, name, f"State.{array}")], self.device)

        return self._once(find, array, name)

    def _jacobian_columns(self, site: int, name: Joints) -> tuple[Tensor, Tensor | None]:
        """Return the ids of joints, and two rows of flags: hinges that carry the site, and slides that carry the site.

        The flags are 0 or 1, shape (2, number of joints, 1), or None if all joints are hinges that carry the site.
        """
        mjm, joints = self.mjm, find_joints(self.scene, name, "State.jacobian")
        carries = np.array([int(mjm.site_bodyid[site]) in subtree(mjm, int(mjm.jnt_bodyid[j])) for j in joints])
        slide = mjm.jnt_type[joints] == SLIDE
        kinds = np.stack([carries & ~slide, carries & slide])[:, :, None]
        flags = None if kinds[0].all() else torch.tensor(kinds, dtype=torch.float32, device=self.device)
        return self._index(joints), flags


def as_columns(numbers: list[int], device: torch.device) -> slice | Tensor:
    """Return columns as a slice if they are consecutive, otherwise as a tensor. Indexing by a slice does not copy."""
    first = numbers[0]
    if numbers == list(range(first, first + len(numbers))):
        return slice(first, first + len(numbers))
    return torch.tensor(numbers, device=device)
