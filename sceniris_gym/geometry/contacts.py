"""MuJoCo's contact rules: which pairs of geoms collide, and at which distance their contact acts."""

from functools import cache

import mujoco
import numpy as np


class ContactRules:
    """The contact rules of a model, by contact class.

    Geoms of the same contact class collide with the same other geoms, and at the same distances. Explicit `<pair>`s
    take precedence over contact bits, and have separate margins. `PairRules` in `program/pack/pairs.py` combines these
    rules with MuJoCo's rules for excluded bodies, parent and child bodies, and static geoms.

    Args:
        mjm: The model.
        geometry: "physics" or "visual". With "visual", all visible geoms collide and MuJoCo's rules do not apply.

    Attributes:
        classes: Contact class of each geom, shape (ngeom,).
        meet: Function of two classes. Returns whether their geoms collide, because of an explicit pair or because their
            contact bits match.
        distance: Function of two classes. Returns the distance [m] below which their geoms are in contact. 0 if they
            have no margin.
    """

    def __init__(self, mjm: mujoco.MjModel, geometry: str) -> None:
        self._mjm, self._visual = mjm, geometry == "visual"
        self._paired: dict[frozenset[int], float] = {}
        self._excluded = {int(signature) for signature in mjm.exclude_signature}
        # cached, because a scene can have a million pairs
        self.meet, self.distance = cache(self._work_out_meet), cache(self._work_out_distance)
        if self._visual:
            self.classes = np.zeros(mjm.ngeom, int)
            return
        for a, b, distance in zip(mjm.pair_geom1, mjm.pair_geom2, mjm.pair_margin, strict=True):
            self._paired[frozenset((int(a), int(b)))] = float(distance)
        inside = {geom for pair in self._paired for geom in pair}
        rules = np.stack([mjm.geom_contype, mjm.geom_conaffinity, mjm.geom_margin, mjm.geom_gap], axis=1).tolist()
        keys = ((geom,) if geom in inside else tuple(rule) for geom, rule in enumerate(rules))
        first: dict[tuple, int] = {}
        self.classes = np.array([first.setdefault(key, geom) for geom, key in enumerate(keys)], int)

    def collides(self, geom: int) -> bool:
        """Return whether a geom can collide with some other geom: it has contact bits or is in a `<pair>`."""
        bits = int(self._mjm.geom_contype[geom] | self._mjm.geom_conaffinity[geom])
        return bits != 0 or any(geom in pair for pair in self._paired)

    def is_explicit(self, a: int, b: int) -> bool:
        """Return whether the geoms of two classes form a `<pair>`. MuJoCo never filters such a pair by its bodies."""
        return bool(self._paired) and frozenset((a, b)) in self._paired

    def excludes(self, body: int, other: int) -> bool:
        """Return whether the model excludes the contacts of two bodies."""
        return bool(self._excluded) and (min(body, other) << 16) + max(body, other) in self._excluded

    def may_touch(self, a: int, b: int, body: int, other: int) -> bool:
        """Return whether geoms of two classes collide on two bodies. An explicit pair also collides if excluded."""
        return self.meet(a, b) and (self.is_explicit(a, b) or not self.excludes(body, other))

    def is_parent(self, body: int, other: int) -> bool:
        """Return whether MuJoCo ignores contacts of two bodies because one moves the other. The world moves nothing."""
        weld, parent = self._mjm.body_weldid, self._mjm.body_parentid
        first, second = weld[[body, other]]
        moves = (first != 0 and first == weld[parent[second]]) or (second != 0 and second == weld[parent[first]])
        return bool(moves) and not self._mjm.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT

    def _work_out_meet(self, a: int, b: int) -> bool:
        if self._visual or self.is_explicit(a, b):
            return True
        contype, conaffinity = self._mjm.geom_contype, self._mjm.geom_conaffinity
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
