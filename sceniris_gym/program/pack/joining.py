"""Objects that are joined at sites: the sites relative to the pivots, and the turn that they imply."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sceniris_gym.config.relations import Joined
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.program.plan import PlacedObject, Plan

# An x axis of a site with a shorter horizontal part gives no heading.
_UPRIGHT = 1e-2


@dataclass(frozen=True)
class JoinedSites:
    """The sites at which one object is joined to another, seen from above and with both headings 0.

    Attributes:
        to: The other object.
        at: Position at which the sites meet, from the pivot of the other object [m], shape (2,): that of its site,
            moved by the gap along the x axis of the site.
        own: Position of the object's own site from its pivot [m], shape (2,).
        turn: The angle that is added to the heading of the other object to get that of this one [rad].
    """

    to: str
    at: np.ndarray
    own: np.ndarray
    turn: float


def joined_sites(plan: Plan, name: str, relation: Joined, where: str) -> JoinedSites:
    """Return how an object is joined.

    Args:
        plan: The plan.
        name: The object.
        relation: Its relation to the other object.
        where: The relation's key, with which errors begin.

    Raises:
        UnknownNameError: An object has no such site.
        SceneKeyError: Joints of the object move a site, its x axis is vertical, or the object is not placed upright.
    """
    words = relation.beside
    its, its_yaw = _site(plan, words.of, words.its, f"{where}.beside.its")
    own, own_yaw = _site(plan, name, words.my, f"{where}.beside.my")
    at = its + (relation.gap or 0.0) * np.array([math.cos(its_yaw), math.sin(its_yaw)])
    turn = math.remainder(its_yaw + math.radians(words.turn) - own_yaw, 2.0 * math.pi)
    return JoinedSites(words.of, at, own, turn)


def _site(plan: Plan, name: str, word: str, where: str) -> tuple[np.ndarray, float]:
    """Return a site's position from the pivot [m] and the heading of its x axis [rad], for the object at heading 0."""
    scene, sites = plan.scene, plan.scene.sites(name)
    if word not in sites:
        raise UnknownNameError(f"site of '{name}'", word, where, sites)
    root, body = scene.bodies[name], int(scene.mjm.site_bodyid[sites[word]])
    while body != root:
        if scene.mjm.body_jntnum[body]:
            raise SceneKeyError(
                f"{where}: '{word}' is on '{scene.mjm.body(body).name}', which joints move. Name a site that is fixed "
                f"to the root of '{name}'."
            )
        body = int(scene.mjm.body_parentid[body])
    placed = next((o for o in plan.objects if o.name == name and o.variants), None)
    mat, pivot = _upright(placed, where) if placed is not None else _at_home(plan, name)
    back = plan.scene.home.xmat[root].reshape(3, 3).T
    pos = back @ (plan.scene.home.site_xpos[sites[word]] - plan.scene.home.xpos[root])
    x = mat @ back @ plan.scene.home.site_xmat[sites[word]].reshape(3, 3)[:, 0]
    if np.linalg.norm(x[:2]) < _UPRIGHT:
        raise SceneKeyError(
            f"{where}: the x axis of '{word}' is vertical, so it gives no heading. Turn it out of '{name}', "
            "towards what is joined to it."
        )
    return (mat @ (pos - pivot))[:2], math.atan2(x[1], x[0])


def _upright(placed: PlacedObject, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the orientation (3, 3) of a placed object at heading 0, and its pivot in its root's frame [m]."""
    if placed.orientation in ("any", "stable"):
        raise SceneKeyError(
            f"{where}: '{placed.name}' has the orientation '{placed.orientation}', which moves its site. Give it a "
            "yaw, or 'fixed'."
        )
    return matrix(placed.variants[0].quat), placed.variants[0].pivot


def _at_home(plan: Plan, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the same for an object that keeps its pose in the model."""
    root, place = plan.scene.bodies[name], plan.place[plan.slots.index(name)]
    mat = plan.scene.home.xmat[root].reshape(3, 3)
    level = matrix(np.array([math.cos(0.5 * place[3]), 0.0, 0.0, -math.sin(0.5 * place[3])])) @ mat
    return level, mat.T @ (place[:3] - plan.scene.home.xpos[root])
