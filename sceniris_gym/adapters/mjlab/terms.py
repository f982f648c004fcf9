"""`PlaceLayouts`: an event term of mjlab that gives entities a fresh layout at every reset."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import torch
from torch import Tensor

from sceniris_gym.adapters.mjlab.variants import VariantRows, model_of_variants
from sceniris_gym.config.member_names import SUPPORT
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.device.fixed import RefusesOldNames
from sceniris_gym.errors import ArgumentError, NotSupportedError, SceneKeyError, import_extra, refuses_old_names
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layout_id import ChosenLayouts
from sceniris_gym.layout.layouts import Layouts, LayoutStatus
from sceniris_gym.layout.masks import as_world_ids
from sceniris_gym.program.compiled import CompiledScene, refuse_draws
from sceniris_gym.scene.adopt import instead_of_variants
from sceniris_gym.scene.build import build_model, build_variants
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.fit import check_fit
from sceniris_gym.sim.sources import make_pipeline
from sceniris_gym.sim.write import warn_of_origins
from sceniris_gym.vector.arguments import fresh_seed
from sceniris_gym.vector.ranks import Rank

EventTermCfg: Any = import_extra("mjlab.managers.event_manager", "mjlab", "mjlab").EventTermCfg
ManagerTermBase: Any = import_extra("mjlab.managers.manager_base", "mjlab", "mjlab").ManagerTermBase

KEYFRAME = "init_state"
"""Name of mjlab's keyframe with the initial states of all entities."""
_CURE = (
    "Layouts are made for the model as mjlab compiles it: events should not change the poses of bodies without joints, "
    "reference positions of joints (qpos0), or sizes, poses and contact bits of geoms."
)


class PlaceLayouts(ManagerTermBase, RefusesOldNames):
    """Gives every environment that is reset a fresh layout at its origin, through the entities' write functions.

    The scene of `PlaceLayoutsCfg` is compiled on mjlab's model. At a reset, free entities get a pose at rest, entities
    with a mocap root get a pose, and joints that the layout sets get a position. Entities with variants get the
    layout's variants, in the model and in `env.sim.world_to_variant`. Other state does not change. List this event
    after all events that write the same entities.

    A layout is a pure function of scene, split, seed and episode. It ignores other events, so objects may start inside
    a robot whose joints another event offsets.

    After a reset, `env.extras["layout"]` has `seed` and `episode`, int64, `fallback` (the layout came from the fallback
    bank), and `start` if the scene has kinds of starts, each of shape (num_envs,). With `scene_params` it has `params`,
    so that `reseed(layouts=extras["layout"])` makes the same layouts. `extras["log"]` has the fraction of environments
    with a layout from the fallback bank. If the scene has kinds of starts, the event also sets the joints of the arm
    and the fingers, but not their controls. If a start holds an object, the next action should close the fingers.

    Attributes:
        compiled: The compiled scene.
        layouts: The latest layout of each environment, relative to the environment's origin.
        pipeline: The LayoutPipeline that makes and prefetches the layouts.
        split: The split of the layouts.

    Raises:
        SceneKeyError: An object of the scene is not the root of an entity.
        NotSupportedError: The scene has settings of `randomize`, or an object with variants that is not an entity with
            variants.
        ScenirisError: The scene cannot be used, for the reasons that `compile_scene` lists.
        SceneMismatchError: Startup events changed the model that layouts depend on. Raised in the first reset.
        ArgumentError: Another event or a command moved the objects after this event had placed them. For a command,
            `keep_layouts` prevents this. Raised in the first reset.
    """

    def __init__(self, cfg: PlaceLayoutsCfg, env: Any) -> None:
        super().__init__(env)
        self.compiled: CompiledScene = compile_scene(_as_model(cfg.scene, env), env.device)
        refuse_draws(self.compiled, "PlaceLayouts", "events of mjlab's `dr`")
        self._variants = VariantRows(self.compiled, env)
        seed = cfg.seed if cfg.seed is not None else env.cfg.seed
        seed = Rank.current().own_seed(fresh_seed() if seed is None else seed)
        own: dict[str, Any] = {"seed": seed, "split": cfg.split, "params": cfg.scene_params, "prefetch": cfg.prefetch}
        self.pipeline, _ = make_pipeline(self.compiled, env.num_envs, "PlaceLayouts", **own)
        self.layouts: Layouts = self.pipeline.layouts
        self._roots, self._joints = _roots(self.compiled, env), _joints(self.compiled, env)
        self._addresses = _addresses(env, self._roots, self._joints)
        self.split: str = cfg.split
        self._is_checked = False
        self._placed: tuple[Tensor, list[Tensor]] | None = None
        self._chosen: dict[int, ChosenLayouts] = {}

    def __call__(self, env: Any, env_ids: Tensor | None) -> None:
        """Place the objects of the environments `env_ids`, or of all if None."""
        ids = torch.arange(env.num_envs, device=env.device) if env_ids is None else env_ids
        if not self._is_checked:
            model, data = env.sim.wp_model, env.sim.wp_data
            check_fit(self.compiled, model, data, self.layouts, env.sim.mj_model, where="PlaceLayouts", cure=_CURE)
            self._variants.check()
            warn_of_origins(self.compiled.scene, env.scene.env_origins.cpu().numpy(), "PlaceLayouts")
        if self._chosen:  # not in `reseed`: a curriculum may have set params since then
            due = {world: self._chosen.pop(world) for world in ids.tolist() if world in self._chosen}
            for chosen in {id(layouts): layouts for layouts in due.values()}.values():
                self.pipeline.reseed([world for world in due if due[world] is chosen], layouts=chosen)
        mask = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
        mask[ids] = True
        self.pipeline.generate(mask)
        self._variants.write(self.layouts, ids)
        self._write(ids)
        self._report()
        if not self._is_checked:
            self._placed = ids, self.state(ids)

    def layout_ids(self) -> list[str]:
        """Return the ids of the present layouts, one per environment. Waits for the device."""
        return self.layouts.ids(self.split)

    def reseed(self, *, layouts: Any, env_ids: Any = None) -> None:
        """Choose the layouts that environments get at their next resets. Later resets continue from these layouts.

        Args:
            layouts: One layout id for all environments, one id for each environment (None keeps the environment's next
                layout), or a mapping {"seed": ..., "episode": ...} with optional "params", such as
                `env.extras["layout"]`.
            env_ids: The environments, in the order of the layouts: ids, a slice, or None for all.

        Raises:
            ArgumentError: The layouts have another form or number.
            ArgumentError, SceneMismatchError: An id is malformed, or from another scene or split.
        """
        chosen = self.pipeline.chosen(layouts, env_ids)
        self._chosen |= dict.fromkeys(as_world_ids(env_ids, self._env.num_envs).tolist(), chosen)

    def set_param(self, name: str, value: Any, env_ids: Any = None) -> None:
        """Change a param of the scene in some environments, or in all, from their next layouts on.

        Raises:
            UnknownNameError, ArgumentError: As in `LayoutSource.set_params`.
        """
        self.pipeline.set_params({name: value}, env_ids)

    def reset(self, env_ids: Tensor | None) -> None:
        """Check once that the objects stayed where they were placed. mjlab calls this at the end of a reset."""
        if self._placed is None:
            return
        ids, state = self._placed
        self._placed, self._is_checked = None, True
        if not all(torch.equal(old, new) for old, new in zip(state, self.state(ids), strict=True)):
            raise ArgumentError(
                f"PlaceLayouts: {', '.join(self._roots)} should keep the poses of the layout, but another term moved "
                f"them later in the same reset. {_suspects(self, self._env)}"
            )

    def state(self, env_ids: Tensor) -> list[Tensor]:
        """Return positions and velocities of the placed entities and joints in the environments `env_ids`."""
        return [array[env_ids[:, None], adr] for array, adr in self._addresses]

    def restore(self, env_ids: Tensor, state: list[Tensor]) -> None:
        """Write `state`, a result of the method `state`, into the environments `env_ids`."""
        for (array, adr), values in zip(self._addresses, state, strict=True):
            array[env_ids[:, None], adr] = values

    def _write(self, env_ids: Tensor) -> None:
        origins = self._env.scene.env_origins[env_ids]
        for name, entity in self._roots.items():
            pose = self.layouts.pose(name)[env_ids]
            pose[:, :3] += origins
            if entity.is_fixed_base:
                entity.write_mocap_pose_to_sim(pose, env_ids=env_ids)
            else:
                entity.write_root_link_pose_to_sim(pose, env_ids=env_ids)
                entity.write_root_link_velocity_to_sim(torch.zeros_like(pose[:, :6]), env_ids=env_ids)
        for entity, joint_ids in self._joints:
            position = self.layouts.qpos[env_ids[:, None], entity.indexing.joint_q_adr[joint_ids]]
            entity.write_joint_state_to_sim(position, torch.zeros_like(position), joint_ids, env_ids)

    def _report(self) -> None:
        """Report the layouts of the environments in `env.extras`."""
        layouts, extras = self.layouts, self._env.extras
        fallback = layouts.status == LayoutStatus.FALLBACK
        extras["layout"] = {"seed": layouts.seed.clone(), "episode": layouts.episode.long(), "fallback": fallback}
        if self.compiled.config.start:
            extras["layout"]["start"] = layouts.start.long()
        if layouts.params.names:
            extras["layout"]["params"] = layouts.params.named(layouts.param.clone())
        extras.setdefault("log", {})["Layouts/fallback_rate"] = fallback.float().mean()


@dataclass(kw_only=True)
class PlaceLayoutsCfg(EventTermCfg):
    """An event that places entities, for `cfg.events`.

    Attributes:
        scene: The scene: a mapping, a path or a name, without `model`. An object stands for the entity with the same
            name or, if it has a `body` such as "cube_0/cube", for the entity with this root body. If the scene has no
            `home`, its home pose is mjlab's keyframe "init_state".
        seed: Seed of environment 0. Environment i has seed + i. None takes the seed of the environment's cfg, or draws
            a seed. Under torchrun and torchrunx, RANK * 2^40 is added.
        split: "train" or "eval", which share no layouts.
        scene_params: Names of the scene's params that `scene_param_stages` or `PlaceLayouts.set_param` may change, or
            patterns that match these names.
        prefetch: Make the next layout of every environment during the steps before its reset, as in ResetRandomizer.
            None prefetches on a GPU.
    """

    func: Any = PlaceLayouts
    mode: str = "reset"
    scene: Any
    seed: int | None = None
    split: str = "train"
    scene_params: Sequence[str] = ()
    prefetch: bool | None = None


PlaceLayoutsCfg.__init__ = refuses_old_names(PlaceLayoutsCfg.__init__)


def scene_param_stages(env: Any, env_ids: Tensor | slice, param_stages: Sequence[Mapping[str, Any]]) -> None:
    """Set params of the scene according to the current number of steps, in the environments that are reset.

    This is a term of mjlab's curriculum, and `param_stages` has the form of mjlab's `reward_params`.

    Args:
        env: The environment, with an event `PlaceLayouts`.
        env_ids: The environments.
        param_stages: Stages by ascending step, each {"step": step, "params": {name: value}}. The names are among the
            event's `scene_params`. A value holds until a later stage sets its param again. A param that no stage has
            set yet has the value of the scene.
    """
    term, values = layouts_term(env), {}
    for stage in param_stages:
        if stage["step"] <= env.common_step_counter:
            values |= stage["params"]
    if term is not None:
        term.pipeline.set_params(values, env_ids)


class KeepLayouts:
    """Mixin for commands that move objects when they draw a target. The objects stay where layouts put them.

    Write `class Command(KeepLayouts, MultiCubeLiftingCommand)`, or use `keep_layouts` to add the mixin to a cfg. If the
    environment has no event `PlaceLayouts`, the command moves objects as usual.
    """

    _env: Any

    def _resample_command(self, env_ids: Tensor) -> None:
        term = layouts_term(self._env)
        state = None if term is None else term.state(env_ids)
        super()._resample_command(env_ids)  # pyrefly: ignore[missing-attribute]
        if term is not None and state is not None:
            term.restore(env_ids, state)


def keep_layouts(cfg: Any) -> Any:
    """Return the cfg of a command with `KeepLayouts` mixed into the command that it builds.

    Args:
        cfg: A CommandTermCfg whose command places objects when it draws a target, such as MultiCubeLiftingCommandCfg.
    """
    kind = type(cfg)

    def build(self: Any, env: Any) -> Any:
        command = kind.build(self, env)
        # `build` of a cfg hard-codes the command's class, so the class can only be changed afterwards
        command.__class__ = type(type(command).__name__, (KeepLayouts, type(command)), {})
        return command

    kept = copy.copy(cfg)
    kept.__class__ = type(kind.__name__, (kind,), {"build": build, "__module__": kind.__module__})
    return kept


def layouts_term(env: Any) -> PlaceLayouts | None:
    """Return the event `PlaceLayouts` of the environment, or None if it has no such event."""
    manager = env.event_manager
    terms = (manager.get_term_cfg(name).func for names in manager.active_terms.values() for name in names)
    return next((term for term in terms if isinstance(term, PlaceLayouts)), None)


def _suspects(term: PlaceLayouts, env: Any) -> str:
    """Return advice that names the commands and events that may have moved objects after `PlaceLayouts` placed them."""
    commands = {name: env.command_manager.get_term(name) for name in env.command_manager.active_terms}
    names = [f"'{n}' ({type(c).__name__})" for n, c in commands.items() if not isinstance(c, KeepLayouts)]
    events = env.event_manager.active_terms["reset"]
    later = events[[env.event_manager.get_term_cfg(name).func for name in events].index(term) + 1 :]
    cures = []
    if names:
        cures.append(
            f"If it was the command {' or '.join(names)}, write cfg.commands[name] = keep_layouts(cfg.commands[name])."
        )
    if later:
        cures.append(f"If it was the event {' or '.join(map(repr, later))}, list it before PlaceLayouts.")
    return " ".join(cures)


def _as_model(scene: Any, env: Any) -> SceneModel:
    """Build the scene for the environment's model. An object with the name of an entity stands for this entity.

    If entities have variants, layouts use a model with a separate body for each variant. The worlds still simulate the
    environment's model.

    Raises:
        NotSupportedError: An object has variants, but is not an entity with variants.
    """
    mjm, entities = env.sim.mj_model, env.scene.entities
    config = SceneConfig.load(scene, {"model": mjm})
    alone = config.with_shared_objects()
    several = {n: e.variant_metadata for n, e in entities.items() if n in alone.objects and e.variant_metadata}
    for name, members in config.variants.items():
        if SUPPORT in members[0]:
            raise NotSupportedError(
                f"{config.where}: objects.{name}: has several supports, or stands on an object with variants, but "
                "PlaceLayouts moves one body for each object. Name one support, an object without variants."
            )
        if name not in several:
            raise NotSupportedError(
                f"{config.where}: objects.{name}: has variants, so it should be an mjlab entity with variants of the "
                f"same names (VariantEntityCfg). {instead_of_variants(name, members)} "
                "In mjlab, this call is cfg.scene.spec_fn = lambda spec: edit_spec(spec, scene)."
            )
    has_key = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_KEY, KEYFRAME) >= 0
    keys: dict[str, Any] = {"home": KEYFRAME} if has_key and config.home is None else {}
    for name, part in alone.objects.items():
        if part.asset is None and part.body is None and name in entities:
            keys[f"objects.{name}.body"] = mjm.body(entities[name].indexing.root_body_id).name
    simulated = SceneConfig.load(alone, {**keys, "model": mjm})
    if not several:
        return build_model(simulated)
    for name, info in several.items():
        keys.pop(f"objects.{name}.body", None)
        if name not in config.variants:
            keys[f"objects.{name}.variants"] = {variant: {} for variant in info.variant_names}
    full = model_of_variants(env, several, config.where)
    return build_variants(SceneConfig.load(config, {**keys, "model": full}), simulated)


def _roots(compiled: CompiledScene, env: Any) -> dict[str, Any]:
    """Return the entities that layouts place, by the name of their object in the scene.

    Raises:
        SceneKeyError: An object is not an entity.
    """
    config, scene = compiled.scene.sim.config, compiled.scene.sim
    entities = {e.indexing.root_body_id: e for e in env.scene.entities.values() if e.spec.bodies[1:]}
    for name, part in config.objects.items():
        if part.is_placed and scene.bodies[name] not in entities:
            body = scene.mjm.body(scene.bodies[name]).name
            raise SceneKeyError(
                f"{config.where}: objects.{name}: body '{body}' should be the root body of an entity, because poses "
                f"are written through entities. Entities: {', '.join(env.scene.entities)}."
            )
    return {name: entities[scene.bodies[name]] for name, part in config.objects.items() if part.is_placed}


def _joints(compiled: CompiledScene, env: Any) -> list[tuple[Any, Tensor]]:
    """Return each entity with joints that layouts set, and the indices of these joints in the entity."""
    scene = compiled.scene
    adr = [int(scene.mjm.jnt_qposadr[joint]) for name in scene.bodies for joint in scene.moving_joints(name)]
    if compiled.starts is not None and compiled.reaching is not None:
        for one in compiled.reaching.arms:
            adr += [*one.arm.qposadr.tolist(), *one.gripper.qposadr.tolist(), *(c.adr for c in one.gripper.couplings)]
    drawn = torch.tensor(adr, dtype=torch.int, device=env.device)
    numbers = {e: torch.isin(e.indexing.joint_q_adr, drawn).nonzero().flatten() for e in env.scene.entities.values()}
    return [(entity, found) for entity, found in numbers.items() if len(found)]


def _addresses(env: Any, roots: dict[str, Any], joints: list[tuple[Any, Tensor]]) -> list[tuple[Any, Tensor]]:
    """Return pairs (array, columns): arrays of the simulation's data, and the columns that hold the entities' state."""
    data, found = env.sim.data, []
    for entity in roots.values():
        if entity.is_fixed_base:
            number = torch.tensor([entity.indexing.mocap_id], device=env.device)
            found += [(data.mocap_pos, number), (data.mocap_quat, number)]
        else:
            found += [(data.qpos, entity.indexing.free_joint_q_adr), (data.qvel, entity.indexing.free_joint_v_adr)]
    for entity, numbers in joints:
        found += [(data.qpos, entity.indexing.joint_q_adr[numbers]), (data.qvel, entity.indexing.joint_v_adr[numbers])]
    return found
