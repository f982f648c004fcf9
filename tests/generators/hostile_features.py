"""Features of hostile models, each with the share of models that get it."""

from __future__ import annotations

import zlib

import numpy as np

FEATURES: dict[str, float] = {
    # bodies and joints
    "nested": 0.7,  # objects with bodies below their root
    "several_joints": 0.3,  # two or three joints on one of these bodies
    "ball_joint": 0.2,
    "slide": 0.5,
    "loose": 0.3,  # free bodies that the scene does not name
    "jointed_obstacle": 0.3,  # chains that the scene does not name
    "many": 0.04,  # 520 to 700 bodies: more start pairs than the stack of the collision test holds
    "crowd": 0.06,  # 60 to 110 bodies
    "tiny": 0.07,  # things of 1 to 10 mm
    "huge": 0.07,  # things of up to 50 m
    "gravcomp": 0.1,
    "armature": 0.2,
    "springs": 0.2,
    # geoms
    "plane": 0.25,  # level and tilted planes that the scene does not name
    "sphere": 0.5,
    "box": 0.7,
    "capsule": 0.5,
    "ellipsoid": 0.4,
    "cylinder": 0.5,
    "hull": 0.4,  # convex meshes from inline vertices
    "mesh": 0.3,  # L-shaped meshes with inline faces
    "flex": 0.012,
    "hfield": 0.012,
    # who collides
    "pair": 0.15,
    "pair_margin": 0.06,
    "exclude": 0.2,
    "bits": 0.4,
    "margin": 0.2,
    "gap": 0.5,  # with a margin above it
    "filterparent": 0.06,
    "contact_off": 0.02,
    "constraint_off": 0.02,
    "midphase_off": 0.08,
    "home_touch": 0.1,  # doors that overlap by 0.2 mm at home, both drawn
    "touching_inside": 1.0,  # not drawn, but found: an object with drawn joints touches itself at home
    # couplings
    "weld": 0.15,  # what holds at home and is not drawn
    "connect": 0.15,
    "inactive": 0.08,  # an equality between placed objects that is switched off
    "weld_placed": 0.012,
    "connect_placed": 0.012,
    "joint_equality": 0.2,
    "constant_equality": 0.08,
    "fixed_tendon": 0.1,
    "tendon_limit": 0.06,
    "tendon_equality": 0.04,
    "spatial_tendon": 0.1,  # that pulls at nothing, within an object or across
    "spatial_limit": 0.012,  # that ties a placed object to the world
    # mocap bodies, keyframes, robots
    "mocap": 0.15,
    "mocap_weld": 0.06,
    "keyframe": 0.4,
    "key_mocap": 0.1,
    "robot": 0.15,
    "free_base_robot": 0.06,
    "mimic": 0.05,  # a robot whose fingers follow each other, and are drawn
    "held_arm": 0.12,  # a static object of the model, held by position actuators
    "base_touch": 0.06,  # an arm whose first link overlaps its base by 0.2 mm at home
    "asset": 0.08,  # a shipped asset between the model's own bodies
    # actuators
    "motor": 0.2,
    "position": 0.25,
    "velocity": 0.1,
    "intvelocity": 0.1,
    "damper": 0.1,
    "cylinder_actuator": 0.08,
    "muscle": 0.08,
    "general": 0.1,
    "filtered": 0.08,  # a position actuator behind a filter
    "delay": 0.08,  # a position actuator with a history
    "tendon_actuator": 0.3,
    "adhesion": 0.04,
    # how the scene uses the model
    "table": 0.4,
    "stacked": 0.15,
    "region_3d": 0.3,
    "fixture": 0.3,
    "marker": 0.1,
    "drawn": 0.6,
    "drawn_static": 0.5,
    "stable": 0.2,
    "any": 0.2,
    "clearance": 0.2,
}
"""Share of the models for which a feature is drawn. Some features need others, and occur somewhat less often."""


def wanted_features(seed: int) -> set[str]:
    """Draw the features of a model, each from a stream of its own: a new feature leaves the others as they are."""
    found = {name for name, share in FEATURES.items() if stream(seed, name).random() < share}
    for one, other in (("tiny", "huge"), ("many", "crowd"), ("many", "huge"), ("crowd", "huge"), ("many", "tiny")):
        if one in found:
            found.discard(other)
    found -= {"stable"} if found & {"tiny", "huge"} else set()  # a centimetre says nothing of their rest
    found -= {"mocap_weld"} if "key_mocap" in found else set()  # it would be violated at home
    if "mimic" in found and "free_base_robot" not in found:
        found.add("robot")
    if "held_arm" in found:
        found.add("position")
    return found | {"box", "capsule"}


def stream(seed: int, name: str) -> np.random.Generator:
    """Random numbers for one purpose in the making of one model."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
