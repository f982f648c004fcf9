"""`State`: a task's access to the worlds by name, for reading and writing."""

import math
from collections.abc import Sequence

import torch
import warp as wp
from torch import Tensor

from sceniris_gym.errors import ArgumentTypeError
from sceniris_gym.layout.masks import as_count, as_shape
from sceniris_gym.sim.model_fields import owner
from sceniris_gym.sim.named_random import draw_named, draw_uniform, task_stream
from sceniris_gym.sim.versions import sleeps
from sceniris_gym.vector.names import Joints, find_body, find_free_dof, find_joints
from sceniris_gym.vector.readings import Readings
from sceniris_gym.vector.writers import JointWriter, PoseWriter


class State(Readings):
    """The state of all worlds by name, as tensors on the environment's device.

    Some of these tensors are views, which later steps overwrite. To keep the values of a tensor, clone it.

    Names are the names of the scene: an object, a robot, or `object/part` for the bodies, sites, joints and actuators
    inside an object or a robot. A single robot also has the name of its asset. In a scene with a `model`, all names of
    that model also work. An unknown name raises UnknownNameError. Poses and velocities are in the robot's base frame,
    or in the world frame if the scene has no robot or several robots.

    Args:
        batch: The worlds.
        layouts: The layouts of the worlds.
        split: The split of the layouts.
        variants: The present variant of each object with variants (`ResetRandomizer.variants`), or None.

    Attributes:
        num_envs: Number of worlds.
        device: Torch device.
        elapsed: Control steps since the reset of each world, shape (num_envs,), int32.
        ctrl: Controls, shape (num_envs, nu). Write to this view to set them.
        control_range: Lower and upper limits of the controls, shape (nu, 2).
        dt: Duration of a control step [s].
        seed: Seed of each world's layout, shape (num_envs,), int64. A seed from 2^63 on appears as its two's
            complement.
        episode: Episode of each world's layout, -1 before the first reset, shape (num_envs,), int32.
        start: Index of each world's kind of start in the scene file's list `start`, or -1 if the file has no such list,
            shape (num_envs,), int32.
        layout_status: Status of each world's layout, shape (num_envs,), int32: 0 before the first layout, 1 for a valid
            layout, 2 for a layout from the fallback bank.
        layout_param: Values of the params of each layout, shape (num_envs, nvalue).
    """

    @property
    def model_rows(self) -> dict[str, Tensor]:
        """The fields of the physics model that have a row for each world, as torch tensors by name."""
        return {name: wp.to_torch(array) for name, array in self._batch.fields.rows.items()}

    def put_joints(self, name: Joints, qpos: Tensor, mask: Tensor) -> None:
        """Set joint positions in a task's `on_reset`. The joints are then at rest, and their actuators hold them.

        `s.put_joints("panda", s.pregrasp_qpos("can"), mask)` starts an episode at the pre-grasp. The call updates all
        quantities that the task reads. It does not check for collisions at the new positions.

        Args:
            name: The joints, as in `qpos`.
            qpos: Positions [m or rad], shape (num_envs, n), of the first n of these joints. Worlds with a NaN keep
                their state.
            mask: Which worlds, shape (num_envs,), bool.
        """
        width = qpos.shape[1]

        def make() -> JointWriter:
            joints = find_joints(self.scene, name, "State.put_joints")[:width]
            return JointWriter(self.mjm, self.data, self._batch.fields.rest, joints)

        writer = self._once(make, "joints", name, width)
        given = mask & qpos.isfinite().all(dim=1)
        writer.write(qpos, given)
        self._batch.fields.launch_bear(wp.from_torch(given, dtype=wp.bool))
        self._batch.update()

    def put_pose(self, name: str, pose: Tensor, mask: Tensor) -> None:
        """Set the pose of a free object or a marker in a task's `on_reset`. The object is then at rest and awake.

        The joints inside the object keep their positions, and objects that stand on it stay where they are. The call
        updates all quantities that the task reads, but does not check for collisions at the new pose. `grasp` moves
        with the object, but `grasp_qpos` and `pregrasp_qpos` still belong to the object's pose in the layout.

        Args:
            name: A free object, a marker, or another free or mocap body of the scene's `model`.
            pose: Position [m] and orientation (wxyz, of any length) in the frame of `State.pose`, shape (num_envs, 7).
                Worlds with a NaN keep their state, and so do worlds without the object.
            mask: Which worlds, shape (num_envs,), bool.

        Raises:
            UnknownNameError: The scene has no such body.
            ArgumentError: The body is a robot, a fixture or a static object, or hangs on joints.
        """

        def make() -> PoseWriter:
            return PoseWriter(self._batch, find_body(self.scene, name, "State.put_pose"), self.device)

        writer = self._once(make, "pose", name)
        pose = torch.cat([pose[:, :3], torch.nn.functional.normalize(pose[:, 3:], dim=1, eps=0.0)], dim=1)
        given = mask & pose.isfinite().all(dim=1)
        if writer.owner in self.scene.config.objects:
            given = given & self.present((writer.owner,))[:, 0]
        writer.write(self._base.to_world(pose), given)
        self._batch.update()

    def sleep(self, names: Sequence[str], mask: Tensor) -> None:
        """Put free objects to sleep in a task's `on_reset`. They sleep until an awake object touches them.

        The task's `options` must contain SLEEPING. Otherwise the call has no effect, and the objects settle as usual.

        Args:
            names: Free objects at rest that do not support each other.
            mask: Which worlds, shape (num_envs,), bool.
        """
        if not sleeps(self._batch.model):
            return

        def find() -> Tensor:
            dofs = [find_free_dof(self.scene, name, "State.sleep") for name in names]
            return self._index(self.mjm.dof_treeid[dofs].tolist())

        trees = self._once(find, "trees", *names)
        asleep, awake = wp.to_torch(self.data.tree_asleep), wp.to_torch(self.data.tree_awake)
        # MuJoCo links sleeping trees in cycles: the number of the tree itself is a cycle of one
        asleep[:, trees] = torch.where(mask[:, None], trees.int(), asleep[:, trees])
        awake[:, trees] = torch.where(mask[:, None], 0, awake[:, trees])

    def model_field(self, name: str, of: str | None = None) -> Tensor:
        """Return a field of the physics model with a row for each world. Write to it in `Task.on_reset`.

        Name the field in `Task.model_fields`, or call this method in `Task.bind`. All other fields have one row for all
        worlds. After `on_reset`, quantities that MuJoCo derives from the field, such as the inverse weights of bodies,
        are updated. Other fields keep their values: to make a body heavier, write both "body_mass" and "body_inertia",
        or call `scale_field`, which scales both.

        Args:
            name: The field, by its name in mujoco_warp's Model: "body_mass", "geom_friction", "gravity".
            of: An element of the model, an object or a robot, or None for the whole field. For an object or a robot, a
                field of bodies has only the row of the root body, and any other field has the rows of all geoms, joints
                or actuators inside.

        Returns:
            A view that steps read, in the units of MuJoCo, shape (num_envs, number of elements, ...), or
            (num_envs, ...) if `of` is a single element.

        Raises:
            UnknownNameError: There is no such field or element, or layouts depend on it.
            ArgumentError: The field is first requested after `bind`. The field is 0 in the whole model, so steps leave
                it out.
        """
        ask = self._batch.fields.ask
        return self._once(lambda: wp.to_torch(ask(name, of, where="State.model_field")), "f", name, of)

    def _field(self, name: str) -> Tensor:
        """Return a whole field of the Model, with a row for each world or one for all. Call this only after `bind`."""
        return self._once(lambda: wp.to_torch(getattr(owner(self._batch.model, name), name)), "whole", name)

    def scale_field(self, name: str, of: str, factor: Tensor, mask: Tensor) -> None:
        """Set some elements of a model field to the model's values times a factor. Call this in a task's `on_reset`.

        As with the word `scale` in a scene file, inertias are scaled with masses, and bias gains with the gains of
        their actuators. Of the frictions, only sliding friction is scaled.

        Args:
            name: A field of `Task.model_fields`, or a field that `Task.bind` got from `model_field`.
            of: An element of the model, an object or a robot. For an object with variants, the factor multiplies the
                values of the present variant.
            factor: Factors, shape (num_envs,), float32.
            mask: Which worlds, shape (num_envs,), bool.

        Raises:
            UnknownNameError, ArgumentError: As in `model_field`. The factors or the mask have another shape.
        """
        self._batch.fields.scale(name, of, factor, wp.from_torch(mask, dtype=wp.bool), "State.scale_field")

    def randomized(self, name: str) -> Tensor:
        """Return the numbers that the scene's `randomize` drew for this episode, shape (num_envs, n).

        The numbers are factors for `scale`, terms for `add`, and values for `abs` and `choice`. If the values of a
        `choice` have several numbers each, such as colours, this method returns the index of the value in the list,
        shape (num_envs, 1). The group `critic` also has the numbers of all draws, under the name "randomized".

        Args:
            name: The name of the draw: "can.mass", "robot.gains", "gravity", "lights.lamp.diffuse".

        Raises:
            UnknownNameError: The scene has no draw of this name.
        """
        return wp.to_torch(self._batch.fields.parameter(name, "State.randomized"))

    def uniform(self, n: int, low: float = 0.0, high: float = 1.0, *, stream: int = 0) -> Tensor:
        """Draw uniform numbers in [low, high) for this step, shape (num_envs, n).

        The numbers depend only on the world's seed and episode, the steps since its reset, and `stream`. A second call
        in the same step returns the same numbers, so use a separate stream for each purpose.
        """
        view, values = self._layouts.view, torch.empty(self.num_envs, as_count(n, "uniform: n", 0), device=self.device)
        number = task_stream(self._split, stream)
        draw_uniform(view.seed, view.episode, self._elapsed, number, low, high, wp.from_torch(values))
        return values

    def random(self, name: str, shape: int | Sequence[int] = (), *high: float) -> Tensor:
        """Draw uniform numbers in [0, 1) for this episode, shape (num_envs, *shape).

        The numbers depend only on the seed and episode of the world, and on `name`. For other limits than 0 and 1,
        scale these numbers. `uniform` takes limits, but draws new numbers in each step. The parameter `high` only
        exists to refuse the former call `random(n, low, high)`.

        Raises:
            ArgumentTypeError: `name` is not a string, or a third argument is given.
        """
        if high or not isinstance(name, str):
            raise ArgumentTypeError(f"State.random: name should be a string, got {name!r}. Call uniform(n, low, high).")
        view, shape = self._layouts.view, as_shape(shape, "random: shape")
        values = torch.empty(self.num_envs, math.prod(shape), device=self.device)
        draw_named(view.seed, view.episode, self._split, name, wp.from_torch(values))
        return values.reshape(self.num_envs, *shape)
