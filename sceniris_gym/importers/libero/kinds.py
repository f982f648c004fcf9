"""LIBERO's classes of objects and fixtures: sizes, headings, and the positions of joints that are open or on.

Headings match the poses that LIBERO's samplers produce. For some classes, LIBERO's samplers write a quaternion in
another component order than MuJoCo reads. If such a sampler draws an angle a about an object's x axis, the object
stands upright with the heading 180 degrees - a. The initial states in LIBERO's data set show the same headings. Sizes
and positions were measured on LIBERO's models.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from sceniris_gym.errors import check_names
from sceniris_gym.importers.libero.problem import Predicate, Problem

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class Kind:
    """A class of objects or fixtures.

    Attributes:
        size: Edges of the bounding box of the upright object [m]: length along its x axis, width, and height.
        yaw: Least and greatest heading [degrees] of an object. A fixture takes its heading from its region.
        up: The axis of LIBERO's model that points up.
        states: Start predicate, such as 'Open' -> range of joint positions [m or rad].
    """

    size: Vec3
    yaw: tuple[float, float] = (180.0, 180.0)
    up: str = "z"
    states: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Workspace:
    """A work surface of LIBERO. All coordinates are in the world frame [m].

    Attributes:
        origin: Origin for the rectangles of problem files.
        low, high: Opposite corners of the surface in x and y.
        top: Height of the surface.
        base: Position of the base of LIBERO's arm.
    """

    origin: Vec3
    low: tuple[float, float]
    high: tuple[float, float]
    top: float
    base: Vec3


WORKSPACES = {
    "kitchen_table": Workspace((0.0, 0.0, 0.9), (-0.5, -0.6), (0.5, 0.6), 0.9, (-0.66, 0.0, 0.912)),
    "table": Workspace((0.0, 0.0, 0.9), (-0.5, -0.6), (0.5, 0.6), 0.9, (-0.66, 0.0, 0.912)),
    "study_table": Workspace((-0.2, 0.0, 0.867), (-0.69, -1.39), (0.69, 1.39), 0.885, (-0.75, 0.0, 0.912)),
    "living_room_table": Workspace((0.0, 0.0, 0.41), (-0.82, -0.62), (0.34, 0.72), 0.437, (-0.51, 0.0, 0.42)),
    "floor": Workspace((0.0, 0.0, -0.035), (-1.5, -1.5), (1.5, 1.5), 0.0, (-0.6, 0.0, 0.0)),
}
"""Work surfaces by class. 'floor' is the ground workspace."""

_BACK, _ACROSS, _MUG, _BOOK = (180.0, 180.0), (90.0, 90.0), (-90.0, -90.0), (-135.0, -90.0)


_CABINET = Kind((0.254, 0.221, 0.218), states={"Open": (-0.16, -0.14), "Close": (0.0, 0.005)})
FIXTURES = {
    "wooden_cabinet": _CABINET,
    "white_cabinet": _CABINET,
    "microwave": Kind((0.345, 0.225, 0.187), states={"Open": (-2.094, -1.3), "Close": (-0.005, 0.0)}),
    "flat_stove": Kind((0.285, 0.19, 0.045), states={"Turnon": (0.5, 2.1), "Turnoff": (-0.005, 0.0)}),
    "wine_rack": Kind((0.268, 0.253, 0.217)),
    "desk_caddy": Kind((0.137, 0.423, 0.167)),
    "wooden_two_layer_shelf": Kind((0.352, 0.191, 0.21)),
}
"""Fixtures that stand on a work surface, by class."""

OBJECTS = {
    "alphabet_soup": Kind((0.062, 0.063, 0.077), _BACK, "y"),
    "tomato_sauce": Kind((0.062, 0.062, 0.077), _BACK, "y"),
    "bbq_sauce": Kind((0.046, 0.03, 0.107), _ACROSS),
    "cookies": Kind((0.062, 0.082, 0.018), _ACROSS),
    "butter": Kind((0.076, 0.04, 0.018), _BACK),
    "chocolate_pudding": Kind((0.081, 0.046, 0.027), _BACK),
    "cream_cheese": Kind((0.082, 0.042, 0.018), _BACK),
    "ketchup": Kind((0.057, 0.037, 0.145), _ACROSS, "y"),
    "milk": Kind((0.053, 0.053, 0.131), _ACROSS, "y"),
    "orange_juice": Kind((0.053, 0.052, 0.131), _ACROSS, "y"),
    "salad_dressing": Kind((0.052, 0.036, 0.146), _ACROSS, "y"),
    "new_salad_dressing": Kind((0.052, 0.036, 0.146), _ACROSS, "y"),
    "akita_black_bowl": Kind((0.107, 0.107, 0.05), _ACROSS),
    "basket": Kind((0.169, 0.158, 0.142), _ACROSS),
    "chefmate_8_frypan": Kind((0.356, 0.204, 0.058), _ACROSS),
    "glazed_rim_porcelain_ramekin": Kind((0.09, 0.089, 0.042), _ACROSS),
    "plate": Kind((0.138, 0.137, 0.019), _ACROSS),
    "white_bowl": Kind((0.081, 0.081, 0.034), _ACROSS),
    "moka_pot": Kind((0.082, 0.147, 0.152), _BACK),
    "wine_bottle": Kind((0.043, 0.044, 0.157), _BACK),
    "wooden_tray": Kind((0.298, 0.167, 0.082), _BACK),
    "black_book": Kind((0.029, 0.11, 0.135), _BOOK),
    "yellow_book": Kind((0.023, 0.098, 0.122), _BOOK),
    "porcelain_mug": Kind((0.125, 0.096, 0.106), _MUG),
    "red_coffee_mug": Kind((0.123, 0.093, 0.133), _MUG),
    "white_yellow_mug": Kind((0.139, 0.106, 0.103), _MUG),
}
"""Free objects, by class."""
ROTATION = {"z": (1.0, 0.0, 0.0, 0.0), "y": (0.5**0.5, 0.5**0.5, 0.0, 0.0)}
"""Rotation (wxyz) that points an axis of a model up."""


def moving(problem: Problem, predicate: Predicate) -> tuple[str, tuple[float, float]]:
    """Return the fixture in a predicate such as `Open`, and the joint range [m or rad] that the predicate requires.

    Raises:
        UnknownNameError: The predicate names no fixture, or does not apply to the fixture's class.
    """
    region, word = problem.regions.get(predicate.names[0]), predicate.word
    name = predicate.names[0] if region is None else region.target
    kinds = {thing: FIXTURES[kind] for thing, kind in problem.fixtures.items() if kind in FIXTURES}
    states = {thing: kind.states[word] for thing, kind in kinds.items() if word in kind.states}
    check_names(f"fixture for {word}", [name], predicate.where, states)
    return name, states[name]
