"""Models that MuJoCo-Warp can simulate."""

from __future__ import annotations

import mujoco
import mujoco_warp as mjw

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.program.plan import Plan


def check_solver(plan: Plan) -> None:
    """Check that MuJoCo-Warp has the solver of the model.

    Raises:
        NotSupportedError: It does not.
    """
    solver = mujoco.mjtSolver(plan.scene.mjm.opt.solver)
    if int(solver) not in set(mjw.SolverType):
        name = solver.name.removeprefix("mjSOL_")
        raise NotSupportedError(f"{plan.scene.config.where}: MuJoCo-Warp has no solver {name}. Use Newton or CG.")


def put_simulated(mjm: mujoco.MjModel, where: str) -> mjw.Model:
    """Return mujoco_warp's Model on Warp's current device.

    Raises:
        NotSupportedError: The model has a feature that MuJoCo-Warp lacks; the message begins with `where`.
    """
    try:
        return mjw.put_model(mjm)
    except NotImplementedError as error:
        raise NotSupportedError(f"{where}: MuJoCo-Warp cannot simulate the model: {error} Take that out.") from None
