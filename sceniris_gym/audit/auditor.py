"""`Auditor`: one report of all checks of layouts except reach and equalities.

Every pair of geoms gets one verdict. With `geometry: physics`, a contact in MuJoCo C is a missed collision if it is
more than 0.01 mm deeper than allowed. The report lists each allowed contact and says why it is allowed. FCL checks the
distances that MuJoCo does not report: clearances, and the distances of fixtures from each other and from the static
scene. With `geometry: visual`, FCL decides on the rendered meshes, and the report lists all contacts in MuJoCo C as
allowed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from sceniris_gym.audit import relations
from sceniris_gym.audit.collisions import CollisionAudit, Conflict, FalseAlarm, JudgedPairs, takes_part
from sceniris_gym.audit.contacts import ROUNDING, Allowed, Contact, ContactAudit, ContactTally
from sceniris_gym.audit.geometry import Poses, poses_of, solids_of, subtree
from sceniris_gym.audit.physics import FAST, STILL, limp_joints, settle
from sceniris_gym.audit.presence import excess_of_presence
from sceniris_gym.audit.reach import StartAudit
from sceniris_gym.audit.relations import Excess, Kept, count
from sceniris_gym.audit.scene import JudgedScene, Outlines
from sceniris_gym.audit.standing import HeapAudit, Misplaced, StandingAudit
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.progress import tell
from sceniris_gym.scene.layout_table import LayoutTable

CHUNK = 500  # rows judged at once, which bounds the memory for their poses


@dataclass(frozen=True)
class Report:
    """The findings of the audit.

    Attributes:
        layouts: Number of layouts that were judged.
        conflicts: Missed collisions: pairs of geoms that are too near in a layout. One entry per layout and pair.
        misplaced: Objects in a place that the scene file does not permit.
        penetration: The contact that exceeds its allowed depth most, or None.
        allowed: Pairs of bodies with allowed contacts.
        kept: In how many layouts each relation, orientation and group was checked, and in how many it was violated.
        settled: Number of layouts that were stepped.
        frozen: Names of joints without a position actuator. They were held still while stepping.
        moved: Object name -> number of layouts where the object moved more than 1 cm while settling.
        fast: Object name -> number of layouts where the object was faster than 1 m/s.
        top_speed: The largest speed of any free object [m/s].
        unstable: Kind of MuJoCo warning -> number of layouts whose rollout ended with such a warning, and the text of
            the first warning. `moved` and `fast` do not count these layouts.
    """

    layouts: int
    conflicts: list[Conflict]
    misplaced: list[Misplaced]
    penetration: Contact | None = None
    allowed: Allowed = field(default_factory=dict)
    kept: list[Kept] = field(default_factory=list)
    settled: int = 0
    frozen: tuple[str, ...] = ()
    moved: dict[str, int] = field(default_factory=dict)
    fast: dict[str, int] = field(default_factory=dict)
    top_speed: float = 0.0
    unstable: dict[str, tuple[int, str]] = field(default_factory=dict)

    @property
    def colliding(self) -> int:
        """Number of layouts with a missed collision."""
        return len({conflict.row for conflict in self.conflicts})

    @property
    def depth(self) -> float:
        """Greatest depth of a contact beyond its allowed depth [m]."""
        return self.penetration.excess if self.penetration is not None else 0.0

    @property
    def relation_violations(self) -> int:
        """Number of violations of relations, orientations and groups, over all layouts."""
        return sum(kept.broken for kept in self.kept)


class Auditor:
    """Judges layouts of one scene, and reports the progress.

    Args:
        mjm: The model.
        config: The scene.
        bodies: Object name -> root body id.

    Raises:
        NotSupportedError: A geom has a type that the audit does not support.
    """

    def __init__(self, mjm: mujoco.MjModel, config: SceneConfig, bodies: Mapping[str, int]) -> None:
        self.scene = scene = JudgedScene(mjm, config, bodies)
        placed = {name: part for name, part in config.parts.items() if part.kind in ("free", "fixture")}
        clearances = {name: part.clearance for name, part in {**placed, **config.all_robots}.items()}
        drawn = {name: bodies[name] for name, part in placed.items() if part.is_placed}
        jointed = {name for name, part in {**config.objects, **config.all_robots}.items() if part.joints}
        self.contacts, heaps = ContactAudit(scene.tree, drawn, scene.markers), HeapAudit(scene)
        self.heaped = heaps.may_touch()
        self.contacts.at_home |= self.heaped
        pairs = JudgedPairs(
            scene.tree, scene.solids, config.geometry, clearances, jointed, self.contacts.at_home, placed=drawn
        )
        self.collisions = CollisionAudit(scene.tree, scene.solids, pairs)
        self.outlines = Outlines(scene)
        self.standing = StandingAudit(scene, self.outlines, heaps, pairs)
        self.starts = StartAudit(scene, self.outlines)
        hulls = self.standing.hulls
        if config.geometry != "physics":  # objects rest on colliding geoms, even if visual geoms keep them apart
            hulls = scene.hulls(solids_of(mjm, "physics"))
        self.orientations = relations.OrientationAudit(scene, hulls)
        self.free = {name: bodies[name] for name, part in placed.items() if part.kind == "free"}
        self._to_stand = self._have_to_stand()

    def judge(self, table: LayoutTable, *, settled: int = 0) -> Report:
        """Check layouts. For absent objects, only groups, contacts and settling are checked.

        Args:
            table: The layouts.
            settled: To find objects that fall, the first `settled` layouts are also stepped for half a second. Layouts
                where a gripper holds an object in the air are skipped, because the gripper would open.
        """
        conflicts: list[Conflict] = []
        misplaced: list[Misplaced] = []
        excess = []
        tally = ContactTally(self.scene.mjm, self.scene.config.geometry, self.heaped)
        for start, some in table.chunks(CHUNK):
            poses, there = poses_of(self.scene.mjm, some), presence(self.scene.config, some)
            grasped, moved, sides = self.starts.grasped(some), self.starts.moved(some, there), {}
            found, supporting = self.standing.check(poses, there)
            found = [m for m in found if m.name not in moved or not moved[m.name][m.row]]
            nearer = {
                (c.row, c.geoms): replace(c, row=start + c.row)
                for c in self.collisions.missed(poses, supporting, there)
                if not self.starts.excuses(some, c, grasped)
            }
            contacts = self.contacts.contacts(some, supporting)
            for c in tally.add(start, self.starts.between(contacts, grasped, sides)):
                nearer.setdefault(
                    (c.row, c.geoms), Conflict(start + c.row, c.geoms, c.owners, -c.depth, -(c.home or 0.0))
                )
            conflicts += [nearer[key] for key in sorted(nearer)]
            found += self.starts.check(some, poses, there, sides)
            found = sorted((m for m in found if there[m.name][m.row]), key=lambda m: (m.row, m.name))
            misplaced += [replace(m, row=start + m.row) for m in found]
            excess.append(self.starts.excuse(self.excess(some, poses), moved))
            tell("layouts judged", start + len(some), len(table))
        report = Report(len(table), conflicts, misplaced, tally.deepest, tally.allowed(), count(excess))
        in_the_air = [i for i, kind in enumerate(self.scene.config.start) if kind.is_held]
        rows = np.flatnonzero(~np.isin(table.start[:settled], in_the_air))
        return self._settle(report, table[rows], rows)

    def _have_to_stand(self) -> list[str]:
        """Return the free objects that must not fall.

        A stack is left out if resets move its centre of mass: by a drawn `ipos`, or, in a stack of several bodies, by
        a drawn `mass`. A single object also counts as a stack.
        """
        objects = self.scene.config.objects
        stacks: dict[str, list[str]] = {}
        for name in self.free:
            stacks.setdefault(self._bottom(name), []).append(name)
        known = []
        for stack in stacks.values():
            words = {word for name in stack for word in objects[name].randomize}
            is_single = len(stack) == 1 and len(subtree(self.scene.mjm, self.free[stack[0]])) == 1
            if "ipos" not in words and (is_single or "mass" not in words):
                known += stack
        filling = {name for heap in self.scene.config.heaps.values() for name in heap.of}
        return [name for name in known if objects[name].has_to_stand and name not in filling]

    def _bottom(self, name: str) -> str:
        """Return the lowest free object of the stack that the free object `name` belongs to."""
        support = self.scene.config.objects[name].support
        below = self.scene.carrier(support.parent).owner if support is not None else None
        return self._bottom(below) if below in self.free else name

    def _settle(self, report: Report, table: LayoutTable, rows: np.ndarray) -> Report:
        """Step the layouts of a table, and return a copy of the report with the motion of free objects.

        `rows` (nrow,) has the index of each of these layouts among all layouts of the report.
        """
        if not len(table) or not self.free:
            return report
        mjm, owner, config = self.scene.mjm, self.scene.tree.owner, self.scene.config
        joints = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
        driven = mjm.actuator_trnid[np.isin(mjm.actuator_trntype, joints), 0]
        # names of the robots, and owners of actuated bodies that are not objects of the scene
        names = {*config.all_robots} | {owner[body] for body in mjm.jnt_bodyid[driven]} - {*config.objects}
        limp = limp_joints(mjm, {body for body, name in enumerate(owner) if name in names})
        motion = settle(mjm, self.free, table, frozen=limp)
        there = presence(config, table)
        falls = [
            Misplaced(int(row), name, "falls")
            for name, far in motion.moved.items()
            if name in self._to_stand
            for row in rows[there[name] & (far > STILL)]
        ]
        unstable: dict[str, tuple[int, str]] = {}
        for kind, text in motion.warnings.values():
            number, first = unstable.get(kind, (0, text))
            unstable[kind] = (number + 1, first)
        return replace(
            report,
            misplaced=sorted(report.misplaced + falls, key=lambda m: (m.row, m.name)),
            settled=len(table),
            frozen=tuple(mjm.joint(j).name or f"joint {j}" for j in limp),
            moved={name: int((d > STILL).sum()) for name, d in motion.moved.items()},
            fast={name: int((v > FAST).sum()) for name, v in motion.speed.items()},
            top_speed=float(max(v.max(initial=0.0, where=~np.isnan(v)) for v in motion.speed.values())),
            unstable=unstable,
        )

    def excess(self, table: LayoutTable, poses: Poses) -> Excess:
        """Measure only relations, orientations and groups.

        Args:
            table: The layouts.
            poses: Poses in the layouts.

        Returns:
            (name, requirement, unit) -> violation in each row, shape (nrow,). `name` is an object or a group, and the
            requirement is `Kept.word`. NaN in rows where the requirement does not apply.
        """
        seen = self.outlines.see(poses, presence(self.scene.config, table))
        found = relations.excess(self.scene, seen) | self.orientations.excess(seen)
        return found | excess_of_presence(self.scene.config, seen)

    def judge_rejected(self, table: LayoutTable, candidate: Sequence[str], order: Sequence[str]) -> list[FalseAlarm]:
        """Check candidates that were rejected for collision.

        Args:
            table: Layouts with the rejected object at its candidate pose.
            candidate: Name of the rejected object in each row.
            order: Names of the placed objects in placement order. Objects after the candidate are ignored.

        Returns:
            The candidates that keep all clearances and have only allowed contacts. Their rejection was a false alarm.
        """
        alarms = []
        names = np.asarray(candidate)
        rank = {name: i for i, name in enumerate(order)}
        for start, some in table.chunks(CHUNK):
            poses, mine = poses_of(self.scene.mjm, some), names[start : start + len(some)]
            there = presence(self.scene.config, some)
            _, supporting = self.standing.check(poses, there)
            found = self.collisions.false_alarms(poses, supporting, mine, rank, there)
            if found and self.scene.config.geometry == "physics":
                rows = np.array([a.row for a in found])
                carrying = {name: bodies[rows] for name, bodies in supporting.items()}
                hit = {
                    int(rows[c.row])
                    for c in self.contacts.contacts(some[rows], carrying)
                    if c.excess > (0.0 if c.home is None else ROUNDING)
                    and takes_part(c.owners, mine[rows[[c.row]]], rank).all()
                }
                found = [a for a in found if a.row not in hit]
            alarms += [replace(a, row=start + a.row) for a in found]
            tell("candidates judged", start + len(some), len(table))
        return alarms


def presence(config: SceneConfig, table: LayoutTable) -> dict[str, np.ndarray]:
    """Return object or robot -> mask of the rows where it is present, shape (nrow,).

    An object with variants is present if one of its variants is.
    """
    names = [*config.objects, *config.all_robots]
    found = {name: table.present[:, i].astype(bool) for i, name in enumerate(names)}
    return found | {name: np.any([found[m] for m in members], axis=0) for name, members in config.variants.items()}
