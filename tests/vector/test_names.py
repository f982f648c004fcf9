"""Names that tasks misspell, and those that are offered instead."""

from __future__ import annotations

import pytest

from sceniris_gym.errors import ArgumentTypeError, UnknownNameError


@pytest.mark.parametrize(
    ("method", "name", "message"),
    [
        ("pose", "blok", "Did you mean 'block'"),
        ("site", "tcp", "Did you mean 'arm/tcp'"),
        ("qpos", "block", "Valid: .*arm/pan"),
        ("velocity", "cabinet", "Valid: block"),
        ("velocity", "blok", "scene 'scene': State.velocity: unknown body 'blok'"),
        ("qvel", "block", "State.qvel: unknown joint"),
        ("actuator", "pan", "Did you mean 'arm/pan'"),
    ],
)
def test_unknown_names_are_answered_with_the_valid_ones(make_env, method, name, message):
    """A misspelt name is refused, with the names there are."""
    with pytest.raises(UnknownNameError, match=message):
        getattr(make_env(1).state, method)(name)


@pytest.mark.parametrize("method", ["pose", "site", "velocity", "actuator"])
@pytest.mark.parametrize("name", [None, 3], ids=str)
def test_a_name_that_is_no_text_is_refused(make_env, method, name):
    """MuJoCo would crash on None."""
    with pytest.raises(ArgumentTypeError, match=f"State.{method}: name should be a str"):
        getattr(make_env(1).state, method)(name)
