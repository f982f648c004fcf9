"""`PlacedObject`: one step of the placement program, with all that is drawn for it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.resting_poses import Variant
from sceniris_gym.geometry.supports import SupportSurface
from sceniris_gym.program.device import Cover, ObjectKind
from sceniris_gym.scene.couplings import Coupling
from sceniris_gym.scene.heaps import HeapPoses
from sceniris_gym.scene.support import Support

_COVERS = {"in": Cover.EITHER, "on": Cover.OPEN, "inside": Cover.COVERED}


@dataclass(frozen=True)
class JointRange:
    """The positions that a joint is drawn from: uniform in [low, high], or one of `choice` if there are any [m or rad].

    `qposadr` is the joint's address in qpos.
    """

    qposadr: int
    low: float
    high: float
    choice: tuple[float, ...] = ()

    @property
    def intervals(self) -> list[tuple[float, float]]:
        """The intervals that the joint is drawn from."""
        return [(value, value) for value in self.choice] or [(self.low, self.high)]


@dataclass(frozen=True)
class PlacedObject:
    """One step of the placement program: an object, or a robot whose base or joints are drawn.

    Attributes:
        name: The object's name, or the robot's.
        stream: Its random stream, from its place in the scene file.
        kind: How its pose is written; STATIC if only joint positions are drawn.
        bodies: Its bodies, the root first, parents before children.
        config: Its words in the scene file; of a robot whose base is not drawn those of a static object.
        joint_ranges: How its joints are drawn.
        followers: Couplings of joints that follow drawn ones, drivers before their followers.
        footprint: With `ratio_on_support` 1, the hull of all its pieces, which must lie on the support as a whole; with
            a single piece, or where joints are drawn, None, as each piece is its own footprint.
        variants: Poses that its orientation is drawn from; empty for STATIC.
        support: The support that carries it; None in a box in space or for STATIC.
        tilts: Whether the support may lean in the states that are drawn.
        surfaces: The surfaces that it may stand on with their regions, a list for each variant. In space these are the
            points, or the box seen from above if it has relations. Variants with equal regions share one list.
        erosion: Distance that its pivot keeps from the outlines, as a share of the shorter edge of the drawn bounds,
            where that edge varies within a variant; else 0, as the regions are eroded already.
        heap: The settled poses that it is drawn from, if it is part of a heap.
    """

    name: str
    stream: int
    kind: ObjectKind
    bodies: list[int]
    config: ObjectConfig
    joint_ranges: list[JointRange] = field(default_factory=list)
    followers: tuple[Coupling, ...] = ()
    footprint: Piece | None = None
    variants: list[Variant] = field(default_factory=list)
    support: Support | None = None
    tilts: bool = False
    surfaces: list[list[SupportSurface]] = field(default_factory=list)
    erosion: float = 0.0
    heap: HeapPoses | None = None

    @property
    def spans(self) -> dict[int, tuple[float, float]]:
        """The least and greatest position of each drawn joint and follower, by its address in qpos [m or rad]."""
        parts = {d.qposadr: d.intervals for d in self.joint_ranges}
        for c in self.followers:
            parts[c.adr] = [c.over(*part) for part in parts[c.driver_adr]]
        return {adr: (float(np.min(ends)), float(np.max(ends))) for adr, ends in parts.items()}

    @property
    def ground(self) -> int | None:
        """The body that carries it; None in a box in space or for STATIC."""
        return None if self.support is None else self.support.body

    @property
    def corners(self) -> np.ndarray:
        """The corners [m] of upright boxes around its regions, in the frame of its ground, shape (n, 3)."""
        boxes = [(s.region.bounds, s.height) for surfaces in self.surfaces for s in surfaces]
        return np.array([[x, y, z] for ends, z in boxes for x in ends[::2] for y in ends[1::2]])

    @property
    def orientation(self) -> str:
        """The kind of its orientation; "yaw" for a robot whose base is not drawn."""
        return self.config.drawn_orientation.kind

    @property
    def cover(self) -> Cover:
        """The cover that is required above the point that it is placed on.

        Static geometry that belongs to no object, such as the world with its walls and ceilings, counts as open
        wherever there is room.
        """
        if self.support is None or self.support.is_floor:
            return Cover.EITHER
        assert self.config.support is not None
        cover = _COVERS[self.config.support.word]
        return Cover.EITHER if cover == Cover.OPEN and self.support.owner is None else cover
