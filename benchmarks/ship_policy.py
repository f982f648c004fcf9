"""Write the policy of a training into envs/, for `sceniris-gym play`: python -m benchmarks.ship_policy RUN.

The file has the weights of the actor in half precision, the task, the success rate of the run's last evaluation, and
64 layouts of the split `eval` to play. A policy that is already there stays if its success rate is higher.
"""

import sys
from pathlib import Path

import numpy as np
import torch

from sceniris_gym.files import replacing
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.training.settings import MODEL, evaluations, read_checkpoint, read_config, read_parts
from sceniris_gym.training.task_scenes import scene_of

LAYOUTS = 64
MOST_BYTES = 1_000_000
ENVS = Path(__file__).parents[1] / "envs"


def ship(run: Path, folder: Path = ENVS) -> str:
    """Write the policy of a run to `folder`, unless a better one is there, and return what was done."""
    task, _ = read_config(run)
    compiled = compile_scene(scene_of(task, reachable=True), "cpu")
    compiled.scene.check_hash(read_parts(run)["scene"]["hash"], str(run), "Train again.")
    success = evaluations(run)[-1]["valid"]["success"]
    file = folder / f"{compiled.config.name}.pt"
    if file.is_file():
        shipped = read_checkpoint(file, "cpu")
        if shipped["layouts"]["scene"] == compiled.hash and shipped["success"] > success:
            return f"{file} stays: its success rate is {shipped['success']:.1%}, that of {run} {success:.1%}"
    generator = LayoutGenerator(compiled, LAYOUTS, split="eval")
    generator.generate()
    layouts = {
        name: torch.from_numpy(value) if isinstance(value, np.ndarray) else value
        for name, value in vars(generator.table()).items()
    }
    actor = read_checkpoint(run / MODEL, "cpu")["actor_state_dict"]
    kept = {name: value.half() for name, value in actor.items() if name.startswith("mlp.")}
    kept |= {name: value for name, value in actor.items() if name.startswith("obs_normalizer.")}
    with replacing(file) as path:
        torch.save({"actor_state_dict": kept, "task": task, "success": success, "layouts": layouts}, path)
        assert path.stat().st_size < MOST_BYTES, f"{path.stat().st_size} bytes"
    return f"{file}: {task}, success rate {success:.1%}, {file.stat().st_size:,} bytes"


if __name__ == "__main__":
    print(ship(Path(sys.argv[1])))
