"""Options that commands share: what is wrong with them is said with the option, before any work."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import pytest
import tyro

from sceniris_gym import cli
from sceniris_gym.commands.options import check_numbers, scene_config
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
    check_numbers(cli.bench, {"num_envs": 1})
    check_numbers(cli.check, {"seed": 2**64 - 1})
    with pytest.raises(ArgumentError, match=r"--num-envs 0: should be at least 1"):
        check_numbers(cli.bench, {"num_envs": 0})
    with pytest.raises(ArgumentError, match=r"--num-envs 65: should be at most 64"):
        check_numbers(cli.view, {"num_envs": 65})
    for seed in (-1, 2**64):
        with pytest.raises(ArgumentError, match=f"--seed {seed}: should be at "):
            check_numbers(cli.check, {"seed": seed})


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
        ("view mid -s -1", "--seed -1: should be at least 0."),
        ("import box.obj -o box.xml --jobs 0", "--jobs 0: should be at least 1."),
        ("settle mid --rows 1000001", "--rows 1000001: should be at most 1000000."),
        ("reach panda -s 18446744073709551616", "--seed 18446744073709551616: should be"),
    ],
)
def test_numbers_of_commands_have_ranges(words: str, refused: str, capsys: pytest.CaptureFixture):
    """An option's annotation has the range."""
    with pytest.raises(SystemExit):
        cli.main(words.split())
    assert refused in capsys.readouterr().err


@cache
def parser(command: str) -> Any:
    """Return the parser of a command."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return tyro.extras.get_parser(cli.COMMANDS[command])


SHARED = {
    "-n": ("--layouts", "INT", "number of layouts"),
    "-s": ("--seed", "INT", "seed of "),
    "-o": ("--out", "PATH", ""),
    "": ("--device", "STR", "cpu, cuda:0, ..."),
    "--json": ("--json", None, "print only one line of JSON"),
}
"""Options with one meaning: the short form, the long form, the type, and the first words of the help."""


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_shared_options_mean_the_same_in_each_command(command: str):
    """Long and short form, type and help."""
    for short, (long, kind, words) in SHARED.items():
        for action in parser(command)._actions:
            if {short, long} & {*action.option_strings}:
                assert set(action.option_strings) == {short, long} - {""}
                assert str(action.metavar) == str(kind)
                assert words in str(action.help)


@pytest.mark.parametrize("command", cli.COMMANDS)
def test_an_unknown_option_names_the_nearest_one(command: str, capsys: pytest.CaptureFixture):
    """For each option of the command, written with a letter missing or a letter too much, and nothing else."""
    names = [name for action in parser(command)._actions for name in action.option_strings]
    for option in (name for name in names if name.startswith("--") and name != "--help"):
        wrong = option[:-1] if len(option) > 6 else f"{option}e"
        with pytest.raises(SystemExit) as stop:
            cli.main([command, wrong])
        assert stop.value.code == 2
        said = f"error: {command}: unknown argument '{wrong}'. Did you mean '{option}'?"
        assert capsys.readouterr().err == f"{said} See sceniris-gym {command} --help.\n"


@pytest.mark.parametrize(
    "words", ["check mid --out x", "check mid -x", "check mid five", "train A-v0 --worlds=3", "view mid --json"]
)
def test_a_far_option_names_no_option(words: str, capsys: pytest.CaptureFixture):
    """'--layouts' only contains the letters of '--out', so it is no help."""
    with pytest.raises(SystemExit, match="2"):
        cli.main(words.split())
    command, _, wrong = words.split()[:3]
    said = f"error: {command}: unknown argument '{wrong}'. It has no similar option. See sceniris-gym {command} --help."
    assert capsys.readouterr().err == f"{said}\n"


def test_an_unknown_command_names_the_nearest_one(capsys: pytest.CaptureFixture):
    """A missing letter."""
    with pytest.raises(SystemExit, match="2"):
        cli.main(["chek", "mid"])
    assert capsys.readouterr().err.startswith("error: sceniris-gym: unknown command 'chek'. Did you mean 'check'?")


def test_a_heap_has_rows_not_layouts(capsys: pytest.CaptureFixture):
    """The former short form names the present option."""
    with pytest.raises(SystemExit):
        cli.main(["settle", "mid", "-n", "4"])
    assert "settle: '-n' is now --rows." in capsys.readouterr().err
