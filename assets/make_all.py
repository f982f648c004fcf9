"""Make every shipped asset again: ``python -m assets.make_all`` from the repository's root."""

from __future__ import annotations

from . import make_fruit, make_furniture, make_kitchenware, make_panda


def main() -> None:
    """Write all MJCF files, meshes and textures."""
    for module in (make_fruit, make_furniture, make_kitchenware, make_panda):
        module.main()


if __name__ == "__main__":
    main()
