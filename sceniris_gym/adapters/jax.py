"""`LayoutFunction`: layouts in functions of JAX. `LayoutAutoResetWrapper`: layouts in MuJoCo Playground on MJX."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from sceniris_gym import errors
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError, check_type, import_extra
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.tables import RequestedLayouts
from sceniris_gym.program.compiled import CompiledScene, refuse_draws, refuse_starts
from sceniris_gym.sim.fit import check_model
from sceniris_gym.sim.rest import affine_law, scene_rest
from sceniris_gym.sim.write import addresses_of

jax: Any = import_extra("jax", "jax")
jnp: Any = jax.numpy

_KEPT = ("steps", "truncation", "episode_done", "episode_metrics", "AutoResetWrapper_preserve_info")
"""Entries of `info` that Playground's and Brax's wrappers carry across a full reset."""
_SEEDS = "seed should be two uint32 words, high word first, shape (..., 2), such as jax.random.PRNGKey(7) for seed 7"


class FreshLayouts(NamedTuple):
    """Layouts as JAX arrays, whose leading shape (...) is the shape of the requested episodes.

    Attributes:
        qpos: Joint positions [m, rad] in the order of the MjModel, quaternions wxyz, shape (..., nq).
        mocap_pos: Positions of mocap bodies [m], world frame, shape (..., nmocap, 3).
        mocap_quat: Orientations of mocap bodies, wxyz, shape (..., nmocap, 4).
        fallback: True for a layout from the fallback bank, shape (...).
    """

    qpos: Any
    mocap_pos: Any
    mocap_quat: Any
    fallback: Any


class LayoutFunction:
    """The layouts of a scene as a pure function of seed and episode, for jit, vmap, scan and eval_shape.

    Each batch size has a separate generator. It is made while JAX traces the first call of this size, and later calls
    use it again.

    Args:
        compiled: The scene, on JAX's device.
        split: "train" or "eval", which share no layouts.

    Raises:
        NotSupportedError: The scene has settings of `randomize`.
    """

    def __init__(self, compiled: CompiledScene, *, split: str = "train") -> None:
        check_type(compiled, CompiledScene, "LayoutFunction: compiled")
        refuse_draws(compiled, "LayoutFunction", "the `randomization_fn` of a training")
        self.compiled, self.split = compiled, split
        self._callables: dict[int, Any] = {}

    def qpos(self, seed: Any, episode: Any, where: Any = True) -> FreshLayouts:
        """Return the layouts of these seeds and episodes.

        Args:
            seed: Two words of 32 bits for each 64-bit seed, the high word first, shape (..., 2), uint32, as
                `jax.random.PRNGKey` returns them. Keys of `jax.random.key` and, with x64, uint64 seeds have shape
                (...).
            episode: Episodes from 0 to 2^31 - 2, integers of shape (...).
            where: True for each layout to make, booleans of shape (...). False gives the start pose instead,
                without a search.

        Raises:
            ArgumentError: The seeds have another type or shape, or the shapes do not broadcast.
            ArgumentTypeError: Seeds or episodes are not integers, or `where` is not boolean.
            SceneMismatchError: The scene is on another device than JAX.
        """
        words, where = _words(seed), _array(where, "where should be booleans", jnp.bool_)
        episode = _array(episode, "episode should be integers from 0 to 2**31 - 1", jnp.integer)
        try:
            lead = jnp.broadcast_shapes(words.shape[:-1], episode.shape, where.shape)
        except ValueError as error:
            raise ArgumentError(f"LayoutFunction: seed, episode and where should broadcast together: {error}") from None
        episode, where = (jnp.broadcast_to(array, lead) for array in (episode.astype(jnp.int32), where))
        qpos, pos, quat, status = _vmappable(self)(jnp.broadcast_to(words, (*lead, 2)), episode, where)
        return FreshLayouts(qpos, pos, quat, status == int(LayoutStatus.FALLBACK))

    def _call(self, words: Any, episode: Any, where: Any) -> list[Any]:
        """Return the poses and statuses of layouts. All arguments have the same leading shape."""
        _check_device(self.compiled)
        lead, mjm = episode.shape, self.compiled.mjm
        nworld = math.prod(lead)
        dims = {"qpos_out": (nworld, mjm.nq), "status_out": (nworld,)}
        dims |= dict.fromkeys(("mocap_pos_out", "mocap_quat_out"), (nworld, mjm.nmocap))
        if nworld not in self._callables:
            self._callables[nworld] = _callable(RequestedLayouts(self.compiled, nworld, self.split))
        call = self._callables[nworld]
        flat = call(words.reshape(nworld, 2)[:, ::-1], episode.reshape(nworld), where.reshape(nworld), output_dims=dims)
        return [array.reshape(*lead, *array.shape[1:]) for array in flat]


class LayoutAutoResetWrapper:
    """Starts every episode of a batch of environments of MuJoCo Playground in a fresh layout.

    The wrapper replaces Playground's BraxAutoResetWrapper, which starts all episodes of a world in the same state. The
    objects and the robot of the scene get the poses of a layout, at rest, with the controls that hold them. The wrapper
    saves the state after a world's first reset, and all other state of a finished world returns to these values. With
    `full_reset`, the other state comes from a new reset of the environment instead. Each step makes the layouts of all
    finished worlds in one call.

    `info` has the entries of BraxAutoResetWrapper. `info["layout"]` has `seed` (two uint32 words), `episode` and
    `fallback` (the layout comes from the fallback bank) of each world. `compiled.layout_id(seed, episode, split)`
    returns the layout's id. Seeds are drawn from the keys of the reset.

    Args:
        env: The batch, wrapped as for BraxAutoResetWrapper: in a VmapWrapper, then in an EpisodeWrapper.
        compiled: A scene with `model: env.mj_model`, on JAX's device.
        split: "train" or "eval", which share no layouts.
        full_reset: Reset the environments in every step, and take `info` (for example targets) and the rest of the
            state of finished worlds from this reset, as BraxAutoResetWrapper does with this argument.
        observe: Function of (data, info) of one world that returns the observation. None takes the method `_get_obs`.
        update: Function of a world's (mjx.Model, mjx.Data) that updates the derived quantities for observations. None
            takes `mjx.forward`. If the observations read no sensors, `mjx.kinematics` is enough and faster.

    Raises:
        ArgumentTypeError: The environment has no `mj_model`.
        SceneMismatchError: The scene was not made from the model of the environment.
        ArgumentError: `observe` is missing, and `_get_obs` takes other arguments.
    """

    def __init__(
        self,
        env: Any,
        compiled: CompiledScene,
        *,
        split: str = "train",
        full_reset: bool = False,
        observe: Callable[[Any, dict[str, Any]], Any] | None = None,
        update: Callable[[Any, Any], Any] | None = None,
    ) -> None:
        refuse_starts(compiled, "LayoutAutoResetWrapper")
        self.env, self.layouts, self.full_reset = env, LayoutFunction(compiled, split=split), full_reset
        check_type(getattr(env, "mj_model", None), type(compiled.mjm), "LayoutAutoResetWrapper: env.mj_model")
        check_model(compiled, env.mj_model, "LayoutAutoResetWrapper", "Compile a scene with model: env.mj_model.")
        self._update = import_extra("mujoco.mjx", "jax", "mujoco-mjx").forward if update is None else update
        try:
            inspect.signature(observe or env.unwrapped._get_obs).bind("data", "info")
        except (AttributeError, TypeError):
            raise ArgumentError(
                "LayoutAutoResetWrapper: observe should be a function of (data, info), because "
                f"{type(env.unwrapped).__name__} has no method _get_obs(data, info)."
            ) from None
        self._observe, self._place = observe, _placing(compiled)

    def __getattr__(self, name: str) -> Any:
        if name in ("env", "__setstate__"):  # copying and unpickling look these up before `env` exists
            raise AttributeError(name)
        return getattr(self.env, name)

    def reset(self, rng: Any) -> Any:
        """Reset all worlds with one key each. Every world gets the first layout of its seed."""
        rng, key, seed = jnp.moveaxis(jax.vmap(lambda one: jax.random.split(one, 3))(rng), 1, 0)
        state, worlds = self.env.reset(key), rng.shape[:1]
        episode = jnp.zeros(worlds, jnp.int32)
        data, obs, fallback = self._start(state.data, state.info, _words(seed), episode, jnp.ones(worlds, bool))
        found, wanted = (jax.tree.map(lambda array: f"{array.dtype}{array.shape}", each) for each in (obs, state.obs))
        if found != wanted:
            raise ArgumentError(
                f"LayoutAutoResetWrapper: observe should return the same names, dtypes and shapes as "
                f"env.reset: {wanted}, got {found}."
            )
        info = {"rng": rng, "done_count": jnp.zeros(worlds, int)} | ({} if self.full_reset else {"first_data": data})
        state.info.update({f"AutoResetWrapper_{name}": value for name, value in info.items()})
        state.info["layout"] = {"seed": _words(seed), "episode": episode, "fallback": fallback}
        return state.replace(data=data, obs=obs)

    def step(self, state: Any, action: Any) -> Any:
        """Step all worlds, and give finished worlds the next layouts of their seeds."""
        if "steps" in state.info:
            state.info.update(steps=jnp.where(state.done, jnp.zeros_like(state.info["steps"]), state.info["steps"]))
        state = self.env.step(state.replace(done=jnp.zeros_like(state.done)), action)
        done, info = state.done.astype(bool), dict(state.info)
        rng, key = jnp.moveaxis(jax.vmap(jax.random.split)(info["AutoResetWrapper_rng"]), 1, 0)
        first = info.get("AutoResetWrapper_first_data")
        if self.full_reset:
            again = self.env.reset(key)
            first, new = again.data, {k: v for k, v in again.info.items() if k in info and k not in _KEPT}
            info |= _where(done, new, {name: info[name] for name in new})
        layout = info["layout"]
        episode = layout["episode"] + done
        data, obs, fallback = self._start(first, info, layout["seed"], episode, done)
        fallback = jnp.where(done, fallback, layout["fallback"])
        info |= {"AutoResetWrapper_rng": rng, "layout": layout | {"episode": episode, "fallback": fallback}}
        info["AutoResetWrapper_done_count"] = info["AutoResetWrapper_done_count"] + done
        data = jax.vmap(lambda one, old, new: old.where(one, new))(done, state.data, data)
        return state.replace(data=data, obs=_where(done, obs, state.obs), info=info)

    def _start(self, data: Any, info: dict[str, Any], seed: Any, episode: Any, where: Any) -> tuple[Any, Any, Any]:
        """Return data with layouts in the masked worlds, observations of all worlds, and flags of fallback layouts."""
        fresh = self.layouts.qpos(seed, episode, where)
        unwrapped, randomized = self.env.unwrapped, getattr(self.env, "_mjx_model_v", None)

        def start(model: Any, data: Any, info: dict[str, Any], fresh: FreshLayouts) -> tuple[Any, Any]:
            data = self._update(model, self._place(data, fresh))
            return data, (self._observe or unwrapped._get_obs)(data, dict(info))

        model, axes = (self.env.mjx_model, None) if randomized is None else (randomized, self.env._in_axes)
        return *jax.vmap(start, in_axes=(axes, 0, 0, 0))(model, data, info, fresh), fresh.fallback


def wrap_for_brax_training(compiled: CompiledScene, **kwargs: Any) -> Callable[..., LayoutAutoResetWrapper]:
    """Return a `wrap_env_fn` for Brax's trainers: Playground's `wrap_for_brax_training` with `LayoutAutoResetWrapper`.

    Args:
        compiled: The scene, as in `LayoutAutoResetWrapper`.
        **kwargs: Other arguments of `LayoutAutoResetWrapper`.
    """
    check_type(compiled, CompiledScene, "wrap_for_brax_training: compiled")
    wrapper = import_extra("mujoco_playground._src.wrapper", "jax", "playground")

    def wrap(env: Any, **arguments: Any) -> LayoutAutoResetWrapper:
        return LayoutAutoResetWrapper(wrapper.wrap_for_brax_training(env, **arguments).env, compiled, **kwargs)

    return wrap


def _placing(compiled: CompiledScene) -> Callable[[Any, FreshLayouts], Any]:
    """Return a function that writes the placed bodies of a layout into a world's data, and brings them to rest."""
    mjm, scene = compiled.mjm, compiled.scene
    rest = scene_rest(scene, wp.get_device("cpu"))
    places = addresses_of(mjm, list(scene.owners), rest)
    is_qpos, is_dof, is_mocap, is_held = (np.zeros(n, bool) for n in (mjm.nq, mjm.nv, mjm.nmocap, mjm.nu + mjm.na))
    is_qpos[places.qposadr] = is_dof[places.dofadr] = is_mocap[places.mocapid] = is_held[places.elements] = True
    (bias, coef), lower, upper = affine_law(rest, mjm.nq), rest.lower.numpy(), rest.upper.numpy()
    coef = coef.astype(np.float32)

    def place(data: Any, fresh: FreshLayouts) -> Any:
        held = jnp.clip(bias + coef @ fresh.qpos, lower, upper)
        return data.replace(
            qpos=jnp.where(is_qpos, fresh.qpos, data.qpos),
            qvel=jnp.where(is_dof, 0.0, data.qvel),
            ctrl=jnp.where(is_held[: mjm.nu], held[: mjm.nu], data.ctrl),
            act=jnp.where(is_held[mjm.nu :], held[mjm.nu :], data.act),
            mocap_pos=jnp.where(is_mocap[:, None], fresh.mocap_pos, data.mocap_pos),
            mocap_quat=jnp.where(is_mocap[:, None], fresh.mocap_quat, data.mocap_quat),
        )

    return place


def _where(mask: Any, new: Any, old: Any) -> Any:
    """Return a pytree whose leaves come from `new` in masked worlds, and from `old` in all other worlds."""
    return jax.vmap(lambda one, a, b: jax.tree.map(lambda x, y: jnp.where(one, x, y), a, b))(mask, new, old)


def _check_device(compiled: CompiledScene) -> None:
    """Raise if the scene and JAX are on different devices: one on a GPU, the other on the CPU."""
    device = jax.config.jax_default_device
    platform = jax.default_backend() if device is None else getattr(device, "platform", device)
    if (platform == "cpu") != (compiled.device == "cpu"):
        raise SceneMismatchError(
            f"LayoutFunction: the compiled scene is on {compiled.device}, but JAX computes "
            f"on {platform}. Compile it there: compile_scene(scene, {'cpu' if platform == 'cpu' else 'cuda:0'!r})."
        )


def _vmappable(layouts: LayoutFunction) -> Any:
    """Return `layouts._call` with a rule for (nested) `vmap`: one call makes the layouts of all members."""
    call = jax.custom_batching.custom_vmap(layouts._call)

    @call.def_vmap
    def batch(size: int, batched: list[bool], *args: Any) -> tuple[Any, Any]:
        spread = [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(args, batched, strict=True)]
        return _vmappable(layouts)(*spread), [True] * len(FreshLayouts._fields)

    return call


def _callable(requested: RequestedLayouts) -> Any:
    """Return `requested.launch` as a JAX function. While this function exists, `requested` is not freed."""

    def launch(
        seed: wp.array2d[wp.uint32],
        episode: wp.array[wp.int32],
        mask: wp.array[wp.bool],
        qpos_out: wp.array2d[wp.float32],
        mocap_pos_out: wp.array2d[wp.vec3],
        mocap_quat_out: wp.array2d[wp.quat],
        status_out: wp.array[wp.int32],
    ) -> None:
        requested.launch(seed, episode, mask, qpos_out, mocap_pos_out, mocap_quat_out, status_out)

    return wp.jax_callable(launch, num_outputs=4, graph_mode=wp.JaxCallableGraphMode.NONE)


def _array(value: Any, wanted: str, kind: Any) -> Any:
    """Return `value` as a JAX array whose dtype is of this `kind`. The error states `wanted`, the expected value."""
    with suppress(TypeError, ValueError, OverflowError):
        if jnp.issubdtype((array := jnp.asarray(value)).dtype, kind):
            return array
    raise ArgumentTypeError(f"LayoutFunction: {wanted}, got {getattr(value, 'dtype', type(value))}.")


def _words(seed: Any) -> Any:
    """Return seeds as two words of 32 bits each, shape (..., 2), uint32."""
    words = _array(seed, _SEEDS, np.generic)
    if jnp.issubdtype(words.dtype, jax.dtypes.prng_key):
        seed = words = jax.random.key_data(words)
    if words.dtype == jnp.uint64:
        return jnp.stack([words >> 32, words], axis=-1).astype(jnp.uint32)
    dtype = getattr(seed, "dtype", words.dtype)  # jnp.asarray cuts 64 bits to 32 without x64
    if dtype != jnp.uint32 or words.shape[-1:] != (2,):
        raise ArgumentError(f"LayoutFunction: {_SEEDS}, got {dtype} of shape {words.shape}.")
    return words


__getattr__ = errors.refuses_old_imports(__name__)
