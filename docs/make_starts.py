"""The picture of docs/starts.md: one world per kind of start in its scene.

python -m docs.make_starts   # half a minute
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

from docs.make_worlds import grid, worlds_of
from sceniris_gym import compile_scene
from sceniris_gym.layout.tables import make_table

PAGE = Path(__file__).parent / "starts.md"
PICTURE = PAGE.with_suffix(".jpg")
_WORLDS, _COLUMNS, _GAP = 48, 4, 4


def main() -> None:
    """Draw the picture."""
    found = re.search(r"^```yaml.*?\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert found is not None
    compiled = compile_scene(YAML(typ="safe").load(found[1]), "cpu")
    kinds = make_table(compiled, _WORLDS, 0).start
    # Held objects are visible in these worlds.
    chosen = [int(np.flatnonzero(kinds == number)[-2]) for number in range(len(compiled.config.start))]
    pictures = worlds_of(compiled, max(chosen) + 1)
    grid([pictures[world] for world in chosen], _COLUMNS, _GAP).save(PICTURE, quality=85, optimize=True)
    print(f"{PICTURE}: {PICTURE.stat().st_size // 1024} KiB")


if __name__ == "__main__":
    main()
