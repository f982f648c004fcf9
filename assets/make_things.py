"""A book, a toy brick, a toy block, a peg, and a chest with a hinged lid."""

from __future__ import annotations

import numpy as np

from .mjcf import Document, add
from .parts import Copies, Look, Part, Piece, add_part, chamfered, circle, disc, write_thing
from .shapes import box, hull, surface

# Book [m], lying flat with the spine to the left.
BOOK, COVER, OVERHANG = (0.15, 0.21, 0.030), 0.0025, 0.004
# Brick [m] with eight studs. Their radius is in mm.
BRICK, STUD_RADIUS, PITCH = (0.064, 0.032, 0.020), 4.9, 0.016
BLOCK = 0.045
PEG = (0.04, 0.04, 0.06)
# Chest [m].
CHEST, CHEST_WALL, LID, LID_GAP = (0.24, 0.16, 0.095), 0.009, 0.016, 0.0012


def make_book() -> None:
    """Write ``book.xml``: two boards, a spine, and a block of pages between them."""
    x, y, z = BOOK[0] / 2, BOOK[1] / 2, BOOK[2]
    bottom = ((-x, -y, 0.0), (x, y, COVER))
    top = ((-x, -y, z - COVER), (x, y, z))
    spine = ((-x, -y, COVER), (-x + COVER, y, z - COVER))
    pages = ((-x + COVER, -y + OVERHANG, COVER), (x - OVERHANG, y - OVERHANG, z - COVER))
    cover = box((-x, -y, 0), (x, y, z)) - box((-x + COVER, -1, COVER), (1, 1, z - COVER))
    looks = {
        "cover": Look(surface(cover), (0.13, 0.30, 0.27), shine=0.25),
        "paper": Look(surface(box(*pages)), (0.90, 0.87, 0.78), shine=0.05),
    }
    pieces: dict[str, Piece] = {"bottom": bottom, "top": top, "spine": spine, "pages": pages}
    write_thing("book", Part(looks, pieces, 0.55, {"grasp": (0, 0, z / 2)}))


def make_brick() -> None:
    """Write ``brick.xml``."""
    x, y, z = BRICK[0] / 2, BRICK[1] / 2, BRICK[2]
    radius = 0.0006
    body = box((-x, -y, 0), (x, y, z), radius, 2)
    pieces: dict[str, Piece] = {"body": chamfered((-x, -y, 0), (x, y, z), radius)}
    stud = [circle(r, height, 16) for r, height in ((STUD_RADIUS, -2), (STUD_RADIUS, 3.5), (STUD_RADIUS - 0.5, 4.0))]
    places = np.array([((i - 1.5) * PITCH, (j - 0.5) * PITCH, z) for i in range(4) for j in range(2)])
    for place in places:
        body = body + hull(np.concatenate(stud) + place)
    core = disc([(STUD_RADIUS, -2.0), (STUD_RADIUS - 0.3, 3.8)], 8)
    pieces["stud"] = Copies(core, places, np.tile([1.0, 0.0, 0.0, 0.0], (8, 1)))
    look = Look(surface(body), (0.78, 0.12, 0.10), shine=0.6)
    write_thing("brick", Part({"visual": look}, pieces, 0.035, {"grasp": (0, 0, 0.01)}))


def make_block() -> None:
    """Write ``block.xml``: a wooden cube."""
    half, radius = BLOCK / 2, 0.003
    low, high = (-half, -half, 0.0), (half, half, BLOCK)
    look = Look(surface(box(low, high, radius, 6)), (0.20, 0.48, 0.66), shine=0.25)
    write_thing("block", Part({"visual": look}, {"body": chamfered(low, high, radius)}, 0.06, {"grasp": (0, 0, half)}))


def make_peg() -> None:
    """Write ``peg.xml``: a standing square peg, with room below the palm for lower objects around it."""
    x, y, z = PEG[0] / 2, PEG[1] / 2, PEG[2]
    low, high, radius = (-x, -y, 0.0), (x, y, z), 0.003
    look = Look(surface(box(low, high, radius, 6)), (0.80, 0.16, 0.12), shine=0.25)
    write_thing("peg", Part({"visual": look}, {"body": chamfered(low, high, radius)}, 0.07, {"grasp": (0, 0, z / 2)}))


def make_chest() -> None:
    """Write ``chest.xml``: an open box, and a lid that rotates about the upper edge of its back."""
    x, y, z = CHEST[0] / 2, CHEST[1] / 2, CHEST[2]
    wall, radius = CHEST_WALL, 0.004
    hollow = box((-x + wall, -y + wall, wall), (x - wall, y - wall, 1.0))
    walls: dict[str, Piece] = {
        "bottom": ((-x, -y, 0.0), (x, y, wall)),
        "left": ((-x, -y, wall), (-x + wall, y, z)),
        "right": ((x - wall, -y, wall), (x, y, z)),
        "front": ((-x + wall, -y, wall), (x - wall, -y + wall, z)),
        "back": ((-x + wall, y - wall, wall), (x - wall, y, z)),
    }
    body = Part({"body": Look(surface(box((-x, -y, 0), (x, y, z)) - hollow), (0.52, 0.33, 0.19), 0.25)}, walls, 0.9)
    # The origin of the lid's frame is on its axis, the lower edge of its back.
    low, high = (-x, -2 * y - 0.001, 0.0), (x, 0.0, LID)
    # The clasp hangs from the front of the lid, 1 mm in front of the box.
    clasp = ((-0.014, -2 * y - 0.004, -0.018), (0.014, -2 * y - 0.001, 0.010))
    lid = Part(
        {
            "lid": Look(surface(box(low, high, radius, 5)), (0.58, 0.38, 0.22), 0.25),
            "clasp": Look(surface(box(*clasp)), (0.72, 0.58, 0.26), 0.8),
        },
        {"board": chamfered(low, high, radius), "latch": clasp},
        0.35,
        {"lid": clasp[0]},
    )
    document = Document("chest")
    add_part(document, document.root, "", body)
    hinge = add(document.root, "body", name="lid", pos=(0, y, z + LID_GAP))
    # Dry friction holds the lid at any angle, except for a slow creep. A force of 5 N at its edge moves it.
    add(hinge, "joint", name="lid", type="hinge", axis=(-1, 0, 0), range=(0, np.radians(105)), damping=0.02,
        frictionloss=0.4, armature=0.002)  # fmt: skip
    add_part(document, hinge, "", lid)
    add(add(document.tree, "keyframe"), "key", name="home", qpos=(0,))
    document.save()


def main() -> None:
    """Write book, brick, block, peg and chest."""
    make_book()
    make_brick()
    make_block()
    make_peg()
    make_chest()


if __name__ == "__main__":
    main()
