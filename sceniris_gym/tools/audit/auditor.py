"""All checks of layouts together, as one report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.tools.audit.collisions import CollisionAudit, Conflict, FalseAlarm
from sceniris_gym.tools.audit.geometry import home_of, pose_of, poses_of, solids_of
from sceniris_gym.tools.audit.language import Kept, LanguageAudit
from sceniris_gym.tools.audit.outlines import Outlines
from sceniris_gym.tools.audit.pairs import Tree
from sceniris_gym.tools.audit.physics import FAST, STILL, Penetration, deepest, settle
from sceniris_gym.tools.audit.presence import presence
from sceniris_gym.tools.audit.standing import Misplaced, StandingAudit, hulls_of

CHUNK = 500  # rows whose poses are held at once


@dataclass(frozen=True)
class Report:
    """What the audit found.

    Attributes:
        layouts: how many layouts were judged.
        conflicts: missed collisions, one entry per pair of geoms.
        misplaced: objects that do not stand where the scene says.
        penetration: the deepest contact of MuJoCo C.
        kept: how well every relation, orientation and group is kept.
        settled: how many layouts were stepped.
        moved: object name -> number of layouts in which it moved more than 1 cm while settling.
        fast: object name -> number of layouts in which it was faster than 1 m/s.
        top_speed: the largest speed of any free object [m/s].
    """

    layouts: int
    conflicts: list[Conflict]
    misplaced: list[Misplaced]
    penetration: Penetration
    kept: list[Kept] = field(default_factory=list)
    settled: int = 0
    moved: dict[str, int] = field(default_factory=dict)
    fast: dict[str, int] = field(default_factory=dict)
    top_speed: float = 0.0

    @property
    def colliding(self) -> int:
        """Number of layouts with a missed collision."""
        return len({conflict.row for conflict in self.conflicts})

    @property
    def relation_violations(self) -> int:
        """Number of relations, orientations and groups that are not kept, over all layouts."""
        return sum(kept.broken for kept in self.kept)


class Auditor:
    """Judges layouts of one scene.

    Args:
        mjm: the model.
        config: the scene.
        bodies: object name -> root body id.

    Raises:
        NotSupportedError: a geom of a type that has no solid here.
    """

    def __init__(self, mjm: mujoco.MjModel, config: SceneConfig, bodies: Mapping[str, int]) -> None:
        self.mjm = mjm
        self.tree = Tree(mjm, bodies)
        markers = {name for name, part in config.objects.items() if part.kind == "marker"}
        solids = [
            solid
            for solid in solids_of(mjm, config.geometry)
            if self.tree.owner[mjm.geom_bodyid[solid.geom]] not in markers
        ]
        placed = {name: part for name, part in config.objects.items() if part.kind in ("free", "fixture")}
        clearances = {name: part.clearance for name, part in placed.items()}
        self.collisions = CollisionAudit(self.tree, solids, config.geometry, clearances)
        home = home_of(mjm)
        outlines = Outlines(self.tree, solids, config, bodies, pose_of(home))
        self.standing = StandingAudit(self.tree, solids, config, outlines, pose_of(home))
        self.outlines = outlines
        hulls = self.standing.hulls
        if config.geometry != "physics":  # what keeps apart is seen, and what carries collides
            names = self.standing.placed
            hulls = hulls_of(self.tree, solids_of(mjm, "physics"), {n: bodies[n] for n in names}, pose_of(home))
        self.language = LanguageAudit(config, outlines, hulls, home)
        self.config = config
        self.free = {name: bodies[name] for name, part in placed.items() if part.kind == "free"}

    def judge(self, rows: LayoutTable, *, settled: int = 0) -> Report:
        """Check layouts. Absent objects are judged by their groups alone, and by what MuJoCo makes of them.

        Args:
            rows: the layouts.
            settled: how many of them, from the first one on, are stepped for half a second as well.
        """
        conflicts: list[Conflict] = []
        misplaced: list[Misplaced] = []
        kept: list[Kept] = []
        for start, some in rows.chunks(CHUNK):
            poses = poses_of(self.mjm, some)
            there = presence(self.config, some)
            found, supporting = self.standing.check(poses)
            misplaced += [Misplaced(start + m.row, m.name, m.cause) for m in found if there[m.name][m.row]]
            conflicts += [
                Conflict(start + c.row, c.geoms, c.owners, c.distance, c.clearance)
                for c in self.collisions.missed(poses, supporting)
                if all(there[owner][c.row] for owner in c.owners if owner in there)
            ]
            kept = self.language.add(kept, start, poses, there)
        penetration = deepest(self.tree, rows)
        some = rows[slice(0, settled)]
        if not len(some) or not self.free:
            return Report(len(rows), conflicts, misplaced, penetration, kept)
        motion = settle(self.mjm, self.free, some)
        return Report(
            len(rows),
            conflicts,
            misplaced,
            penetration,
            kept,
            settled=len(some),
            moved={name: int((d > STILL).sum()) for name, d in motion.moved.items()},
            fast={name: int((v > FAST).sum()) for name, v in motion.speed.items()},
            top_speed=float(max(v.max() for v in motion.speed.values())),
        )

    def judge_language(self, rows: LayoutTable) -> list[Kept]:
        """Check relations, orientations and groups alone, which is quick."""
        kept: list[Kept] = []
        for start, some in rows.chunks(CHUNK):
            kept = self.language.add(kept, start, poses_of(self.mjm, some), presence(self.config, some))
        return kept

    def judge_rejected(self, rows: LayoutTable, candidate: Sequence[str], order: Sequence[str]) -> list[FalseAlarm]:
        """Check candidates that were rejected for collision.

        Args:
            rows: layouts in which the rejected object stands at its candidate pose.
            candidate: name of the rejected object of each row.
            order: names of the placed objects, in the order they are placed; later ones are not there yet.

        Returns:
            The candidates that keep their clearance from everything.
        """
        alarms = []
        names = np.asarray(candidate)
        for start, some in rows.chunks(CHUNK):
            poses = poses_of(self.mjm, some)
            _, supporting = self.standing.check(poses)
            found = self.collisions.false_alarms(poses, supporting, names[start : start + len(some)].tolist(), order)
            alarms += [FalseAlarm(start + a.row, a.owners, a.surplus) for a in found]
        return alarms
