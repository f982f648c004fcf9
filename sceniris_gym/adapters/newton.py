"""`NewtonRandomizer`: resets worlds of Newton's MuJoCo solver to fresh layouts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.sequence import launching
from sceniris_gym.errors import ArgumentError, SceneMismatchError, check_type, import_extra
from sceniris_gym.layout.masks import as_worlds, fill_mask
from sceniris_gym.program.compiled import CompiledScene, refuse_draws, refuse_starts
from sceniris_gym.sim.fit import check_fit, check_model
from sceniris_gym.sim.sources import SourceLike, make_pipeline

newton: Any = import_extra("newton", "newton")

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FREE = wp.constant(int(newton.JointType.FREE))
_BALL = wp.constant(int(newton.JointType.BALL))

_TOLERANCE = 1.0e-4
"""Largest difference [m, rad, or of a quaternion] between two starts that counts as rounding."""
_CURE = (
    "Compile a scene with model: solver.mj_model, and give all worlds the same shapes and origin: one builder, "
    "replicated without spacing."
)


@wp.kernel
def _write_joints(
    # Lists of joints:
    joint_type: wp.array[int],
    q_start: wp.array[int],
    qd_start: wp.array[int],
    x_c: wp.array[wp.transform],
    dof_ref: wp.array[float],
    qposadr: wp.array[int],
    mocapid: wp.array[int],
    # In:
    mask: wp.array[wp.bool],
    qpos: wp.array2d[float],
    mocap_pos: wp.array2d[wp.vec3],
    mocap_quat: wp.array2d[wp.quat],
    # Newton's arrays out:
    x_p: wp.array[wp.transform],
    joint_q: wp.array[float],
    joint_qd: wp.array[float],
    joint_mask: wp.array[wp.bool],
):
    worldid, i = wp.tid()
    joint = worldid * qposadr.shape[0] + i
    joint_mask[joint] = mask[worldid]
    if not mask[worldid]:
        return
    x, adr, first = qpos[worldid], qposadr[i], q_start[joint]
    if adr < 0 and mocapid[i] < 0:  # MuJoCo has no position of this joint
        return
    for k in range(qd_start[joint], qd_start[joint + 1]):
        joint_qd[k] = 0.0
    if joint_type[joint] == _BALL:
        anchor = wp.transform_get_rotation(x_c[joint])
        rotation = wp.quat_inverse(anchor) * wp.quat(x[adr + 1], x[adr + 2], x[adr + 3], x[adr]) * anchor
        for k in range(4):
            joint_q[first + k] = rotation[k]
        return
    if joint_type[joint] != _FREE and mocapid[i] < 0:
        for k in range(q_start[joint + 1] - first):
            joint_q[first + k] = x[adr + k]
            if dof_ref:
                joint_q[first + k] -= dof_ref[qd_start[joint] + k]
        return

    pose = wp.transform_identity()  # xyzw, while MuJoCo's quaternions are wxyz
    if mocapid[i] >= 0:
        quat = mocap_quat[worldid, mocapid[i]]
        pose = wp.transform(mocap_pos[worldid, mocapid[i]], wp.quat(quat[1], quat[2], quat[3], quat[0]))
    else:
        rotation = wp.quat(x[adr + 4], x[adr + 5], x[adr + 6], x[adr + 3])
        pose = wp.transform(wp.vec3(x[adr], x[adr + 1], x[adr + 2]), rotation)
    if joint_type[joint] == _FREE:
        motion = wp.transform_inverse(x_p[joint]) * pose * x_c[joint]
        for k in range(7):
            joint_q[first + k] = motion[k]
    else:  # a fixed root has no coordinates, so its pose is set by the frame of its joint
        x_p[joint] = pose * x_c[joint]


class NewtonRandomizer(StaysHere):
    """Resets chosen worlds of a `newton.solvers.SolverMuJoCo` to fresh layouts, at rest.

    Newton owns the state: every step of the solver copies `State.joint_q` into MuJoCo's data. A reset therefore writes
    layouts to `State.joint_q` in Newton's convention, in which the pose of a joint is measured between its two anchors,
    and quaternions are xyzw. The reset also sets `joint_qd` to 0, updates body poses and velocities (`newton.eval_fk`),
    and clears warm starts, forces, activations and controls (`solver.reset`). Joints that layouts do not set return
    to their start positions. Roots that Newton fixes to the world can also be placed, through `Model.joint_X_p`. All
    other worlds keep their bits.

    A reset with a mask on the device does not wait for the device, so a graph can capture the reset with the steps.

    Args:
        compiled: A scene with `model: solver.mj_model`, on the device of the model.
        model: The newton.Model.
        solver: The newton.solvers.SolverMuJoCo that steps it.
        *states: Every newton.State that the loop steps. A reset writes all of them.
        seed: Seed of world 0 (world i has seed + i), or one seed per world. Not used with a layout_source.
        split: "train" or "eval", which share no layouts. Not used with a layout_source.
        layout_source: A LayoutSource, a LayoutTable or LayoutDataset whose rows are served, or a function
            `(compiled, nworld)` that returns a LayoutSource. None makes a LayoutGenerator.
        prefetch: Make the next layout of every world during the steps before its reset, as in ResetRandomizer. None
            prefetches on a GPU. Not with a layout_source.

    Attributes:
        pipeline: The LayoutPipeline that makes and prefetches the layouts.
        layouts: The latest layout of each world.

    Raises:
        ArgumentError: The solver runs on MuJoCo C, or treats all worlds as one. The solver or a state belongs to
            another model.
        SceneMismatchError: The scene was made from another model, the worlds differ from each other, or joints start at
            other positions in the scene than in Newton's model.
        NotSupportedError: The scene uses `start` or `randomize`.
    """

    _SEND = "its CompiledScene to the other process, and construct a new object there"

    @launching
    def __init__(
        self,
        compiled: CompiledScene,
        model: Any,
        solver: Any,
        *states: Any,
        seed: int | Sequence[int] | np.ndarray = 0,
        split: str = "train",
        layout_source: SourceLike | None = None,
        prefetch: bool | wp.Stream | None = None,
    ) -> None:
        arguments = [(compiled, CompiledScene, "compiled"), (model, newton.Model, "model")]
        arguments += [(state, newton.State, "states") for state in states or (None,)]
        for argument, kind, name in arguments:
            check_type(argument, kind, f"NewtonRandomizer: {name}")
        refuse_starts(compiled, "NewtonRandomizer")
        refuse_draws(compiled, "NewtonRandomizer", "writing into the arrays of newton.Model")
        nworld, data = model.world_count, getattr(solver, "mjw_data", None)
        if data is None or solver.use_mujoco_cpu or solver.model is not model or data.nworld != nworld:
            raise ArgumentError(
                "NewtonRandomizer: solver should be a SolverMuJoCo of the model, with use_mujoco_cpu=False and as "
                f"many worlds as the model ({nworld}). Make the worlds of the model by newton.ModelBuilder.replicate."
            )
        if any(state.joint_q.shape != model.joint_q.shape for state in states):
            raise ArgumentError("NewtonRandomizer: each state should come from model.state() of the same model.")
        self.compiled, self.model, self.solver, self.states = compiled, model, solver, states
        where, given = "NewtonRandomizer", {"layout_source": layout_source, "prefetch": prefetch}
        self.pipeline, _ = make_pipeline(compiled, nworld, where, seed=seed, split=split, **given)
        self.layouts = self.pipeline.layouts
        check_model(compiled, solver.mj_model, where, _CURE)
        check_fit(compiled, solver.mjw_model, data, self.layouts, where=where, cure=_CURE)
        with wp.ScopedDevice(model.device):
            self._world_mask = wp.zeros(nworld + 1, dtype=wp.bool)  # the last entry is Newton's global world
            self._mask = self._world_mask[:nworld]
            self._joint_mask = wp.zeros(model.joint_count, dtype=wp.bool)
            self._qposadr = wp.array(solver.mj_q_start.numpy()[: model.joint_count // nworld], dtype=int)
            self._mocapid = wp.array(self._mocap_of_joints(), dtype=int)
        self._check_start()

    @launching
    def reset(self, worlds: Any = None, *, seed: Any = None, layouts: Any = None) -> None:
        """Give worlds their next layouts, or chosen layouts.

        Args:
            worlds: None for all worlds, booleans of shape (nworld,), ids of worlds, or a slice.
            seed: As in `ResetRandomizer.reset`.
            layouts: As in `ResetRandomizer.reset`.

        Raises:
            ArgumentTypeError, ArgumentError, SceneMismatchError: As `ResetRandomizer.reset`.
        """
        if seed is not None or layouts is not None:
            self.pipeline.reseed(worlds, seed=seed, layouts=layouts)
        fill_mask(as_worlds(worlds, self.model.world_count, self.model.device, self._mask), self._mask)
        self.pipeline.generate(self._mask)
        for state in self.states:
            self._write(self.layouts.view.qpos, state.joint_q, state.joint_qd, self.model.joint_X_p)
            newton.eval_fk(self.model, state.joint_q, state.joint_qd, state, joint_mask=self._joint_mask)
            self.solver.reset(state, self._world_mask, flags=0)

    def _write(self, qpos: wp.array, joint_q: wp.array, joint_qd: wp.array, x_p: wp.array) -> None:
        """Write joint positions into the masked worlds of Newton's arrays, with the mocap poses of the layouts."""
        m, layouts = self.model, self.layouts.view
        dof_ref = getattr(getattr(m, "mujoco", None), "dof_ref", None)
        joints = [m.joint_type, m.joint_q_start, m.joint_qd_start, m.joint_X_c, dof_ref, self._qposadr, self._mocapid]
        wp.launch(
            _write_joints,
            (m.world_count, self._qposadr.shape[0]),
            inputs=[*joints, self._mask, qpos, layouts.mocap_pos, layouts.mocap_quat],
            outputs=[x_p, joint_q, joint_qd, self._joint_mask],
            device=m.device,
        )

    def _mocap_of_joints(self) -> np.ndarray:
        """Return for each Newton joint of a world the placed mocap body that this joint fixes to the world, or -1."""
        found, roots = np.full(self._qposadr.shape[0], -1), self.solver.mjc_mocap_to_newton_jnt
        placed = self.compiled.mjm.body_mocapid[list(self.compiled.scene.owners)]
        for mocap in placed[placed >= 0]:
            found[roots.numpy()[0, mocap]] = mocap
        return found

    def _check_start(self) -> None:
        """Raise if a joint that layouts do not place starts at another position in the scene than in Newton's model."""
        m, mjm, scene = self.model, self.compiled.mjm, self.compiled.scene
        home = wp.array(np.tile(self.compiled.home_qpos, (m.world_count, 1)), dtype=float, device=m.device)
        joint_q, joint_qd = wp.clone(m.joint_q), wp.clone(m.joint_qd)
        self._mask.fill_(True)
        self._write(home, joint_q, joint_qd, wp.clone(m.joint_X_p))
        free = set(mjm.jnt_qposadr[np.isin(mjm.jnt_bodyid, list(scene.owners))].tolist())
        first, adr, start, wanted = m.joint_q_start.numpy(), self._qposadr.numpy(), m.joint_q.numpy(), joint_q.numpy()
        for joint in range(m.joint_count):
            q = slice(first[joint], first[joint + 1])
            if adr[joint % len(adr)] not in free and np.abs(start[q] - wanted[q]).max(initial=0.0) > _TOLERANCE:
                raise SceneMismatchError(
                    f"NewtonRandomizer: joint '{m.joint_label[joint]}' starts at {start[q].round(4).tolist()} in "
                    f"model.joint_q, but at {wanted[q].round(4).tolist()} in the scene, so layouts are tested "
                    "with a wrong pose. Change the scene: `robot: {in_model: base, joints: {name: {value: ...}}}`."
                )
