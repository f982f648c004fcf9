"""The viewer's page of one scene: its state, and the action of each control."""

import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace

import viser

from sceniris_gym.errors import InfeasibleSceneError, ScenirisError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.progress import listening
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.viewer import why
from sceniris_gym.viewer.deck import Candidate, LayoutDeck, Where
from sceniris_gym.viewer.layers import COLLIDED, LAYERS, PARKED, REACH, SEEN, ReachSlice, sketch_pieces
from sceniris_gym.viewer.panel import SPEEDS, Panel
from sceniris_gym.viewer.scene_file import LoadedScene, SceneFile
from sceniris_gym.viewer.server import Requests
from sceniris_gym.viewer.shown import START, Player, ShownWorld, poses_of_arm, target_ranges, with_arm
from sceniris_gym.viewer.sketch import Sketch
from sceniris_gym.viewer.worlds import Worlds, view_direction

_FRAME = 1.0 / 60.0  # s between pictures of physics
_IDLE = 0.25  # s between checks of the scene's files
_KERNELS = "The first start compiles kernels, which takes a minute."
_TRIED = "The tab 'Why' shows the rejected candidates in red."
_CANDIDATE, _SLICE, _PIECES = "candidate", "slice", "pieces"  # names of sketches on the page


class SceneView:
    """Shows layouts of a scene on a page. The thread that calls `tick` handles the requests of the page's controls.

    Args:
        server: The viser server of the page.
        file: The scene.
        where: Split, seed and episode of the layouts to show first.
        num: Number of worlds to show first.
    """

    def __init__(self, server: viser.ViserServer, file: SceneFile, where: Where, num: int = 1) -> None:
        self.server, self.file, self.where, self.num = server, file, where, num
        self.requests = Requests()
        self.panel = Panel(server, self.requests, self, num)
        self.panel.say(f"The scene is being compiled. {_KERNELS}")
        self._ready = False  # True once a scene is on the page, and the next four attributes are set
        self.loaded: LoadedScene
        self.deck: LayoutDeck
        self.table: LayoutTable
        self._worlds: Worlds
        self._broken: str | None = None  # the error in the file, while the page shows the last good scene
        self._player: Player | None = None
        self._slices: list[ReachSlice] = []
        self._candidates: list[Candidate] | None = None
        self._candidate = 0
        self._counted = True
        self._looked = self._stepped = time.monotonic()

    def tick(self, seconds: float = _IDLE) -> None:
        """Handle requests, step physics, and reload the scene if its files changed. Called in a loop.

        If there is no request and physics is paused, wait for a request up to `seconds` [s].
        """
        running = self._player is not None and self._player.running
        for action in self.requests.take(_FRAME if running else seconds):
            self._try(action)
        now = time.monotonic()
        if self._player is not None and self._player.advance((now - self._stepped) * SPEEDS[self.panel.speed.value]):
            self._show_player()
        self._stepped = now
        if now - self._looked > _IDLE:
            self._looked = now
            if self.file.changed():
                self._try(self.load)
            elif not self._counted:  # the page is idle
                self._counted = True
                self.deck.count_ahead()
                self._tell_counts()

    def load(self) -> None:
        """Read the scene, and show its layouts of the current split, seed and episode.

        If the scene has an error, show the message. If the scene cannot be built, the page keeps the last scene.
        """
        with listening(self._tell_progress):
            loaded = self.file.load()
        if loaded.error is not None:
            print(loaded.error, file=sys.stderr, flush=True)
        self._broken = str(loaded.error) if loaded.compiled is None else None
        if loaded.compiled is None:
            self.panel.say(str(loaded.error), bad=True)
            return
        self.loaded = loaded
        self._slices = ReachSlice.of(loaded.compiled.scene)
        ranges = target_ranges(loaded.compiled.mjm)
        self.panel.set_scene(loaded.compiled.object_names, ranges, bool(self._slices))
        self._draw_worlds(loaded.compiled)
        if loaded.error is not None:
            self.panel.rejected.value = True
            self.show_rejected(True)

    def go(self, where: Where) -> None:
        """Show the layouts of another split, seed or episode."""
        if not self._ready:
            return
        self.where, self.panel.arm.value = where, START
        self._end_play()
        self.table = self.deck.make(where)
        self._worlds.paint(self.deck.compiled, self.table)
        if self._candidates is not None:
            self._candidates = self.deck.rejected(where)
            self._candidate = self._first_candidate()
        self.show()
        self._tell()

    def go_to_id(self, text: str) -> None:
        """Show the layout with the id `text` in the first world."""
        if self._ready and text.strip() != self._layout_id():
            self.go(self.deck.find(text))

    def show_worlds(self, num: int) -> None:
        """Show `num` worlds."""
        self.num = num
        if self._ready:
            self._draw_worlds(self.deck.compiled)

    def show(self) -> None:
        """Draw all worlds and layers in their current state, as the user's controls say."""
        if not self._ready:
            return
        compiled, worlds = self.deck.compiled, self._worlds
        first, candidate = self._first_world()
        before = [] if candidate is None else why.bodies_before(first, candidate, view_direction(compiled.mjm))
        for i in range(self.num):
            world = first if i == 0 else ShownWorld(compiled, self.table[i : i + 1])
            parked = self.panel.layers[PARKED].value
            hidden = world.hidden_bodies(with_absent=not parked)
            if candidate is not None and i == 0:
                hidden += [*compiled.scene.subtree(candidate.name), *before]
            worlds.put(i, world.data, hidden, world.parked_offsets(worlds.low) if parked else {})
        worlds.send()
        worlds.show_visuals(self.panel.geometry.value != COLLIDED or self._player is not None)
        self._show_layers(first)
        self._show_candidate(first, candidate, before)
        self._show_slices(first)
        self._show_player()

    def show_slices(self) -> None:
        """Show the slice of the reach map at the height that the user chose."""
        if self._ready:
            self._show_slices(self._first_world()[0])

    def move_arm(self) -> None:
        """End physics, and show the first world in its layout, with the arm in the pose that the user chose."""
        self._candidates = None
        self.panel.rejected.value = False
        self._end_play()
        self.show()

    def show_rejected(self, shown: bool) -> None:
        """Show or hide the rejected candidates of the first world's layout. Showing them ends physics."""
        if shown:
            self._end_play()
        self._candidates = self.deck.rejected(self.where) if shown and self._ready else None
        self._candidate = self._first_candidate()
        self.show()

    def show_candidate(self, i: int) -> None:
        """Show the rejected candidate with index `i`. An index out of range is clipped."""
        self._candidate = min(max(i, 0), max(len(self._candidates or ()) - 1, 0))
        self.show()

    def play(self, running: bool) -> None:
        """Run or pause physics in the first world."""
        player = self._playing()
        player.running, self._stepped = running, time.monotonic()
        self.panel.play.label = "Pause" if running else "Play"

    def step(self) -> None:
        """Pause physics in the first world, and take one step."""
        self.play(False)
        self._playing().step()
        self._show_player()

    def reset_play(self) -> None:
        """End physics, and show the layout and its layers again."""
        if self._player is not None:
            self._player.reset()
            self.panel.set_targets(self._player.data.ctrl)
            self._end_play()
            self.show()

    def set_target(self, i: int, value: float) -> None:
        """Set the control of actuator `i`, and run physics in the first world."""
        self._playing().data.ctrl[i] = value
        self.play(True)

    def _try(self, action: Callable[[], None]) -> None:
        """Run an action. If it raises, show the error on the page. Print unexpected errors to stderr too."""
        try:
            action()
        except ScenirisError as error:
            self.panel.say(str(error), bad=True)
        except Exception as error:
            traceback.print_exc(file=sys.stderr)
            self.panel.say(f"The viewer failed: {type(error).__name__}: {error}", bad=True)

    def _tell_progress(self, what: str, done: int, total: int) -> None:
        self.panel.say(f"The scene is being compiled ({what}: {done} of {total}). {_KERNELS}")

    def _draw_worlds(self, compiled: CompiledScene) -> None:
        """Replace all worlds on the page, because the scene or the number of worlds changed."""
        self.deck, self._counted = LayoutDeck(compiled, self.num), False
        self.server.scene.reset()
        worlds = Worlds(self.server, compiled.scene, self.num)
        worlds.aim(open_pages=not self._ready or not worlds.is_like(self._worlds))
        self._worlds, self._ready = worlds, True
        self.go(self.where)

    def _first_world(self) -> tuple[ShownWorld, Candidate | None]:
        """Return the first world as it should be drawn, and the rejected candidate to draw in it, or None.

        If there is a candidate, the world is in the state in which the candidate was tried. Otherwise, the world is in
        its layout, with the arm in the selected pose.
        """
        if self._candidates:
            candidate = self._candidates[self._candidate]
            return why.world_of(self.deck.compiled, candidate), candidate
        world = ShownWorld(self.deck.compiled, self.table[:1], stands=self.deck.stands(self.where.split))
        if (pose := self.panel.arm.value) != START:
            moved = with_arm(world, pose)
            if moved is None:
                self.panel.say(f"Inverse kinematics found no solution for the {pose}.", bad=True)
            else:
                world = replace(world, table=moved)
        return world, None

    def _sketch(self, name: str, sketch: Sketch) -> None:
        sketch.draw(self.server, name, self._worlds.origins[0], self._worlds.size)

    def _show_layers(self, world: ShownWorld) -> None:
        for name, (sketch, _) in LAYERS.items():
            if sketch is not None and self.panel.layers[name].value and self._player is None:
                self._sketch(f"layer_{name}", sketch(world, self.panel.only))
            else:
                self.server.scene.remove_by_name(f"/layer_{name}")
        geometry = self.panel.geometry.value
        if geometry == SEEN or self._player is not None:
            self.server.scene.remove_by_name(f"/{_PIECES}")
        else:
            self._sketch(_PIECES, sketch_pieces(world, opacity=1.0 if geometry == COLLIDED else 0.5))

    def _show_candidate(self, world: ShownWorld, candidate: Candidate | None, before: Sequence[int]) -> None:
        if candidate is None:
            self.server.scene.remove_by_name(f"/{_CANDIDATE}")
            text = "This layout rejected no candidates." if self._candidates == [] else "Tick the box to see them."
            self.panel.set_candidates(0, 0, text)
            return
        hits = self.deck.blame.hits(world.data, candidate.number) if candidate.cause == "collision" else []
        self._sketch(_CANDIDATE, why.sketch_candidate(world, candidate, hits, before))
        text = why.explain(self.deck.compiled, candidate, hits)
        self.panel.set_candidates(len(self._candidates or ()), self._candidate, text)

    def _show_slices(self, world: ShownWorld) -> None:
        self.server.scene.remove_by_name(f"/{_SLICE}")
        if not self.panel.layers[REACH].value:
            return
        self.server.scene.add_frame(f"/{_SLICE}", show_axes=False, position=self._worlds.origins[0])
        flat = {"cast_shadow": False, "receive_shadow": False}
        for i, piece in enumerate(self._slices):
            (at, rotation), size = piece.pose(world.data, self.panel.height.value), 2.0 * piece.span
            name, image = f"/{_SLICE}/{i}", piece.picture(world.data, self.panel.height.value)
            self.server.scene.add_image(name, image, size, size, format="png", position=at, wxyz=rotation, **flat)

    def _show_player(self) -> None:
        if self._player is None:
            return
        world = ShownWorld(self.deck.compiled, self.table[:1])
        self._worlds.put(0, self._player.data, world.hidden_bodies())
        self._worlds.send()

    def _playing(self) -> Player:
        """Return the player for the first world's layout. If there is none, make one, and hide the layers.

        Layers show the layout, so they are wrong once physics moves the objects.
        """
        if self._player is None:
            self._player = Player(self.deck.compiled, self.table[:1])
            self._candidates = None
            self.panel.rejected.value, self.panel.arm.value = False, START
            self.panel.set_targets(self._player.data.ctrl)
            self.show()
        return self._player

    def _end_play(self) -> None:
        self._player = None
        self.panel.play.label = "Play"

    def _first_candidate(self) -> int:
        """Return the index of the rejected candidate to show first.

        If the scene has no valid layout, the error blames an object and a cause. The first candidate of this object
        that was rejected for this cause is then shown first.
        """
        error = self.loaded.error if self._ready else None
        blamed = (error.name, error.cause) if isinstance(error, InfeasibleSceneError) else None
        return next((i for i, c in enumerate(self._candidates or ()) if (c.name, c.cause) == blamed), 0)

    def _layout_id(self) -> str:
        return self.deck.compiled.layout_id(self.where.seed, self.where.episode, self.where.split)

    def _tell(self) -> None:
        """Write above the controls which layout is shown, or the error in the scene."""
        poses = poses_of_arm(ShownWorld(self.deck.compiled, self.table[:1]))
        self.panel.set_where(self.where, self._layout_id(), poses)
        self._tell_counts()
        if self._broken is not None:
            return self.panel.say(self._broken, bad=True)
        if self.loaded.error is not None:
            return self.panel.say(f"{self.loaded.error}\n\n{_TRIED}", bad=True)
        name, row = self.deck.compiled.config.name, self.table[:1]
        source = "a fresh layout" if row.valid[0] else "a layout from the bank, because no fresh layout was found"
        start = f", start {row.start[0]}" if self.deck.compiled.config.start else ""
        made = f"{name}: {source}{start}, {row.attempts[0]} candidates"
        if self.num > 1:
            last = (self.where.seed + self.num - 1) % 2**64
            made = f"{name}: {self.num} layouts, seeds {self.where.seed} to {last}"
        return self.panel.say(made, notices=self.loaded.notices)

    def _tell_counts(self) -> None:
        self.panel.table.content = why.table_in_html(self.deck.table(), self.deck.layouts, self.deck.valid)
