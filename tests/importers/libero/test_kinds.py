"""The table of classes: complete, and turned as LIBERO's samplers turn them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.importers.libero.kinds import FIXTURES, OBJECTS, ROTATION, WORKSPACES

QUARTER = 90.0
TURNED = {  # the axis and the least and greatest angle [degrees] that LIBERO gives a class
    ("x", QUARTER, QUARTER): (
        *("akita_black_bowl", "basket", "chefmate_8_frypan", "glazed_rim_porcelain_ramekin", "plate", "white_bowl"),
        *("bbq_sauce", "cookies"),
    ),
    ("x", 0.0, 0.0): (*("butter", "chocolate_pudding", "cream_cheese", "moka_pot", "wine_bottle", "wooden_tray"),),
    ("x", -QUARTER, -QUARTER): ("porcelain_mug", "red_coffee_mug", "white_yellow_mug"),
    ("x", -QUARTER, -0.5 * QUARTER): ("black_book", "yellow_book"),
    ("z", QUARTER, QUARTER): ("alphabet_soup", "tomato_sauce"),
    ("xz", QUARTER, QUARTER): ("ketchup", "milk", "orange_juice", "salad_dressing", "new_salad_dressing"),
}


def sampled(axes: str, angle: float) -> Rotation:
    """Return MuJoCo's rotation for LIBERO's quaternion, which is written as xyzw and read as wxyz."""
    w, x, y, z = Rotation.from_euler(axes, [angle] * len(axes), degrees=True).as_quat()
    return Rotation.from_quat([x, y, z, w])


def test_the_table_is_complete():
    """26 classes of objects and 12 of fixtures, five of which are work surfaces."""
    assert (len(OBJECTS), len(FIXTURES) + len(WORKSPACES)) == (26, 12)
    assert sorted(name for names in TURNED.values() for name in names) == sorted(OBJECTS)


@pytest.mark.parametrize("rule", TURNED, ids=str)
def test_objects_stand_and_turn_as_libero_turns_them(rule: tuple[str, float, float]):
    """The axis that points up, and the headings at both ends of the angle."""
    axes, low, high = rule
    for name in TURNED[rule]:
        kind = OBJECTS[name]
        headings = []
        for angle in (low, high):
            turn = sampled(axes, angle)
            np.testing.assert_allclose(turn.apply(np.eye(3)["xyz".index(kind.up)]), [0, 0, 1], atol=1e-12)
            upright = turn * Rotation.from_quat(ROTATION[kind.up], scalar_first=True).inv()
            x, y, _ = upright.apply([1.0, 0.0, 0.0])
            headings.append(np.degrees(np.arctan2(y, x)))
        turned = np.degrees(np.unwrap(np.radians([*sorted(headings), *kind.yaw])))
        np.testing.assert_allclose(np.cos(np.radians(np.sort(turned[:2]) - np.sort(turned[2:]))), 1.0, atol=1e-12)
