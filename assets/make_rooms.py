"""Chair, dining table, shelf, cupboard and counter: visual boards, and a convex collision piece per board."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .grasps import Grasp, add_grasp
from .make_furniture import unite
from .mjcf import Document, add
from .parts import Corners, Look, Part, Piece, add_part, chamfered, disc, sheared, write_thing
from .shapes import Mesh, box, lathe, solid, surface

OAK, DARK_OAK, PAINT, STEEL, STONE, CARCASS = (
    (0.70, 0.53, 0.35), (0.47, 0.32, 0.20), (0.84, 0.86, 0.84), (0.66, 0.68, 0.70), (0.30, 0.31, 0.33),
    (0.62, 0.60, 0.56),
)  # fmt: skip

# Chair [m]: height of the seat's upper side, and slope of the back.
SEAT_HALF, SEAT_HEIGHT, SEAT_THICK, CHAIR_HEIGHT, LEAN = 0.21, 0.45, 0.028, 0.86, 0.13
# Dining table [m].
TABLE, TABLE_HEIGHT, TABLE_TOP = (1.2, 0.8), 0.74, 0.03
# Shelf [m]: heights of the boards' upper sides.
SHELF_WIDTH, SHELF_DEPTH, SHELF_HEIGHT, SHELF_BOARDS, BOARD = 0.80, 0.30, 1.12, (0.08, 0.43, 0.78), 0.018
# Cupboard [m]: the frame without the door.
CUPBOARD_WIDTH, CUPBOARD_DEPTH, CUPBOARD_HEIGHT, PLINTH, DOOR, DOOR_GAP = 0.50, 0.40, 0.80, 0.06, 0.018, 0.003
# Counter [m]: the inside of the sink and its centre.
COUNTER, COUNTER_HEIGHT, COUNTER_TOP, TOE = (2.0, 0.6), 0.90, 0.04, 0.10
SINK, SINK_DEPTH, SINK_WALL, SINK_PLACE = (0.40, 0.35), 0.15, 0.006, (0.45, 0.01)


def union(boards: Mapping[str, Corners]) -> Mesh:
    """The union of boards with sharp edges, as one surface."""
    return surface(unite([box(*corners) for corners in boards.values()]))


def leaning(mesh: Mesh) -> Mesh:
    """Shear a mesh of the chair so that it leans back above the seat."""
    return sheared(mesh, (0.0, LEAN, 0.0), 2, SEAT_HEIGHT - SEAT_THICK)


def make_chair() -> None:
    """Write ``chair.xml``: its back is at +y."""
    under, half, leg = SEAT_HEIGHT - SEAT_THICK, SEAT_HALF, 0.034
    seat = ((-half, -half, under), (half, half, SEAT_HEIGHT))
    upright: dict[str, Corners] = {}
    for name, x in (("left", -half + 0.012), ("right", half - 0.012 - leg)):
        upright[f"leg_front_{name}"] = ((x, -half + 0.012, 0.0), (x + leg, -half + 0.012 + leg, under))
        upright[f"leg_back_{name}"] = ((x, half - 0.012 - leg, 0.0), (x + leg, half - 0.012, under))
        upright[f"rail_{name}"] = ((x + 0.009, -half + 0.046, 0.18), (x + 0.025, half - 0.046, 0.205))
        upright[f"apron_{name}"] = ((x + 0.007, -half + 0.046, 0.365), (x + 0.027, half - 0.046, under))
    inner = half - 0.012 - leg
    upright["apron_front"] = ((-inner, -half + 0.019, 0.365), (inner, -half + 0.039, under))
    upright["apron_back"] = ((-inner, half - 0.039, 0.365), (inner, half - 0.019, under))
    # Boards of the back are thinner than 2 cm, so their tops are edges and not support surfaces.
    front, rear = half - 0.030, half - 0.012
    back: dict[str, Corners] = {}
    for name, x in (("left", -half + 0.012), ("right", half - 0.012 - leg)):
        back[f"post_{name}"] = ((x, front, under), (x + leg, rear, CHAIR_HEIGHT - 0.07))
    back["crest"] = ((-half + 0.012, front, CHAIR_HEIGHT - 0.07), (half - 0.012, rear, CHAIR_HEIGHT))
    for i, x in enumerate((-0.09, 0.0, 0.09)):
        back[f"slat_{i}"] = ((x - 0.02, front + 0.004, under), (x + 0.02, rear - 0.004, CHAIR_HEIGHT - 0.07))
    crest = back["crest"]
    solids = [box(*seat, radius=0.0045, steps=4)] + [box(*corners) for corners in upright.values()]
    for name, corners in back.items():
        board = box(*corners, radius=0.006, steps=4) if name == "crest" else box(*corners)
        solids.append(solid(leaning(surface(board))))
    pieces: dict[str, Piece] = {"seat": chamfered(*seat, 0.0045), **upright}
    pieces |= {name: leaning(surface(box(*corners))) for name, corners in back.items() if name != "crest"}
    pieces["crest"] = leaning(chamfered(*crest, 0.006))
    write_thing("chair", Part({"visual": Look(surface(unite(solids)), OAK, 0.2)}, pieces, 4.5))


def make_dining_table() -> None:
    """Write ``dining_table.xml``."""
    x, y, under, leg = TABLE[0] / 2, TABLE[1] / 2, TABLE_HEIGHT - TABLE_TOP, 0.06
    top = ((-x, -y, under), (x, y, TABLE_HEIGHT))
    boards: dict[str, Corners] = {}
    for i, (right, back) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        low = (-x + 0.03 + right * (2 * x - 0.06 - leg), -y + 0.03 + back * (2 * y - 0.06 - leg), 0.0)
        boards[f"leg_{i}"] = (low, (low[0] + leg, low[1] + leg, under))
    for name, sign in (("front", -1), ("back", 1)):
        middle = sign * (y - 0.03 - leg / 2)
        boards[f"apron_{name}"] = ((-x + 0.09, middle - 0.01, under - 0.08), (x - 0.09, middle + 0.01, under))
    for name, sign in (("left", -1), ("right", 1)):
        middle = sign * (x - 0.03 - leg / 2)
        boards[f"apron_{name}"] = ((middle - 0.01, -y + 0.09, under - 0.08), (middle + 0.01, y - 0.09, under))
    mesh = surface(box(*top, radius=0.004, steps=5) + unite([box(*corners) for corners in boards.values()]))
    pieces: dict[str, Piece] = {"top": chamfered(*top, 0.004), **boards}
    write_thing("dining_table", Part({"visual": Look(mesh, DARK_OAK, 0.3)}, pieces, 24.0))


def make_shelf() -> None:
    """Write ``shelf.xml``: open to the front, three covered boards and the top."""
    x, y = SHELF_WIDTH / 2, SHELF_DEPTH / 2
    boards: dict[str, Corners] = {
        "left": ((-x, -y, 0.0), (-x + BOARD, y, SHELF_HEIGHT - BOARD)),
        "right": ((x - BOARD, -y, 0.0), (x, y, SHELF_HEIGHT - BOARD)),
        "top": ((-x, -y, SHELF_HEIGHT - BOARD), (x, y, SHELF_HEIGHT)),
        "back": ((-x + BOARD, y - 0.008, 0.0), (x - BOARD, y, SHELF_HEIGHT - BOARD)),
        "plinth": ((-x + BOARD, -y + 0.02, 0.0), (x - BOARD, -y + 0.035, SHELF_BOARDS[0] - BOARD)),
    }
    for i, height in enumerate(SHELF_BOARDS):
        boards[f"board_{i}"] = ((-x + BOARD, -y, height - BOARD), (x - BOARD, y - 0.008, height))
    pieces: dict[str, Piece] = {**boards}
    write_thing("shelf", Part({"visual": Look(union(boards), OAK, 0.2)}, pieces, 22.0))


def to_front(mesh: Mesh) -> Mesh:
    """Rotate a mesh by 90 degrees about x, so that its top faces the front."""
    return Mesh(mesh.vertices[:, [0, 2, 1]] * (1.0, -1.0, 1.0), mesh.faces)


def make_cupboard() -> None:
    """Write ``cupboard.xml``: a door hinged at the left, and one board inside. The frame defines the origin."""
    x, y, z, side, back = CUPBOARD_WIDTH / 2, CUPBOARD_DEPTH / 2, CUPBOARD_HEIGHT, 0.016, 0.008
    middle = 0.44
    boards: dict[str, Corners] = {
        "left": ((-x, -y, 0.0), (-x + side, y, z - side)),
        "right": ((x - side, -y, 0.0), (x, y, z - side)),
        "top": ((-x, -y, z - side), (x, y, z)),
        "bottom": ((-x + side, -y, PLINTH), (x - side, y - back, PLINTH + side)),
        "board": ((-x + side, -y + 0.03, middle - side), (x - side, y - back, middle)),
        "back": ((-x + side, y - back, PLINTH), (x - side, y, z - side)),
        "plinth": ((-x + side, -y + 0.03, 0.0), (x - side, -y + 0.045, PLINTH)),
    }
    pieces: dict[str, Piece] = {**boards}
    frame = Part({"frame": Look(union(boards), OAK, 0.2)}, pieces, 18.0)
    # The door rotates about the back of its left edge, so that it swings clear of the frame.
    width, height = CUPBOARD_WIDTH - 0.002, z - PLINTH - 0.003
    low, high = (0.0, -DOOR, 0.0), (width, 0.0, height)
    panel = box(low, high) - box((0.06, -DOOR - 1, 0.06), (width - 0.06, -DOOR + 0.0012, height - 0.06), 0.0)
    knob = lathe(np.array([(0, 26), (9, 26), (13, 23), (13, 18), (6, 10), (6, -2), (0, -2)]) / 1000.0, 16)
    place = np.array([width - 0.035, -DOOR, height - 0.18])
    door = Part(
        {"door": Look(surface(panel), PAINT, 0.3), "knob": Look(to_front(knob).moved(place), STEEL, 0.8)},
        {
            "leaf": ((0.0, -DOOR + 0.0012, 0.0), high),
            "stem": to_front(disc([(6, -2), (6, 10)], 16)).moved(place),
            "head": to_front(disc([(6, 10), (13, 18), (13, 23), (9, 26)], 8)).moved(place),
        },
        3.2,
        {"handle": place + [0, -0.02, 0]},
    )
    document = Document("cupboard")
    add_part(document, document.root, "", frame)
    hinge = add(document.root, "body", name="door", pos=(-x + 0.001, -y - DOOR_GAP, PLINTH))
    # Dry friction keeps the door in place. A pull of 1 N at its knob moves it.
    add(hinge, "joint", name="door", type="hinge", axis=(0, 0, -1), range=(0, np.radians(110)), damping=0.4,
        frictionloss=0.4, armature=0.02)  # fmt: skip
    add_part(document, hinge, "", door)
    add_grasp(hinge, "handle", Grasp(place + [0, -0.02, 0], (0, 1, 0), (1, 0, 0)))
    add(add(document.tree, "keyframe"), "key", name="home", qpos=(0,))
    document.save()


def counter_top() -> tuple[Corners, dict[str, Corners]]:
    """Return corners of the hole for the sink in the worktop, and of the four boards around the hole."""
    x, y, z = COUNTER[0] / 2, COUNTER[1] / 2, COUNTER_HEIGHT
    under = z - COUNTER_TOP
    (sx, sy), (px, py) = SINK, SINK_PLACE
    left, right = px - sx / 2 - SINK_WALL, px + sx / 2 + SINK_WALL
    front, back = py - sy / 2 - SINK_WALL, py + sy / 2 + SINK_WALL
    boards: dict[str, Corners] = {
        "top_left": ((-x, -y, under), (left, y, z)),
        "top_right": ((right, -y, under), (x, y, z)),
        # Boards overlap by 1 mm, so that rounding leaves no slit in the support surface of the worktop.
        "top_front": ((left - 0.001, -y, under), (right + 0.001, front, z)),
        "top_back": ((left - 0.001, back, under), (right + 0.001, y, z)),
    }
    return ((left, front, 0.0), (right, back, 2.0)), boards


def make_counter() -> None:
    """Write ``counter.xml``: cupboards below a worktop, and a body ``sink`` in the worktop."""
    x, y, z = COUNTER[0] / 2, COUNTER[1] / 2, COUNTER_HEIGHT
    under = z - COUNTER_TOP
    hole, tops = counter_top()
    sink_floor = z - SINK_DEPTH - SINK_WALL
    # The box below the sink belongs to the sink's body, so that the worktop has no level surface hidden under the sink.
    (left, front, _), (right, back, _) = hole
    body: dict[str, Corners] = {}
    for name, low, high in (("left", -x + 0.01, left), ("right", right, x - 0.01)):
        body[f"carcass_{name}"] = ((low, -y + 0.04, TOE), (high, y, under))
        body[f"toe_{name}"] = ((low, -y + 0.09, 0.0), (high, y, TOE))
    body["carcass_front"] = ((left, -y + 0.04, TOE), (right, front, under))
    body["toe_front"] = ((left, -y + 0.09, 0.0), (right, front, TOE))
    body["carcass_back"] = ((left, back, 0.0), (right, y, under))
    fronts: dict[str, Corners] = {}
    width = (2 * x - 0.02) / 4
    for i in range(4):
        start = -x + 0.01 + i * width
        low, high = (start + 0.002, -y + 0.022, TOE + 0.004), (start + width - 0.002, -y + 0.041, under - 0.03)
        fronts[f"front_{i}"] = (low, high)
    (sx, sy), (px, py) = SINK, SINK_PLACE
    rim, base = z - 0.001, sink_floor + SINK_WALL
    basin: dict[str, Corners] = {
        "floor": ((left, front, sink_floor), (right, back, base)),
        "left": ((left, front, base), (px - sx / 2, back, rim)),
        "right": ((px + sx / 2, front, base), (right, back, rim)),
        "front": ((px - sx / 2, front, base), (px + sx / 2, py - sy / 2, rim)),
        "back": ((px - sx / 2, py + sy / 2, base), (px + sx / 2, back, rim)),
    }
    below: Corners = ((left, front, 0.0), (right, back, sink_floor))
    # 5 um above the floor: visible, but without a step or a separate level surface.
    drain = lathe(np.array([(0, 0.005), (22, 0.005), (22, -1), (0, -1)]) / 1000.0, 24)
    pieces: dict[str, Piece] = {**tops, **body, **fronts}
    counter = Part(
        {
            "worktop": Look(union(tops), STONE, 0.5),
            "cabinets": Look(union(body), CARCASS, 0.2),
            **{f"panel_{i}": Look(surface(box(*corners)), PAINT, 0.3) for i, corners in enumerate(fronts.values())},
        },
        pieces,
        120.0,
    )
    sink = Part(
        {
            "basin": Look(union(basin), STEEL, 0.8),
            "block": Look(surface(box(*below)), CARCASS, 0.2),
            "drain": Look(drain.moved((px, py, base)), (0.25, 0.26, 0.27), 0.8),
        },
        {**basin, "below": below},
        4.0,
    )
    document = Document("counter")
    add_part(document, document.root, "", counter)
    add_part(document, add(document.root, "body", name="sink"), "sink_", sink)
    document.save()


def main() -> None:
    """Write chair, dining table, shelf, cupboard and counter."""
    make_chair()
    make_dining_table()
    make_shelf()
    make_cupboard()
    make_counter()


if __name__ == "__main__":
    main()
