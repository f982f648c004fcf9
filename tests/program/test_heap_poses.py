"""The poses of things of heaps in the plan and in the flat arrays."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import HeapError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.program.scenes import Packed, pack
from tests.scene.heaping import THINGS, folder, words


def packed() -> Packed:
    """The scene with a bin of blocks."""
    return pack(build_model(SceneConfig.load(words(folder()))))


def test_each_thing_has_its_column_of_the_rows():
    """One after the other, drawn from the stream of the first of them."""
    found = packed()
    with np.load(folder() / "pile.npz") as rows:
        for i, name in enumerate(THINGS):
            adr, num, _ = found["obj_heap"][found.number(name)]
            assert found["heap_pose"][adr : adr + num, :3] == pytest.approx(rows["pos"][:, i])
            assert found["heap_pose"][adr : adr + num, 3:] == pytest.approx(rows["quat"][:, i])
    assert found["obj_heap"][found.number("bin"), 0] == -1
    streams = found["obj_heap"][[found.number(name) for name in THINGS], 2]
    assert set(streams.tolist()) == {found["obj_stream"][found.number("a")]}


def test_things_of_a_heap_are_not_kept_apart_from_each_other_or_from_the_bin():
    """But from the floor, which is not fixed to the bin."""
    found = packed()
    for name in THINGS:
        others = {body for pair in found.listed(name, "pair", "pair_bodies") for body in pair[:2]}
        assert others == {0, found.scene.bodies[name]}


def test_a_heap_without_rows_is_told_how_to_make_them():
    """By the key that is missing."""
    with pytest.raises(HeapError, match=r"heaps\.pile\.rows: is missing. Make them with `sceniris-gym settle"):
        build_plan(build_model(SceneConfig.load(words(folder(), rows=None))))
