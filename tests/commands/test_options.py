"""Options that commands share: what is wrong with them is said with the option, before any work."""

from __future__ import annotations

import pytest

from sceniris_gym.commands.options import check_counts, check_seed, scene_config
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, SceneKeyError


def test_changes_are_yaml():
    """Numbers, lists and words, as in a scene file."""
    assert read_changes(["a.b=1e-3", "c=[1, 2]", "d=mug"]) == {"a.b": 1e-3, "c": [1, 2], "d": "mug"}
    assert scene_config("mid", ["objects.apple.clearance=0.02"]).objects["apple"].clearance == 0.02


@pytest.mark.parametrize("change", ["apple", "=1", "a=[1", "a=" + 3000 * "["])
def test_what_is_no_change_is_quoted(change: str):
    """A pair that is none, and values that are no YAML."""
    with pytest.raises(SceneKeyError, match="--set "):
        read_changes([change])


def test_counts_and_seeds_have_bounds():
    """Named as the option is."""
    check_counts(1, num_envs=1)
    check_seed(2**64 - 1)
    with pytest.raises(ArgumentError, match=r"--num-envs 0: should be at least 1"):
        check_counts(1, num_envs=0)
    with pytest.raises(ArgumentError, match=r"--n 5: should be at most 4"):
        check_counts(1, most=4, n=5)
    with pytest.raises(ArgumentError, match=r"--seed -1"):
        check_seed(-1)
