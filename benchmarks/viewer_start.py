"""Start of `sceniris-gym view`: times to its address, to the first message that a page gets, and to the first picture.

python -m benchmarks.viewer_start mid --worlds 64

A client that speaks viser's protocol stands for the browser first, so that only this package, viser and mjviser are
measured. With a Chromium on the path, one that is open already then goes to the page: `drawn` is when its program has
handed the first frame with the worlds to the graphics driver, and `picture` when two more frames are through, which
without a GPU is the time that the processor takes for their pixels. Prints a line of JSON for each start, in seconds
from before the process was started; `cpu` is what the process itself has used until the worlds were sent, on all cores.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

_WORLDS = b"BatchedGlb"
"""What the message that shows meshes in many places is called."""
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
_EMPTY = 2000
"""Triangles that a page without worlds stays far below."""
_DRAWN = f"() => (window.__viserTestpoints?.rendererInfo.render.triangles ?? 0) > {_EMPTY}"
_NEXT = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
_PATIENCE = 120.0  # s


@contextmanager
def served(scene: str, worlds: int) -> Iterator[tuple[subprocess.Popen[str], str, float]]:
    """Start the page; gives its process, its address, and when it was started."""
    command = [sys.executable, "-m", "sceniris_gym", "view", scene, "--num-envs", str(worlds)]
    begun = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        yield process, process.stdout.readline().split()[-1], begun
        process.terminate()


def cpu(process: subprocess.Popen[str]) -> float:
    """Seconds that a process has used on all cores."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def start(scene: str, worlds: int) -> dict[str, float]:
    """Start the page, connect to it, and wait until the worlds are there."""
    with served(scene, worlds) as (process, address, begun):
        times = {"address": time.perf_counter() - begun}
        page = address.rstrip("/").replace("http", "ws")
        # pyrefly: ignore[bad-argument-type]
        with connect(page, subprotocols=[f"viser-v{version('viser')}"], max_size=None) as socket:
            received = socket.recv(timeout=_PATIENCE)
            times["first_message"] = time.perf_counter() - begun
            while _WORLDS not in received:  # pyrefly: ignore[unsupported-operation]
                received = socket.recv(timeout=_PATIENCE)
            times["worlds"] = time.perf_counter() - begun
            times["cpu"] = cpu(process)
    return times


def draw(browser: Any, scene: str, worlds: int) -> dict[str, float]:
    """Start the page, go there with a browser, and wait until it has drawn the worlds."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    with served(scene, worlds) as (_, address, begun):
        page.goto(address, timeout=1e3 * _PATIENCE)
        page.wait_for_function(_DRAWN, timeout=1e3 * _PATIENCE, polling=20)
        times = {"drawn": time.perf_counter() - begun}
        page.evaluate(_NEXT)
        times["picture"] = time.perf_counter() - begun
        page.close()
    return times


def main() -> None:
    """Print a line for each start."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=4)
    words = parser.parse_args()
    for _ in range(words.repeats):
        show(start(words.scene, words.worlds))
    program = next((path for path in map(shutil.which, _BROWSERS) if path is not None), None)
    if program is None:
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=list(_FLAGS))
        for _ in range(words.repeats):
            show(draw(browser, words.scene, words.worlds))
        browser.close()


def show(times: dict[str, float]) -> None:
    """Print a line."""
    print(json.dumps({name: round(seconds, 2) for name, seconds in times.items()}), flush=True)


if __name__ == "__main__":
    main()
