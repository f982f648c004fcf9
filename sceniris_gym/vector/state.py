"""`State`: the worlds as a task reads them, as torch tensors by name, in the robot's base frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from typing import Any, overload

import mujoco
import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.config.variants import owners_of
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.program.plan import slot_names
from sceniris_gym.program.reach import ReachTarget
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.named_random import draw_named, draw_uniform, task_stream
from sceniris_gym.sim.versions import actuator_controls, sleeps
from sceniris_gym.vector import rotations
from sceniris_gym.vector.base_frame import base_frame
from sceniris_gym.vector.joint_writer import JointWriter
from sceniris_gym.vector.pose_writer import PoseWriter
from sceniris_gym.vector.variants import Boxes, VariantView

Joints = str | tuple[int, ...]
"""An object, a robot or one joint by its name, or joints by their numbers in the model."""

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
SCALAR = (SLIDE, int(mujoco.mjtJoint.mjJNT_HINGE))


class State:
    """The state of all worlds by name. Tensors are on the environment's device; clone what you keep, some are views.

    Names are those of the scene: an object, a robot (the only one also by the name of its asset), or `object/part` for
    the bodies, sites, joints and actuators inside. In a scene with a `model` all names of that model can be used too.
    A name that the scene does not have raises UnknownNameError. Poses and velocities are in the robot's base frame, or
    in the world frame if the scene has no robot or several.

    Args:
        batch: The worlds.
        layouts: The layouts of the worlds.
        split: The split of the layouts.
        variant: The present variant of each object with variants, as `VariantWriter.variant`, if there are any.

    Attributes:
        num_envs: Number of worlds.
        device: Torch device.
        elapsed: Control steps since the reset of each world, shape (num_envs,), int32.
        ctrl: Controls, a view to write to, shape (num_envs, nu).
        control_range: Lower and upper limits of the controls, shape (nu, 2).
        dt: Duration of a control step [s].
        seed: Seed of each world's layout, shape (num_envs,), int64 (from 2^63 on as its two's complement).
        episode: Episode of each world's layout, -1 before the first reset, shape (num_envs,), int32.
        start: Number of the kind of start of each world in the scene file, -1 in scenes without, shape (num_envs,),
            int32.
        layout_status: 0 for no layout yet, 1 for a valid one, 2 for one from the bank, shape (num_envs,), int32.
        layout_knob: Numbers of the knobs that each layout was made with, shape (num_envs, nvalue).
    """

    def __init__(self, batch: Batch, layouts: Layouts, split: str = "train", variant: wp.array | None = None) -> None:
        self.num_envs, self.scene, self.mjm = batch.nworld, batch.scene, batch.scene.mjm
        self.data, self._layouts, self._split = batch.data, layouts, split
        self._batch = batch
        self.dt = batch.substeps * float(self.mjm.opt.timestep)
        self.device = torch.device(wp.device_to_torch(batch.device))
        self.elapsed = torch.zeros(self.num_envs, dtype=torch.int32, device=self.device)
        self._elapsed = wp.from_torch(self.elapsed)
        self.seed, self.episode = wp.to_torch(layouts.seed).view(torch.int64), wp.to_torch(layouts.episode)
        self.layout_status, self.layout_knob = wp.to_torch(layouts.status), wp.to_torch(layouts.knob)
        self.start = wp.to_torch(layouts.start)
        d = batch.data
        self.ctrl = wp.to_torch(d.ctrl)
        self.control_range = torch.tensor(self.mjm.actuator_ctrlrange, dtype=torch.float32, device=self.device)
        self._qpos, self._qvel = wp.to_torch(d.qpos), wp.to_torch(d.qvel)
        self._xpos, self._xquat = wp.to_torch(d.xpos), wp.to_torch(d.xquat)
        self._site_xpos = wp.to_torch(d.site_xpos)
        self._xanchor, self._xaxis = wp.to_torch(d.xanchor), wp.to_torch(d.xaxis)
        self._base = base_frame(self.scene, self.device, self._xpos, self._xquat)
        present = None if variant is None else wp.to_torch(variant)
        self.variants = VariantView(batch.full_scene, present, self.device)
        self._kept: dict[tuple[Hashable, ...], Any] = {}
        if layouts.reaching is not None:
            self._layout_grasp = wp.to_torch(layouts.grasp)
            self._layout_joints = {q: wp.to_torch(getattr(layouts, q)) for q in ("grasp_qpos", "pregrasp_qpos")}

    @property
    def model_rows(self) -> dict[str, wp.array]:
        """The arrays of the physics model that have a row for each world, by name."""
        return self._batch.fields.rows

    @property
    def finite(self) -> Tensor:
        """Worlds of which all positions and velocities are finite, shape (num_envs,), bool."""
        # a sum is finite if its terms are, and a finite number minus itself is 0
        total = self._qpos.sum(dim=1) + self._qvel.sum(dim=1)
        return total - total == 0.0

    def pose(self, name: str) -> Tensor:
        """Return position [m] and orientation (wxyz) of a body, shape (num_envs, 7)."""
        body = self._id("body", name, "pose")
        return self._base.pose(self._xpos[:, body], self._xquat[:, body])

    def present(self, names: Sequence[str]) -> Tensor:
        """Return which objects are present rather than left out by their groups, shape (num_envs, len(names)), bool."""

        def find() -> Tensor:
            objects = list(self.scene.config.objects)
            unknown = [name for name in names if name not in objects]
            if unknown:
                raise self._unknown("object", unknown[0], "present", objects)
            slots, always = slot_names(self.variants.scene.config), present.shape[1]
            return self._index([always if name in self.variants.names else slots.index(name) for name in names])

        present = wp.to_torch(self._layouts.present)
        columns = self._once(find, "present", *names)
        if self.variants.names:  # of which one variant is always there
            present = torch.cat([present, torch.ones_like(present[:, :1])], dim=1)
        return present[:, columns] > 0

    def variant(self, name: str, *, one_hot: bool = False) -> Tensor:
        """Return which variant of an object is present, numbered as in the scene file.

        Args:
            name: An object with variants.
            one_hot: Return a 1 in the column of that variant and 0 in the others, instead of its number.

        Returns:
            Shape (num_envs,), int64; with `one_hot` shape (num_envs, number of variants), float32.

        Raises:
            UnknownNameError: The scene has no such object with variants.
        """
        if name not in self.variants.names:
            raise self._unknown("object with variants", name, "variant", self.variants.names)
        index = self.variants.index(name)
        if not one_hot:
            return index
        return torch.nn.functional.one_hot(index, len(self.variants.scene.config.variants[name])).float()

    def extent(self, name: str) -> Tensor:
        """Return the edges [m] of the smallest box around a body, along the axes of its frame, shape (num_envs, 3).

        It contains the colliding geoms of the body itself, of the variant that is present.

        Raises:
            UnknownNameError: The scene has no such body.
            NotSupportedError: It has no geom that collides.
        """
        where = f"scene '{self.scene.config.name}': State.extent"
        boxes = self._once(lambda: Boxes(self.variants, [self._id("body", name, "extent")], where), "extent", name)
        lower, upper = boxes.corners()
        return (upper - lower).reshape(-1, 3).expand(self.num_envs, 3)

    def poses(self, names: Sequence[str]) -> Tensor:
        """Return the poses of several bodies at once, shape (num_envs, len(names), 7); see `pose`."""
        bodies = self._once(lambda: self._index([self._id("body", n, "poses") for n in names]), "poses", *names)
        return self._base.pose(self._xpos[:, bodies], self._xquat[:, bodies])

    def site(self, name: str) -> Tensor:
        """Return position [m] and orientation (wxyz) of a site, shape (num_envs, 7)."""

        def find() -> tuple[int, int, Tensor]:
            number = self._id("site", name, "site")
            return number, int(self.mjm.site_bodyid[number]), self._base.seen(self.mjm.site_quat[number])

        site, body, seen = self._once(find, "site", name)
        return self._base.pose(self._site_xpos[:, site], self._xquat[:, body], seen)

    def velocity(self, name: str) -> Tensor:
        """Return linear [m/s] and angular [rad/s] velocity of a free object, shape (num_envs, 6)."""
        return self.velocities((name,))[:, 0]

    def velocities(self, names: Sequence[str]) -> Tensor:
        """Return the velocities of several free objects at once, shape (num_envs, len(names), 6); see `velocity`."""

        def find() -> tuple[Tensor, Tensor]:
            bodies = [self._id("body", name, "velocity") for name in names]
            dofs = [[self._free_dof(body, "velocity") + i for i in range(6)] for body in bodies]
            return self._index(bodies), self._index(dofs).reshape(-1, 6)

        bodies, dofs = self._once(find, "velocities", *names)
        linear, angular = self._qvel[:, dofs].split(3, dim=-1)
        # MuJoCo keeps the angular velocity of a free joint in the body's own frame
        angular = rotations.rotate(self._xquat[:, bodies], angular)
        return self._base.vectors(linear, angular)

    def qpos(self, name: Joints) -> Tensor:
        """Return positions [m or rad] of the hinges and slides inside an object or a robot, or of one joint.

        Shape (num_envs, number of joints), in the order of the model, or in that of the numbers in a tuple.
        """
        return self._qpos[:, self._span("qpos", name)]

    def qvel(self, name: Joints) -> Tensor:
        """Return velocities [m/s or rad/s] of the same joints as qpos."""
        return self._qvel[:, self._span("qvel", name)]

    def grasp(self, name: str) -> Tensor:
        """Return the TCP pose of the grasp that an object's layout was accepted for, shape (num_envs, 7).

        Position [m] and orientation (wxyz), +z the approach and +y the closing axis. It moves with the object; NaN
        where the object is absent.
        """
        columns, targets = self._once(lambda: self._targets(name, "grasp"), "targets", name)
        body, pos, quat, first = self._once(lambda: self._grasps(targets), "grasps", name)
        # at most one variant has a grasp, and each has its own after those of the variants before
        own = self._layout_grasp[:, columns]
        chosen = torch.where(own >= 0, own + first, -1).amax(dim=1)
        i = chosen.clamp(min=0).long()
        rows = torch.arange(self.num_envs, device=self.device)
        xpos, xquat = self._xpos[rows, body[i]], self._xquat[rows, body[i]]
        pose = self._base.pose(xpos + rotations.rotate(xquat, pos[i]), rotations.multiply(xquat, quat[i]))
        return torch.where(chosen[:, None] >= 0, pose, torch.nan)

    def grasp_qpos(self, name: str) -> Tensor:
        """Return the arm's joints [rad or m] in that grasp, for the object's start pose, shape (num_envs, joints).

        NaN where the object is absent, and for objects whose reachability only the arm's map decided.
        """
        return self._solved("grasp_qpos", name)

    def pregrasp_qpos(self, name: str) -> Tensor:
        """Return the arm's joints [rad or m] at the pre-grasp, 8 cm back along the approach, as `grasp_qpos` does.

        NaN also for tiers below `clear`.
        """
        return self._solved("pregrasp_qpos", name)

    def jacobian(self, site: str, name: Joints) -> Tensor:
        """Return the Jacobian of a site, shape (num_envs, 6, number of joints), linear above angular.

        This times qvel is the site's linear [m/s] and angular [rad/s] velocity in the robot's base frame. The column of
        a hinge is (a x (p - o), a) for its axis a, its anchor o and the site's position p. The column of a slide is
        (a, 0), that of a joint that does not carry the site 0.

        Args:
            site: The site.
            name: The joints, as in `qpos`.
        """
        number = self._id("site", site, "jacobian")
        joints, kinds = self._once(lambda: self._jacobian_columns(number, name), "jacobian", site, name)
        axis, arm = self._xaxis[:, joints], self._site_xpos[:, None, number] - self._xanchor[:, joints]
        linear = torch.linalg.cross(axis, arm)
        if kinds is not None:
            hinge, slide = kinds
            linear, axis = hinge * linear + slide * axis, hinge * axis
        return self._base.vectors(linear, axis).transpose(1, 2)

    def put_joints(self, name: Joints, qpos: Tensor, mask: Tensor) -> None:
        """Set joint positions, at rest and held by their position actuators; for a task's `on_reset`.

        `s.put_joints("panda", s.pregrasp_qpos("can"), mask)` starts an episode at the pre-grasp. Afterwards everything
        that the task reads is up to date. Collisions at the new positions are not checked.

        Args:
            name: The joints, as in `qpos`.
            qpos: Positions of the first of these joints [m or rad], shape (num_envs, number of joints or fewer); worlds
                with a NaN stay as they are.
            mask: Which worlds, shape (num_envs,), bool.
        """
        width = qpos.shape[1]

        def make() -> JointWriter:
            return JointWriter(self.mjm, self.data, self._batch.fields.rest, self._joints(name, "put_joints")[:width])

        writer = self._once(make, "joints", name, width)
        writer.write(qpos, mask & qpos.isfinite().all(dim=1))
        self._batch.update()

    def put_pose(self, name: str, pose: Tensor, mask: Tensor) -> None:
        """Set the pose of a free object or of a marker, at rest and awake; for a task's `on_reset`.

        The joints inside the object keep their positions. Afterwards everything that the task reads is up to date:
        `grasp` has moved with the object, while `grasp_qpos` and `pregrasp_qpos` still belong to the layout's pose.
        Collisions at the new pose are not checked, and things that stand on the object stay where they are.

        Args:
            name: A free object, a marker, or any other free or mocap body of the scene's own model.
            pose: Position [m] and orientation (wxyz, of any length) in the frame of `State.pose`, shape (num_envs, 7);
                worlds with a NaN stay as they are, and so do those in which the object is absent.
            mask: Which worlds, shape (num_envs,), bool.

        Raises:
            UnknownNameError: The scene has no such body.
            ArgumentError: The body is a robot, a fixture or static, or hangs on joints.
        """
        writer = self._once(
            lambda: PoseWriter(self._batch, self._id("body", name, "put_pose"), self.device), "pose", name
        )
        pose = torch.cat([pose[:, :3], torch.nn.functional.normalize(pose[:, 3:], dim=1, eps=0.0)], dim=1)
        given = mask & pose.isfinite().all(dim=1)
        if writer.owner in self.scene.config.objects:
            given = given & self.present((writer.owner,))[:, 0]
        writer.write(self._base.to_world(pose), given)
        self._batch.update()

    def sleep(self, names: Sequence[str], mask: Tensor) -> None:
        """Put free objects to sleep where they are, until something that is awake touches them; for `on_reset`.

        Only where the task's `options` have SLEEPING: else nothing happens, and they settle as usual.

        Args:
            names: Free objects at rest, none of which stands on another.
            mask: Which worlds, shape (num_envs,), bool.
        """
        if not sleeps(self._batch.model):
            return

        def find() -> Tensor:
            bodies = [self._id("body", name, "sleep") for name in names]
            return self._index([int(self.mjm.dof_treeid[self._free_dof(body, "sleep")]) for body in bodies])

        trees = self._once(find, "trees", *names)
        asleep, awake = wp.to_torch(self.data.tree_asleep), wp.to_torch(self.data.tree_awake)
        # a tree that sleeps by itself is named by its own number
        asleep[:, trees] = torch.where(mask[:, None], trees.int(), asleep[:, trees])
        awake[:, trees] = torch.where(mask[:, None], 0, awake[:, trees])

    def model_field(self, name: str, of: str | None = None) -> Tensor:
        """Return a field of the physics model with a row for each world, to write to in `Task.on_reset`.

        Name it in `Task.model_fields`, or ask for it in `Task.bind`: steps have all other fields once for all worlds.
        What follows from the field, such as the inverse weights of bodies, is brought up to date after `on_reset`;
        other fields do not follow, except by `scale_field`: to make a body heavier, write "body_inertia" as well.

        Args:
            name: The field, by its name in mujoco_warp's Model: "body_mass", "geom_friction", "gravity".
            of: An element of the model, or an object or a robot, of which a field of bodies has the row of the root
                body, and other fields those of all geoms, joints or actuators inside.

        Returns:
            A view that steps read, in the units of MuJoCo, shape (num_envs, number of elements, ...); (num_envs, ...)
            for `of` a single element.

        Raises:
            UnknownNameError: There is no such field or element, or layouts depend on it.
            ArgumentError: The field is asked for after `bind`, or the model has none of what it scales.
        """
        return self._once(
            lambda: wp.to_torch(self._batch.fields.ask(name, of, where="State.model_field")), "f", name, of
        )

    def scale_field(self, name: str, of: str, factor: Tensor, mask: Tensor) -> None:
        """Set part of a model field to the model's values times a factor, in the masked worlds; for `Task.on_reset`.

        As with the word `scale` of a scene file, friction is that of sliding, inertias follow masses, and gains of the
        bias those of actuators.

        Args:
            name: A field of `Task.model_fields`, or that was asked for in `Task.bind`.
            of: An element of the model, or an object or a robot; relative to the present variant of an object.
            factor: Factors, shape (num_envs,), float32.
            mask: Which worlds, shape (num_envs,), bool.

        Raises:
            UnknownNameError, ArgumentError: As in `model_field`; or factors or a mask of another shape.
        """
        self._batch.fields.scale(name, of, factor, wp.from_torch(mask, dtype=wp.bool), "State.scale_field")

    def parameter(self, name: str) -> Tensor:
        """Return the numbers that `randomize` of the scene has drawn for this episode, shape (num_envs, n).

        These are factors for `scale`, terms for `add`, and values for `abs` and `choice`. They are in the group
        `critic`, too, under the name "parameters".

        Args:
            name: The name of the draw: "can.mass", "robot.gains", "gravity", "lights.lamp.diffuse".

        Raises:
            UnknownNameError: The scene draws nothing of this name.
        """
        return wp.to_torch(self._batch.fields.parameter(name, "State.parameter"))

    @property
    def parameters(self) -> Tensor | None:
        """All numbers that `randomize` of the scene has drawn, shape (num_envs, n); None if it draws nothing."""
        numbers = [self.parameter(draw.name) for draw in self.scene.draws]
        return torch.cat(numbers, dim=1) if numbers else None

    def actuator(self, name: str) -> int:
        """Return the column of an actuator in `ctrl`."""
        return int(actuator_controls(self.mjm)[0][self._id("actuator", name, "actuator")])

    @overload
    def random(self, n: int, low: float = 0.0, high: float = 1.0, *, stream: int = 0) -> Tensor: ...
    @overload
    def random(self, n: str, low: tuple[int, ...] = ()) -> Tensor: ...
    def random(self, n: int | str, low: Any = None, high: float = 1.0, *, stream: int = 0) -> Tensor:
        """Draw uniform numbers: `random(n, low, high)` for this step, or `random(name, shape)` for this episode.

        With a number they are in [low, high), by default [0, 1), shape (num_envs, n), and depend only on the world's
        seed and episode, the steps since its reset, and `stream`: a second call in the same step gives the same
        numbers, so use another stream for another purpose.

        With a name they are in [0, 1), shape (num_envs, *shape), and depend only on seed, episode and name.
        """
        layouts = self._layouts
        if isinstance(n, str):
            shape = low or ()
            values = torch.empty(self.num_envs, math.prod(shape), device=self.device)
            draw_named(layouts.seed, layouts.episode, self._split, n, wp.from_torch(values))
            return values.reshape(self.num_envs, *shape)
        values = torch.empty(self.num_envs, n, device=self.device)
        number, low = task_stream(self._split, stream), low or 0.0
        draw_uniform(layouts.seed, layouts.episode, self._elapsed, number, low, high, wp.from_torch(values))
        return values

    def _targets(self, name: str, method: str) -> tuple[Tensor, list[ReachTarget]]:
        """Return the columns of a reachable object in the layouts' grasps, and its ReachTargets, one for a variant."""
        targets = () if self._layouts.reaching is None else self._layouts.reaching.targets
        members = self.variants.scene.config.variants.get(name, (name,))
        found = [i for i, target in enumerate(targets) if target.name in members]
        if not found:
            owners = owners_of(self.variants.scene.config.variants)
            raise self._unknown("reachable object", name, method, {owners.get(t.name, t.name) for t in targets})
        return self._index(found), [targets[i] for i in found]

    def _solved(self, array: str, name: str) -> Tensor:
        columns, targets = self._once(lambda: self._targets(name, array), "targets", name)
        assert self._layouts.reaching is not None
        joints = len(self._layouts.reaching.arm_of(targets[0]).arm.joints)
        solved = self._layout_joints[array][:, columns, :joints]
        if len(targets) == 1:
            return solved[:, 0].clone()
        there = self._layout_grasp[:, columns].argmax(dim=1)  # absent variants have -1
        return solved[torch.arange(self.num_envs, device=self.device), there]

    def _grasps(self, targets: Sequence[ReachTarget]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return body ids, positions and orientations (wxyz) of grasps, and the number of the first one of a target."""
        grasps = [grasp for target in targets for grasp in target.grasp_set.grasps]
        counts = [0, *(len(target.grasp_set.grasps) for target in targets[:-1])]
        bodies = self.variants.scene.sim_bodies[[g.body for g in grasps]]
        pos, quat = (
            torch.tensor(np.array(values), dtype=torch.float32, device=self.device)
            for values in zip(*((g.pos, g.quat) for g in grasps), strict=True)
        )
        return self._index(bodies.tolist()), pos, quat, self._index(np.cumsum(counts).tolist())

    def _once(self, make: Callable[[], Any], *key: Hashable) -> Any:
        """Return what `make` returned when it was first called for this key."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _index(self, numbers: list) -> Tensor:
        return torch.tensor(numbers, dtype=torch.int64, device=self.device)

    def _free_dof(self, body: int, method: str) -> int:
        """Return the address of the first of the six velocities of a free object."""
        mjm = self.mjm
        joint = int(mjm.body_jntadr[body])
        if joint < 0 or mjm.jnt_type[joint] != FREE:
            free = [mjm.body(b).name for j, b in enumerate(mjm.jnt_bodyid) if mjm.jnt_type[j] == FREE]
            raise self._unknown("free object", mjm.body(body).name, method, free)
        return int(mjm.jnt_dofadr[joint])

    def _id(self, kind: str, name: str, method: str) -> int:
        """Return the number of a body, a site or an actuator in the model."""
        if kind == "body":
            return find_body(self, name, f"State.{method}")
        number = mujoco.mj_name2id(self.mjm, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)
        if number < 0:
            count = {"site": self.mjm.nsite, "actuator": len(self.mjm.actuator_trntype)}[kind]
            valid = [getattr(self.mjm, kind)(i).name for i in range(count)]
            raise self._unknown(kind, name, method, filter(None, valid))
        return number

    def _unknown(self, kind: str, name: str, method: str, valid: Iterable[str]) -> UnknownNameError:
        return UnknownNameError(kind, name, f"scene '{self.scene.config.name}': State.{method}", valid)

    def _span(self, array: str, name: Joints) -> slice | Tensor:
        def find() -> slice | Tensor:
            adr = self.mjm.jnt_qposadr if array == "qpos" else self.mjm.jnt_dofadr
            return as_columns([int(adr[j]) for j in self._joints(name, array)], self.device)

        return self._once(find, array, name)

    def _joints(self, name: Joints, method: str) -> list[int]:
        """Return the ids of a joint, or of the hinges and slides inside an object, a robot or a body."""
        if not isinstance(name, str):
            return list(name)
        mjm = self.mjm
        scalar = [j for j in range(mjm.njnt) if mjm.jnt_type[j] in SCALAR]
        found = [j for j in scalar if mjm.joint(j).name == name]
        body = _body(self.scene, name)
        if not found and body >= 0:
            inside = subtree(mjm, body)
            found = [j for j in scalar if int(mjm.jnt_bodyid[j]) in inside]
        if not found:
            roots = {mjm.body(int(mjm.body_rootid[int(mjm.jnt_bodyid[j])])).name for j in scalar}
            raise self._unknown("joint", name, method, filter(None, roots | {mjm.joint(j).name for j in scalar}))
        return found

    def _jacobian_columns(self, site: int, name: Joints) -> tuple[Tensor, Tensor | None]:
        """Return the joints of a Jacobian, and flags of those that carry the site: of hinges, then of slides.

        The flags are 0 or 1, shape (2, number of joints, 1), and None if all joints are hinges that carry the site.
        """
        mjm, joints = self.mjm, self._joints(name, "jacobian")
        body = int(mjm.site_bodyid[site])
        carries = np.array([body in subtree(mjm, int(mjm.jnt_bodyid[j])) for j in joints])
        slide = mjm.jnt_type[joints] == SLIDE
        kinds = np.stack([carries & ~slide, carries & slide])[:, :, None]
        flags = None if kinds[0].all() else torch.tensor(kinds, dtype=torch.float32, device=self.device)
        return self._index(joints), flags


def as_columns(numbers: list[int], device: torch.device) -> slice | Tensor:
    """Return columns as a slice where they follow each other, so that indexing gives a view."""
    first = numbers[0]
    if numbers == list(range(first, first + len(numbers))):
        return slice(first, first + len(numbers))
    return torch.tensor(numbers, device=device)


def find_body(s: State, name: str, where: str) -> int:
    """Return the id of a body, by the scene's name of an object or a robot, or by its name in the model.

    `where` names the caller in an error.

    Raises:
        UnknownNameError: The scene has no such body.
    """
    body = _body(s.scene, name)
    if body < 0:
        valid = {*s.scene.bodies, *(s.mjm.body(i).name for i in range(1, s.mjm.nbody))}
        raise UnknownNameError("body", name, f"scene '{s.scene.config.name}': {where}", filter(None, valid))
    return body


def _body(scene: SceneModel, name: str) -> int:
    if name in scene.bodies:
        return scene.bodies[name]
    return mujoco.mj_name2id(scene.mjm, mujoco.mjtObj.mjOBJ_BODY, name)
