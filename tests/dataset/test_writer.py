"""Data sets on disk: the same bytes however they came about, and never half there."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import signal
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.dataset import manifest
from sceniris_gym.dataset.manifest import DatasetPlan
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.dataset.writer import DatasetWriter
from sceniris_gym.errors import DatasetError, OutputError
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import COLUMNS
from tests.layout.scenes import compile_on_cpu

ROWS = 16


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of a few rows."""
    monkeypatch.setattr(manifest, "PART_ROWS", ROWS)


def write(folder: Path, n: int = 40, shard: Shard | None = None, **options) -> bool:
    """Write a share of n layouts of `mid` from seed 3, and return whether each part has a record now."""
    compiled = compile_on_cpu("mid")
    plan = DatasetPlan.of(compiled, n, 3, "train")
    return len(DatasetWriter(compiled, plan, folder, shard or Shard(), **options).write(chunk=7)) == plan.parts


def contents(folder: Path) -> dict[str, str]:
    """Checksums of all files below a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_a_data_set_is_a_table_in_parts_and_a_model_that_fit(tmp_path: Path):
    """Every column bit by bit, the last part shorter; and the scene as MuJoCo reads it from the archive."""
    folder = tmp_path / "new" / "folder"
    assert write(folder)
    names = ["dataset.json", *(f"layouts-{i:05}.npy" for i in range(3)), "scene.zip"]
    assert sorted(path.name for path in folder.iterdir()) == names
    parts = [np.load(folder / name) for name in names[1:-1]]
    assert [len(part) for part in parts] == [16, 16, 8]
    rows, table = np.concatenate(parts), make_table(compile_on_cpu("mid"), 40, 3)
    for name in rows.dtype.names or ():
        np.testing.assert_array_equal(rows[name], getattr(table, name), err_msg=name)
        assert rows[name].dtype == getattr(table, name).dtype, name
    left_out = set(COLUMNS) - set(rows.dtype.names or ())
    drawn = {"draw_seed", "draw_episode", "draw_stream", "param"}
    assert left_out == {"start", "grasp", "grasp_pose", "grasp_qpos", "pregrasp_qpos", "path"} | drawn
    with (folder / "scene.zip").open("rb") as file:
        mjm = mujoco.MjSpec.from_zip(file).compile()
    assert (mjm.nq, mjm.nmocap) == (rows["qpos"].shape[1], 1)
    told = json.loads((folder / "dataset.json").read_text())
    assert (told["layouts"], told["seed"], told["object_names"]) == (40, 3, ["cabinet", "apple", "banana"])
    assert [part["valid"] for part in told["parts"]] == [int(part["valid"].sum()) for part in parts]


def test_what_is_reached_is_written(crane: CompiledScene, tmp_path: Path):
    """Index, pose in the world and joints by object; the cube is taken at its middle, straight from above."""
    DatasetWriter(crane, DatasetPlan.of(crane, 12, 3, "eval"), tmp_path, Shard()).write(chunk=64)
    rows, table = np.load(tmp_path / "layouts-00000.npy"), make_table(crane, 12, 3, split="eval")
    assert rows["grasp"].shape == (12, 1)
    assert rows["grasp_qpos"].shape == rows["pregrasp_qpos"].shape == (12, 1, 4)
    np.testing.assert_array_equal(rows["grasp_pose"], table.grasp_pose)
    adr = crane.mjm.jnt_qposadr[crane.mjm.joint("thing/free").id]
    assert np.allclose(rows["grasp_pose"][:, 0, :3], rows["qpos"][:, adr : adr + 3] + [0.0, 0.0, 0.02], atol=1e-5)
    for quat in rows["grasp_pose"][:, 0, 3:]:
        turned = np.zeros(3)
        mujoco.mju_rotVecQuat(turned, np.array([0.0, 0.0, 1.0]), quat.astype(float))
        assert np.allclose(turned, [0.0, 0.0, -1.0], atol=1e-5)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_shares_of_any_order_are_the_bytes_of_one_process(tmp_path: Path, order: tuple[int, ...]):
    """The last one writes the manifest; until then it is not there, and what is left is known."""
    write(tmp_path / "alone")
    for number in order:
        assert not (tmp_path / "shared" / "dataset.json").exists()
        made = write(tmp_path / "shared", shard=Shard(number, 3))
    assert made  # pyrefly: ignore[unbound-name]
    assert contents(tmp_path / "shared") == contents(tmp_path / "alone")
    assert write(tmp_path / "shared", shard=Shard(1, 3))  # a rank that is started again


def test_a_share_without_parts_does_nothing_wrong(tmp_path: Path):
    """More processes than parts."""
    assert not write(tmp_path, 10, shard=Shard(5, 8))
    assert write(tmp_path, 10, shard=Shard(0, 8))


def test_a_data_set_is_never_written_over(tmp_path: Path):
    """Without --resume not at all; with it another one is refused by what differs."""
    write(tmp_path)
    before = contents(tmp_path)
    with pytest.raises(DatasetError, match=r"already holds a data set\. Add --resume"):
        write(tmp_path)
    with pytest.raises(DatasetError, match="layouts = 40, not 50"):
        write(tmp_path, 50, resume=True)
    assert write(tmp_path, resume=True)
    assert contents(tmp_path) == before
    held = tmp_path / "dataset.json"
    scene = compile_on_cpu("mid").scene
    held.write_text(held.read_text().replace(scene.hash, "0123456789abcdef"))
    with pytest.raises(DatasetError, match=f"the data set here has hash = 0123456789abcdef, not {scene.hash}"):
        write(tmp_path, resume=True)
    held.write_text("[" * 200_000)
    with pytest.raises(DatasetError, match="cannot be read"):
        write(tmp_path, resume=True)


def killed(folder: Path, after: str) -> None:
    """Write it in a process that kills itself at the n-th call of `os.replace` or `os.fsync`: "replace 3"."""
    name, number = after.split()
    kept, calls = getattr(os, name), []

    def dies(*args: Any) -> Any:
        calls.append(args)
        if len(calls) == int(number):
            os.kill(os.getpid(), signal.SIGKILL)
        return kept(*args)

    compile_on_cpu("mid")
    child = os.fork()
    if child == 0:
        try:
            setattr(os, name, dies)
            write(folder)
        finally:
            os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


@pytest.mark.parametrize("after", ["fsync 1", "replace 3", "fsync 3", "replace 5", "replace 9"])
def test_a_killed_run_resumes_to_the_same_bytes(tmp_path: Path, after: str):
    """Killed in the middle of a file, before or after its record: no manifest is there, and nothing hidden is left."""
    write(tmp_path / "whole")
    killed(tmp_path / "killed", after)
    assert not (tmp_path / "killed" / "dataset.json").exists()
    with pytest.raises(DatasetError, match="--resume"):
        write(tmp_path / "killed")
    write(tmp_path / "killed", resume=True)
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")
    assert sorted(path.name for path in (tmp_path / "killed").iterdir()) == sorted(
        path.name for path in (tmp_path / "whole").iterdir()
    )


def test_a_part_that_is_gone_is_made_again(tmp_path: Path):
    """By the manifest's own sums; a file cut off counts as gone."""
    write(tmp_path)
    before = contents(tmp_path)
    (tmp_path / "layouts-00001.npy").unlink()
    os.truncate(tmp_path / "layouts-00002.npy", 300)
    write(tmp_path, resume=True)
    assert contents(tmp_path) == before


def test_other_bytes_than_the_manifest_tells_are_said(tmp_path: Path):
    """A row that came out otherwise must not pass unseen."""
    write(tmp_path)
    path = tmp_path / "dataset.json"
    told = json.loads(path.read_text())
    told["parts"][1]["sha256"] = "0" * 64
    path.write_text(json.dumps(told))
    (tmp_path / "layouts-00001.npy").unlink()
    with pytest.raises(DatasetError, match="same versions of sceniris_gym"):
        write(tmp_path, resume=True)


def test_a_full_disk_is_told_and_resumed_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With the file; no half of it stays, and when there is room the rest follows."""
    calls = []

    def full(_: int) -> None:
        calls.append(1)
        if len(calls) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match=r"layouts-00001\.npy cannot be written: no space left"):
            write(tmp_path / "a")
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == [".progress", "layouts-00000.npy", "scene.zip"]
    write(tmp_path / "a", resume=True)
    write(tmp_path / "b")
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
