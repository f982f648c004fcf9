"""The picture of docs/variants.md: sixteen worlds of its scene with their variants.

python -m docs.make_variants   # half a minute
"""

from __future__ import annotations

from pathlib import Path

from docs.make_worlds import grid, worlds_of
from sceniris_gym import compile_scene

PICTURE = Path(__file__).parent / "variants.jpg"
THINGS = ["can", "mug", "bottle", "bowl", "pear", "banana", "book", "cereal_box", "brick", "glass", "lemon", "spatula"]
SCENE = {
    "floor": {"size": [1.6, 1.6]},
    "objects": {
        "table": {"asset": "table", "kind": "static"},
        "thing": {"asset": THINGS, "on": "table", "region": {"box": [[-0.15, -0.12], [0.15, 0.12]]}},
        "fruit": {"asset": ["apple", "orange"], "scale": [0.8, 1.0, 1.3], "on": "table", "relations": []},
    },
}
SCENE["objects"]["fruit"]["relations"] = [{"near": "thing", "measure": "bounds", "distance": {"max": 0.05}}]
_WORLDS, _COLUMNS, _GAP = 16, 4, 4


def main() -> None:
    """Draw the picture."""
    pictures = worlds_of(compile_scene(SCENE, "cpu"), _WORLDS)
    grid(list(pictures), _COLUMNS, _GAP).save(PICTURE, quality=85, optimize=True)
    print(f"{PICTURE}: {PICTURE.stat().st_size // 1024} KiB")


if __name__ == "__main__":
    main()
