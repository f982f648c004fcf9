"""`SceneVectorEnv`: many worlds of one task, each with a fresh layout at every reset."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
import warp as wp
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from torch import Tensor

from sceniris_gym.config.fields import short
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.settings import as_config
from sceniris_gym.device.fixed import Fixed, StaysHere
from sceniris_gym.device.sequence import ObjectLock, exclusive, launching
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError, check_type
from sceniris_gym.layout.layout_id import ChosenLayouts, layouts_of_mapping
from sceniris_gym.layout.masks import as_count, as_world_ids, check_mask
from sceniris_gym.levels.curriculum import ADR, LevelReplay
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.snapshot import Snapshot, take
from sceniris_gym.sim.sources import SourceLike, maker_memory
from sceniris_gym.vector import arguments, settings
from sceniris_gym.vector.arguments import LAYOUTS, PARAMS, STATE
from sceniris_gym.vector.observer import Images, Observer
from sceniris_gym.vector.ranks import Rank
from sceniris_gym.vector.rendering import RENDER_MODES, Rendering
from sceniris_gym.vector.sensing import Sensing
from sceniris_gym.vector.settings import ROOM, ImageConfig, RenderConfig, SimConfig
from sceniris_gym.vector.statistics import finite_rows
from sceniris_gym.vector.task import Task
from sceniris_gym.vector.task_worlds import TaskWorlds, versions, written
from sceniris_gym.vector.torch_stream import on_torch_stream

OUTPUTS = ("torch", "numpy")


class SceneVectorEnv(Fixed, StaysHere, VectorEnv):
    """A vector environment of `num_envs` worlds on one device, each with a fresh layout at every reset.

    Observations are a dict of groups (`policy`, `critic`), each of shape (num_envs, size). `observation_names` lists
    the parts of each group in order. Some wrappers, such as Gymnasium's NormalizeObservation, need a single array. Make
    the environment with `observation_groups="policy"` for them, or put them around FlattenObservation.

    The argument `images` adds a group `images`. For each camera and kind of picture, this group has a tensor of shape
    (num_envs, height, width, channels): `observation["images"]["overview"]["rgb"]` (3 channels, uint8), `["depth"]` (1
    channel, float32: distance along the camera's axis [m], 0 for the background) and `["segmentation"]` (1 channel,
    int32: an index into `images.names`). Pictures are taken after resets, so they never show the previous layout.

    `info["layout"]` has the `seed` and the `episode` of each world's layout, and `fallback`, which is true if the
    layout came from the fallback bank. If objects have variants, `info["layout"]` also has `variants`: for each object,
    the number of its present variant. If the task has a `language`, `info["language"]` is a list with this instruction
    for each world. After a step, `info` also has the `success`, `reward_terms` and `broken` (below)
    of this step. With the autoreset mode SAME_STEP, `info` has `final_obs` and `final_info` for all worlds, but only
    the worlds in `_final_obs` have valid entries. Seeds are int64, because torch lacks uint64 arithmetic. A seed from
    2^63 on appears as its two's complement, and `int(seed) % 2**64` recovers the seed.

    Under `torchrun` each process takes the GPU of its LOCAL_RANK and adds RANK * 2^40 to integer seeds, so that no two
    processes get the same layout from `reset(seed=0)`. Lists of seeds are used without this offset.

    `reset(seed=np_random_seed)` gives the same layouts again, from episode 0 on. `np_random_seed` is the last seed
    given. If the first reset has no seed, `np_random_seed` is the seed drawn for that reset. After a list or a mask has
    seeded worlds separately, `np_random_seed` is -1, Gymnasium's value for an unknown seed.

    `statistics` sums up the results of finished episodes on the device. `statistics.read()` returns the means.

    `batch.memory` is the memory that the worlds take on the device. Its attribute `most` is the greatest number of
    worlds that fits. The memory is logged at level INFO before it is allocated.

    Attributes such as `compiled` and `randomizer` cannot be replaced, because captured graphs, including your own, use
    the arrays of the original scene. To change such an attribute, make another environment.

    A world is `broken` if its positions, velocities, activations, controls, rewards or observations are not finite. A
    broken world terminates in the same step, with reward 0, and `statistics` counts it. If autoreset is DISABLED, a
    finished world keeps running until you reset the world.

    Args:
        task: A Task, its class, or "module:Class".
        num_envs: Number of worlds.
        scene: The scene to use instead of the task's scene: a name, path, mapping, SceneConfig or CompiledScene.
        overrides: Parts of the scene to change, by dotted keys: {"objects.apple.clearance": 0.01}.
        device: "cpu" or "cuda:0". None takes cuda:0 (under torchrun cuda:LOCAL_RANK), or cpu if there is no GPU.
        split: "train" or "eval", which share no layouts and no random numbers. If the layout_source has a split, that
            split is used instead.
        layout_source: A LayoutSource, a LayoutTable or LayoutDataset whose rows are served, or a function
            `(compiled, num_envs)` that returns a LayoutSource. None makes a LayoutGenerator.
        curriculum: A LevelReplay, an ADR, or a mapping of the fields of one. It chooses the next layout of each world
            by the outcomes of earlier episodes. `info["layout"]` then has `level`: the index of each world's layout in
            the level buffer, -1 for a fresh layout, or -2 for a layout from the fallback bank.
        params: Names of the parts of the scene file that `set_param` can change, or patterns such as "objects.*.region"
            (docs/levels.md). `info["layout"]` then has `params`, the values of these parts by name. Params cannot be
            combined with a layout_source.
        max_episode_steps: Control steps after which an episode is truncated. None sets no limit.
        autoreset_mode: An AutoresetMode, or its value.
        observation_groups: The groups to observe, such as ("policy", "critic"). None observes all groups. With the name
            of a single group, such as "policy", observations are the array of this group instead of a dict. If there
            are images, observations stay a dict.
        sensing: A Sensing, a mapping of its fields, or None: noise, delay and dropout of the group `policy`, and delay
            of actions.
        output: "torch" (tensors on `device`) or "numpy".
        images: Camera images to observe: an ImageConfig, a mapping of its fields, or only its `cameras`: {"overview":
            {"size": (width, height), "data": kinds}}. None takes the task's `images`. Of the task's `images`, a mapping
            changes only the fields that it names. An ImageConfig replaces the task's `images`, but an ImageConfig
            without cameras takes the task's cameras. With an empty mapping, there are no images.
        render_mode: "rgb_array" makes `render` return pictures. "human" shows every reset and step on a page in the
            browser, in real time (extra `viewer`). None renders no pictures.
        render_config: A RenderConfig, or a mapping of its fields: size and camera of the pictures of `render`, and the
            number of worlds that they show.
        sim_config: A SimConfig, or a mapping of its fields: room for contacts, graphs, prefetching and copies. A
            SimConfig replaces the task's `sim_config`, and a mapping changes only the fields that it contains. If the
            environment's scene is not the task's, the task's `nconmax`, `njmax` and `nvmax` are ignored.

    Raises:
        ScenirisError: The scene cannot be used, for the reasons that `compile_scene` lists.
        TaskError: A method of the task returns a wrong type or shape. Raised here, or in the first step.
        FixedError: You assign to an attribute that captured graphs use. Raised at this assignment, not here.
        MemoryLimitError: The worlds do not fit into the memory of the device. The message has the number that fits.
        ContactBudgetError: The first reset has more contacts than `nconmax` leaves room for. After later steps, call
            `randomizer.check_budget()` to check this.
    """

    _FIXED = (
        *("task", "autoreset_mode", "output", "compiled", "batch", "randomizer", "state", "statistics", "num_envs"),
        *("device", "split", "rank", "sim_config", "image_config"),
    )
    SETTABLE = ("max_episode_steps",)
    """Attributes that `set_attr` takes."""
    _ARGUMENTS = ("scene", "overrides", "layout_source", "curriculum", "params")

    # outside inference mode, torch refuses writes to tensors that were made inside it
    @torch.inference_mode(False)
    @launching
    def __init__(
        self,
        task: Task | type[Task] | str,
        num_envs: int = 1,
        *,
        # scene and layouts:
        scene: str | Path | Mapping | SceneConfig | CompiledScene | None = None,
        overrides: Mapping[str, Any] | None = None,
        device: str | None = None,
        split: str = "train",
        layout_source: SourceLike | None = None,
        curriculum: LevelReplay | ADR | Mapping[str, Any] | None = None,
        params: str | Sequence[str] = (),
        # episodes:
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        # observations:
        observation_groups: str | Sequence[str] | None = None,
        images: ImageConfig | Mapping[str, Any] | None = None,
        sensing: Sensing | Mapping[str, Any] | None = None,
        output: str = "torch",
        # rendering and simulation:
        render_mode: str | None = None,
        render_config: RenderConfig | Mapping[str, Any] | None = None,
        sim_config: SimConfig | Mapping[str, Any] | None = None,
    ) -> None:
        if output not in OUTPUTS:
            raise ArgumentError(f"output should be one of {', '.join(OUTPUTS)}, got {short(output)}.")
        num_envs = as_count(num_envs, "num_envs")
        wanted = None if sensing is None else as_config(Sensing, sensing, "sensing")
        groups, self.max_episode_steps = arguments.as_groups(observation_groups), max_episode_steps
        self.task, self.num_envs = arguments.as_task(task), num_envs
        self.autoreset_mode = arguments.as_autoreset_mode(autoreset_mode)
        self.image_config = seen = settings.as_image_config(self.task.images, images)
        settings.as_settings(SimConfig(), sim_config, "sim_config")  # refuses mistakes before the scene is compiled
        shown = as_config(RenderConfig, {} if render_config is None else render_config, "render_config")
        self.rendering = Rendering(render_mode, num_envs, shown)
        self.output, self.render_mode = output, render_mode
        self.rank = Rank.current()
        device = self.rank.device if device is None and not isinstance(scene, CompiledScene) else device
        self.lock = ObjectLock(type(self).__name__)
        self.compiled = arguments.as_compiled_scene(self.task.scene if scene is None else scene, overrides, device)
        own = self.task.sim_config
        if self.compiled.config.name != Path(self.task.scene).stem:  # room for contacts fits no other scene
            own = replace(own, **dict.fromkeys(ROOM))  # pyrefly: ignore[bad-argument-type]
        self.sim_config = sim = settings.as_settings(own, sim_config, "sim_config")
        self.rank.tell(self.compiled.device)
        physics: dict[str, Any] = {name: getattr(sim, name) for name in (*ROOM, "graph")}
        physics |= {name: getattr(self.task, name) for name in ("needs", "substeps", "options")}
        shots = {} if seen is None else settings.as_shots(seen.cameras)
        makers = maker_memory(self.compiled, num_envs, layout_source, sim.prefetch)
        physics["beside"] = [*makers, *(shot.memory for shot, _ in shots.values())]
        self.batch = batch = Batch(self.compiled.scene, num_envs, self.compiled.device, **physics)
        served: dict[str, Any] = {"layout_source": layout_source, "split": split, "prefetch": sim.prefetch}
        served |= {"curriculum": curriculum, "params": params, "needs": self.task.needs, "graph": sim.graph}
        self.randomizer = ResetRandomizer.of_batch(batch, self.compiled, **served)
        self._worlds = worlds = TaskWorlds(self.task, batch, self.randomizer)
        self.split, self._redrawn = self.randomizer.split, wp.to_torch(self.randomizer.redrawer.mask)
        self.state, self.statistics, self.device = worlds.state, worlds.statistics, worlds.state.device
        fps = round(1.0 / self.state.dt)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": RENDER_MODES, "render_fps": fps}

        wp.synchronize_device(self.batch.device)  # the arrays were made on Warp's stream, and torch uses its own
        with on_torch_stream(self.batch.device):
            worlds.bind()
            # cameras follow bind, which fixes the model fields that differ between worlds
            self.images = None if seen is None else Images(self.batch, shots, seen.every, graph=sim.graph)
            self._observer = Observer(self.task, self.state, self.images, groups=groups, sensing=wanted, copy=sim.copy)
        self.observation_names = self._observer.names
        self._plain = observation_groups if isinstance(observation_groups, str) and self.images is None else None
        self.single_observation_space = self._seen(self._observer.space)
        self.single_action_space = self._observer.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._autoreset, self._ready = torch.zeros(num_envs, dtype=torch.bool, device=self.device), False
        self._np_random, self._np_random_seed = seeding.np_random(arguments.fresh_seed())
        self._made = versions(self._live())

    @property
    def max_episode_steps(self) -> int | None:
        """Control steps after which an episode is truncated, or None. You may change this limit at any time."""
        return self._most_steps

    @max_episode_steps.setter
    def max_episode_steps(self, steps: int | None) -> None:
        self._most_steps = None if steps is None else as_count(steps, "max_episode_steps")

    @exclusive
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Give worlds fresh layouts, chosen layouts, or a stored state.

        Args:
            seed: An integer, a list of num_envs integers, or None. If it is an integer, world i gets seed + i. If it is
                a list, world i gets seed[i]. With a mask, the list may also have one entry for each masked world, in
                order. A world with a seed starts at episode 0. None, also as an entry of a list, gives a world its next
                episode. In the first reset, None takes np_random_seed as the seed, and each None in a list takes a
                random seed.
            options: {"reset_mask": mask} resets, and reseeds, only the masked worlds. The other worlds do not change.
                The mask is an array of booleans (numpy, torch or Warp), shape (num_envs,), true for at least one world.
                {"layouts": ids} gives world i the layout with id `ids[i]`, or its next layout if `ids[i]` is None. A
                single id is for all worlds. You can also pass `info["layout"]` of any `info` as the ids. Later resets
                of a world continue from the episode of its id. {"state": snapshot} restores worlds to their state at
                the call of `snapshot`. Without a mask, each row of the snapshot restores the world that it was copied
                from. With a mask, the rows restore the masked worlds in order. {"params": {name: value}} sets params of
                the worlds to reset, as `set_param` does, before their layouts are chosen.

        Raises:
            ArgumentTypeError: The options are not a mapping. The mask is not an array of booleans.
            ArgumentError: More than one of seed, layouts and state is given. The number of seeds, layouts or rows of
                the state differs from the number of worlds. A seed is not an integer from 0 to 2^64 - 1. A param cannot
                have its value. The mask has the wrong shape, or is false everywhere.
            ArgumentError, SceneMismatchError: A layout id is malformed, or from another scene or split. The state is
                from another scene or task.
            UnknownNameError: An unknown option, or a param that the worlds do not have.
            ResetNeeded: The first reset has a mask or a state.
        """
        launches = self._launching()
        mask, given = arguments.as_reset_mask(options, self.num_envs), options or {}
        kept, params = given.get(STATE), given.get(PARAMS)
        if not self._ready and (mask is not None or kept is not None):
            raise gymnasium.error.ResetNeeded(
                "The first reset() should give all worlds new layouts. Leave out reset_mask and state."
            )
        source, chosen = self.randomizer.pipeline, None
        if given.get(LAYOUTS) is not None:
            chosen = source.chosen(given[LAYOUTS], mask, f"options['{LAYOUTS}']")
        if sum(part is not None for part in (seed, chosen, kept)) > 1:
            raise ArgumentError(f"reset should have at most one of seed, options['{LAYOUTS}'] and options['{STATE}'].")
        due = torch.ones_like(self._autoreset) if mask is None else torch.from_numpy(mask).to(self.device)
        if params is not None and chosen is not None and chosen.param is not None:
            raise ArgumentError(f"reset: options['{LAYOUTS}'] already has params. Leave out options['{PARAMS}'].")
        self.batch.fields.check()
        if seed is None and not self._ready:
            # np_random_seed is -1 after a generator was assigned to np_random
            seed = arguments.fresh_seed() if self.np_random_seed == -1 else self.np_random_seed
        own = arguments.as_reset_seeds(seed, self.num_envs, self.rank, first=not self._ready, mask=mask)
        if params is not None and kept is not None:
            source.checked_params(params)  # before the restore changes anything
        with launches:
            if kept is not None:
                worlds = None if mask is None else np.flatnonzero(mask)
                due = self._worlds.restore(kept, written(self._live(), self._made), worlds)
            if params is not None:
                source.set_params(params, mask)  # after a restore, which overwrites params
            if kept is None:
                self._reseed(seed, own, chosen, mask)
                self._worlds.reset(due.clone())  # a copy, because `on_reset` may overwrite its mask
                self._autoreset.logical_and_(~due)
            if not self._ready:
                self.randomizer.check_budget()
                self._ready = True
            observation = self._observer.flat(0) | self._observer.pictures(due)
            self.rendering.show(self.batch, self.randomizer.layouts, 0.0)
            return self._returned(self._seen(observation)), self._returned(self._worlds.layout_info())

    @exclusive
    def redraw(self, objects: str | Sequence[str], worlds: Any = None) -> None:
        """Move objects to new places, in the middle of an episode, in some worlds or in all.

        The episodes continue, and the rest of each world keeps its state, including the memory of the task. After the
        first call, `info["layout"]` also has `redraws`, the number of redraws of each world since its reset, and
        `redraw_failed`, which is true for a world if its latest redraw found no valid places. The objects then stayed
        where they were. The seed, the episode, the number of redraws and the state before the redraw determine the new
        places. The layout id does not record these places. See `ResetRandomizer.redraw` for the rules.

        Args:
            objects: Names of placed objects. If you name an object, also name all objects that the scene puts on this
                object.
            worlds: None for all worlds, booleans of shape (num_envs,) that may all be false, ids of worlds of shape
                (k,), or a slice.

        Raises:
            ResetNeeded: There was no reset yet.
            UnknownNameError, ArgumentError, ArgumentTypeError: As ResetRandomizer.redraw.
        """
        with self._launching("redraw"):
            if isinstance(worlds, Tensor) and worlds.dtype is torch.bool:  # ten times faster than a Warp view
                check_mask(worlds, self.num_envs, "worlds")
                self._redrawn.copy_(worlds)
                self.randomizer.redrawer.launch(objects, self.randomizer.redrawer.mask)
            else:
                self.randomizer.redraw(objects, worlds)

    @exclusive
    def snapshot(self, worlds: Any = None) -> Snapshot:
        """Copy the state of worlds, for `reset(options={"state": snapshot})`.

        A snapshot has the physics, the present layout, the choice of the next layout, the steps since the reset, and
        the memory of the task. The memory consists of tensors with `num_envs` rows, in the task or in objects that it
        contains. The reset restores such a tensor if it was written to since the environment was made. On a CPU, a
        restored episode continues bit for bit. On a GPU, the restored state has the same bits, but the following steps
        may differ by rounding, as in any two runs on a GPU. In `statistics`, the rewards of a restored episode count
        from the restore on, but its length includes the steps before the snapshot.

        Args:
            worlds: As in `redraw`. Ids set the order of the rows.

        Raises:
            ResetNeeded: There was no reset yet.
            ArgumentError, ArgumentTypeError: As in `redraw`.
        """
        with self._launching("snapshot"):
            return take(self.randomizer._source, self._live(), as_world_ids(worlds, self.num_envs))

    @exclusive
    def set_param(self, name: str, value: Any, worlds: Any = None) -> None:
        """Change a param, which is a part of the scene file, in some worlds or in all, from their next layouts on.

        Args:
            name: One of the environment's `params`, such as "groups.clutter.count".
            value: A value within the limits that the scene file sets: [low, high] for an interval or a count, a number
                for a clearance, or a number for each member for weights. Write the box of a region as its low corner
                and its high corner, even if the scene file has another form. Joint positions are in m or rad. To give
                worlds different values, pass an array of shape (num_envs, ...).
            worlds: As in `redraw`.

        Raises:
            UnknownNameError: The environment has no such param.
            ArgumentError: A value that the param cannot have.
            ArgumentError, ArgumentTypeError: As in `redraw`.
        """
        check_type(name, str, "set_param: name")
        with self._launching():
            self.randomizer.set_param(name, value, worlds)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of the environment, or a param in all worlds. The name of a param has a dot.

        Raises:
            UnknownNameError: The name is neither in `params` nor in SETTABLE. A subclass may extend SETTABLE.
            ArgumentError: A value that the param cannot have.
            FixedError: An attribute that cannot be changed.
        """
        check_type(name, str, "set_attr: name")
        if "." in name:
            self.set_param(name, values)
        elif name in (*self.SETTABLE, *self._FIXED, *self._ARGUMENTS):
            setattr(self, name, values)
        else:
            raise UnknownNameError("attribute", name, "set_attr", self.SETTABLE)

    def layout_ids(self, info: Mapping[str, Any] | None = None) -> list[str]:
        """Return the ids of the present layouts, one per world. Waits for the device.

        Args:
            info: An earlier `info` of `reset` or `step`, to get the ids of the layouts in this `info`. Pass
                `info["final_info"]` for the layouts of the episodes that ended in the step.
        """
        if info is None:
            return self.randomizer.layout_ids()
        if not isinstance(info, Mapping) or "layout" not in info:
            raise ArgumentError("layout_ids: info should be the info of a reset or a step, or its 'final_info'.")
        layout = {"params": {}, **info["layout"]}
        found, _ = layouts_of_mapping(layout, self.randomizer.layouts, "layout_ids: info['layout']")
        keys: Any = found.seed, found.episode, found.param
        return self.randomizer.pipeline.ids(self.split, keys)

    def _live(self) -> dict[str, Tensor]:
        """Return all tensors whose rows a snapshot may copy, by name."""
        return self._worlds.live(sensors=self._observer.sensors, due=self._autoreset)

    def _reseed(
        self, seed: Any, own: ChosenLayouts | None, chosen: ChosenLayouts | None, mask: np.ndarray | None
    ) -> None:
        """Choose the masked worlds' next layouts: `own` comes from `seed`, and `chosen` from the option `layouts`."""
        for part in filter(None, (own, chosen)):
            given = part.given if mask is None else part.given & mask
            self.randomizer.reseed(layouts=part._replace(given=given))
            if part is not chosen and mask is None and isinstance(seed, int | np.integer):
                self._np_random, self._np_random_seed = seeding.np_random(int(seed))
            elif given.any():
                self.np_random = np.random.default_rng(part.seed[given])  # the assignment sets np_random_seed to -1

    @exclusive
    def step(self, actions: Any) -> tuple[dict[str, Any], Any, Any, Any, dict[str, Any]]:
        """Take one control step in all worlds.

        Args:
            actions: Actions, clipped to [-1, 1], shape (num_envs, action size), torch or numpy.

        Returns:
            Observations, rewards (num_envs,) float32, terminations and truncations (num_envs,) bool, info.

        Raises:
            ResetNeeded: There was no reset yet.
            BusyError: Another thread is in a call of this environment.
            ArgumentError: The actions have the wrong shape, or are not real numbers.
        """
        with self._launching("step"):
            self.batch.fields.check()
            action = arguments.as_action(actions, self.action_space, self.device)
            sensors = self._observer.sensors
            delayed = action if sensors is None else sensors.delayed_action(self.state, action)
            self.task.apply(self.state, delayed)
            self.batch.step()
            self.state.elapsed.add_(1)
            outcome = self._outcome(action)
            self.rendering.show(self.batch, self.randomizer.layouts, self.state.dt)
            return outcome

    @exclusive
    def render(self) -> tuple[np.ndarray, ...] | None:
        """Return pictures of the first `render_config.num_envs` worlds, each (height, width, 3) uint8.

        With the render_mode "rgb_array", the result is a tuple of pictures. With all other modes, it is None. In the
        mode "human", this method updates the page, as every reset and step does.
        """
        with self._launching():
            self.rendering.show(self.batch, self.randomizer.layouts, 0.0)
            return self.rendering.pictures(self.batch) if self.render_mode == "rgb_array" else None

    def close_extras(self, **kwargs: Any) -> None:
        """Release the camera, and close the page."""
        self.rendering.close()

    def _outcome(self, action: Tensor) -> tuple[dict[str, Any], Any, Any, Any, dict[str, Any]]:
        """Return the results of the step, and reset the worlds that the autoreset mode selects."""
        outcome, observer = self._worlds.judge(action, self.max_episode_steps), self._observer
        same_step, due = self.autoreset_mode is AutoresetMode.SAME_STEP, torch.zeros_like(self._autoreset)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            # this step resets the worlds that ended in the last step, and their results of this step do not count
            due = self._autoreset.clone()
            self._worlds.reset(due)
        observation = observer.flat(int(same_step))
        outcome = outcome.breaking(~finite_rows(observation.values())).without(due)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._autoreset.copy_(outcome.done)
        self._worlds.count(outcome)
        info = outcome.info()
        if same_step:
            done, final = outcome.done, self.image_config is not None and self.image_config.final
            info["final_info"] = outcome.info() | self._worlds.layout_info()
            info["final_obs"] = self._seen(observation | (observer.pictures(done, copy=True) if final else {}))
            info["_final_obs"] = info["_final_info"] = done.clone()
            self._worlds.reset(done)
            observation = observer.flat(0)
        info |= self._worlds.layout_info()
        observation |= observer.pictures()
        returned = (self._seen(observation), outcome.gained.sum(dim=0), outcome.terminated, outcome.truncated, info)
        return tuple(self._returned(value) for value in returned)

    def groups_of(self, observation: Any) -> dict[str, Any]:
        """Return an observation, or an observation space, as a dict of groups. Wrap a single group in a dict."""
        return observation if self._plain is None else {self._plain: observation}

    def _seen(self, groups: Mapping[str, Any]) -> Any:
        return groups if self._plain is None else groups[self._plain]

    def _returned(self, value: Any) -> Any:
        """Return a tensor, a list or a dict of these. Convert tensors to NumPy if the `output` is "numpy"."""
        if self.output == "torch" or isinstance(value, list):
            return value
        if isinstance(value, dict):
            return {key: self._returned(item) for key, item in value.items()}
        return value.detach().cpu().numpy()

    def _launching(self, method: str | None = None) -> AbstractContextManager:
        """Check that the environment is open and that a reset preceded `method`. Return a context for launches."""
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError("This environment was closed. Make a new one.")
        if method is not None and not self._ready:
            raise gymnasium.error.ResetNeeded(f"Call reset() before {method}().")
        return on_torch_stream(self.batch.device)


def as_same_step(env: Any, where: str) -> SceneVectorEnv:
    """Return an environment that fits the adapter `where` of a training library.

    Raises:
        ArgumentTypeError: `env` is not a SceneVectorEnv.
        ArgumentError: `env` has another autoreset mode or output, or does not copy observations.
    """
    if not isinstance(env, SceneVectorEnv):
        raise ArgumentTypeError(f"{where}: env should be a SceneVectorEnv of make_vec, got {short(env)}.")
    if env.autoreset_mode is not AutoresetMode.SAME_STEP or env.output != "torch" or not env.sim_config.copy:
        raise ArgumentError(f"{where}: env needs autoreset_mode='SameStep', output='torch' and SimConfig(copy=True).")
    return env
