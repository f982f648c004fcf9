"""Rendering of an environment: the modes, the number of worlds, and the page that is kept meanwhile."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from sceniris_gym.errors import MissingExtraError, ScenirisError
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.sim.batch import Batch
from sceniris_gym.vector import rendering
from sceniris_gym.vector.rendering import Rendering
from sceniris_gym.vector.settings import RenderConfig
from sceniris_gym.viewer.worlds import Window


class _Page:
    def __init__(self, scene: object, num: int) -> None:
        self.num, self.shown, self.closed = num, 0, False

    def show(self, *_: object) -> None:
        self.shown += 1

    def close(self) -> None:
        self.closed = True


def test_no_more_worlds_are_looked_at_than_there_are():
    """All of them by default, and as many as there are where more are asked for."""
    assert Rendering(None, 3, RenderConfig()).worlds == 3
    assert Rendering("human", 3, RenderConfig(num_envs=8)).worlds == 3
    assert Rendering("rgb_array", 3, RenderConfig(size=cast(Any, np.array([32, 24])))).size == (32, 24)


@pytest.mark.parametrize(("mode", "worlds", "size"), [("ansi", 1, (8, 8)), (None, 0, (8, 8)), (None, 1, (0, 8))])
def test_what_cannot_be_is_refused(mode: str | None, worlds: int, size: tuple[int, int]):
    """A mode that is none, no world, no pixel."""
    with pytest.raises(ScenirisError, match="render_"):
        Rendering(mode, 3, RenderConfig(num_envs=worlds, size=size))


def test_a_page_is_opened_when_it_is_first_needed_and_closed(monkeypatch: pytest.MonkeyPatch):
    """Once, and never in another mode."""
    opened: list[_Page] = []

    def open_page(scene: object, num: int) -> _Page:
        opened.append(_Page(scene, num))
        return opened[-1]

    monkeypatch.setattr(rendering, "entry_points", lambda **_: [SimpleNamespace(load=lambda: open_page)])
    batch: Any = SimpleNamespace(full_scene=None)
    layouts: Any = None
    for mode, pages in (("rgb_array", 0), (None, 0), ("human", 1)):
        looked = Rendering(mode, 2, RenderConfig())
        for _ in range(2):
            looked.show(batch, layouts, 0.0)
        assert len(opened) == pages
        looked.close()
    assert (opened[0].num, opened[0].shown, opened[0].closed) == (2, 2, True)


def test_the_viewer_registers_its_page():
    """As an entry point of the installed package, so `make_vec` with render_mode="human" is all that a user calls."""
    assert rendering._page() is Window


def test_a_page_that_nobody_registers_names_the_extra(monkeypatch: pytest.MonkeyPatch):
    """As after an installation of part of the package."""
    monkeypatch.setattr(rendering, "PAGES", "sceniris_gym.pages_that_are_not_there")
    looked, batch, layouts = Rendering("human", 2, RenderConfig()), cast(Any, None), cast(Any, None)
    with pytest.raises(MissingExtraError, match=r"\[viewer\]"):
        looked.show(batch, layouts, 0.0)


class FakeWindow:
    """Stands in for the page, and keeps what it is shown."""

    def __init__(self, scene: Any, num: int) -> None:
        self.num, self.shown, self.closed = num, [], False

    def show(self, batch: Batch, layouts: Layouts, seconds: float) -> None:
        """Keep the positions of bodies, what the presence of objects has for a shape, and the time."""
        self.shown.append((batch.data.xpos.numpy().copy(), layouts.present.shape, seconds))

    def close(self) -> None:
        """Remember it."""
        self.closed = True


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[FakeWindow]:
    """The pages that were opened."""
    pages: list[FakeWindow] = []

    def make(scene: Any, num: int) -> FakeWindow:
        pages.append(FakeWindow(scene, num))
        return pages[-1]

    monkeypatch.setattr(rendering, "entry_points", lambda **_: [SimpleNamespace(load=lambda: make)])
    return pages


def test_resets_and_steps_are_shown(make_env, opened: list[FakeWindow]):
    """Of as many worlds as are asked for, at the pace of the control steps; `render` returns nothing."""
    envs = make_env(3, render_mode="human", render_config={"num_envs": 2})
    assert "human" in envs.metadata["render_modes"]
    assert opened == []
    envs.reset(seed=0)
    (page,) = opened
    assert page.num == 2
    envs.step(torch.zeros(3, 5))
    assert envs.render() is None
    assert [seconds for *_, seconds in page.shown] == [0.0, envs.state.dt, 0.0]
    assert page.shown[0][1] == (3, len(envs.compiled.slots))
    block = envs.compiled.scene.bodies["block"]
    np.testing.assert_allclose(page.shown[-1][0][:2, block], envs.state.pose("block")[:2, :3], atol=1e-5)
    envs.close()
    assert page.closed


def test_nothing_is_opened_without_it(make_env, opened: list[FakeWindow]):
    """Neither for pictures nor without a mode."""
    envs = make_env(2)
    envs.reset(seed=0)
    assert envs.render() is None
    envs.close()
    assert opened == []
