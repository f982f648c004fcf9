"""Options that commands share: what is wrong with them is said with the option, before any work."""

from __future__ import annotations

import pytest

from sceniris_gym import cli
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


@pytest.mark.parametrize(
    ("words", "refused"),
    [
        ("generate mid -n 0 -o data", "--layouts 0: should be at least 1."),
        ("generate mid -n 2000000000 -o data", "--layouts 2000000000: should be at most 1000000000."),
        ("generate mid -n 8 --chunk 0 -o data", "--chunk 0: should be at least 1."),
        ("audit mid --rejected -1", "--rejected -1: should be at least 0."),
        ("audit mid --settled -1", "--settled -1: should be at least 0."),
        ("view mid --num-envs 65", "--num-envs 65: should be at most 64."),
        ("view mid --port 0", "--port 0: should be at least 1."),
        ("view mid --episode 2147483648", "--episode 2147483648: should be at most 2147483647."),
        ("view mid -s -1", "--seed -1: should be an integer from 0 to 2^64 - 1."),
        ("import box.obj -o box.xml --jobs 0", "--jobs 0: should be at least 1."),
        ("settle mid -n 1000001", "--rows 1000001: should be at most 1000000."),
        ("reach panda -s 18446744073709551616", "--seed 18446744073709551616: should be"),
    ],
)
def test_numbers_of_commands_have_ranges(words: str, refused: str, capsys: pytest.CaptureFixture):
    """An option's annotation has the range."""
    with pytest.raises(SystemExit):
        cli.main(words.split())
    assert refused in capsys.readouterr().err
