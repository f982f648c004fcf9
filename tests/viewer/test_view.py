"""The page of a scene without a browser: what its controls ask for is done, and mistakes are said on it."""

from __future__ import annotations

import gc
import re
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.viewer import view as view_module
from sceniris_gym.viewer.deck import Where
from sceniris_gym.viewer.layers import COLLIDED, LAYERS, PARKED, REACH, SEEN
from sceniris_gym.viewer.panel import ALL
from sceniris_gym.viewer.scene_file import SceneFile
from sceniris_gym.viewer.shown import START
from sceniris_gym.viewer.sketch import Sketch
from sceniris_gym.viewer.view import SceneView
from sceniris_gym.viewer.worlds import Worlds
from tests.viewer.pages import control, drawn_body, page, press, shown, text

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")

SCENE = "floor: {size: [1.0, 1.0]}\nobjects: {apple: {asset: apple, on: floor}, pear: {asset: pear, on: floor}}\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A scene in a file."""
    path = tmp_path / "scene.yaml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def view(path: Path) -> Iterator[SceneView]:
    """Its page."""
    with page() as server:
        view = SceneView(server, SceneFile(str(path), {}), Where())
        view.load()
        yield view


def message(view: SceneView) -> str:
    """Return what is said above the controls."""
    return next(handle.content for handle in shown(view.server) if hasattr(handle, "content"))


def choose(view: SceneView, label: str, value: object) -> None:
    """Change a control as a user does, and let the page do what it asks for."""
    press(view.server, label, value)
    view.tick(0.0)


def saved(view: SceneView, path: Path, words: str) -> None:
    """Save the scene, and let the page see it, at once."""
    path.write_text(words)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(view_module, "_IDLE", -1.0)
        view.tick(0.0)


def test_controls_lead_to_layouts(view: SceneView):
    """Seed and episode as numbers, arrows, and an id that is pasted; what is on show is the generator's."""
    press(view.server, "seed", "41")
    view.tick(0.0)
    assert view.where == Where(seed=41)
    press(view.server, "episode", "2")
    view.tick(0.0)
    assert view.where == Where(seed=41, episode=2)
    assert view.deck is not None
    press(view.server, "id", view.deck.compiled.layout_id(7, 1, "eval"))
    view.tick(0.0)
    assert view.where == Where("eval", 7, 1)
    assert [control(view.server, label).value for label in ("seed", "episode", "split")] == ["7", "1", "eval"]
    generator = LayoutGenerator(view.deck.compiled, 1, seed=[7], split="eval")
    generator.generate()
    generator.generate()
    assert view.table is not None
    np.testing.assert_array_equal(view.table.qpos[0], generator.layouts.qpos.cpu().numpy()[0])


@pytest.mark.parametrize("wrong", ["-1", "1.5", "apple", str(2**64)])
def test_wrong_numbers_and_ids_are_said(view: SceneView, wrong: str):
    """In red, and what is on show stays."""
    press(view.server, "seed", wrong)
    view.tick(0.0)
    assert "should be an integer from 0 to 2^64 - 1" in message(view)
    press(view.server, "id", wrong)
    view.tick(0.0)
    assert "should be scenehash" in message(view)
    assert view.where == Where()


def test_saving_shows_the_scene_at_the_same_seed_and_mistakes_leave_the_last_good_one(
    view: SceneView, path: Path, capsys: pytest.CaptureFixture
):
    """The error is in the words of the file; once it is mended the page says that all is well."""
    view.go(Where(seed=9))
    saved(view, path, SCENE.replace("pear: {asset: pear", "can: {asset: can"))
    assert view.where == Where(seed=9)
    assert view.deck is not None
    assert view.deck.compiled.object_names == ("apple", "can")
    shown = view.deck
    saved(view, path, SCENE.replace("on: floor}, pear", "onn: floor}, pear"))
    assert "objects.apple.onn" in message(view)
    assert "#8a1414" in message(view)
    assert view.deck is shown
    assert "objects.apple.onn" in capsys.readouterr().err
    view.go(view.where.moved(seeds=1))
    view.go(view.where.moved(seeds=-1))
    assert "objects.apple.onn" in message(view), "it stands there until it is mended"
    saved(view, path, SCENE)
    assert "a fresh layout" in message(view)
    assert view.where == Where(seed=9)
    saved(view, path, f"{SCENE}start: [{{weight: 1}}]\n")
    assert "a fresh layout, start 0," in message(view)


def test_a_scene_that_cannot_be_made_shows_what_was_tried(view: SceneView, path: Path):
    """With the object that is to blame, its cause, and how often; the candidate is in the picture."""
    saved(view, path, SCENE.replace("pear: {asset: pear, on: floor", "chest: {asset: chest, on: floor, clearance: 2.0"))
    assert "could not be placed" in message(view)
    assert re.search(r"\b(apple|chest): collision \(", text(view.server))
    assert view.server.scene.get_handle_by_name("/candidate") is not None
    saved(view, path, SCENE)
    assert view.server.scene.get_handle_by_name("/candidate") is None


def test_layers_are_drawn_and_go(view: SceneView):
    """Each of them, of all objects and of one; what collides takes the place of what is seen."""
    for name in (name for name, (sketch, _) in LAYERS.items() if sketch is not None):
        choose(view, name, True)
        assert view.server.scene.get_handle_by_name(f"/layer_{name}") is not None
        choose(view, "layers of", "apple")
        choose(view, name, False)
        choose(view, "layers of", ALL)
        assert view.server.scene.get_handle_by_name(f"/layer_{name}") is None
    choose(view, "geometry", COLLIDED)
    assert view.server.scene.get_handle_by_name("/pieces") is not None
    choose(view, "geometry", SEEN)
    assert view.server.scene.get_handle_by_name("/pieces") is None
    choose(view, PARKED, True)
    choose(view, REACH, True)
    assert control(view.server, REACH).disabled


def test_worlds_can_be_many(view: SceneView):
    """World i has seed + i, and what is said is about all of them."""
    view.show_worlds(16)
    assert view.table is not None
    assert len(view.table) == 16
    assert view.table.seed.tolist() == list(range(16))
    assert "16 layouts, seeds 0 to 15" in message(view)


@pytest.fixture
def times(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time of each state that is drawn in the first world, the latest last."""
    times: list[float] = []
    put = Worlds.put

    def watched(worlds: Worlds, i: int, data: mujoco.MjData, *rest: Any) -> None:
        if i == 0:
            times.append(data.time)
        put(worlds, i, data, *rest)

    monkeypatch.setattr(Worlds, "put", watched)
    return times


def has_names(view: SceneView) -> bool:
    """Return whether the layer of names is drawn."""
    return view.server.scene.get_handle_by_name("/layer_names") is not None


def test_physics_is_played_stepped_and_reset(view: SceneView, times: list[float]):
    """Time goes on while it plays, and layers are away; another layout ends it."""
    choose(view, "names", True)
    press(view.server, "rejected candidates", True)
    view.tick(0.0)
    view.play(True)
    assert control(view.server, "Pause") is view.panel.play
    for _ in range(5):
        view.tick(0.0)
    assert times[-1] > 0.0
    assert not has_names(view)
    view.step()
    stopped = times[-1]
    time.sleep(0.01)
    view.tick(0.0)
    assert times[-1] == stopped
    view.reset_play()
    assert times[-1] == 0.0
    assert has_names(view), "layers are back"
    choose(view, "speed", "a tenth")
    assert has_names(view), "a speed begins nothing"
    view.go(Where(seed=1))
    began = time.monotonic()
    view.play(True)
    for _ in range(5):
        view.tick(0.0)
    assert 0.0 < times[-1] < 0.1 * (time.monotonic() - began) + 1e-6
    view.go(Where(seed=2))
    assert has_names(view)
    assert control(view.server, "Play") is view.panel.play


def test_what_is_on_show_is_what_is_played(view: SceneView, times: list[float]):
    """A layer that is switched does not put the layout back; candidates and poses of the arm end physics."""
    view.step()
    choose(view, "names", True)
    assert times[-1] > 0.0
    view.show_rejected(True)
    assert has_names(view)
    assert times[-1] == 0.0
    choose(view, "arm in", START)
    assert "Tick the box to see them" in text(view.server)
    assert not control(view.server, "rejected candidates").value


def test_physics_begins_and_ends_with_the_arm_at_its_start(view: SceneView, monkeypatch: pytest.MonkeyPatch):
    """Whatever the arm had jumped into: time goes on from the layout, and `Reset` goes back to it."""
    jumps: list[str] = []
    monkeypatch.setattr(view_module, "with_arm", lambda world, pose: (jumps.append(pose), world.table)[1])
    view.panel.arm.options = (START, "grasp of pear")
    choose(view, "arm in", "grasp of pear")
    assert jumps == ["grasp of pear"]
    view.play(True)
    assert control(view.server, "arm in").value == START
    view.reset_play()
    assert jumps == ["grasp of pear"]


def test_physics_is_seen_where_pieces_stood_for_worlds(view: SceneView):
    """Pieces are about the layout; while time goes on the worlds themselves are drawn."""
    apple = drawn_body(view.server, "apple")
    choose(view, "geometry", COLLIDED)
    assert not apple.visible
    view.play(True)
    assert apple.visible
    view.reset_play()
    assert not apple.visible
    view.play(True)
    view.go(Where(seed=1))
    assert not apple.visible


def test_cameras_stay_when_a_scene_is_saved(view: SceneView, path: Path, monkeypatch: pytest.MonkeyPatch):
    """Users have turned them to what they write about; another number of worlds, or another room, is aimed at anew."""
    aimed: list[bool] = []
    monkeypatch.setattr(Worlds, "aim", lambda self, open_pages=True: aimed.append(open_pages))
    saved(view, path, SCENE.replace("pear", "orange"))
    assert aimed == [False]
    saved(view, path, SCENE.replace("[1.0, 1.0]", "[4.0, 4.0]"))
    view.show_worlds(4)
    assert aimed == [False, True, True]


def test_controls_say_what_is_on_show_after_a_reload(view: SceneView, path: Path, monkeypatch: pytest.MonkeyPatch):
    """Candidates stay on where they were on, and so does the object that layers are of, as long as there is one."""
    drawn: list[str | None] = []
    monkeypatch.setitem(LAYERS, "names", (lambda world, name: (drawn.append(name), Sketch())[1], ""))
    for label, value in [("rejected candidates", True), ("layers of", "pear"), ("names", True)]:
        press(view.server, label, value)
    view.tick(0.0)
    saved(view, path, SCENE.replace("[1.0, 1.0]", "[1.1, 1.1]"))
    assert (control(view.server, "layers of").value, drawn[-1]) == ("pear", "pear")
    saved(view, path, SCENE.replace("pear", "orange"))
    assert control(view.server, "rejected candidates").value
    assert "Tick the box to see them" not in text(view.server)
    assert (control(view.server, "layers of").value, drawn[-1]) == (ALL, None)
    view.show_rejected(False)
    assert control(view.server, "candidate").value == 1


def test_rejected_candidates_are_shown_one_by_one(view: SceneView, path: Path):
    """From the first to the last; a layout without any says so."""
    saved(view, path, SCENE.replace("[1.0, 1.0]", "[0.2, 0.2]"))
    view.show_rejected(True)
    while view.server.scene.get_handle_by_name("/candidate") is None:
        view.go(view.where.moved(seeds=1))
        assert view.where.seed < 50
    view.show_candidate(0)
    assert control(view.server, "candidate").value == 1
    view.show_candidate(10**6)
    candidate = control(view.server, "candidate")
    assert candidate.value == candidate.max
    view.show_rejected(False)
    assert view.server.scene.get_handle_by_name("/candidate") is None


def test_a_failure_of_ours_is_said_and_the_page_goes_on(view: SceneView, capsys: pytest.CaptureFixture):
    """With a traceback on stderr."""

    def fail() -> None:
        raise ZeroDivisionError("division by zero")

    view.requests.put("boom", fail)
    view.tick(0.0)
    assert "ZeroDivisionError" in message(view)
    assert "Traceback" in capsys.readouterr().err
    view.go(Where(seed=3))
    assert "a fresh layout" in message(view)


def test_memory_is_flat_over_many_layouts(view: SceneView):
    """Two hundred of them leave less than 2 kB each behind."""
    for seed in range(50):
        view.go(Where(seed=seed))
    gc.collect()
    tracemalloc.start()
    try:
        for seed in range(200):
            view.go(Where(seed=seed))
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] < 200 * 2048
    finally:
        tracemalloc.stop()
