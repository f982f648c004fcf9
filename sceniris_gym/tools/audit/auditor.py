"""`Auditor`: all checks of layouts except reach, as one report."""

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
    """The findings of the audit.

    Attributes:
        layouts: Number of layouts that were judged.
        conflicts: Missed collisions, one entry per pair of geoms.
        misplaced: Objects that do not stand where the scene says.
        penetration: The deepest contact that MuJoCo C finds.
        kept: How well every relation, orientation and group is kept.
        settled: Number of layouts that were stepped.
        moved: Object name -> number of layouts in which it moved more than 1 cm while settling.
        fast: Object name -> number of layouts in which it was faster than 1 m/s.
        top_speed: The largest speed of any free object [m/s].
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
        mjm: The model.
        config: The scene.
        bodies: Object name -> root body id.

    Raises:
        NotSupportedError: A geom has a type that the audit does not know.
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
        if config.geometry != "physics":  # visual geoms keep objects apart, colliding ones carry them
            names = self.standing.placed
            hulls = hulls_of(self.tree, solids_of(mjm, "physics"), {n: bodies[n] for n in names}, pose_of(home))
        self.language = LanguageAudit(config, outlines, hulls, home)
        self.config = config
        self.free = {name: bodies[name] for name, part in placed.items() if part.kind == "free"}

    def judge(self, table: LayoutTable, *, settled: int = 0) -> Report:
        """Check layouts. Of absent objects only their groups, penetration and settling are checked.

        Args:
            table: The layouts.
            settled: Number of layouts, from the first on, that are also stepped for half a second.
        """
        conflicts: list[Conflict] = []
        misplaced: list[Misplaced] = []
        kept: list[Kept] = []
        for start, some in table.chunks(CHUNK):
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
        penetration = deepest(self.tree, table)
        some = table[slice(0, settled)]
        if not len(some) or not self.free:
            return Report(len(table), conflicts, misplaced, penetration, kept)
        motion = settle(self.mjm, self.free, some)
        return Report(
            len(table),
            conflicts,
            misplaced,
            penetration,
            kept,
            settled=len(some),
            moved={name: int((d > STILL).sum()) for name, d in motion.moved.items()},
            fast={name: int((v > FAST).sum()) for name, v in motion.speed.items()},
            top_speed=float(max(v.max() for v in motion.speed.values())),
        )

    def judge_language(self, table: LayoutTable) -> list[Kept]:
        """Check only relations, orientations and groups, which is fast."""
        kept: list[Kept] = []
        for start, some in table.chunks(CHUNK):
            kept = self.language.add(kept, start, poses_of(self.mjm, some), presence(self.config, some))
        return kept

    def judge_rejected(self, table: LayoutTable, candidate: Sequence[str], order: Sequence[str]) -> list[FalseAlarm]:
        """Check candidates that were rejected for collision.

        Args:
            table: Layouts in which the rejected object stands at its candidate pose.
            candidate: Name of the rejected object of each row.
            order: Names of the placed objects in placement order; those after the candidate are not there yet.

        Returns:
            The candidates that keep their clearance from everything.
        """
        alarms = []
        names = np.asarray(candidate)
        for start, some in table.chunks(CHUNK):
            poses = poses_of(self.mjm, some)
            _, supporting = self.standing.check(poses)
            found = self.collisions.false_alarms(poses, supporting, names[start : start + len(some)].tolist(), order)
            alarms += [FalseAlarm(start + a.row, a.owners, a.surplus) for a in found]
        return alarms
