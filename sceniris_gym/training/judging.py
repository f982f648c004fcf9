"""Evaluation of a policy on layouts that its training has not seen.

The deterministic policy runs one episode in each layout. There are two kinds of layouts: valid layouts of the split
"eval", and layouts that are placed uniformly without checks. An episode counts as a success if the task succeeds at the
episode's last step.
"""

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.progress import tell
from sceniris_gym.training import layout_sources
from sceniris_gym.training.settings import success_interval
from sceniris_gym.training.task_scenes import SEED_SPACING, make_env, scene_of
from sceniris_gym.vector.state import State

EVAL_SEED = 7 * SEED_SPACING

SPARE = 16
"""One spare world per 16 layouts, because layouts from the bank do not count."""

TARGETS = {
    "ClutterExtract-v0": ("target",),
    "ClutterPush-v0": ("tin",),
    "DrawerPick-v0": ("banana",),
    "TabletopLift-v0": ("block", "can", "lemon"),
}
"""Target objects of each task. If the task chooses one per episode, they have the order of its `chosen`."""


def judges_of(task: str, layouts: int, device: str | None, **options: Any) -> dict[str, RslRlVecEnvWrapper]:
    """Return two environments that evaluate policies of a task: one with valid layouts, and one with unchecked layouts.

    The keys are `valid` and `unfiltered`. In unfiltered layouts, objects may be out of reach, unless the task uses the
    grasp of an object. `options` are more arguments of the environment `valid`.
    """
    worlds = layouts + max(1, layouts // SPARE)
    compiled = compile_scene(scene_of(task, reachable=True), device)
    anywhere = compile_scene(scene_of(task, reachable=False), device)
    uniform = {"split": "eval", **layout_sources.words_of_uniform(task, compiled.scene, "eval")}
    try:
        unfiltered = make_env(task, worlds, anywhere, **uniform)
    except UnknownNameError:  # the task uses the grasp of an object
        unfiltered = make_env(task, worlds, compiled, **uniform)
    valid = make_env(task, worlds, compiled, split="eval", curriculum=None, **options)
    return {"valid": RslRlVecEnvWrapper(valid), "unfiltered": RslRlVecEnvWrapper(unfiltered)}


def density(task: str, s: State, chosen: Tensor) -> tuple[Tensor, Tensor]:
    """Return how much clutter surrounds the target object of each world, as two tensors of shape (num_envs,).

    The first tensor is the number of present free objects other than the target. The second is the horizontal distance
    [m] from the target's origin to the nearest origin of these objects. If the task is not in TARGETS, the first tensor
    counts all free objects, and the second is the least distance of two of them. Without other objects, it is infinite.

    Args:
        task: Id of a task of this package without the namespace, or MODULE:ID.
        s: The worlds.
        chosen: For each object in `TARGETS[task]`, 1 if it is the world's target, otherwise 0, shape (num_envs, number
            of objects).
    """
    nearest = torch.full((s.num_envs,), torch.inf, device=s.device)
    names = [name for name, part in s.scene.config.objects.items() if part.kind == "free"]
    if not names:
        return torch.zeros_like(nearest, dtype=torch.long), nearest
    present, flat = s.present(names), s.poses(names)[:, :, :2]
    if task not in TARGETS:
        pairs = present[:, :, None] & present[:, None] & ~torch.eye(len(names), dtype=torch.bool, device=s.device)
        return present.sum(dim=1), torch.where(pairs, torch.cdist(flat, flat), torch.inf).amin(dim=(1, 2))
    is_target = torch.zeros_like(present)
    is_target[:, [names.index(name) for name in TARGETS[task]]] = chosen > 0
    away = (flat - (flat * is_target[:, :, None]).sum(dim=1, keepdim=True)).norm(dim=2)
    others = present & ~is_target
    return others.sum(dim=1), torch.where(others, away, torch.inf).amin(dim=1)


@torch.inference_mode()
def judge(
    policy: Any, env: RslRlVecEnvWrapper, task: str, layouts: int, film: Callable[[Tensor], object] = lambda _: None
) -> dict[str, Any]:
    """Let a policy play one episode in each of the first `layouts` worlds whose layout is not from the bank.

    `film` is called at the start and after each step, with True for each world whose episode runs.

    Returns:
        A mapping with these keys.

        - `layouts`: number of episodes
        - `success`: fraction of successes, with its 95% `interval`
        - `return`: mean sum of rewards
        - `unfinished`: number of episodes that did not end within the maximum episode length
        - `by_choice`: fraction of successes for each object that a task of this package may choose as target
        - `each`: per layout, `id` (reproduces valid layouts only), `success`, `things` (number of other objects) and
          `nearest` (distance to the nearest other object [mm]), both as `density` returns them
    """
    obs, info = env.reset(seed=EVAL_SEED)
    ids = env.unwrapped.layout_ids(info)
    s = env.unwrapped.state
    fresh = s.layout_status == LayoutStatus.VALID
    counted = fresh & (fresh.cumsum(dim=0) <= layouts)
    chosen = None if ":" in task else getattr(env.unwrapped.task, "chosen", None)
    chosen = torch.ones(env.num_envs, 1, device=env.device) if chosen is None else chosen.clone()
    things, nearest = density(task, s, chosen)
    running = counted.clone()
    success, total = torch.zeros_like(running), torch.zeros(env.num_envs, device=env.device)
    steps = int(env.max_episode_length)
    film(running)
    for step in range(steps):
        tell("judged steps", step, steps)
        obs, reward, done, extras = env.step(policy(obs))
        total += reward * running
        ends = running & done.bool()
        success |= ends & extras["success"]
        running &= ~ends
        film(running)
    number, successes = int(counted.sum()), int(success.sum())
    by_choice = (success.float() @ chosen) / (counted.float() @ chosen)
    return {
        "layouts": number,
        "success": successes / max(1, number),
        "interval": success_interval(successes, number),
        "return": float(total[counted].mean()),
        "unfinished": int(running.sum()),
        "by_choice": [round(share, 4) for share in by_choice.tolist()],
        "each": {
            "id": [ids[world] for world in counted.nonzero()[:, 0].tolist()],
            "success": success[counted].int().tolist(),
            "things": things[counted].tolist(),
            "nearest": [None if math.isinf(d) else round(1000 * d) for d in nearest[counted].tolist()],
        },
    }
