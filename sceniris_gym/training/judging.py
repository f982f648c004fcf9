"""Judge the policy of a training run on layouts that it has not seen.

    python -m sceniris_gym.training.judging results/reach_0

loads `model.pt` of the folder, runs the first episodes of 4,096 valid layouts of the split "eval" with the
deterministic policy, takes success at the last step, and prints the share with its Wilson interval. `--out` writes the
same, and for every layout whether it was a success, how many other things are present and how near the nearest of them
is. Then the same on layouts that are placed uniformly without checks. What a training wrote stays as it is.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import torch
import tyro
import warp as wp
from torch import Tensor

from sceniris_gym.adapters.rsl_rl import RslRlVecEnv
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import Status
from sceniris_gym.training import layout_sources
from sceniris_gym.training.intervals import wilson
from sceniris_gym.training.task_scenes import SEED_SPACING, make_env, scene_of
from sceniris_gym.vector.state import State

EVAL_SEED = 7 * SEED_SPACING

SPARE = 16
"""A judge has this part of its worlds more: layouts from the bank, of worlds that run out of restarts, do not count."""

TARGETS = {
    "ClutterExtract-v0": ("target",),
    "ClutterPush-v0": ("tin",),
    "DrawerPick-v0": ("banana",),
    "TabletopLift-v0": ("block", "can", "lemon"),
}
"""What a task is about, the middle of its clutter; where it is one of several, in the order of the task's `chosen`."""


def judges_of(task: str, layouts: int, device: str | None, **kwargs: Any) -> dict[str, RslRlVecEnv]:
    """Return environments to judge a task's policies in: on `valid` layouts and on `unfiltered` ones."""
    worlds = layouts + max(1, layouts // SPARE)
    made = {}
    for name, reachable, source in (("valid", True, None), ("unfiltered", False, layout_sources.uniform("eval"))):
        compiled = compile_scene(scene_of(task, reachable=reachable), device)
        made[name] = RslRlVecEnv(make_env(task, worlds, compiled, split="eval", layout_source=source, **kwargs))
    return made


def density(task: str, s: State, chosen: Tensor) -> tuple[Tensor, Tensor]:
    """Return how many other free objects are present, and how far the nearest is from the target [m]; (num_envs,).

    The distance is between the middles of both, seen from above, and infinite where a task is not in TARGETS.

    Args:
        task: An id of this package without its namespace.
        s: The worlds.
        chosen: 1 for the target, of those in TARGETS, else 0; shape (num_envs, number of targets).
    """
    names = [name for name, part in s.scene.config.objects.items() if part.kind == "free"]
    present = s.present(names)
    if task not in TARGETS:
        return present.sum(dim=1), torch.full((s.num_envs,), torch.inf, device=s.device)
    is_target = torch.zeros_like(present)
    is_target[:, [names.index(name) for name in TARGETS[task]]] = chosen > 0
    flat = s.poses(names)[:, :, :2]
    away = (flat - (flat * is_target[:, :, None]).sum(dim=1, keepdim=True)).norm(dim=2)
    others = present & ~is_target
    return others.sum(dim=1), torch.where(others, away, torch.inf).amin(dim=1)


@torch.inference_mode()
def judge(policy: Any, env: RslRlVecEnv, task: str, layouts: int, seed: int = EVAL_SEED) -> dict[str, Any]:
    """Run the first episodes of the first `layouts` worlds with a layout of their own.

    Returns:
        `layouts`, how many there were; `success`, the share of those that ended in one, with `interval`; `return`, the
        mean sum of rewards; `unfinished`; `by_choice`, the success for each object of a task that chooses one; and
        `each`: `success`, `things`, how many others there are, and `nearest` [mm] of every layout.
    """
    obs, _ = env.reset(seed=seed)
    s = env.unwrapped.state
    fresh = s.layout_status == Status.VALID
    counted = fresh & (fresh.cumsum(dim=0) <= layouts)
    chosen = getattr(env.unwrapped.task, "chosen", None)
    chosen = torch.ones(env.num_envs, 1, device=env.device) if chosen is None else chosen.clone()
    things, nearest = density(task, s, chosen)
    running = counted.clone()
    success, total = torch.zeros_like(running), torch.zeros(env.num_envs, device=env.device)
    for _ in range(env.max_episode_length):
        obs, reward, done, extras = env.step(policy(obs))
        total += reward * running
        ends = running & done.bool()
        success |= ends & extras["success"]
        running &= ~ends
    number, successes = int(counted.sum()), int(success.sum())
    by_choice = (success.float() @ chosen) / (counted.float() @ chosen)
    return {
        "layouts": number,
        "success": successes / max(1, number),
        "interval": wilson(successes, number),
        "return": float(total[counted].mean()),
        "unfinished": int(running.sum()),
        "by_choice": [round(share, 4) for share in by_choice.tolist()],
        "each": {
            "success": success[counted].int().tolist(),
            "things": things[counted].tolist(),
            "nearest": [None if math.isinf(d) else round(1000 * d) for d in nearest[counted].tolist()],
        },
    }


def main(
    folder: Annotated[Path, tyro.conf.Positional],
    layouts: int = 4096,
    device: str | None = None,
    out: Path | None = None,
) -> None:
    """Judge the policy in a folder, and print the shares.

    Args:
        folder: of a run of sceniris_gym.training.train
        layouts: how many
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
        out: JSON file for the verdicts
    """
    from sceniris_gym.training.train import Settings, as_json, runner_of  # which imports this file

    told = json.loads((folder / "config.json").read_text())
    task, settings = told["options"]["task"], Settings(**told["settings"])
    found = {}
    for name, env in judges_of(task, layouts, device).items():
        runner = runner_of(env, settings, 0)
        runner.load(str(folder / "model.pt"), map_location=str(env.device))
        found[name] = judge(runner.get_inference_policy(str(env.device)), env, task, layouts)
        low, high = found[name]["interval"]
        print(f"{name}: {found[name]['success']:.1%} ({low:.1%} to {high:.1%}) of {found[name]['layouts']:,} layouts")
    if out is not None:
        out.write_text(as_json(found))


if __name__ == "__main__":
    wp.config.quiet = True
    tyro.cli(main)
