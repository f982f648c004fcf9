"""The bodies of the tree that all variants of an object share in the simulation."""

from collections.abc import Mapping, Sequence
from itertools import combinations, count
from typing import NamedTuple

import mujoco
import numpy as np

MOST_LEVELS = 2
"""Most levels of bodies below the root of a variant."""
_NAMES = {None: "fixed", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide", int(mujoco.mjtJoint.mjJNT_HINGE): "hinge"}


class SharedPart(NamedTuple):
    """A body of a shared tree.

    Attributes:
        label: Its name, without the name of the object: '' for the root, 'slide_0' or 'hinge_1/slide_0' for others.
        parent: Number of its parent in the list of parts, -1 for the root.
        bodies: For each variant, the body that it simulates, or -1 if the variant has no such body.
    """

    label: str
    parent: int
    bodies: tuple[int, ...]

    def name_of(self, owner: str) -> str:
        """Return the name of the body that the variants of an object share."""
        return f"{owner}/{self.label}" if self.label else owner


def shared_parts(mjm: mujoco.MjModel, roots: Sequence[int], named: Mapping[int, str]) -> list[SharedPart]:
    """Match the bodies of variants, parents before their children.

    Below each part, bodies with the same kind of joint are matched: first by their names in `named`, then in their
    order. So without names, the first drawer of a variant and the first drawer of any other variant are the same part.

    Args:
        mjm: The model with all variants.
        roots: The root bodies of the variants of one object.
        named: Body -> the name that the scene file gives to it in `parts`.
    """
    parts, unused = [SharedPart("", -1, tuple(roots))], [-1] * len(roots)
    for number, part in enumerate(parts):  # grows while it is read
        levels = [[(_label(mjm, i), named.get(i), i) for i in _children(mjm, body)] for body in part.bodies]
        names = list(dict.fromkeys((label, name) for level in levels for label, name, _ in level if name is not None))
        below: dict[tuple[str, int], list[int]] = {}
        for variant, level in enumerate(levels):
            for label, name, child in sorted(level, key=lambda each: each[1] is None):
                same = [one for kind, one in names if kind == label]
                free = (i for i in count() if below.get((label, i), unused)[variant] < 0)
                place = next(free) if name is None else same.index(name)
                below.setdefault((label, place), [-1] * len(roots))[variant] = child
        for label, place in _in_order(below):
            name, bodies = f"{label}_{place}", below[label, place]
            parts.append(SharedPart(f"{part.label}/{name}" if part.label else name, number, tuple(bodies)))
    return parts


def _in_order(below: Mapping[tuple[str, int], Sequence[int]]) -> list[tuple[str, int]]:
    """Return the keys of matched bodies in the order that the bodies have in each variant, if these orders agree.

    Sums over bodies, such as a centre of mass, then have the same bits as in the variant's own model.
    """
    before = {
        (first, second)
        for variant in zip(*below.values(), strict=True)
        for (body, first), (_, second) in combinations(sorted(zip(variant, below, strict=True)), 2)
        if body >= 0
    }
    left, ordered = [*below], list[tuple[str, int]]()
    while left:
        following = next((key for key in left if not any((other, key) in before for other in left)), None)
        if following is None:
            return [*below]
        left.remove(following)
        ordered.append(following)
    return ordered


def misfit(mjm: mujoco.MjModel, root: int) -> str | None:
    """Return why the bodies below the root of a variant cannot be parts of a shared tree, or None if they can."""
    level = [root]
    for depth in range(MOST_LEVELS + 1):
        level = [child for body in level for child in _children(mjm, body)]
        for body in level:
            joints = np.arange(mjm.body_jntadr[body], mjm.body_jntadr[body] + mjm.body_jntnum[body])
            if len(joints) > 1 or not {*mjm.jnt_type[joints].tolist()} <= {*_NAMES}:
                return f"body '{mjm.body(body).name}' should have one slide, one hinge or no joint"
            if depth == MOST_LEVELS:
                return f"body '{mjm.body(body).name}' is more than {MOST_LEVELS} levels below the root"
    return None


def _children(mjm: mujoco.MjModel, body: int) -> list[int]:
    return np.flatnonzero((mjm.body_parentid == body) & (np.arange(mjm.nbody) > 0)).tolist() if body >= 0 else []


def _label(mjm: mujoco.MjModel, body: int) -> str:
    """Return the class of a body: its kind of joint, and what mujoco_warp stores once for all worlds."""
    if mjm.body_jntnum[body] == 0:
        return _NAMES[None]
    joint = mjm.body_jntadr[body]
    free, force, compensated = not mjm.jnt_limited[joint], mjm.jnt_actfrclimited[joint], mjm.jnt_actgravcomp[joint]
    traits = [word for word, holds in (("free", free), ("weak", force), ("light", compensated)) if holds]
    return "_".join([*traits, _NAMES[int(mjm.jnt_type[joint])]])
