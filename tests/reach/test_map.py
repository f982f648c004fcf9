"""Map files, and what is kept of corners."""

import gc
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import MapError
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.map import (
    CODE_VALUES,
    MOST_FALSE_ACCEPTS,
    MOST_TURN_ERROR,
    ReachMap,
    default_tier,
    map_file,
    pack,
    why_not_map,
)
from tests.reach.shapes import ball, codes_at, gantry, map_of, poses, random_axes


@pytest.fixture(scope="module")
def arm() -> SerialArm:
    """An arm for which a map can be."""
    return gantry()[1]


@pytest.fixture(scope="module")
def shell(arm: SerialArm) -> ReachMap:
    """A map of `shapes.ball`."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        return map_of(ball, monkeypatch, arm, 0.15, math.radians(15))


def test_a_saved_map_comes_back_whole(shell: ReachMap, arm: SerialArm, tmp_path: Path):
    """Every field, and so every verdict; saving again writes the same bytes."""
    shell.save(tmp_path / "a.reach")
    again = ReachMap.load(tmp_path / "a.reach", arm)
    for name in ReachMap.__dataclass_fields__:
        if name != "arm":
            assert np.array_equal(getattr(again, name), getattr(shell, name)), name
            assert type(getattr(again, name)) is type(getattr(shell, name)), name
    again.save(tmp_path / "b.reach")
    assert (tmp_path / "a.reach").read_bytes() == (tmp_path / "b.reach").read_bytes()
    pos = np.random.default_rng(0).uniform(-0.8, 0.8, (2_000, 3))
    asked = poses(pos, random_axes(2_000, 1), np.zeros(2_000))
    assert np.array_equal(again.verdict(asked, "cpu"), shell.verdict(asked, "cpu"))


@pytest.mark.parametrize("share", [None, 0.0, 0.0123])
def test_the_share_of_false_accepts_is_kept(shell: ReachMap, arm: SerialArm, tmp_path: Path, share: float | None):
    """A file from before it was measured has none, and loads as a map that was not; verdicts are the same."""
    path = tmp_path / "a.reach"
    replace(shell, false_accepts=share).save(path)
    with np.load(path) as stored:
        assert ("false_accepts" in stored.files) is (share is not None)
        assert stored["format"] == 1
    again = ReachMap.load(path, arm)
    assert again.false_accepts == share
    assert type(again.false_accepts) is type(share)
    assert again.coarse is (share == 0.0123)
    assert np.array_equal(again.codes, shell.codes)


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan, 1, "few"])
def test_a_share_that_is_none_is_refused(shell: ReachMap, arm: SerialArm, tmp_path: Path, share: float | str):
    """Below nothing, above all, and no number."""
    path = tmp_path / "a.reach"
    shell.save(path)
    with np.load(path) as stored:
        fields = {name: stored[name] for name in stored.files}
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **fields, false_accepts=np.array(share))
    with pytest.raises(MapError, match="the reachability map is damaged: false_accepts is"):
        ReachMap.load(path, arm)


def test_why_a_map_does_not_decide(shell: ReachMap):
    """There is none, its verdicts depend on turns, or it accepts what is out of reach; only then is it not default."""
    known = {
        "it has no map yet (build one, on a GPU in seconds, on a CPU core in hours": None,
        "which maps ignore: its map is wrong about 0.6%": replace(shell, turn_error=0.006, false_accepts=0.02),
        "too coarse: 2.00% of the poses that it accepts": replace(shell, false_accepts=0.02),
    }
    for says, reach_map in known.items():
        assert says in str(why_not_map(shell.arm, reach_map, "own"))
        assert default_tier(shell.arm, reach_map) == Tier.IK
    assert "maybe too inexact" in str(why_not_map(gantry("-2 2")[1], None, "own"))
    for reach_map in (shell, replace(shell, false_accepts=MOST_FALSE_ACCEPTS, turn_error=MOST_TURN_ERROR)):
        assert why_not_map(shell.arm, reach_map, "own") is None
        assert default_tier(shell.arm, reach_map) == Tier.MAP


def test_a_map_of_another_arm_is_refused(shell: ReachMap, tmp_path: Path):
    """One limit that differs is another arm; the message says how to build its map."""
    shell.save(tmp_path / "a.reach")
    with pytest.raises(MapError, match=r"links, limits or TCP differ.*--build -o"):
        ReachMap.load(tmp_path / "a.reach", gantry("-2 2")[1])


def test_a_missing_map_says_how_it_is_built(arm: SerialArm, tmp_path: Path):
    """There is no foreign traceback."""
    with pytest.raises(MapError, match=r"no such reachability map.*sceniris-gym reach base --build"):
        ReachMap.load(tmp_path / "none.reach", arm)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.98])
def test_a_file_that_was_cut_off_is_refused(shell: ReachMap, arm: SerialArm, tmp_path: Path, share: float):
    """Wherever it ends."""
    shell.save(tmp_path / "a.reach")
    whole = (tmp_path / "a.reach").read_bytes()
    (tmp_path / "a.reach").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(MapError, match="the file is damaged, or not a reachability map"):
        ReachMap.load(tmp_path / "a.reach", arm)


def test_a_damaged_file_is_refused(shell: ReachMap, arm: SerialArm, tmp_path: Path):
    """A changed byte in the middle of the codes, where the archive's checksum sees it; text; another archive."""
    path = tmp_path / "a.reach"
    shell.save(path)
    whole = bytearray(path.read_bytes())
    whole[whole.index(b"codes.npy") + 200] ^= 0xFF
    path.write_bytes(whole)
    with pytest.raises(MapError, match="damaged"):
        ReachMap.load(path, arm)
    path.write_text("no map at all")
    with pytest.raises(MapError, match="not a reachability map"):
        ReachMap.load(path, arm)
    np.savez(path.with_suffix(".npz"), other=np.zeros(3))
    with pytest.raises(MapError, match="not a reachability map"):
        ReachMap.load(path.with_suffix(".npz"), arm)


def test_an_array_is_no_map(arm: SerialArm, tmp_path: Path):
    """A .npy file, as that of poses is, is not taken for an archive."""
    np.save(tmp_path / "poses.npy", np.zeros((3, 4, 4)))
    with pytest.raises(MapError, match=r"the file is damaged, or not a reachability map \(File is not a zip file\)"):
        ReachMap.load(tmp_path / "poses.npy", arm)


def test_the_advice_is_what_the_caller_says(arm: SerialArm, tmp_path: Path):
    """A caller may know another command than the default."""
    with pytest.raises(MapError, match=r"no such reachability map\. Do this\.$"):
        ReachMap.load(tmp_path / "none.reach", arm, "Do this.")


_FAULTS: dict[str, tuple[str, Callable[[np.ndarray], np.ndarray]]] = {
    "rows too few": ("rows", lambda a: a[:-1]),
    "rows of floats": ("rows", lambda a: a.astype(float)),
    "rows beyond the codes": ("rows", lambda a: a + np.array([1 << 20, 0, 0], np.int32)),
    "rows below zero": ("rows", lambda a: a - np.array([0, 1, 0], np.int32)),
    "rows too long": ("rows", lambda a: a + np.array([0, 1 << 20, 0], np.int32)),
    "codes too few": ("codes", lambda a: a[:-2]),
    "codes of another type": ("codes", lambda a: a.astype(np.int64)),
    "codes in two dimensions": ("codes", lambda a: a[None]),
    "one pole": ("poles", lambda a: a[:1]),
    "poles without corners": ("poles", lambda a: a[:, :1]),
    "codes of poles": ("poles", lambda a: a + np.uint8(200)),
    "witnesses of another arm": ("wit_joints", lambda a: a[:, :-1]),
    "witnesses without numbers": ("wit_joints", lambda a: np.full_like(a, np.nan)),
    "too few witnesses": ("wit_joints", lambda a: a[:-1]),
    "cells of witnesses below zero": ("wit_cells", lambda a: a - np.int32(1)),
    "cells of witnesses that are not square": ("wit_cells", lambda a: a[:, :, :-1]),
    "no step": ("step", np.zeros_like),
    "no number as a step": ("tilt_step", lambda a: np.full_like(a, np.nan)),
    "a word as a step": ("pole_step", lambda a: np.array("wide")),
    "more corners than rows": ("nz", lambda a: a + 1),
    "half a corner": ("nu", lambda a: a + 0.5),
    "one corner": ("ntilt", np.ones_like),
}


@pytest.mark.parametrize("fault", _FAULTS)
def test_a_map_that_would_lead_look_ups_astray_is_refused(shell: ReachMap, arm: SerialArm, tmp_path: Path, fault: str):
    """A whole archive with the arm's hash, of which one field has another type, shape or range."""
    path, (name, change) = tmp_path / "a.reach", _FAULTS[fault]
    shell.save(path)
    with np.load(path) as stored:
        fields = {name: stored[name] for name in stored.files}
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **(fields | {name: change(fields[name])}))
    with pytest.raises(MapError, match="the reachability map is damaged"):
        ReachMap.load(path, arm)


def test_a_map_in_which_nothing_is_within_reach_is_refused(shell: ReachMap, arm: SerialArm, tmp_path: Path):
    """No arm is so short; every object would be out of reach without a word."""
    replace(shell, codes=0 * shell.codes, poles=0 * shell.poles).save(tmp_path / "a.reach")
    with pytest.raises(MapError, match="codes are 0, out of reach"):
        ReachMap.load(tmp_path / "a.reach", arm)


@pytest.mark.parametrize(("name", "value"), [("step", 1e9), ("z_low", -1e9), ("nz", 10**12)])
def test_a_map_of_no_arm_is_refused(shell: ReachMap, arm: SerialArm, tmp_path: Path, name: str, value: float):
    """Steps and places that are out of all bounds."""
    replace(shell, **{name: value}).save(tmp_path / "a.reach")  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(MapError, match=f"the reachability map is damaged: {name} is"):
        ReachMap.load(tmp_path / "a.reach", arm)


def test_a_damaged_file_is_closed(shell: ReachMap, arm: SerialArm, tmp_path: Path, recwarn: pytest.WarningsRecorder):
    """No handle stays open behind the error."""
    path = tmp_path / "a.reach"
    shell.save(path)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(MapError):
        ReachMap.load(path, arm)
    gc.collect()
    assert not [w for w in recwarn if issubclass(w.category, ResourceWarning)]


def test_a_pose_without_numbers_is_not_reached(shell: ReachMap):
    """NaN and infinite positions and axes are looked up as out of reach."""
    made = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (5, 1, 1))
    made[:4, :3, :3] = poses(np.zeros((1, 3)), np.array([[0.6, 0.0, 0.8]]), np.zeros(1))[0, :3, :3]
    made[0, 0, 3], made[1, 2, 3], made[2, 1, 3], made[4, 2, 3] = np.nan, np.nan, np.inf, np.nan
    made[3, :3, 2] = np.nan
    assert shell.verdict(made, "cpu").tolist() == [0] * 5


def test_a_file_of_another_format_is_refused(shell: ReachMap, arm: SerialArm, tmp_path: Path):
    """Both formats are named."""
    path = tmp_path / "a.reach"
    shell.save(path)
    with np.load(path) as stored:
        fields = {name: stored[name] for name in stored.files if name != "format"}
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, format=np.array(99), **fields)
    with pytest.raises(MapError, match="should have format 1, got format 99"):
        ReachMap.load(path, arm)


def test_an_own_map_lies_beside_its_mjcf(tmp_path: Path):
    """A shipped arm's is installed with the assets; without a file there is None."""
    assert map_file(str(tmp_path / "my_arm.xml")) is None
    (tmp_path / "my_arm.reach").touch()
    assert map_file(str(tmp_path / "my_arm.xml")) == tmp_path / "my_arm.reach"
    assert map_file("no_such_arm") is None


def test_codes_are_packed_and_found_again(shell: ReachMap, monkeypatch: pytest.MonkeyPatch):
    """Corner by corner, the sign of a code is whether the corner is reached."""
    codes = np.random.default_rng(2).integers(0, 16, 43, np.uint8)
    words = pack(codes)
    assert len(words) == 6
    assert [int(words[i // 8] >> np.uint32(4 * (i % 8))) & 15 for i in range(43)] == codes.tolist()
    n = (shell.nz, shell.ntilt, shell.nu, shell.nu)
    index = np.stack(np.meshgrid(*map(np.arange, n), indexing="ij"), axis=-1).reshape(-1, 4)
    low = np.array([shell.z_low, 0.0, shell.u_low, shell.u_low])
    step = np.array([shell.step, shell.tilt_step, shell.step, shell.step])
    assert np.array_equal(CODE_VALUES[codes_at(shell, index)] > 0.0, ball(low + index * step))


def test_a_map_says_how_much_memory_it_takes(shell: ReachMap):
    """Rows that are cut to what is reached take less than half of four bits for each corner of the box."""
    size, witnesses = shell.nbytes
    assert 0 < size - shell.rows.nbytes - shell.poles.size // 2 < 0.25 * shell.nz * shell.ntilt * shell.nu**2
    assert 0 < witnesses < 32 * shell.wit_cells[..., 1].size + 16 * len(shell.wit_joints)
