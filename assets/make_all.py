"""Make every shipped asset again: ``python -m assets.make_all`` from the repository's root."""

from __future__ import annotations

from . import make_fruit

if __name__ == "__main__":
    make_fruit.main()
