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


def collected(thing: object, generation: int | None = None) -> bool:
    """Return whether the garbage collector looks at a thing, in one of its generations or in any."""
    return any(one is thing for one in gc.get_objects(generation))


def test_what_a_program_froze_stays_frozen():
    """As a server does before it forks. Frozen things may end meanwhile, so one is held rather than all counted."""
    kept = [[]]
    assert collected(kept)
    gc.freeze()
    try:
        assert not collected(kept)
        with uncollected():
            pass
        assert not collected(kept)
    finally:
        gc.unfreeze()
    assert collected(kept)
    with uncollected():
        made = [[]]
    assert gc.get_freeze_count() == 0
    assert collected(made, generation=2)
