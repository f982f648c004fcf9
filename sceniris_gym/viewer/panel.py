"""The controls on the page of a scene."""

import html
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import viser

from sceniris_gym.program.compiled import USER_SPLITS
from sceniris_gym.viewer.deck import Where
from sceniris_gym.viewer.layers import BOTH, COLLIDED, LAYERS, REACH, SEEN
from sceniris_gym.viewer.server import Requests
from sceniris_gym.viewer.shown import START

ALL = "all objects"
NUMBERS = ("1", "4", "16", "64")
SPEEDS = {"real time": 1.0, "half": 0.5, "a tenth": 0.1, "a hundredth": 0.01}
_BOX = "padding:8px 10px; border-radius:6px; font-size:13px; white-space:pre-wrap; overflow-wrap:anywhere;"
_GOOD, _BAD, _WARNED = "background:#eef5ee; color:#1d4d2b;", "background:#fdeaea; color:#8a1414;", "background:#fff5e0;"


class Panel:
    """Draws the controls, which hold the user's choices. If a user changes one, the panel adds a request to a queue.

    Args:
        server: The viser server of the page.
        requests: The queue of requests.
        commands: The SceneView. Each request calls one of its public methods.
        num: Number of worlds at first.

    Attributes:
        layers: The checkbox of each layer, by name.
        geometry: The list with the kinds of geometry to draw.
        height: The slider with the height of the slice of the reach map [m].
        speed: The list of speeds of physics, with the keys of `SPEEDS`.
        rejected: The checkbox that shows rejected candidates.
        table: The table of rejection counts.
        play: The button that runs or pauses physics.
        arm: The list of the arm's poses.
    """

    def __init__(self, server: viser.ViserServer, requests: Requests, commands: Any, num: int) -> None:
        self._gui, self._ask, self._do = server.gui, requests.put, commands
        self._on, self._add_arrows = requests.put_changes, partial(requests.put_moves, server.gui)
        self._message = self._gui.add_html("")
        self._add_layout(num)
        tabs = self._gui.add_tab_group()
        for title, add in (("Layers", self._add_layers), ("Why", self._add_why), ("Play", self._add_play)):
            with tabs.add_tab(title):
                add()
        self._targets: list[Any] = []

    def say(self, text: str, *, bad: bool = False, notices: Sequence[str] = ()) -> None:
        """Show a message above all controls, and warnings below the message. With `bad`, the message is red."""
        boxes = [f"<div style='{_BOX}{_BAD if bad else _GOOD}'>{html.escape(text)}</div>"]
        boxes += [f"<div style='{_BOX}{_WARNED}'>{html.escape(notice)}</div>" for notice in notices]
        self._message.content = "".join(boxes)

    @property
    def only(self) -> str | None:
        """The object whose layers the user selected, or None for all objects."""
        return None if self._object.value == ALL else self._object.value

    def set_scene(self, names: Sequence[str], targets: Sequence[tuple[str, float, float]], has_map: bool) -> None:
        """Update the controls for another scene. If the selected object is not in this scene, select all objects.

        Args:
            names: The objects of the scene, to select from.
            targets: Name, least and greatest control of each actuator. Each gets a slider.
            has_map: True if a robot of the scene has a reach map.
        """
        self._object.options = (ALL, *names)  # viser selects the first option if the selected one is gone
        self.layers[REACH].disabled = self.height.disabled = not has_map
        for handle in self._targets:
            handle.remove()
        with self._play_tab:
            self._targets = [self._add_target(i, *target) for i, target in enumerate(targets)]
        self._no_targets.visible = not targets

    def set_where(self, where: Where, layout_id: str, poses: Sequence[str]) -> None:
        """Show which layouts the page shows: their split, seed and episode, and the id of the first world's layout.

        `poses` are the poses of the arm in this layout that the user can select.
        """
        self._split.value, self._seed.value, self._episode.value = where.split, str(where.seed), str(where.episode)
        self._id.value = layout_id
        self.arm.options = tuple(poses)
        self.arm.value = START
        self.arm.disabled = len(poses) < 2

    def set_targets(self, values: Iterable[float]) -> None:
        """Move the sliders to the current controls of the actuators."""
        for handle, value in zip(self._targets, values, strict=True):
            handle.value = min(max(float(value), handle.min), handle.max)

    def set_candidates(self, num: int, i: int, text: str) -> None:
        """Set the slider for rejected candidates to candidate `i` of `num`, and show the explanation `text`."""
        self._candidate.max = max(num, 1)
        self._candidate.disabled = num < 2
        self._candidate.value = i + 1 if num else 1
        self._why.content = f"<div style='{_BOX}{_BAD if num else _GOOD}'>{html.escape(text)}</div>"

    def _add_layout(self, num: int) -> None:
        gui = self._gui
        with gui.add_folder("Layout"):
            self._id = gui.add_text("id", "", hint="Copy the id, or paste another id of this scene.")
            self._on(self._id, "id", self._do.go_to_id)
            self._split: Any = gui.add_dropdown("split", USER_SPLITS)
            self._on(self._split, "where", lambda split: self._do.go(Where(split, self._do.where.seed, 0)))
            self._seed = gui.add_text("seed", "0", hint="From 0 to 2^64 - 1. World i has seed + i.")
            self._on(self._seed, "where", lambda text: self._go_to_number(text, "seed"))
            self._add_arrows("seed", lambda step: self._do.go(self._do.where.moved(seeds=step)))
            self._episode = gui.add_text("episode", "0", hint="Number of resets of the worlds since they got the seed.")
            self._on(self._episode, "where", lambda text: self._go_to_number(text, "episode"))
            self._add_arrows("episode", lambda step: self._do.go(self._do.where.moved(episodes=step)))
            numbers = sorted({*NUMBERS, str(num)}, key=int)
            self._number = gui.add_dropdown("worlds", numbers, initial_value=str(num))
            self._on(self._number, "worlds", lambda num: self._do.show_worlds(int(num)))

    def _go_to_number(self, text: str, what: str) -> None:
        text = text.strip()
        bits = 64 if what == "seed" else 31
        if not (text.isascii() and text.isdecimal()) or int(text) >= 2**bits:
            self.say(f"{what} '{text}': should be an integer from 0 to 2^{bits} - 1.", bad=True)
        else:
            self._do.go(self._do.where._replace(**{"episode": 0, what: int(text)}))

    def _add_layers(self) -> None:
        gui = self._gui
        self.geometry: Any = gui.add_dropdown(
            "geometry", (SEEN, COLLIDED, BOTH), hint="Only the first world shows collisions."
        )
        self.layers = {name: gui.add_checkbox(name, False, hint=hint) for name, (_, hint) in LAYERS.items()}
        self.height = gui.add_slider("height of slice [m]", 0.0, 2.0, 0.01, 0.5)
        self._on(self.height, "height", lambda _: self._do.show_slices())
        self._object: Any = gui.add_dropdown("layers of", (ALL,), hint="Show the layers of one object, or of all.")
        for handle in (self.geometry, *self.layers.values(), self._object):
            self._on(handle, "show", lambda _: self._do.show())
        self.arm: Any = gui.add_dropdown("arm in", (START,), hint="Move the arm into a grasp of this layout.")
        self._on(self.arm, "arm", lambda _: self._do.move_arm())

    def _add_why(self) -> None:
        gui = self._gui
        self.rejected = gui.add_checkbox("rejected candidates", False, hint="One by one, in red, in the first world.")
        self._on(self.rejected, "rejected", self._do.show_rejected)
        self._candidate = gui.add_slider("candidate", 1, 2, 1, 1, disabled=True)
        self._on(self._candidate, "candidate", lambda i: self._do.show_candidate(int(i) - 1))
        self._add_arrows("candidate", lambda step: self._do.show_candidate(int(self._candidate.value) - 1 + step))
        self._why = gui.add_html("")
        self.table = gui.add_html("")

    def _add_play(self) -> None:
        gui = self._gui
        self._play_tab = gui.add_folder("Physics of the first world")
        with self._play_tab:
            self.play = gui.add_button("Play", hint="Step the first world with MuJoCo C from this layout on.")
            self.play.on_click(lambda _: self._ask("play", lambda: self._do.play(self.play.label == "Play")))
            buttons = gui.add_button_group("   ", ("Step", "Reset"))
            actions = {"Step": self._do.step, "Reset": self._do.reset_play}
            buttons.on_click(lambda event: self._ask("step", actions[event.target.value]))
            self.speed = gui.add_dropdown("speed", tuple(SPEEDS))
            self._no_targets = gui.add_html("<p>The scene has no actuators.</p>")

    def _add_target(self, i: int, name: str, low: float, high: float) -> Any:
        step = max((high - low) / 200.0, 1e-6)
        handle = self._gui.add_slider(name.rpartition("/")[2], low, high, step, low, hint=f"target of {name}")
        return self._on(handle, f"target {i}", lambda value: self._do.set_target(i, float(value)))
