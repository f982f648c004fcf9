"""Size of a YAML file with its aliases and merges written out: a few lines can mean billions of values."""

from __future__ import annotations

from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

MOST_VALUES = 1_000_000
"""Greatest number of values in a scene file: a scene of 10,000 objects has a tenth of it."""


def expanded_size(text: str) -> int:
    """Return the number of values in a YAML text, `MOST_VALUES` + 1 for more, or for a value that contains itself.

    Raises:
        YAMLError: The text is not YAML.
    """
    if "&" not in text:
        return 0
    root = YAML(typ="safe", pure=True).compose(text)
    return 0 if root is None else _size(root, {})


def _size(node: Node, known: dict[int, int]) -> int:
    if id(node) in known:
        return known[id(node)]
    known[id(node)] = MOST_VALUES + 1  # until it is known, since an alias inside of itself never ends
    if isinstance(node, MappingNode):
        parts = [part for pair in node.value for part in pair]
    else:
        parts = node.value if isinstance(node, SequenceNode) else []
    known[id(node)] = min(1 + sum(_size(part, known) for part in parts), MOST_VALUES + 1)
    return known[id(node)]
