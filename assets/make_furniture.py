"""A table, and a cabinet with two drawers: visual solids, and a collision box per board.

``EDGE`` is the radius of the rounded visual edges. Collision boxes are smaller by ``EDGE`` along two axes, so that
their sharp edges stay inside the visual surface. Along the third axis they keep the full size, because objects may
stand on a board or against it.
"""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from .grasps import Grasp, add_grasp
from .mjcf import Document, add, inertial
from .shapes import box, hull, surface, write_obj

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]

# Radius of rounded edges [m].
EDGE = 0.0015

# Table [m]: narrow along x, so that an arm with its base at x = -0.5 has the whole top in front of it.
TABLE_SIZE, TABLE_HEIGHT, TABLE_TOP, TABLE_LEG = (0.8, 1.0), 0.4, 0.03, 0.06

# Cabinet [m]. The front of the frame is at y = -DEPTH / 2.
WIDTH, DEPTH, HEIGHT = 0.42, 0.32, 0.50
SIDE, BOARD, BACK = 0.015, 0.014, 0.010
OPENING = (HEIGHT - 3 * BOARD) / 2
TRAVEL = 0.25
# Drawer. The origin of its frame is the front bottom edge of its opening, on the middle plane.
GAP, WALL, FRONT, TRAY_HEIGHT = 0.003, 0.010, 0.018, 0.13
HALF = WIDTH / 2 - SIDE - GAP
TRAY_BACK = DEPTH - BACK - GAP - 0.002
HANDLE_HEIGHT, HANDLE_REACH, HANDLE_HALF, HANDLE_THICKNESS = 0.135, 0.034, 0.065, 0.011


def unite(solids: list[Manifold]) -> Manifold:
    """The union of all solids."""
    whole = solids[0]
    for other in solids[1:]:
        whole = whole + other
    return whole


def inset(corners: Corners, axes: str) -> Corners:
    """Move corners inward by ``EDGE`` along ``axes``, at both ends."""
    (x0, y0, z0), (x1, y1, z1) = corners
    x, y, z = (EDGE * (axis in axes) for axis in "xyz")
    return (x0 + x, y0 + y, z0 + z), (x1 - x, y1 - y, z1 - z)


def table_boards() -> dict[str, Corners]:
    """Corners of the table's top, legs and rails."""
    x, y = TABLE_SIZE[0] / 2, TABLE_SIZE[1] / 2
    under = TABLE_HEIGHT - TABLE_TOP
    boards: dict[str, Corners] = {"top": ((-x, -y, under), (x, y, TABLE_HEIGHT))}
    for i, (right, back) in enumerate(((0, 0), (1, 0), (0, 1), (1, 1))):
        low = (-x + 0.02 + right * (2 * x - 0.04 - TABLE_LEG), -y + 0.02 + back * (2 * y - 0.04 - TABLE_LEG), 0.0)
        boards[f"leg_{i}"] = (low, (low[0] + TABLE_LEG, low[1] + TABLE_LEG, under))
    # Rails run from the middle of a leg to the middle of the next.
    x, y, half, low_edge = x - 0.05, y - 0.05, 0.01, under - 0.05
    boards["rail_front"] = ((-x, -y - half, low_edge), (x, -y + half, under))
    boards["rail_back"] = ((-x, y - half, low_edge), (x, y + half, under))
    boards["rail_left"] = ((-x - half, -y, low_edge), (-x + half, y, under))
    boards["rail_right"] = ((x - half, -y, low_edge), (x + half, y, under))
    return boards


def make_table() -> None:
    """Write ``table.xml``."""
    boards = table_boards()
    parts = [box(*boards["top"], radius=EDGE)]
    for name, (low, high) in boards.items():
        if name != "top":
            # Legs and rails reach into the top, so that the union has no seam.
            parts.append(box(low, (high[0], high[1], high[2] + 0.01), radius=EDGE if "leg" in name else 0.0))
    mesh = surface(unite(parts))
    write_obj("table", mesh)
    document = Document("table")
    document.colour("wood", (0.66, 0.49, 0.33), shine=0.2)
    document.mesh("table", "table")
    inertial(document.root, mesh, mass=18.0)
    document.visual(document.root, "visual", "table", "wood")
    for name, corners in boards.items():
        document.collision_box(document.root, name, *(corners if "rail" in name else inset(corners, "xy")))
    document.save()


def frame_boards() -> dict[str, Corners]:
    """Corners of the collision boxes for the frame's boards."""
    x, y = WIDTH / 2 - EDGE, DEPTH / 2 - EDGE
    inner = WIDTH / 2 - SIDE
    shelf = BOARD + OPENING
    return {
        "left": ((-x, -y, 0), (-inner, y, HEIGHT)),
        "right": ((inner, -y, 0), (x, y, HEIGHT)),
        "bottom": ((-inner, -y, 0), (inner, y, BOARD)),
        "shelf": ((-inner, -y, shelf), (inner, y, shelf + BOARD)),
        "top": ((-inner, -y, HEIGHT - BOARD), (inner, y, HEIGHT)),
        "back": ((-inner, DEPTH / 2 - BACK, BOARD), (inner, y, HEIGHT - BOARD)),
    }


def frame_solid() -> Manifold:
    """The frame: a block with rounded edges and two openings with bevelled rims."""
    x, y = WIDTH / 2, DEPTH / 2
    body = box((-x, -y, 0), (x, y, HEIGHT), radius=EDGE, steps=10)
    bevel = EDGE
    for low in (BOARD, 2 * BOARD + OPENING):
        inner = np.array([[sx * (x - SIDE), 0, low + sz * OPENING] for sx in (-1, 1) for sz in (0, 1)])
        wide = inner + [[sx * bevel, 0, (2 * sz - 1) * bevel] for sx in (-1, 1) for sz in (0, 1)]
        body = body - hull(np.concatenate([inner + [0, -y - 0.01, 0], inner + [0, y - BACK, 0]]))
        body = body - hull(np.concatenate([inner + [0, -y + bevel, 0], wide + [0, -y, 0], wide + [0, -y - 0.01, 0]]))
    return body


def drawer_boards() -> dict[str, Corners]:
    """Corners of a drawer's boards, in the drawer's frame."""
    low, back = GAP, TRAY_BACK
    return {
        "front": ((-HALF, 0, low), (HALF, FRONT, OPENING - GAP)),
        "floor": ((-HALF, FRONT, low), (HALF, back, low + WALL)),
        "left": ((-HALF, FRONT, low + WALL), (-HALF + WALL, back, low + TRAY_HEIGHT)),
        "right": ((HALF - WALL, FRONT, low + WALL), (HALF, back, low + TRAY_HEIGHT)),
        "back": ((-HALF + WALL, back - WALL, low + WALL), (HALF - WALL, back, low + TRAY_HEIGHT)),
    }


def drawer_boxes() -> dict[str, Corners]:
    """Corners of the collision boxes for a drawer's boards. The boxes end before the tray's rounded outer edges."""
    boards = drawer_boards()
    (x0, y0, z0), (x1, y1, z1) = boards["floor"]
    boxes = {"front": inset(boards["front"], "xz"), "floor": ((x0 + EDGE, y0, z0), (x1 - EDGE, y1 - EDGE, z1))}
    for name in ("left", "right"):
        low, (x1, y1, z1) = boards[name]
        boxes[name] = (low, (x1, y1 - EDGE, z1 - EDGE))
    low, (x1, y1, z1) = boards["back"]
    return boxes | {"back": (low, (x1, y1, z1 - EDGE))}


def drawer_solid() -> Manifold:
    """The drawer: a tray with rounded inner edges, and a front panel with rounded edges."""
    boards = drawer_boards()
    panel = box(*boards["front"], radius=EDGE, steps=8)
    tray = box((-HALF, FRONT - 0.006, GAP), (HALF, TRAY_BACK, GAP + TRAY_HEIGHT), radius=EDGE, steps=4)
    hollow = box((-HALF + WALL, FRONT, GAP + WALL), (HALF - WALL, TRAY_BACK - WALL, 1.0), radius=0.003, steps=4)
    return (panel + tray) - (hollow ^ box((-1, FRONT, 0), (1, 1, 0.5)))


def handle_bars() -> dict[str, Corners]:
    """Corners of a handle's bar and its two feet, which end inside the front panel."""
    x, y, z, half = HANDLE_HALF, -HANDLE_REACH, HANDLE_HEIGHT, HANDLE_THICKNESS / 2
    return {
        "handle_bar": ((-x - half, y - half, z - half), (x + half, y + half, z + half)),
        "handle_left": ((-x - half, y - half, z - half), (-x + half, 0.003, z + half)),
        "handle_right": ((x - half, y - half, z - half), (x + half, 0.003, z + half)),
    }


def handle_boxes() -> dict[str, Corners]:
    """Corners of the collision boxes for a handle. The feet begin behind the bar and end on the panel."""
    bars = {name: inset(corners, "xz") for name, corners in handle_bars().items()}
    behind = -HANDLE_REACH + HANDLE_THICKNESS / 2
    for name in ("handle_left", "handle_right"):
        (x0, _, z0), (x1, _, z1) = bars[name]
        bars[name] = ((x0, behind, z0), (x1, 0.0, z1))
    return bars


def handle_solid() -> Manifold:
    """A handle of three square bars with rounded edges."""
    return unite([box(*corners, radius=EDGE, steps=6) for corners in handle_bars().values()])


def add_drawer(document: Document, name: str, floor: float) -> None:
    """Add a drawer that slides to the front."""
    body = add(document.root, "body", name=f"{name}_drawer", pos=(0, -DEPTH / 2, floor))
    add(body, "joint", name=name, class_="slide")
    inertial(body, surface(drawer_solid()), mass=2.2)
    document.visual(body, f"{name}_drawer", "drawer", "front")
    document.visual(body, f"{name}_handle", "handle", "steel")
    for part, corners in (drawer_boxes() | handle_boxes()).items():
        document.collision_box(body, f"{name}_{part}", *corners)
    handle = (0, -HANDLE_REACH, HANDLE_HEIGHT)
    add(body, "site", name=f"{name}_handle", pos=handle, size=0.005, group=4)
    add_grasp(body, f"{name}_handle", Grasp(handle, (0, 1, 0), (0, 0, 1)))


def make_cabinet() -> None:
    """Write ``cabinet.xml``."""
    frame = surface(frame_solid())
    write_obj("cabinet_frame", frame)
    write_obj("cabinet_drawer", surface(drawer_solid()))
    write_obj("cabinet_handle", surface(handle_solid()))
    document = Document("cabinet")
    slide = add(document.default, "default", class_="slide")
    # Dry friction keeps a drawer in place, up to a pull of 1.5 N.
    add(slide, "joint", type="slide", axis=(0, -1, 0), range=(0, TRAVEL), damping=6, frictionloss=1.5, armature=0.1)
    document.colour("body", (0.72, 0.55, 0.37), shine=0.2)
    document.colour("front", (0.90, 0.86, 0.78), shine=0.3)
    document.colour("steel", (0.30, 0.31, 0.33), shine=0.8)
    for part in ("frame", "drawer", "handle"):
        document.mesh(part, f"cabinet_{part}")
    inertial(document.root, frame, mass=14.0)
    document.visual(document.root, "frame", "frame", "body")
    for name, corners in frame_boards().items():
        document.collision_box(document.root, f"frame_{name}", *corners)
    add_drawer(document, "upper", 2 * BOARD + OPENING)
    add_drawer(document, "lower", BOARD)
    add(add(document.tree, "keyframe"), "key", name="home", qpos=(0, 0))
    document.save()


def main() -> None:
    """Write the table and the cabinet."""
    make_table()
    make_cabinet()


if __name__ == "__main__":
    main()
