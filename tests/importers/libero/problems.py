"""Problem files in the form of LIBERO's, written for these tests."""

from __future__ import annotations

from pathlib import Path

KITCHEN = """
(define (problem LIBERO_Kitchen_Tabletop_Manipulation)
  (:domain robosuite)
  (:language put the bowl on the plate and close the top drawer)
  (:regions ; a comment
    (bowl_region (:target kitchen_table) (:ranges ((-0.12 -0.02 -0.08 0.02))) (:yaw_rotation ((0.0 0.0))))
    (plate_region (:target kitchen_table) (:ranges ((0.02 0.1 0.06 0.14))))
    (cabinet_region (:target kitchen_table) (:ranges ((0.0 -0.31 0.02 -0.29)))
      (:yaw_rotation ((3.141592653589793 3.141592653589793))))
    (stove_region (:target kitchen_table) (:ranges ((-0.21 0.29 -0.19 0.31))) (:rgba (0 0 1 0)))
    (top_region (:target wooden_cabinet_1))
    (top_side (:target wooden_cabinet_1))
    (cook_region (:target flat_stove_1))
  )
  (:fixtures
    kitchen_table - kitchen_table
    wooden_cabinet_1 - wooden_cabinet
    flat_stove_1 - flat_stove
  )
  (:objects
    akita_black_bowl_1 akita_black_bowl_2 - akita_black_bowl
    plate_1 - plate
  )
  (:obj_of_interest akita_black_bowl_1 plate_1)
  (:init
    (On akita_black_bowl_1 kitchen_table_bowl_region)
    (On akita_black_bowl_2 wooden_cabinet_1_top_side)
    (On plate_1 kitchen_table_plate_region)
    (On wooden_cabinet_1 kitchen_table_cabinet_region)
    (On flat_stove_1 kitchen_table_stove_region)
    (Open wooden_cabinet_1_top_region)
    (Turnon flat_stove_1)
  )
  (:goal
    (And (On akita_black_bowl_1 plate_1) (Close wooden_cabinet_1_top_region))
  )
)
"""
"""A cabinet with a bowl on it and an open drawer, a stove that is on, a bowl and a plate."""

STACK = """
(define (problem LIBERO_Floor_Manipulation)
  (:domain robosuite)
  (:language lift the bowl)
  (:regions
    (box_region (:target floor) (:ranges ((-0.05 -0.05 0.05 0.05))))
    (basket_region (:target floor) (:ranges ((0.2 -0.01 0.22 0.01))))
    (contain_region (:target basket_1))
  )
  (:fixtures floor - floor)
  (:objects cookies_1 - cookies akita_black_bowl_1 - akita_black_bowl basket_1 - basket)
  (:init
    (On akita_black_bowl_1 cookies_1)
    (On cookies_1 floor_box_region)
    (On basket_1 floor_basket_region)
  )
  (:goal (In akita_black_bowl_1 basket_1_contain_region))
)
"""
"""On the floor, a bowl on a box beside a basket."""


def write(folder: Path, text: str = KITCHEN, **changes: str) -> Path:
    """Write a problem file, in which each text is replaced by another one, and return its path."""
    for i, (before, after) in enumerate(changes.items()):
        assert before in text, f"change {i}: the file has no '{before}'"
        text = text.replace(before, after)
    path = folder / "problem.bddl"
    path.write_text(text)
    return path
