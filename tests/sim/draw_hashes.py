"""Hashes of drawn physics, parameters and factors, in a file that `python -m tests.sim.draw_hashes` writes anew.

No shipped scene draws physics, so the scenes are those of the tests of what is drawn.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import column_of
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.draws import drawn_fields
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.layout.layout_hashes import processor
from tests.layout.param_scenes import scene_with_params
from tests.layout.scenes import box_mjcf
from tests.sim.test_drawn_resets import compiled_scene

FILE = Path(__file__).with_suffix(".json")
NWORLD = 32
MASSES = {"mass": {"scale": [0.125, 8.0], "distribution": "log_uniform"}}
LOOKS = {"friction": {"abs": [0.8, 0.1], "distribution": "normal"}, "rgba": {"choice": [[1, 0, 0], [0, 1, 0]]}}
CENTRES = {"ipos": {"add": [[-0.01, -0.01, 0.0], [0.01, 0.01, 0.0]]}}
CAMERA = {"pos": {"add": [-0.1, 0.1]}, "quat": {"add": [[-5, -5, -5], [5, 5, 5]]}, "fovy": {"add": [-5, 5]}}
LAYOUTS = ("qpos", "present", "start", "status", "attempts", "param", "draw_seed", "draw_episode", "draw_stream")


def _copies(arrays: Mapping[str, wp.array], mark: str = "") -> dict[str, np.ndarray]:
    return {name + mark: array.numpy().copy() for name, array in arrays.items()}


def _randomizer(compiled: CompiledScene, *fields: str, **words: Any) -> ResetRandomizer:
    model, data = make_worlds(compiled, NWORLD, fields=fields, nconmax=64, njmax=256)
    return ResetRandomizer(compiled, model, data, seed=7, prefetch=False, **words)


def _narrow(set_params: Callable[..., None], params: Mapping[str, Any]) -> None:
    """Set every interval, count, box and list of weights to a narrower one in every third world."""
    for name, param in params.items():
        low, high = np.split(param.default, 2) if param.half else (param.default, param.default)
        narrow = np.concatenate([np.round(0.75 * low + 0.25 * high) if param.form == "count" else low, high])
        if param.form in ("interval", "box"):
            narrow = np.concatenate([0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high])
        values = {"weights": 0.5 * param.default + 1.0, "clearance": param.default + 0.03}.get(param.form, narrow)
        set_params({name: values}, np.arange(NWORLD) % 3 == 0)


def _reset_some(randomizer: ResetRandomizer) -> dict[str, np.ndarray]:
    """Reset all worlds, then every second, the params narrowed in between; return what they have drawn."""
    randomizer.reset()
    _narrow(randomizer.pipeline.set_params, randomizer.layouts.params.params)
    randomizer.reset(np.arange(NWORLD) % 2 == 0)
    return _drawn(randomizer)


def _drawn(randomizer: ResetRandomizer) -> dict[str, np.ndarray]:
    fields, draws = randomizer.fields.rows, randomizer.compiled.scene.sim.draws
    found = {name: array for name, array in fields.items() if name in {*drawn_fields(draws), "rest"}}
    found |= {f"drawn.{draw.name}": randomizer.fields.parameter(draw.name, "draw_hashes") for draw in draws}
    found |= {name: column_of(randomizer.layouts, name) for name in LAYOUTS}
    return _copies(found | {f"data.{name}": getattr(randomizer.data, name) for name in ("qpos", "mocap_pos", "ctrl")})


def resets(device: str, folder: Path, *, variants: bool, params: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Draw masses, friction, colours, gains, armatures and a camera; of an object with variants, too."""
    return _reset_some(_randomizer(compiled_scene(device, variants=variants), params=params))


def words(device: str, folder: Path) -> dict[str, np.ndarray]:
    """Draw by every form and distribution."""
    objects = {"can": {"randomize": {**MASSES, **CENTRES}}, "block": {"randomize": {**LOOKS, "mass": {"abs": [1, 2]}}}}
    scene: dict[str, Any] = {"base": "tabletop_lift", "bank": 8, "objects": objects}
    scene["robot"] = {"randomize": {"gains": {"scale": [0.5, 2]}, "damping": {"scale": [0.5, 1.5], "each": True}}}
    scene["randomize"] = {"gravity": {"add": [[-0.1, -0.1, -0.5], [0.1, 0.1, 0.5]]}, "cameras": {"overview": CAMERA}}
    return _reset_some(_randomizer(compile_scene(scene, device), split="eval"))


def masses(device: str, folder: Path) -> dict[str, np.ndarray]:
    """Draw masses that layouts have to stand with, of which most fall back; scale one, and place its object anew."""
    objects = {
        "block": {"asset": box_mjcf(folder, "block", 0.08, 0.08, 0.05), "kind": "fixture", "on": "floor"},
        "plank": {"asset": box_mjcf(folder, "plank", 0.3, 0.06, 0.02), "on": "block", "randomize": MASSES | CENTRES},
        "load": {"asset": box_mjcf(folder, "load", 0.04, 0.04, 0.04), "on": "plank", "randomize": {**MASSES}},
    }
    scene = {"floor": {"size": [1, 1]}, "attempts": 3, "restarts": 1, "objects": objects, "bank": 8}
    compiled = compile_scene(SceneConfig.load(scene), device)
    found = {}
    for params in ((), ("objects.load.randomize.mass",)):
        randomizer = _randomizer(compiled, "body_mass", "geom_friction", params=params)
        found |= {f"{name}{' narrowed' if params else ''}": array for name, array in _reset_some(randomizer).items()}
    factors = np.linspace(0.5, 2.0, NWORLD, dtype=np.float32)
    for name in ("body_mass", "geom_friction"):
        randomizer.scale_field(name, "load", factors)
    names = ("body_mass", "body_inertia", "geom_friction")
    found |= _copies({name: getattr(randomizer.model, name) for name in names}, " scaled")
    randomizer.redraw("load")
    return found | _copies({"qpos": randomizer.data.qpos, "status": randomizer.redrawer.counts.status}, " replaced")


def parameters(device: str, folder: Path) -> dict[str, np.ndarray]:
    """Narrow all that can be a param of layouts, kinds of starts as well, with a mass that is drawn."""
    scene = scene_with_params(folder, objects__a__randomize=MASSES)
    generator = LayoutGenerator(compile_scene(scene, device), NWORLD, params="*")
    generator.generate()
    _narrow(generator.set_params, generator.layouts.params.params)
    generator.generate(np.arange(NWORLD) % 2 == 0)
    return _copies({name: column_of(generator.layouts, name) for name in LAYOUTS})


CASES: dict[str, Callable[..., dict[str, np.ndarray]]] = {
    "resets": lambda device, folder: resets(device, folder, variants=False),
    "resets with variants": lambda device, folder: resets(device, folder, variants=True),
    "resets with params": lambda device, folder: resets(device, folder, variants=True, params=["*.randomize.*"]),
    "words": words,
    "masses": masses,
    "parameters": parameters,
}


def draw_hashes(case: str, device: str) -> dict[str, str]:
    """Return the hash of each array of a case."""
    with tempfile.TemporaryDirectory() as folder:
        found = CASES[case](device, Path(folder))
    return {name: hashlib.sha256(values.tobytes()).hexdigest()[:16] for name, values in sorted(found.items())}


if __name__ == "__main__":
    cases = {case: draw_hashes(case, "cpu") for case in CASES}
    FILE.write_text(json.dumps({"processor": processor(), "cases": cases}, indent=4) + "\n")
