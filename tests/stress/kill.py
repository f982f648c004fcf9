"""kill -9 at random moments: what is resumed ends as if it had never been stopped.

python -m tests.stress.kill generate --times 25 [--device cpu] [--seed 0]
python -m tests.stress.kill reach --times 25
python -m tests.stress.kill train --times 10
python -m tests.stress.kill signals --times 25

Each time a process is killed once, at a moment drawn from the whole run's length, and is resumed to its end. A data set
and a map are to have the bytes of a run that was left alone, with no other file beside them. A training is to resume
with a checkpoint that can be read and a log that goes on without a gap or a double. `signals` sends Ctrl-C and SIGTERM
to `generate` instead, 0.5 to 3 seconds after its start: it has to end at once, with the status of shells, without a
traceback. Prints a line of JSON; the exit status is 1 if anything was not so.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

_STEPS = 24  # control steps of an iteration of TabletopReach-v0
_ENVS = 8
_HASTY = "from sceniris_gym.reach import checkpoint; checkpoint._SECONDS = 0.0; "
_PROGRAM = "from sceniris_gym.__main__ import main; main()"
_AT_ONCE = 2.0  # s, since others may use the machine, too


@dataclass(frozen=True)
class Work:
    """Something that is killed and resumed.

    Attributes:
        command: Makes it in a folder, or resumes it.
        fault: What is wrong in a folder, given the folder of a run that was left alone; None if nothing is.
        killed: What is wrong right after the kill; None if nothing is.
    """

    command: Callable[[Path], Sequence[str]]
    fault: Callable[[Path, Path], str | None]
    killed: Callable[[Path], str | None] = lambda _: None


def generate(n: int, device: str) -> Work:
    """A data set of several parts."""

    def command(folder: Path) -> Sequence[str]:
        words = ["generate", "mid", "-n", str(n), "-o", str(folder / "set"), "--device", device, "--resume"]
        return [sys.executable, "-m", "sceniris_gym", *words]

    return Work(command, _differs)


def reach(arm: str, device: str) -> Work:
    """A coarse map, with a checkpoint after every batch."""

    def command(folder: Path) -> Sequence[str]:
        words = ["reach", arm, "--build", "--step", "0.2", "--tilt-step", "30", "-o", str(folder / "arm.reach")]
        return [sys.executable, "-c", _HASTY + _PROGRAM, *words, "--device", device]

    return Work(command, _differs)


def train(iterations: int, device: str) -> Work:
    """A small training, with a checkpoint after every iteration."""

    def command(folder: Path) -> Sequence[str]:
        words = ["TabletopReach-v0", "--num-envs", str(_ENVS), "--device", device, "--out", str(folder), "--resume"]
        words += ["--minutes", "1000", "--million-steps", str(iterations * _STEPS * _ENVS / 1e6)]
        words += ["--every", "1", "--save-every", "0", "--evaluate-every", "100000"]
        return [sys.executable, "-m", "sceniris_gym", "train", *words]

    def fault(folder: Path, _: Path) -> str | None:
        lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
        steps = [line["env_steps"] for line in lines if line["kind"] == "train"]
        wanted = [_STEPS * _ENVS * (i + 1) for i in range(iterations)]
        if steps != wanted:
            return f"steps of the log: {steps}"
        evaluated = [line["env_steps"] for line in lines if line["kind"] == "eval"]
        if evaluated != wanted[-1:]:
            return f"evaluations at {evaluated}"
        held = torch.load(folder / "model.pt", weights_only=False)
        if held["infos"]["iterations"] != iterations:
            return f"the checkpoint is of iteration {held['infos']['iterations']}"
        return _others(folder, {"log.jsonl", "model.pt", "config.json", "judged.json"})

    def killed(folder: Path) -> str | None:
        if (folder / "model.pt").exists():
            held = torch.load(folder / "model.pt", weights_only=False)["infos"]
            if held["log_size"] > (folder / "log.jsonl").stat().st_size:
                return "the log is shorter than the checkpoint says"
        return None

    return Work(command, fault, killed)


def _others(folder: Path, wanted: set[str]) -> str | None:
    found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    return None if found == wanted else f"files {sorted(found ^ wanted)} are missing or left over"


def _differs(folder: Path, whole: Path) -> str | None:
    """Compare all files of two folders."""
    sums = [_sums(path) for path in (folder, whole)]
    if sums[0].keys() != sums[1].keys():
        return f"files {sorted(sums[0].keys() ^ sums[1].keys())} are missing or left over"
    other = [name for name in sums[0] if sums[0][name] != sums[1][name]]
    return f"other bytes in {other}" if other else None


def _sums(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def campaign(work: Work, times: int, seed: int, folder: Path) -> dict[str, object]:
    """Kill and resume `times` times; return what was found."""
    whole = folder / "whole"
    start = time.monotonic()
    failed = _to_the_end(work, whole)
    if failed is not None:
        raise SystemExit(failed)
    seconds = time.monotonic() - start
    draws, faults, early = np.random.default_rng(seed), [], 0
    bar = tqdm(total=times, file=sys.stderr)
    for i in range(4 * times):  # some runs end before their moment
        if bar.n == times:
            break
        place, moment = folder / f"run_{i}", draws.uniform(0.0, seconds)
        place.mkdir()
        with _started(work, place) as process:
            try:
                process.wait(moment)
                early += 1
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                bar.update()
        fault = work.killed(place)
        if fault is None:
            said = _to_the_end(work, place)
            fault = said or work.fault(place, whole)
        if fault is not None:
            faults.append(f"killed after {moment:.2f} s: {fault}")
            tqdm.write(faults[-1], file=sys.stderr)
        shutil.rmtree(place)
    return {"times": bar.n, "seconds_of_a_run": round(seconds, 1), "ended_before": early, "faults": faults}


def _started(work: Work, folder: Path) -> subprocess.Popen:
    folder.mkdir(exist_ok=True)
    log = (folder.parent / "said.txt").open("wb")
    with log:
        return subprocess.Popen(work.command(folder), stdout=log, stderr=log, start_new_session=True)


def _to_the_end(work: Work, folder: Path) -> str | None:
    """Run it until it ends; return what it said if it failed."""
    with _started(work, folder) as process:
        status = process.wait()
    return f"status {status}: {(folder.parent / 'said.txt').read_text()[-500:]}" if status else None


def signals(times: int, seed: int, folder: Path, device: str) -> dict[str, object]:
    """Stop `generate` soon after its start, by Ctrl-C and SIGTERM in turns."""
    draws, faults, slowest = np.random.default_rng(seed), [], 0.0
    for i in tqdm(range(times), file=sys.stderr):
        number = [signal.SIGINT, signal.SIGTERM][i % 2]
        words = ["generate", "mid", "-n", "100000000", "-o", str(folder / str(i)), "--device", device]
        moment = draws.uniform(0.5, 3.0)
        process = subprocess.Popen(
            [sys.executable, "-m", "sceniris_gym", *words],
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        time.sleep(moment)
        sent = time.monotonic()
        process.send_signal(number)
        said = process.communicate()[1]
        took = time.monotonic() - sent
        slowest = max(slowest, took)
        right = process.returncode == 128 + number
        right |= process.returncode == -number and not said  # by the system, before the program has begun
        left = [path.name for path in folder.rglob("*.tmp")]
        if not right or "Traceback" in said or took > _AT_ONCE or left:
            faults.append(f"{number.name} after {moment:.2f} s: status {process.returncode} in {took:.2f} s, {left}")
            tqdm.write(f"{faults[-1]}\n{said[-300:]}", file=sys.stderr)
    return {"times": times, "slowest_s": round(slowest, 2), "faults": faults}


def main() -> None:
    """Run a campaign, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["generate", "reach", "train", "signals"])
    parser.add_argument("--times", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--n", type=int, default=400_000, help="layouts of the data set")
    parser.add_argument("--arm", default="heron", help="arm of the map")
    parser.add_argument("--iterations", type=int, default=30, help="iterations of the training")
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if words.what == "signals":
            found = signals(words.times, words.seed, folder, words.device)
        else:
            work = {
                "generate": lambda: generate(words.n, words.device),
                "reach": lambda: reach(words.arm, words.device),
                "train": lambda: train(words.iterations, words.device),
            }[words.what]()
            found = campaign(work, words.times, words.seed, folder)
    print(json.dumps({"what": words.what, **found}))
    sys.exit(int(bool(found["faults"])))


if __name__ == "__main__":
    main()
