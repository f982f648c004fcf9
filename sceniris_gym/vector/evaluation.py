"""`evaluate`: runs a policy on layouts of your choice, and returns the result of each episode."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from gymnasium.vector import VectorEnv
from torch import Tensor

from sceniris_gym.config.fields import short
from sceniris_gym.device.fixed import RefusesOldNames
from sceniris_gym.errors import ArgumentError, refuses_old_names
from sceniris_gym.layout.layout_id import layouts_of_ids, layouts_of_mapping
from sceniris_gym.layout.masks import as_count
from sceniris_gym.vector.arguments import LAYOUTS
from sceniris_gym.vector.vector_env import SceneVectorEnv

Policy = Callable[[Any], Any]
Film = Callable[[Tensor], object]


@dataclass(frozen=True)
class EpisodeResult(RefusesOldNames):
    """Result of one episode.

    Attributes:
        id: Layout id of the episode, for `sceniris-gym replay`.
        success: The last step was a success.
        success_once: Any step was a success.
        total_reward: Sum of the rewards.
        length: Number of control steps.
        fallback: The search for this seed and episode failed, so the layout came from the fallback bank.
        broken: The episode ended because its state was not finite.
        terms: Sum of each term of the reward, by name.
    """

    id: str
    success: bool
    success_once: bool
    total_reward: float
    length: int
    fallback: bool
    broken: bool = False
    terms: Mapping[str, float] = field(default_factory=dict)


@torch.inference_mode()
@refuses_old_names
def evaluate(
    policy: Callable[[Any], Any], envs: VectorEnv, layouts: Iterable[str] | Mapping[str, Any] | int | None = None
) -> list[EpisodeResult]:
    """Run one episode from each layout, in batches of `num_envs` worlds.

    If the policy treats each world independently, the results do not depend on `num_envs`, except for the rounding of
    rewards.

    Args:
        policy: A function that takes the observations of all worlds, as `envs` returns them, and returns the actions.
        envs: A SceneVectorEnv with max_episode_steps, or wrappers around it that pass on `info`. Afterwards, some
            worlds may be in the middle of an episode, so reset `envs` before further use.
        layouts: One layout id or several, from the scene and split of `envs`. Or `info["layout"]`, or another mapping
            with arrays `seed`, `episode` and optionally `params`, all of one length. Or a number n, which selects
            episode 0 of the seeds 0 to n - 1, or the first n rows if `envs` serves stored layouts. If `layouts` is
            None, n is `num_envs`. If `envs` has a curriculum, layouts without `params` have the scene file's values,
            and the curriculum counts the episodes.

    Returns:
        A result for each layout, in the same order.

    Raises:
        ArgumentError: `policy` is not a function. `envs` is not a SceneVectorEnv, or lacks max_episode_steps. The
            number of layouts is negative. An id is malformed.
        SceneMismatchError: An id is from another scene or split.
    """
    return [result for batch in episodes(policy, envs, layouts) for result in batch]


@torch.inference_mode()
def episodes(
    policy: Policy, envs: VectorEnv, layouts: Any, film: Film = lambda _: None
) -> Iterator[list[EpisodeResult]]:
    """Yield the results of each batch of `evaluate`.

    `film` is called after each reset and each step, with True for each world whose episode runs.
    """
    if not callable(policy):
        raise ArgumentError(f"evaluate: policy should be a function of the observations, got {short(policy)}.")
    inner = envs.unwrapped if isinstance(envs, VectorEnv) else None
    if not isinstance(inner, SceneVectorEnv):
        raise ArgumentError(
            "evaluate: envs should be a SceneVectorEnv, which gym.make_vec makes, or Gymnasium's vector wrappers "
            f"around one, got {type(envs).__name__}."
        )
    if inner.max_episode_steps is None:
        raise ArgumentError("evaluate: envs should have max_episode_steps, so that every episode ends.")
    for batch, count in _batches(layouts, inner):
        counted = torch.arange(inner.num_envs, device=inner.device) < count
        yield _run(policy, envs, inner, batch, lambda running, counted=counted: film(running & counted))[:count]


def _batches(layouts: Any, inner: SceneVectorEnv) -> Iterator[tuple[Any, int]]:
    """Yield pairs: a batch of layouts for `reset`, one per world, and the number of worlds whose results count.

    The last batch repeats its last layout until each world has one.
    """
    number, where = inner.num_envs, "evaluate: layouts"
    if isinstance(layouts, Iterable) and not isinstance(layouts, Mapping):
        ids = layouts if isinstance(layouts, str) else list(layouts)
        found = layouts_of_ids(ids, inner.randomizer.layouts, inner.split, where)
        if not found.given.all():
            raise ArgumentError(f"{where} should have an id in each entry, got None.")
    else:
        if not isinstance(layouts, Mapping):
            layouts = {"seed": np.arange(number if layouts is None else as_count(layouts, where, 0)), "episode": 0}
        if inner.randomizer.levels is not None:  # not the values that the curriculum has reached
            layouts = {"params": {}, **layouts}
        found, _ = layouts_of_mapping(layouts, inner.randomizer.layouts, where)
    for first in range(0, len(found.seed), number):
        rows = np.minimum(np.arange(first, first + number), len(found.seed) - 1)
        yield found.of_rows(rows), min(number, len(found.seed) - first)


def _run(policy: Policy, envs: VectorEnv, inner: SceneVectorEnv, layouts: Any, film: Film) -> list[EpisodeResult]:
    """Run one episode in each world, and return its result."""
    observation, info = envs.reset(options={LAYOUTS: layouts})
    names, fallback = inner.layout_ids(), _tensor(info["layout"]["fallback"], inner)
    running = torch.ones_like(fallback)
    last, ever, broken = (torch.zeros_like(running) for _ in range(3))
    length, terms = torch.zeros_like(running).long(), dict[str, Tensor]()
    film(running)
    for _ in range(inner.max_episode_steps or 0):
        observation, reward, terminated, truncated, info = envs.step(policy(observation))
        success = _tensor(info["success"], inner)
        done = _tensor(terminated, inner) | _tensor(truncated, inner)
        gained = {"": reward, **info["reward_terms"]}
        for name, term in gained.items():
            terms[name] = terms.get(name, 0.0) + torch.where(running, _tensor(term, inner).double(), 0.0)
        length += running
        broken |= running & _tensor(info["broken"], inner)
        ever |= running & success
        last = torch.where(running, success, last)
        running = running & ~done
        film(running)
        if not running.any():
            break
    sums = {name: term.tolist() for name, term in terms.items()}
    total = sums.pop("")
    columns = (last.tolist(), ever.tolist(), total, length.tolist(), fallback.tolist(), broken.tolist())
    each = [dict(zip(sums, row, strict=True)) for row in zip(*sums.values(), strict=True)]
    return [EpisodeResult(*row) for row in zip(names, *columns, each, strict=True)]


def _tensor(value: Any, envs: SceneVectorEnv) -> Tensor:
    return torch.as_tensor(value, device=envs.device)
