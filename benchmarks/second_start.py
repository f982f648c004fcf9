"""Time to an environment's first step in a fresh process, with everything kept that an earlier start made.

python -m benchmarks.second_start TabletopReach-v0 --device cpu --repeats 5

The first start is not counted. Prints a line of JSON for each of the others and one with median, least and greatest of
each figure, in seconds: `first_step` from before the process was started, `cpu` of all its threads until then, and
`ended` until the process is gone.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time

from benchmarks.timing import spread

_PROGRAM = """
import resource, time
import gymnasium, sceniris_gym
envs = gymnasium.make_vec("sceniris_gym/{env}", num_envs={num_envs}, device="{device}")
envs.reset(seed=1)
_, reward, *_ = envs.step(envs.action_space.sample())
reward.sum().item()
used = resource.getrusage(resource.RUSAGE_SELF)
print("STEPPED", time.time(), used.ru_utime + used.ru_stime, flush=True)
"""

_LOG = "import warp; warp.config.log_level = warp.LOG_DEBUG"


def start(env: str, num_envs: int, device: str, *, log: bool = False) -> dict[str, float]:
    """Start a process, and return its figures. With `log`, print what Warp says of each module on stderr."""
    begin = time.time()
    program = (_LOG if log else "") + _PROGRAM.format(env=env, num_envs=num_envs, device=device)
    said = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout
    end = time.time()
    if log:
        print(said, file=sys.stderr)
    stepped, cpu = map(float, said.rpartition("STEPPED ")[2].split())
    return {"first_step": stepped - begin, "cpu": cpu, "ended": end - begin}


def main() -> None:
    """Print the figures of an environment."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env")
    parser.add_argument("--num-envs", type=int, default=16)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--repeats", type=int, default=5)
    words = parser.parse_args()
    start(words.env, words.num_envs, words.device)
    found = []
    for _ in range(words.repeats):
        found.append(start(words.env, words.num_envs, words.device))
        print(json.dumps(found[-1]), flush=True)
    print(json.dumps({name: spread([one[name] for one in found], 2) for name in found[0]}), flush=True)


if __name__ == "__main__":
    main()
