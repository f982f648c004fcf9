"""`State`: the worlds by name, as a task reads them and writes to them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
import warp as wp
from torch import Tensor

from sceniris_gym.layout.masks import as_count, as_shape
from sceniris_gym.sim.named_random import draw_named, draw_uniform, task_stream
from sceniris_gym.sim.versions import sleeps
from sceniris_gym.vector.names import Joints, find_body, find_free_dof, find_joints
from sceniris_gym.vector.readings import Readings
from sceniris_gym.vector.writers import JointWriter, PoseWriter


class State(Readings):
    """The state of all worlds by name. Tensors are on the environment's device; clone what you keep, some are views.

    Names are those of the scene: an object, a robot (the only one also by the name of its asset), or `object/part` for
    the bodies, sites, joints and actuators inside. In a scene with a `model` all names of that model can be used too.
    A name that the scene does not have raises UnknownNameError. Poses and velocities are in the robot's base frame, or
    in the world frame if the scene has no robot or several.

    Args:
        batch: The worlds.
        layouts: The layouts of the worlds.
        split: The split of the layouts.
        variants: The present variant of each object with variants, as `ResetRandomizer.variants`, if there are any.

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
        layout_param: Numbers of the params that each layout was made with, shape (num_envs, nvalue).
    """

    @property
    def model_rows(self) -> dict[str, Tensor]:
        """The fields of the physics model that have a row for each world, by name."""
        return {name: wp.to_torch(array) for name, array in self._batch.fields.rows.items()}

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
            return JointWriter(
                self.mjm, self.data, self._batch.fields.rest, find_joints(self.scene, name, "State.put_joints")[:width]
            )

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
            lambda: PoseWriter(self._batch, find_body(self.scene, name, "State.put_pose"), self.device), "pose", name
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
            bodies = [find_body(self.scene, name, "State.sleep") for name in names]
            return self._index(
                [int(self.mjm.dof_treeid[find_free_dof(self.scene, body, "State.sleep")]) for body in bodies]
            )

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

    def randomized(self, name: str) -> Tensor:
        """Return the numbers that `randomize` of the scene has drawn for this episode, shape (num_envs, n).

        These are factors for `scale`, terms for `add`, and values for `abs` and `choice`. They are in the group
        `critic`, too, under the name "randomized".

        Args:
            name: The name of the draw: "can.mass", "robot.gains", "gravity", "lights.lamp.diffuse".

        Raises:
            UnknownNameError: The scene draws nothing of this name.
        """
        return wp.to_torch(self._batch.fields.parameter(name, "State.randomized"))

    def uniform(self, n: int, low: float = 0.0, high: float = 1.0, *, stream: int = 0) -> Tensor:
        """Draw uniform numbers in [low, high) for this step, shape (num_envs, n).

        They depend only on the world's seed and episode, the steps since its reset, and `stream`. A second call in the
        same step gives the same numbers, so use another stream for another purpose.
        """
        view, values = self._layouts.view, torch.empty(self.num_envs, as_count(n, "uniform: n", 0), device=self.device)
        number = task_stream(self._split, stream)
        draw_uniform(view.seed, view.episode, self._elapsed, number, low, high, wp.from_torch(values))
        return values

    def random(self, name: str, shape: int | Sequence[int] = ()) -> Tensor:
        """Draw uniform numbers in [0, 1) for this episode, shape (num_envs, *shape).

        They depend only on the world's seed and episode, and the name.
        """
        view, shape = self._layouts.view, as_shape(shape, "random: shape")
        values = torch.empty(self.num_envs, math.prod(shape), device=self.device)
        draw_named(view.seed, view.episode, self._split, name, wp.from_torch(values))
        return values.reshape(self.num_envs, *shape)
