"""The garbage collector rests while large libraries are imported, and is as before afterwards."""

from __future__ import annotations

import gc

import pytest

from sceniris_gym.collecting import uncollected


@pytest.mark.parametrize("collecting", [True, False])
def test_it_is_as_before_afterwards(collecting: bool):
    """On or off, also after an error."""
    was = gc.isenabled()
    try:
        (gc.enable if collecting else gc.disable)()
        with uncollected():
            assert not gc.isenabled()
        assert gc.isenabled() == collecting
        with pytest.raises(ImportError), uncollected():
            raise ImportError
        assert gc.isenabled() == collecting
    finally:
        (gc.enable if was else gc.disable)()


def test_what_a_program_froze_stays_frozen():
    """As a server does before it forks."""
    gc.freeze()
    try:
        frozen = gc.get_freeze_count()
        with uncollected():
            pass
        assert gc.get_freeze_count() == frozen > 0
    finally:
        gc.unfreeze()
    with uncollected():
        kept = [[]]
    assert gc.get_freeze_count() == 0
    assert kept in gc.get_objects(generation=2)
