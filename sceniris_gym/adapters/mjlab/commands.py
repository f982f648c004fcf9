"""`RedrawObjects`: a command term of mjlab that gives entities new places in the middle of episodes, on a timer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import warp as wp
from torch import Tensor

from sceniris_gym.adapters.mjlab.terms import layouts_term
from sceniris_gym.errors import ArgumentError, import_extra
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.masks import as_worlds
from sceniris_gym.sim.redrawing import Redrawer
from sceniris_gym.sim.reset_writer import Simulation
from sceniris_gym.sim.rest import scene_rest

_COMMANDS: Any = import_extra("mjlab.managers.command_manager", "mjlab", "mjlab")


class RedrawObjects(_COMMANDS.CommandTerm):
    """Gives entities new places on a timer, with all other entities as obstacles in their current poses.

    The entities are objects of the scene of `PlaceLayouts`, which places them at resets. This command only redraws
    between resets. `env.extras["layout"]` then has `redraws`, the number of redraws of each environment since its
    reset, and `redraw_failed`, which is true if the latest redraw found no valid places. The objects then stayed where
    they were.

    Attributes:
        command: The number of redraws since the reset, shape (num_envs, 1), float32.

    Raises:
        ArgumentError: The environment has no event `PlaceLayouts`, or entities in the event's scene have variants.
        UnknownNameError, ArgumentError: Objects cannot be redrawn, for the reasons that `chosen_objects` lists. Raised
            when the first timer runs out.
    """

    def __init__(self, cfg: RedrawObjectsCfg, env: Any) -> None:
        super().__init__(cfg, env)
        term = layouts_term(env)
        if term is None or term.compiled.config.variants:
            raise ArgumentError("RedrawObjects: cfg.events should have a PlaceLayoutsCfg whose scene has no variants.")
        rest = scene_rest(term.compiled.scene, term.layouts.view.qpos.device)
        origins = wp.from_torch(env.scene.env_origins.contiguous(), dtype=wp.vec3)
        worlds = term.compiled, env.sim.wp_model, env.sim.wp_data, term.split
        simulation = Simulation(*worlds, rest, refresh=lambda: None, origins=origins)
        self._redrawer = Redrawer(simulation, term.layouts, graph=True)

    @property
    def command(self) -> Tensor:
        """The number of redraws since the reset, shape (num_envs, 1), float32."""
        return self._redrawer.number[:, None].float()

    def _resample_command(self, env_ids: Tensor) -> None:
        if not self.command_counter[env_ids].any():  # a reset, where the event has already placed the objects
            self._redrawer.number[env_ids] = 0
            return
        self._redrawer.launch(self.cfg.objects, as_worlds(env_ids, self.num_envs, self.device, self._redrawer.mask))
        self._env.sim.forward()
        failed = self._redrawer.status == LayoutStatus.KEPT
        self._env.extras.setdefault("layout", {}).update(redraws=self._redrawer.number.long(), redraw_failed=failed)

    def _update_metrics(self) -> None:
        pass

    def _update_command(self, env_ids: Tensor | None) -> None:
        pass


@dataclass(kw_only=True)
class RedrawObjectsCfg(_COMMANDS.CommandTermCfg):
    """A command that gives entities new places on a timer, for `cfg.commands`.

    Attributes:
        objects: Names of the objects to redraw together, as in the scene of `PlaceLayoutsCfg`. If you name an object,
            also name all objects that the scene puts on this object.
        resampling_time_range: Least and greatest time [s] between two redraws, and from a reset to the first redraw.
    """

    objects: tuple[str, ...]

    def build(self, env: Any) -> RedrawObjects:
        """Return the command of an environment."""
        return RedrawObjects(self, env)
