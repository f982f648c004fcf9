"""Generate all shipped assets: ``python -m assets.make_all`` from the repository's root."""

from __future__ import annotations

from . import (
    make_fruit,
    make_furniture,
    make_groceries,
    make_heron,
    make_kitchenware,
    make_panda,
    make_rooms,
    make_tableware,
    make_things,
    make_ur5e,
)

MODULES = (
    make_fruit,
    make_kitchenware,
    make_furniture,
    make_panda,
    make_groceries,
    make_heron,
    make_rooms,
    make_tableware,
    make_things,
    make_ur5e,
)


def main() -> None:
    """Write all MJCF files, meshes and textures."""
    for module in MODULES:
        module.main()


if __name__ == "__main__":
    main()
