"""MuJoCo's own rules: which geoms collide, and from which distance on a contact acts."""

from __future__ import annotations

import mujoco
import numpy as np


class ContactRules:
    """Which geoms of a model collide, by contact class: geoms of one class meet the same others from the same distance.

    Explicit `<pair>`s come before contact bits, and have margins of their own. How excludes, parents and
    what never moves bear on them is in `program/pairs.py`.

    Args:
        mjm: The model.
        geometry: "physics"; or "visual", where what is seen collides and MuJoCo's rules do not apply.

    Attributes:
        classes: Contact class of each geom, shape (ngeom,).
    """

    def __init__(self, mjm: mujoco.MjModel, geometry: str) -> None:
        self._mjm, self._visual = mjm, geometry == "visual"
        self._paired: dict[frozenset[int], float] = {}
        # as lists, since single numbers of an array are slow, and scenes have a million pairs
        self._contype, self._conaffinity = mjm.geom_contype.tolist(), mjm.geom_conaffinity.tolist()
        self._margin, self._gap = mjm.geom_margin.tolist(), mjm.geom_gap.tolist()
        self._excluded = {int(signature) for signature in mjm.exclude_signature}
        self._meet: dict[tuple[int, int], bool] = {}
        self._distance: dict[tuple[int, int], float] = {}
        if self._visual:
            self.classes = np.zeros(mjm.ngeom, int)
            return
        for a, b, distance in zip(mjm.pair_geom1, mjm.pair_geom2, mjm.pair_margin, strict=True):
            self._paired[frozenset((int(a), int(b)))] = float(distance)
        inside = {geom for pair in self._paired for geom in pair}
        keys = [
            (geom,) if geom in inside else (-1, bits[0], bits[1], margin, gap)
            for geom, (bits, margin, gap) in enumerate(
                zip(
                    zip(self._contype, self._conaffinity, strict=True),
                    self._margin,
                    self._gap,
                    strict=True,
                )
            )
        ]
        first = {key: geom for geom, key in reversed(list(enumerate(keys)))}
        self.classes = np.array([first[key] for key in keys], int)

    def collides(self, geom: int) -> bool:
        """Whether a geom collides with anything at all."""
        bits = int(self._mjm.geom_contype[geom] | self._mjm.geom_conaffinity[geom])
        return bits != 0 or any(geom in pair for pair in self._paired)

    def is_explicit(self, a: int, b: int) -> bool:
        """Whether geoms of two classes are an explicit `<pair>`, to which excludes and parents are nothing."""
        return bool(self._paired) and frozenset((a, b)) in self._paired

    def excludes(self, body: int, other: int) -> bool:
        """Whether the model excludes the contacts of two bodies."""
        return bool(self._excluded) and (min(body, other) << 16) + max(body, other) in self._excluded

    def meet(self, a: int, b: int) -> bool:
        """Whether geoms of two classes collide: an explicit pair, or the contype of either meets the other's bits."""
        found = self._meet.get((a, b))
        if found is None:
            found = self._meet[a, b] = self._work_out_meet(a, b)
        return found

    def distance(self, a: int, b: int) -> float:
        """From which distance [m] on a contact of geoms of two classes acts: 0 without margins."""
        found = self._distance.get((a, b))
        if found is None:
            found = self._distance[a, b] = self._work_out_distance(a, b)
        return found

    def _work_out_meet(self, a: int, b: int) -> bool:
        if self._visual or self.is_explicit(a, b):
            return True
        contype, conaffinity = self._contype, self._conaffinity
        return bool(contype[a] & conaffinity[b] or contype[b] & conaffinity[a])

    def _work_out_distance(self, a: int, b: int) -> float:
        mjm = self._mjm
        if self._visual:
            return 0.0
        if mjm.opt.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE:
            return max(float(mjm.opt.o_margin), 0.0)
        if self.is_explicit(a, b):
            return max(self._paired[frozenset((a, b))], 0.0)
        return max(float(mjm.geom_margin[[a, b]].sum()), 0.0)
