"""Warnings are heard as ever, and can be written down and made again."""

from __future__ import annotations

import json
import warnings

import pytest
import torch

from sceniris_gym.errors import FallbackWarning, ModelWarning
from sceniris_gym.program.notices import from_record, noting, to_record, warn

HELD = FallbackWarning("here: it is full.", 0.25, "apple", "collision", (3, 64))


def test_a_warning_is_issued_at_its_level_and_noted():
    """A warning is placed as by `warnings.warn`, and noted only inside of the block."""
    with warnings.catch_warnings(record=True) as caught, noting() as noted:
        warnings.simplefilter("always")
        warn(ModelWarning("odd"))
    assert [str(w.message) for w in caught] == [str(w) for w in noted] == ["odd"]
    assert caught[0].filename == __file__
    with pytest.warns(ModelWarning):
        warn(ModelWarning("odd as well"))
    assert len(noted) == 1


def test_a_warning_points_past_the_libraries_between():
    """As when Gymnasium, or a decorator of torch, calls this package."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        torch.no_grad()(warn)(ModelWarning("odd"))
    assert caught[0].filename == __file__


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_block_around_another_notes_its_warnings_too():
    """In their order."""
    with noting() as outer:
        warn(ModelWarning("first"))
        with noting() as inner:
            warn(ModelWarning("second"))
        warn(ModelWarning("third"))
    assert [str(warning) for warning in outer] == ["first", "second", "third"]
    assert [str(warning) for warning in inner] == ["second"]


@pytest.mark.parametrize("warning", [ModelWarning("odd"), HELD])
def test_a_warning_is_made_again_from_json(warning: UserWarning):
    """Its class, its words and what it says beside them."""
    again = from_record(json.loads(json.dumps(to_record(warning))))
    assert type(again) is type(warning)
    assert str(again) == str(warning)
    assert again.__dict__.keys() == warning.__dict__.keys()


@pytest.mark.parametrize("name", ["annotations", "ScenirisError", "system"])
def test_nothing_but_warnings_is_made(name: str):
    """A name in a file leads to no other class or function."""
    with pytest.raises(ValueError, match="is not a warning"):
        from_record([name, ["true"]])
