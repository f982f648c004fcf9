"""Are the layouts of one device those of another, to the bit? The first one's are saved, the second one's compared.

python -m tests.stress.same_layouts save FOLDER --device cpu
python -m tests.stress.same_layouts compare FOLDER --device cuda:0

Without names of scenes, all shipped ones are made, and mixed ones that together have every tier and kind of start.
What is compared is what a reset makes of 2,048 worlds: layouts, state, controls, and fields of the model that are
drawn. A line for each scene; the status is 1 if a bit differs.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.config.loader import shipped
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.draws import drawn_fields
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.layout.reaching.test_paths import CUPBOARD
from tests.layout.starting import SCENE

_LAYOUTS = ("qpos", "mocap_pos", "mocap_quat", "attempts", "status", "present", "start")
_GRASPS = ("grasp", "grasp_qpos", "pregrasp_qpos", "path")
_STATE = ("qpos", "mocap_pos", "mocap_quat", "ctrl")
_NOISE = {"*": {"noise": 0.02}}
MIXED: dict[str, dict[str, Any]] = {
    "every_start": SCENE,
    "paths": {**CUPBOARD, "start": [{}, {"robot": "path", "of": "can", "share": [0.0, 1.0]}]},
    "drawn_masses": {
        "robot": {"asset": "panda", "base": [-0.5, 0.0, 0.0], "joints": _NOISE},
        "objects": {
            "table": {"asset": "table", "kind": "static"},
            "target": {
                "asset": ["can", "mug", "lemon", "cereal_box"],
                "on": "table",
                "reachable": "ik",
                "randomize": {
                    "mass": {"scale": [0.5, 2.0], "distribution": "log_uniform"},
                    "friction": {"scale": [1.0, 0.1], "distribution": "normal"},
                },
            },
            "bowl": {"asset": "bowl", "on": "table", "relations": [{"near": "target", "distance": {"max": 0.35}}]},
            "apple": {"asset": "apple", "on": "table", "clearance": 0.01},
            "book": {"asset": "book", "on": "table"},
            "tin": {"asset": "tin", "on": "book", "stands": True, "randomize": {"mass": {"scale": [0.3, 3.0]}}},
        },
        "groups": {"fruit": {"of": ["apple"], "count": [0, 1]}},
        "start": [
            {"weight": 2},
            {"robot": "pregrasp", "of": "target"},
            {"robot": "grasp", "of": "target"},
        ],
    },
    "two_arms": {
        "floor": {"size": [2.4, 1.8]},
        "robots": {
            "left": {"asset": "panda", "base": [-0.7, 0.0, 0.0], "joints": _NOISE},
            "right": {"asset": "ur5e", "base": [0.7, 0.0, 0.0], "yaw": 180},
        },
        "objects": {
            "can": {"asset": "can", "on": "floor", "reachable": {"by": "left", "tier": "clear"}},
            "tin": {"asset": "tin", "on": "floor", "reachable": {"by": "right", "tier": "ik"}},
            "brick": {"asset": "brick", "on": "floor"},
        },
        "start": [
            {"robot": "grasp", "of": "can", "lift": [0.05, 0.2]},
            {"robot": "pregrasp", "of": "tin"},
            {"robot": "grasp", "of": "tin", "robot_joints": {"*": {"noise": 0.3}}},
        ],
    },
    "drawn_base": {
        "floor": {"size": [2.0, 2.0]},
        "robot": {
            "asset": "heron",
            "on": "floor",
            "region": {"box": [[-0.8, -0.8], [0.8, 0.8]]},
            "relations": [{"near": "can", "distance": {"max": 0.5}}],
        },
        "objects": {
            "can": {"asset": "can", "on": "floor", "region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}, "reachable": "ik"},
            "mug": {"asset": "mug", "on": "floor", "relations": [{"left_of": "can", "angle": 40}]},
        },
        "start": [{}, {"robot": "grasp", "of": "can"}],
    },
    "drawn_meshes": {
        "geometry": "visual",
        "robot": {"asset": "panda", "base": [-0.5, 0.0, 0.0], "joints": _NOISE},
        "objects": {
            "table": {"asset": "table", "kind": "static"},
            "mug": {"asset": "mug", "on": "table", "reachable": "clear"},
            "pear": {"asset": "pear", "on": "table", "orientation": {"face_to": "mug"}},
            "pan": {"asset": "pan", "on": "table", "relations": [{"beside": "mug", "side": "left", "gap": 0.02}]},
        },
        "start": [{}, {"robot": "pregrasp", "of": "mug"}],
    },
}


def rows_of(compiled: CompiledScene, nworld: int) -> dict[str, np.ndarray]:
    """Return the arrays that the first reset of so many worlds makes, by name."""
    with wp.ScopedDevice(compiled.device):
        model, data = make_worlds(compiled, nworld, nconmax=8, njmax=8)
        randomizer = ResetRandomizer(compiled, model, data, graph=False)
        randomizer.reset()
    drawn = tuple(drawn_fields(compiled.scene.sim.draws))
    names = {"layouts": _LAYOUTS if compiled.reaching is None else _LAYOUTS + _GRASPS, "data": _STATE, "model": drawn}
    sources = {"layouts": randomizer.layouts, "data": data, "model": model}
    arrays = {f"{key}_{name}": getattr(sources[key], name) for key in names for name in names[key]}
    return {name: (array if isinstance(array, wp.array) else array.cpu()).numpy() for name, array in arrays.items()}


def differing(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return in which rows a bit differs, shape (n,); all nan are one."""
    bits = [np.where(np.isnan(x), np.nan, x) if x.dtype.kind == "f" else x for x in (a, b)]
    one, other = (np.ascontiguousarray(x.reshape(len(x), -1)).view(np.uint8) for x in bits)
    return (one != other).any(axis=1)


def report(saved: dict[str, np.ndarray], made: dict[str, np.ndarray]) -> dict[str, Any]:
    """Count the rows that differ, by array with the largest difference, and name the first of them."""
    assert saved.keys() == made.keys()
    different = {name: differing(saved[name], made[name]) for name in saved}
    anywhere = np.any(list(different.values()), axis=0)
    by = {
        name: (int(rows.sum()), float(np.nanmax(np.abs(saved[name][rows] - made[name][rows].astype(float)), initial=0)))
        for name, rows in different.items()
        if rows.any()
    }
    return {"worlds": len(anywhere), "differ": int(anywhere.sum()), "in": by, "rows": np.flatnonzero(anywhere)[:8]}


def main() -> None:
    """Save scenes, or compare them and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("save", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="*", help="shipped, mixed, or paths; all shipped and mixed ones by default")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--worlds", type=int, default=2048)
    words = parser.parse_args()
    wp.config.quiet = True
    words.folder.mkdir(parents=True, exist_ok=True)
    differ = 0
    for scene in words.scenes or [*shipped("envs", ".yaml"), *MIXED]:
        began = time.perf_counter()
        file = words.folder / f"{Path(scene).stem}.npz"
        made = rows_of(compile_scene(MIXED.get(scene, scene), words.device, cache=False), words.worlds)
        line: dict[str, Any] = {"scene": scene}
        if words.what == "save":
            np.savez_compressed(file, allow_pickle=False, **made)
        elif not file.exists():
            parser.error(f"there is no {file}: save '{scene}' first")
        else:
            line |= report(dict(np.load(file)), made)
            differ += line["differ"]
        line["seconds"] = round(time.perf_counter() - began, 1)
        print(json.dumps(line, default=np.ndarray.tolist), flush=True)
    sys.exit(differ > 0)


if __name__ == "__main__":
    main()
