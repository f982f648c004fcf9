"""YAML files that mean more than they are long."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.config.expansion import MOST_VALUES, expanded_size
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneFileError
from tests.config.scenes import write


def test_a_file_without_anchors_is_not_expanded():
    """Each value is there once."""
    assert expanded_size("a: [1, 2]\nb: 3\n") == 0


def test_aliases_count_as_often_as_they_stand():
    """A mapping of one key with a list of two numbers, and the list once more."""
    assert expanded_size("a: &x [1, 2]\nb: *x\n") == 1 + 2 + 2 * 3


@pytest.mark.parametrize("form", ["<<: [{}]", "k: [{}]"], ids=["merges", "lists"])
def test_a_bomb_is_refused_before_it_is_built(tmp_path: Path, form: str):
    """Nine to the power of twelve values in twelve lines, as merges and as plain lists."""
    lines = ["a0: &a0 {x: 1, y: 2}"]
    lines += [f"a{i}: &a{i} {{{form.format(', '.join([f'*a{i - 1}'] * 9))}}}" for i in range(1, 13)]
    assert expanded_size("\n".join(lines)) == MOST_VALUES + 1
    with pytest.raises(
        SceneFileError, match=r"bomb\.yaml: with its aliases and merges written out .* more than 1000000"
    ):
        SceneConfig.load(write(tmp_path, "bomb.yaml", "\n".join(lines)))


def test_a_value_that_holds_itself_is_refused(tmp_path: Path):
    """Written out it has no end."""
    with pytest.raises(SceneFileError, match="more than 1000000 values"):
        SceneConfig.load(write(tmp_path, "loop.yaml", "objects: &x {a: *x}"))
