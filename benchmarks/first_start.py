"""Time to an environment's first step in a fresh process with empty caches of kernels and scenes.

python -m benchmarks.first_start ClutterExtract-v0 --num-envs 4096 --device cuda:0

Prints one line of JSON with the figures of `benchmarks.second_start` in seconds, the number of `kernels` that were
compiled, and the number of `cores`. With `--log`, the lines of Warp follow on stderr, with the time of each module.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from pathlib import Path

from benchmarks.second_start import start


def main() -> None:
    """Print the figures of an environment."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env")
    parser.add_argument("--num-envs", type=int, default=16)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--log", action="store_true")
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.environ |= {"WARP_CACHE_PATH": f"{folder}/kernels", "SCENIRIS_GYM_CACHE": f"{folder}/scenes"}
        found = start(words.env, words.num_envs, words.device, log=words.log)
        kernels = len(list(Path(folder).glob("kernels/*/wp_*")))
    print(json.dumps(found | {"kernels": kernels, "cores": len(os.sched_getaffinity(0))}))


if __name__ == "__main__":
    main()
