"""The page in a browser: a Chromium opens it, clicks, types and looks at what is drawn.

With SCENIRIS_SCREENSHOTS=docs/viewer the pictures of docs/viewer.md are written there.
"""

from __future__ import annotations

import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.viewer.pages import free_port

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next((path for path in map(shutil.which, BROWSERS) if path is not None), None)
SCREENSHOTS = os.environ.get("SCENIRIS_SCREENSHOTS")
PATIENCE = 300.0  # s; a browser that renders without a GPU is slow where others work too
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
QUIET = ".mantine-Notification-root, .mantine-Notifications-root { display: none !important; }"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason=f"there is no browser: none of {', '.join(BROWSERS)} is installed"),
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A browser without a window."""
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


class Served:
    """The `view` command in a process of its own, and the pages on it."""

    def __init__(self, browser: Any, *arguments: str) -> None:
        command = [sys.executable, "-m", "sceniris_gym", "view", *arguments, "--port", str(free_port())]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        self.browser = browser
        self.pages = [self.open()]

    def open(self) -> Any:
        """Open a page, and wait until a scene is there."""
        page = self.browser.new_page(viewport={"width": 1280, "height": 800})
        # Without a fixed ratio of pixels, the page draws fewer of them where a machine is busy.
        page.goto(f"{self.address}?fixedDpr=1", timeout=1e3 * PATIENCE)
        page.add_style_tag(content=QUIET)
        page.wait_for_selector("canvas", timeout=1e3 * PATIENCE)
        page.get_by_text("a fresh layout").or_(page.get_by_text("layouts, seeds")).or_(
            page.get_by_text("could not be placed")
        ).first.wait_for(timeout=1e3 * PATIENCE)
        return page

    def stop(self) -> int:
        """Press Ctrl-C, and return the status."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(PATIENCE)

    def close(self) -> None:
        """Close everything."""
        for page in self.pages:
            page.close()
        self.process.kill()
        self.process.wait()


@pytest.fixture
def serve(browser: Any) -> Iterator[Callable[..., Served]]:
    """Return a function that serves a scene."""
    served: list[Served] = []

    def make(*arguments: str) -> Served:
        served.append(Served(browser, *arguments))
        return served[-1]

    yield make
    for one in served:
        one.close()


def seen(page: Any) -> np.ndarray:
    """Return what is drawn, without the controls, (height, width, 3)."""
    picture = Image.open(io.BytesIO(page.locator("canvas").first.screenshot(timeout=1e3 * PATIENCE)))
    return np.asarray(picture.convert("RGB"), int)[:, :900]


def changed(now: np.ndarray, before: np.ndarray) -> float:
    """Return the share of a picture that is another one."""
    return float(np.mean(np.abs(now - before).max(axis=-1) > 12))


def settled(page: Any) -> np.ndarray:
    """Wait until what is drawn stays as it is, and return it."""
    end, before = time.monotonic() + PATIENCE, seen(page)
    while time.monotonic() < end:
        page.wait_for_timeout(300)
        now = seen(page)
        if changed(now, before) < 0.001:
            return now
        before = now
    return before


def wait_for_change(page: Any, before: np.ndarray, share: float = 0.001) -> np.ndarray:
    """Wait until at least a share of the picture is another one."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        now = settled(page)
        if changed(now, before) > share:
            return now
    raise AssertionError("the picture stays as it is")


def keep(page: Any, name: str) -> None:
    """Write a picture for the documentation, if that is asked for."""
    if SCREENSHOTS is not None:
        page.mouse.move(450, 780)  # away from controls, whose hints would be in the picture
        settled(page)
        Path(SCREENSHOTS).mkdir(parents=True, exist_ok=True)
        picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        small = picture.resize((960, 600), Image.Resampling.LANCZOS)
        small.save(Path(SCREENSHOTS) / f"{name}.jpg", quality=90, optimize=True)


def field(page: Any, label: str) -> Any:
    """Return the input beside a label."""
    return page.locator(f'xpath=//*[normalize-space(text())="{label}"]/following::input[not(@type="hidden")][1]').first


def test_layouts_layers_and_ids(serve: Callable[..., Served]):
    """Arrows and ids change what is drawn, layers come and go, a second page sees the same, and Ctrl-C ends it all."""
    served = serve("tabletop_lift")
    page = served.pages[0]
    first = settled(page)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 100
    keep(page, "layout")
    name = field(page, "id").input_value()
    page.get_by_role("button", name="seed ▶").click()
    second = wait_for_change(page, first)
    assert field(page, "seed").input_value() == "1"
    field(page, "id").fill(name)
    wait_for_change(page, second)
    assert changed(settled(page), first) < 0.01
    for layer in ("regions", "clearances"):
        field(page, layer).click()
        wait_for_change(page, first)
        keep(page, layer)
        field(page, layer).click()
        page.wait_for_timeout(1500)
    other = served.open()
    served.pages.append(other)
    assert field(other, "id").input_value() == name
    page.close()
    served.pages.remove(page)
    field(other, "names").click()
    wait_for_change(other, first)
    assert served.stop() == 130


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder for a scene; for pictures, in which messages name it, one with a short name."""
    if SCREENSHOTS is None:
        yield tmp_path
        return
    path = Path(tempfile.gettempdir()) / "scenes"
    path.mkdir()
    yield path
    shutil.rmtree(path)


def test_a_file_that_is_being_written(serve: Callable[..., Served], folder: Path):
    """An orange that never fits is shown in red with its cause; a typing error in words; what is mended at once."""
    path = folder / "orange.yaml"
    orange = "{asset: orange, on: cabinet/upper_drawer, clearance: 0.2}"
    path.write_text(f"base: mid\nobjects:\n  orange: {orange}\n")
    page = serve(str(path)).pages[0]
    page.get_by_role("tab", name="Why").click()
    page.get_by_text("orange: collision (").first.wait_for(timeout=1e3 * PATIENCE)
    picture = settled(page)
    red = (picture[..., 0] > 150) & (picture[..., 1] < 90) & (picture[..., 2] < 90)
    assert red.sum() > 50
    keep(page, "why")
    path.write_text(f"base: mid\nobjects:\n  orange: {orange.replace('asset', 'aset')}\n")
    page.get_by_text("objects.orange.aset").first.wait_for(timeout=1e3 * PATIENCE)
    keep(page, "error")
    path.write_text("base: mid\nobjects:\n  orange: {asset: orange, on: floor}\n")
    page.get_by_text("a fresh layout").first.wait_for(timeout=1e3 * PATIENCE)


def test_many_worlds(serve: Callable[..., Served]):
    """64 of them, each in a place of its own."""
    page = serve("mid", "--num-envs", "64").pages[0]
    picture = settled(page)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
    keep(page, "worlds")


def test_physics(serve: Callable[..., Served]):
    """An arm moves where the slider of a joint says, and the button says that it can be stopped."""
    page = serve("tabletop_lift").pages[0]
    before = settled(page)
    page.get_by_role("tab", name="Play").click()
    page.get_by_role("button", name="Play").wait_for(timeout=1e3 * PATIENCE)
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").wait_for(timeout=1e3 * PATIENCE)
    field(page, "joint1").fill("0.6")
    wait_for_change(page, before)
