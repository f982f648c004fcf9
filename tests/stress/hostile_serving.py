"""Layouts as they are served: poses, and the controls, activations and histories that a reset leaves."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.rest import affine_law, rest_map
from tests.generators.hostile_words import Served


def serve(scene: Mapping[str, Any], nworld: int, device: str | None) -> tuple[mujoco.MjModel, Served]:
    """Compile a scene and make a batch of layouts.

    A model whose actuators have histories goes through a reset of mujoco_warp; all others take the generator's poses
    and the controls at rest, which spares them the making of a batch.
    """
    compiled = compile_scene(scene, device)
    if getattr(compiled.mjm, "nhistory", 0):
        return compiled.mjm, _after_a_reset(compiled, nworld)
    generator = LayoutGenerator(compiled, nworld)
    generator.generate()
    layouts, mjm = generator.layouts, compiled.mjm
    qpos = layouts.qpos.cpu().numpy().astype(float)
    mocap = [a.cpu().numpy()[:, : mjm.nmocap].astype(float) for a in (layouts.mocap_pos, layouts.mocap_quat)]
    home_act = mjm.key("home").act
    rest = rest_map(mjm, compiled.scene.home_ctrl, home_act, "cpu")
    constants, factors = affine_law(rest, mjm.nq)
    values = np.clip(constants + qpos @ factors.T, rest.lower.numpy(), rest.upper.numpy())
    return mjm, Served(qpos, mocap[0], mocap[1], values[:, : mjm.nu], values[:, mjm.nu :])


def _after_a_reset(compiled: CompiledScene, nworld: int) -> Served:
    mjm = compiled.mjm
    with wp.ScopedDevice(compiled.device):
        plain = copy.copy(mjm)  # without the flags that mujoco_warp does not take; a reset has no use for them
        plain.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
        model, data = mjw.put_model(plain), mjw.make_data(plain, nworld=nworld, nconmax=8, njmax=8)
        ResetRandomizer(compiled, model, data, graph=False).reset()

    def read(name: str) -> np.ndarray:
        return getattr(data, name).numpy().astype(float)

    history = read("history") if hasattr(data, "history") else None
    poses = read("qpos"), read("mocap_pos")[:, : mjm.nmocap], read("mocap_quat")[:, : mjm.nmocap]
    return Served(*poses, read("ctrl"), read("act"), history)
