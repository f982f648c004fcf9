"""Files of settled heaps: rows that are written are read, as poses in the plan too, and others are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.config.groups import HeapConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.heaps import HeapRows, read_rows, rigid_part, settled_with
from tests.program.scenes import Packed, pack
from tests.scene.heaping import BIN, THINGS, folder, model, words

HEAP = HeapConfig.model_validate({"fill": "bin", "of": ["a", "b"]})
ROWS = HeapRows(("a", "b"), np.full((3, 2, 3), 0.25), np.tile([1.0, 0.0, 0.0, 0.0], (3, 2, 1)), "0123456789abcdef")


def test_what_is_written_is_read(tmp_path: Path):
    """With the same bytes each time."""
    ROWS.write(tmp_path / "rows.npz")
    ROWS.write(tmp_path / "again.npz")
    found = read_rows(tmp_path / "rows.npz", HEAP, "here")
    assert (found.names, found.settled_with) == (ROWS.names, ROWS.settled_with)
    assert np.array_equal(found.pos, ROWS.pos)
    assert (tmp_path / "rows.npz").read_bytes() == (tmp_path / "again.npz").read_bytes()


def test_files_that_do_not_fit_are_refused(tmp_path: Path):
    """Missing, of something else, of other things, of poses that are none."""
    with pytest.raises(SceneKeyError, match=r"here\.rows: '.*': there is no such file.*sceniris-gym settle"):
        read_rows(tmp_path / "rows.npz", HEAP, "here")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(SceneKeyError, match="holds no settled heaps"):
        read_rows(tmp_path / "text.npz", HEAP, "here")
    HeapRows(("a", "b"), ROWS.pos, 0.0 * ROWS.quat, "").write(tmp_path / "none.npz")
    with pytest.raises(SceneKeyError, match="holds no settled heaps"):
        read_rows(tmp_path / "none.npz", HEAP, "here")
    HeapRows(("b", "a"), ROWS.pos, ROWS.quat, "").write(tmp_path / "other.npz")
    with pytest.raises(SceneKeyError, match="has heaps of b, a, but the heap in the scene has a, b"):
        read_rows(tmp_path / "other.npz", HEAP, "here")


def test_the_content_of_the_rows_is_in_the_hash_of_the_scene(tmp_path: Path):
    """Neither their name nor their place is."""
    at = folder()
    (tmp_path / "copy.npz").write_bytes((at / "pile.npz").read_bytes())
    copied = SceneConfig.load(words(at), {"heaps.pile.rows": str(tmp_path / "copy.npz")})
    assert build_model(copied).hash == build_model(SceneConfig.load(words(at))).hash
    ROWS.write(tmp_path / "copy.npz")
    assert build_model(copied).hash != build_model(SceneConfig.load(words(at))).hash


def test_other_shapes_and_masses_are_told_apart(tmp_path: Path):
    """A wall that is a millimetre higher; where the bin stands does not matter."""
    at, scene = folder(), model(folder())
    heap = scene.config.heaps["pile"]
    known = settled_with(scene, heap, "here")
    assert settled_with(model(at, **{"objects.bin.kind": "free"}), heap, "here") == known
    higher = BIN.replace(".005 .05", ".005 .051")
    (tmp_path / "bin.xml").write_text(f"<mujoco><worldbody><body>{higher}</body></worldbody></mujoco>")
    assert settled_with(model(at, **{"objects.bin.asset": str(tmp_path / "bin.xml")}), heap, "here") != known


def test_things_with_joints_are_refused():
    """A heap is of rigid things."""
    scene = model(folder(), **{"objects.a.asset": "cupboard"})
    with pytest.raises(NotSupportedError, match="object 'a' should have 'kind: free' and no inner joints"):
        settled_with(scene, scene.config.heaps["pile"], "here")


def test_a_drawer_is_no_rigid_part_of_its_cabinet():
    """A joint begins a new rigid part."""
    scene = build_model(SceneConfig.load({"objects": {"cabinet": {"asset": "cabinet", "kind": "static"}}}))
    drawer = scene.parts("cabinet")["upper_drawer"]
    assert scene.bodies["cabinet"] not in rigid_part(scene.mjm, drawer)
    assert drawer not in rigid_part(scene.mjm, scene.bodies["cabinet"])


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
    with pytest.raises(SceneKeyError, match=r"heaps\.pile\.rows: is missing. Run `sceniris-gym settle"):
        build_plan(build_model(SceneConfig.load(words(folder(), rows=None))))
