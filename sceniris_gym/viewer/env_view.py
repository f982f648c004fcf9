"""The page of an environment, where a policy plays one layout after another."""

import sys
import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
import viser

from sceniris_gym.errors import ScenirisError
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.reading import read_layouts
from sceniris_gym.training.policies import GROUP, Policy
from sceniris_gym.vector.arguments import LAYOUTS
from sceniris_gym.vector.vector_env import SceneVectorEnv
from sceniris_gym.viewer.plots import Plots
from sceniris_gym.viewer.server import Requests
from sceniris_gym.viewer.worlds import Window

_IDLE = 0.25  # s
_LOOK = 1.0  # s between the end of all episodes and the next start
_PLOTTED = 0.2  # s between two drawings of the plots
_FIRST = " The first step takes longer, because it compiles or loads the kernels of physics."


class EnvView:
    """Plays a policy and shows the episodes on a page. All work is done in the thread that calls `tick`.

    Args:
        server: The viser server of the page.
        envs: The environment, without autoreset, or a PlayedWorld.
        policy: The policy, or None for random actions.
        ids: Ids of layouts to play, one after another. If empty, the layouts have the seeds 0, 1, 2, ...
    """

    def __init__(
        self, server: viser.ViserServer, envs: SceneVectorEnv, policy: Policy | None, ids: Sequence[str] = ()
    ) -> None:
        self.envs, self.policy = envs, policy
        self.requests = Requests()
        self.ids = [self._own_id(text) for text in ids]
        self._wrong = ""  # the error of the pasted id, until the next action of a user
        self.running, self.speed = True, 1.0
        self._plotted, self._before = 0.0, np.zeros(2, int)  # earlier episodes: how many ended, and with success
        self._ended = self._success = np.zeros(0, bool)
        self._stepped = not isinstance(envs, SceneVectorEnv)  # True once the kernels of physics are compiled
        self._window = Window(envs.compiled.scene, envs.num_envs, server)
        self._add_controls(server.gui)
        names = envs.observation_names[GROUP]
        self._plots = Plots(server, names, lambda: self.requests.put("part", self._plots.draw))
        self.start(0)

    def start(self, first: int, pasted: LayoutId | None = None) -> None:
        """Start an episode in each world.

        Args:
            first: Index of the layout in the first world. Each further world takes the next index. If the user gave
                ids, the index selects an id, and after the last id the first follows again. Otherwise, the index is
                the seed of the layout.
            pasted: If given, the first world takes this layout, whose id the user pasted into the page.
        """
        self._before, self.first, envs = self._counts(), max(first, 0), self.envs
        numbers = range(self.first, self.first + envs.num_envs)
        chosen = [LayoutId(envs.compiled.hash, envs.split, i, 0) for i in numbers]
        if self.ids:
            chosen = [self.ids[i % len(self.ids)] for i in numbers]
        if pasted is not None:
            chosen[0] = pasted
        self._observation, _ = envs.reset(options={LAYOUTS: chosen})
        self._ended, self._success = np.zeros((2, envs.num_envs), bool)
        self._step = 0
        self._plots.clear()
        name = chosen[0]
        self._id.value = envs.compiled.layout_id(name.seed, name.episode, name.split, name.params)
        table = read_layouts(envs.randomizer.layouts, envs.split, self._window.num)
        self._window.worlds.paint(envs.compiled, table)
        self._window.show(envs.batch, envs.randomizer.layouts, 0.0)
        self._tell()

    def tick(self) -> None:
        """Handle the user's requests. Unless paused, take a step, or start new episodes if all have ended."""
        seconds = _IDLE if not self.running else _LOOK if self._ended.all() else 0.0
        for action in self.requests.take(seconds):
            self._wrong = ""
            self._try(action)
        if self.running:
            self._try(self.step if not self._ended.all() else lambda: self.start(self.first + self.envs.num_envs))

    def _try(self, action: Callable[[], None]) -> None:
        """Run an action. If it raises an error, pause the episodes, and show the error on the page and on stderr."""
        try:
            action()
        except Exception as error:
            self.running = False
            if not isinstance(error, ScenirisError):
                traceback.print_exc()
            print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
            self._status.content = f"**Stopped: {type(error).__name__}: {error}**"

    def step(self) -> None:
        """Take one control step in all worlds."""
        with torch.inference_mode():
            actions = self._actions()
            self._observation, _, terminated, truncated, info = self.envs.step(actions)
        success = info["success"].cpu().numpy()
        if not self._ended[0]:
            rewards = {name: float(term[0]) for name, term in info["reward_terms"].items()}
            self._plots.add(rewards, float(success[0]), self.envs.groups_of(self._observation)[GROUP][0].cpu().numpy())
        self._success = np.where(self._ended, self._success, success)
        self._ended |= (terminated | truncated).cpu().numpy()
        self._step += 1
        self._stepped = True
        self._window.show(self.envs.batch, self.envs.randomizer.layouts, self.envs.state.dt / self.speed)
        if self._ended.all() or time.monotonic() - self._plotted > _PLOTTED:
            self._draw()

    def _actions(self) -> Any:
        if self.policy is not None:
            return self.policy(self.envs.groups_of(self._observation))
        return 2.0 * torch.rand(self.envs.action_space.shape or (), device=self.envs.device) - 1.0

    def _own_id(self, text: str) -> LayoutId:
        cure = "Open its environment, with the same changes of the scene, and start the viewer with its --split."
        return LayoutId.of_scene(text, self.envs.compiled.scene, cure, self.envs.split)

    def _draw(self) -> None:
        self._plotted = time.monotonic()
        self._plots.draw()
        self._tell()

    def _tell(self) -> None:
        ended, won = self._counts()
        state = "running" if not self._ended[0] else "ended, success" if self._success[0] else "ended, no success"
        world = "" if self.envs.num_envs == 1 else "first world "
        wrong = f"\n\n**{self._wrong}**" if self._wrong else ""
        self._status.content = (
            f"**{type(self.envs.task).__name__}**, step {self._step}: {world}{state}. "
            f"{ended} {'episode' if ended == 1 else 'episodes'} ended so far, {won} with success."
            f"{f' Layout {self.first % len(self.ids) + 1} of the {len(self.ids)} chosen.' if self.ids else ''}"
            f"{'' if self._stepped else _FIRST}{wrong}"
        )

    def _counts(self) -> np.ndarray:
        """Return how many episodes have ended since the start of the page, and how many with success, shape (2,)."""
        return self._before + [self._ended.sum(), (self._success & self._ended).sum()]

    def _add_controls(self, gui: viser.GuiApi) -> None:
        num = self.envs.num_envs
        self._status = gui.add_markdown("")
        self._id = gui.add_text("layout", "", hint="The layout of the world, or of the first one.")
        self.requests.put_changes(self._id, "id", self._play_id)
        self.requests.put_moves(gui, "layout", lambda step: self.start(self.first + step * num))
        buttons = gui.add_button_group("  ", ("Pause", "Step", "Play"))
        buttons.on_click(lambda event: self.requests.put(None, partial(self._press, event.target.value)))
        speed = gui.add_slider("speed", 0.1, 1.0, 0.1, 1.0)
        speed.on_update(lambda _: setattr(self, "speed", float(speed.value)))

    def _press(self, button: str) -> None:
        self.running = button == "Play"
        if button == "Step":
            self.step()
        self._draw()

    def _play_id(self, text: str) -> None:
        try:
            found = self._own_id(text.strip())
        except ScenirisError as error:
            self._wrong = str(error)
            return self._tell()
        return self.start(self.first, found)
