"""Rates of images as observations: pictures alone, and control steps with them and without.

    python -m benchmarks.image_rates                             # the figures of NOTES.md, on a GPU
    python -m benchmarks.image_rates --what parts                # what the time of pictures goes into
    python -m benchmarks.image_rates --device cpu --cases TabletopReach-v0:16:32 --repeats 2

prints a line of JSON for each case. All of them are of one camera, `overview`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import gymnasium
import mujoco_warp as mjw
import torch
import tyro

from benchmarks.timing import spread, wait
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.pictures import context
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training.task_scenes import NAMESPACE, scene_of
from sceniris_gym.vector.vector_env import SceneVectorEnv

CASES = (
    *("TabletopReach-v0:4096:64", "TabletopReach-v0:1024:64", "TabletopReach-v0:1024:84", "TabletopReach-v0:1024:128"),
    *("KitchenReset-v0:1024:64", "DrawerPick-v0:1024:64"),
)
"""Task, worlds, and pixels along an edge."""
DATA = ("rgb", "depth")
LOOKS: dict[str, dict[str, bool]] = {"plain": {}, "thin": {"thin": True}, "shadows": {"shadows": True}}
PARTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "no textures": {"use_textures": False},
    "no highlights": {"enable_specular": False, "enable_emission": False},
    "flat faces": {"enable_vertex_normals": False},
    "no ambient light of lamps": {"enable_per_light_ambient": False},
    "no face seen from behind": {"enable_backface_culling": True},
    "shapes for collisions": {"enabled_geom_groups": [0, 3]},
    "the floor alone": {"enabled_geom_groups": [0]},
}
"""Options of mujoco_warp's context that tell what a part of a picture costs."""


@dataclass(frozen=True)
class Options:
    """Options of the measurement.

    Attributes:
        what: rates of the cases; or parts, the first case with parts of its pictures left out
        cases: task without its namespace, worlds, and pixels along an edge
        steps: calls that are timed together
        repeats: how often they are timed
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    what: Literal["rates", "parts"] = "rates"
    cases: tuple[str, ...] = CASES
    steps: int = 50
    repeats: int = 5
    device: str | None = None


def clock(envs: SceneVectorEnv, options: Options, call: Callable[[], Any]) -> dict[str, float]:
    """Return the mean time of a call [ms]: median, least and greatest of several means."""
    for _ in range(3):
        call()
    means = []
    for _ in range(options.repeats):
        wait(envs)
        start = time.perf_counter()
        for _ in range(options.steps):
            call()
        wait(envs)
        means.append(1e3 * (time.perf_counter() - start) / options.steps)
    return spread(means, 3)


def make(compiled: CompiledScene, task: str, worlds: int, images: dict[str, Any] | None) -> SceneVectorEnv:
    """Return the environment of a case."""
    envs = gymnasium.make_vec(NAMESPACE + task, num_envs=worlds, scene=compiled, images=images)
    assert isinstance(envs, SceneVectorEnv)
    envs.reset(seed=0)
    return envs


def used(envs: SceneVectorEnv) -> int:
    """Return the bytes in use on the whole device; 0 on a CPU."""
    if envs.device.type != "cuda":
        return 0
    free, total = torch.cuda.mem_get_info(envs.device)
    return total - free


def rates(compiled: CompiledScene, case: str, options: Options) -> Iterator[dict[str, Any]]:
    """Yield a line for each look of the pictures of a case."""
    task, worlds, edge = case.split(":")
    plain = make(compiled, task, int(worlds), None)
    # pyrefly: ignore[no-matching-overload]
    action = 0.3 * torch.randn(plain.action_space.shape, device=plain.device).clamp(-1.0, 1.0)
    everyone = torch.ones(int(worlds), dtype=torch.bool, device=plain.device)
    few = torch.arange(int(worlds), device=plain.device) % 100 == 0
    step = clock(plain, options, lambda: plain.step(action))
    for name, looks in LOOKS.items():
        before = used(plain)
        envs = make(compiled, task, int(worlds), {"overview": {"size": (int(edge), int(edge)), "data": DATA, **looks}})
        seen = envs.images
        assert seen is not None
        taken = clock(envs, options, partial(seen.take, everyone, copy=True))
        due = clock(envs, options, partial(seen.take, few, copy=True))
        both = clock(envs, options, partial(envs.step, action))
        yield {
            "case": case,
            "looks": name,
            "ms_pictures": taken,
            "ms_pictures_of_1_percent": due,
            "images_per_second": round(1e3 * int(worlds) / taken["median"]),
            "ms_step": step,
            "ms_step_with_images": both,
            "share_of_steps": round(step["median"] / both["median"], 3),
            "megabytes_more": round((used(envs) - before) / 1e6),
        }
        envs.close()
    plain.close()


@contextmanager
def with_options(**options: Any) -> Iterator[None]:
    """Make contexts with other options of mujoco_warp's."""
    original = context.render_context
    # pyrefly: ignore[bad-argument-type]
    context.render_context = lambda *args, **given: original(*args, **(given | options))
    try:
        yield
    finally:
        context.render_context = original


@contextmanager
def with_rows() -> Iterator[None]:
    """Let neighbouring threads take the pixels of a row rather than of a tile."""
    original, context._TILE = context._TILE, (1 << 20, 1)  # pyrefly: ignore[bad-assignment]
    try:
        yield
    finally:
        context._TILE = original


def parts(compiled: CompiledScene, case: str, options: Options) -> Iterator[dict[str, Any]]:
    """Yield a line for each part of the pictures of a case that is left out."""
    task, worlds, edge = case.split(":")
    images = {"overview": {"size": (int(edge), int(edge)), "data": DATA}}
    everyone = torch.ones(int(worlds), dtype=torch.bool)
    for name, changed in {"rays by rows": None, **PARTS}.items():
        with with_rows() if changed is None else with_options(**changed):
            envs = make(compiled, task, int(worlds), images)
        seen = envs.images
        assert seen is not None
        taken = clock(envs, options, partial(seen.take, everyone.to(envs.device), copy=True))
        yield {"case": case, "part": name, "ms": taken}
        if name == "as it is":
            cameras = seen._cameras[0]
            bvh = clock(envs, options, partial(mjw.refit_bvh, cameras.model, cameras._seen, cameras.context))
            yield {"case": case, "part": "boxes around geoms alone", "ms": bvh}
        envs.close()


def main(options: Options) -> None:
    """Measure one case after another."""
    cases = options.cases if options.what == "rates" else options.cases[:1]
    for case in cases:
        compiled = compile_scene(scene_of(case.split(":")[0], reachable=True), options.device)
        for line in (rates if options.what == "rates" else parts)(compiled, case, options):
            print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))
