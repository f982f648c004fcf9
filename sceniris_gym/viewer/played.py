"""`PlayedWorld`: one world of a task that MuJoCo C simulates, so no kernels of MuJoCo-Warp are compiled."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.batch import Batch, with_options
from sceniris_gym.training.settings import of_a_run, read_checkpoint
from sceniris_gym.training.task_scenes import scene_of, spec_of
from sceniris_gym.vector.arguments import LAYOUTS, as_task
from sceniris_gym.vector.observer import flatten, names_of
from sceniris_gym.vector.state import State
from sceniris_gym.viewer.shown import Player

_READ = ("qpos", "qvel", "act", "ctrl", "xpos", "xquat", "xmat", "site_xpos", "xanchor", "xaxis", "mocap_quat")


class PlayedWorld:
    """One world of a task, with stored layouts and physics by MuJoCo C. `EnvView` shows it as a SceneVectorEnv.

    The task should have no `needs`, and the scene no variants and no `randomize`.

    Args:
        file: A shipped policy, with the name of its task, and layouts: row i has seed i and episode 0.

    Attributes:
        ids: Ids of the layouts.
        randomizer: The source of the layouts.

    Raises:
        ArgumentError: The file cannot be read.
        SceneMismatchError: The layouts belong to another version of the scene.
    """

    num_envs = 1

    def __init__(self, file: Path) -> None:
        with of_a_run(file):
            stored = read_checkpoint(file, "cpu")
            columns: Any = {k: v.numpy() if isinstance(v, Tensor) else v for k, v in stored["layouts"].items()}
            self._table, spec = LayoutTable(**columns), spec_of(stored["task"])
        self.task, self._most = as_task(spec.kwargs["task"]), spec.max_episode_steps
        self.compiled = compiled = upload_scene(build_model(scene_of(stored["task"], reachable=True)), "cpu")
        self.split, self.device, self.groups_of = self._table.split, torch.device("cpu"), dict
        self.ids = [compiled.layout_id(seed, 0, self.split) for seed in range(len(self._table))]
        self.randomizer = StoredLayouts(compiled, self._table, 1)
        self.batch = Batch(compiled.scene, 1, "cpu", nconmax=self.task.sim_config.nconmax, substeps=self.task.substeps)
        self.state = State(self.batch, self.randomizer.layouts, self.split)
        self._mjm, self._data = with_options(compiled.mjm, self.task.options), mujoco.MjData(compiled.mjm)
        self.task.bind(self.state)
        self.observation_names = names_of(self.task.observe(self.state))

    def reset(self, *, options: dict[str, Any]) -> tuple[dict[str, Tensor], dict[str, Any]]:
        """Start an episode in the layout with the only id in `options["layouts"]`.

        Raises:
            ArgumentError: The layout is not stored.
        """
        (name,) = options[LAYOUTS]
        found = self.compiled.layout_id(name.seed, name.episode, name.split, name.params)
        if found not in self.ids:
            last = len(self.ids) - 1
            raise ArgumentError(f"{found}: should be a stored layout, with a seed from 0 to {last} and episode 0.")
        self._data = Player(self.compiled, self._table[name.seed]).data
        self.randomizer.reseed(seed=name.seed)
        self.randomizer.launch_generate(None)
        self.state.elapsed.zero_()
        self._read()
        self.task.on_reset(self.state, torch.ones(1, dtype=torch.bool))
        return flatten(self.task.observe(self.state)), {}

    def step(self, actions: Tensor) -> tuple[Any, ...]:
        """Take one control step. The arguments and the results are those of `SceneVectorEnv.step`."""
        s, task, action = self.state, self.task, actions.clamp(-1.0, 1.0)
        task.apply(s, action)
        self._data.ctrl[:] = s.ctrl[0].numpy()
        mujoco.mj_step(self._mjm, self._data, task.substeps)
        s.elapsed.add_(1)
        self._read()
        terms, success, ended = task.reward(s, action), task.success(s), task.terminated(s)
        info = {"success": success, "reward_terms": terms}
        return flatten(task.observe(s)), sum(terms.values()), ended, s.elapsed == self._most, info

    def _read(self) -> None:
        """Copy the state of MuJoCo C to the arrays that the task and the page read."""
        data, arrays = self._data, self.batch.data
        mujoco.mj_kinematics(self._mjm, data)
        for name in _READ:
            array = getattr(arrays, name).numpy()  # shares memory
            array[...] = np.reshape(getattr(data, name), array.shape)
        ncon = min(data.ncon, arrays.naconmax)
        arrays.contact.geom.numpy()[:ncon] = data.contact.geom[:ncon]
        arrays.nacon.numpy()[0] = ncon
