"""Data sets read back: rows as they were written, through torch's loaders, and damage that is told."""

from __future__ import annotations

import json
import os
import pickle
import shutil
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sceniris_gym.dataset import manifest, reader
from sceniris_gym.dataset.manifest import DatasetPlan
from sceniris_gym.dataset.reader import LayoutDataset, verify
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.dataset.writer import DatasetWriter
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, DatasetError, UnknownNameError
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.progress import listening
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable
from tests.layout.scenes import compile_on_cpu, full_tray

N, SEED = 40, 3


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of three parts."""
    folder = tmp_path_factory.mktemp("data")
    compiled = compile_on_cpu("mid")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manifest, "PART_ROWS", 16)
        DatasetWriter(compiled, DatasetPlan.of(compiled, N, SEED, "train"), folder, Shard()).write(chunk=64)
    return folder


@pytest.fixture
def copied(written: Path, tmp_path: Path) -> Path:
    """A copy of it to be damaged."""
    return shutil.copytree(written, tmp_path / "copy")


@pytest.fixture(scope="module")
def table() -> LayoutTable:
    """The same layouts, straight from a generator."""
    return make_table(compile_on_cpu("mid"), N, SEED)


def test_a_row_is_a_layout(written: Path, table: LayoutTable):
    """Each column as a tensor of its own type; negative indices count from the end."""
    dataset = LayoutDataset(written)
    assert len(dataset) == N
    for i in (0, 15, 16, N - 1, -1):
        row = dataset[i]
        assert tuple(row) == dataset.columns
        for name, value in row.items():
            np.testing.assert_array_equal(value.numpy(), getattr(table, name)[i], err_msg=name)
    assert dataset[0]["qpos"].dtype == torch.float32
    for wrong in (N, -N - 1):
        with pytest.raises(IndexError, match="from 0 to 39"):
            dataset[wrong]
    with pytest.raises(ArgumentTypeError, match=r"integer, got 1\.5"):
        dataset[1.5]  # pyrefly: ignore[bad-index]


@pytest.mark.parametrize("workers", [0, 2])
def test_a_loader_sees_every_row_once(written: Path, table: LayoutTable, workers: int):
    """In batches, shuffled, in processes of its own; only the columns that were asked for."""
    dataset = LayoutDataset(written, ("seed", "qpos"))
    loader = torch.utils.data.DataLoader(dataset, batch_size=7, shuffle=True, num_workers=workers)
    batches = list(loader)
    assert set(batches[0]) == {"seed", "qpos"}
    seeds, qpos = (torch.cat([batch[name] for batch in batches]).numpy() for name in ("seed", "qpos"))
    order = np.argsort(seeds)
    np.testing.assert_array_equal(seeds[order], table.seed)
    np.testing.assert_array_equal(qpos[order], table.qpos)


def test_rows_come_in_the_order_asked_for(written: Path, table: LayoutTable, monkeypatch: pytest.MonkeyPatch):
    """From all parts, twice the same too, and with fewer maps open than there are parts; copies, never the file."""
    monkeypatch.setattr(reader, "_mapped", lru_cache(1)(reader._mapped.__wrapped__))
    dataset, wanted = LayoutDataset(written), [39, 0, 16, 0, -1]
    found = dataset.rows(wanted)
    np.testing.assert_array_equal(found["qpos"], table.qpos[wanted])
    found["qpos"][:] = 0.0
    np.testing.assert_array_equal(dataset.rows(wanted)["qpos"], table.qpos[wanted])
    assert dataset.rows([])["qpos"].shape == (0, table.qpos.shape[1])


def test_a_table_can_be_served_again(written: Path, table: LayoutTable):
    """All columns, with none for reach; resets may serve it."""
    held = LayoutDataset(written).table(10, 20)
    for name in COLUMNS:
        if getattr(table, name).size:
            np.testing.assert_array_equal(getattr(held, name), getattr(table, name)[10:30], name)
    source = StoredLayouts(compile_on_cpu("mid"), held, 4, seed=0)
    source.generate()
    np.testing.assert_array_equal(source.layouts.qpos.cpu().numpy(), table.qpos[10:14])
    with pytest.raises(ArgumentError, match="from 0 to 39"):
        LayoutDataset(written).table(30, 20)
    with pytest.raises(ArgumentError, match="all columns"):
        LayoutDataset(written, ["qpos"]).table()


def test_a_data_set_can_be_sent_to_another_process(written: Path, table: LayoutTable):
    """Without its open files."""
    dataset = LayoutDataset(written)
    dataset[0]
    sent = pickle.loads(pickle.dumps(dataset))
    np.testing.assert_array_equal(sent[5]["qpos"].numpy(), table.qpos[5])


def test_a_working_directory_may_change(written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Rows of a folder that was given relative to the old one are there still, in another process as well."""
    monkeypatch.chdir(written.parent)
    dataset = LayoutDataset(written.name)
    monkeypatch.chdir(tmp_path)
    assert dataset[N - 1]["seed"] == SEED + N - 1
    assert pickle.loads(pickle.dumps(dataset))[0]["seed"] == SEED


def test_an_unknown_column_is_named(written: Path):
    """With the nearest that there is."""
    with pytest.raises(UnknownNameError, match="Did you mean 'qpos'"):
        LayoutDataset(written, ["qpoz"])


def test_a_whole_data_set_is_verified(written: Path):
    """All rows are told."""
    told = []
    with listening(lambda *words: told.append(words)):
        assert verify(written)["layouts"] == N
    assert told == [("layouts", done, N) for done in (16, 32, 40)]


def test_a_pipe_in_place_of_a_file_is_not_waited_for(copied: Path):
    """Nor is a folder read."""
    (copied / "scene.zip").unlink()
    os.mkfifo(copied / "scene.zip")
    with pytest.raises(DatasetError, match=r"scene\.zip is damaged"):
        verify(str(copied))
    (copied / "scene.zip").unlink()
    (copied / "scene.zip").mkdir()
    with pytest.raises(DatasetError, match=r"scene\.zip is damaged"):
        verify(copied)


@pytest.mark.parametrize("rows", [[True, False], np.array([True, False, False]), [0.7], ["a"], None, [[0], [1, 2]]])
def test_only_integers_are_row_numbers(written: Path, rows: Any):
    """A mask is no list of numbers, and nothing is rounded."""
    with pytest.raises(ArgumentTypeError, match="rows should be integers"):
        LayoutDataset(written).rows(rows)


def test_rows_that_no_data_set_has_are_no_rows(written: Path):
    """However large the number; none are none."""
    dataset = LayoutDataset(written)
    for row in (N, -N - 1, 2**63, 2**70, -(2**70)):
        with pytest.raises(IndexError, match="a row should be from 0 to 39"):
            dataset.rows([row])
        with pytest.raises(IndexError, match="a row should be from 0 to 39"):
            dataset[row]
    assert len(dataset.rows([])["qpos"]) == 0


@pytest.mark.parametrize(
    "wrong",
    [
        lambda folder: LayoutDataset(folder).table(0.5, 2),  # pyrefly: ignore[bad-argument-type]
        lambda folder: LayoutDataset(folder).table("a"),  # pyrefly: ignore[bad-argument-type]
        lambda _: LayoutDataset(None),  # pyrefly: ignore[bad-argument-type]
        lambda folder: LayoutDataset(folder, 5),  # pyrefly: ignore[bad-argument-type]
        lambda _: verify(None),  # pyrefly: ignore[bad-argument-type]
    ],
)
def test_what_is_of_another_kind_is_refused(written: Path, wrong: Callable[[Path], object]):
    """With what it should be."""
    with pytest.raises(ArgumentTypeError, match="should be"):
        wrong(written)


def test_damage_is_found_and_named(copied: Path):
    """One bit of a row, a scene that is gone, a part of other rows; all files at once."""
    path = copied / "layouts-00001.npy"
    data = bytearray(path.read_bytes())
    data[-5] ^= 1
    path.write_bytes(data)
    with pytest.raises(DatasetError, match=r"layouts-00001\.npy is damaged or missing, according to dataset\.json"):
        verify(copied)
    (copied / "scene.zip").unlink()
    with pytest.raises(DatasetError, match=r"scene\.zip, layouts-00001\.npy are damaged"):
        verify(copied)
    path.write_bytes(b"\x93NUMPY" + bytes(len(data)))
    with pytest.raises(DatasetError, match="cannot read it"):
        LayoutDataset(copied).rows([20])
    path.write_bytes(bytes(data).replace(b"(16,)", b"(16,("))
    with pytest.raises(DatasetError, match="cannot read it"):
        LayoutDataset(copied).rows([20])
    path.write_bytes((copied / "layouts-00002.npy").read_bytes() * 3)
    with pytest.raises(DatasetError, match="number of rows should be as in"):
        LayoutDataset(copied)[20]
    path.unlink()
    with pytest.raises(DatasetError, match=r"1 of its 3 parts are missing.*layouts-00001"):
        LayoutDataset(copied)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("layouts", 41, "should add up"),
        ("parts", [], "should add up"),
        ("columns", {"qpos": {"dtype": "object", "shape": []}}, "numeric dtype"),
        ("columns", {"qpos": {"dtype": "float32", "shape": [10**12]}}, "cut off|cannot be read"),
        ("columns", {"qpos": "float32"}, "cannot be read"),
        ("columns", {"qpos": {"dtype": f"{'9' * 5000},f4", "shape": []}}, "cannot be read"),
        ("columns", {}, "numeric dtype"),
        ("split", "x", "'split' should be train or eval, got x"),
        ("format", 99, r"'format' should be 1 to \d+, got 99"),
        ("format", 0, "'format'"),
        ("rows_of_a_part", 0, "'rows_of_a_part' should be positive"),
        ("layouts", -1, "'layouts' should be positive"),
        ("seed", -1, "'seed' should be 0 or more"),
        ("hash", "", "'hash' should be 16 hexadecimal digits"),
        ("scene_sha256", "x", "'scene_sha256' should be 64 hexadecimal digits"),
        ("files", {"a\0b": "x"}, "plain file name"),
        ("files", {"\ud800": "x"}, "plain file name"),
        ("files", {"..": "x"}, "plain file name"),
        ("files", {"../scene.zip": "x"}, "plain file name"),
        ("files", {"x" * 5000: "x"}, "plain file name"),
        ("files", {"scene.usdc": 7}, "plain file name"),
    ],
)
def test_a_manifest_that_cannot_be_right_is_refused(copied: Path, name: str, value: object, words: str):
    """Before memory is taken for what it declares."""
    path = copied / "dataset.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {name: value}))
    with pytest.raises(DatasetError, match=words):
        LayoutDataset(copied)


@pytest.mark.parametrize(
    ("name", "value"), [("rows", -16), ("valid", -1), ("valid", 17), ("first_pass_valid", -1), ("sha256", "")]
)
def test_the_record_of_a_part_that_cannot_be_right_is_refused(copied: Path, name: str, value: object):
    """By its field: more valid layouts than rows, fewer than none, no sum."""
    path = copied / "dataset.json"
    held = json.loads(path.read_text())
    held["parts"][1][name] = value
    path.write_text(json.dumps(held))
    with pytest.raises(DatasetError, match=f"'{name}' should be"):
        LayoutDataset(copied)


def test_a_data_set_keeps_the_keys_that_physics_is_drawn_by(tmp_path: Path):
    """Of fallbacks as well; in older ones, which lack them, a fallback's is unknown."""
    compiled, folder = full_tray(tmp_path, randomize={"gravity": {"scale": [0.5, 1.0]}}), tmp_path / "data"
    DatasetWriter(compiled, DatasetPlan.of(compiled, 16, SEED, "eval"), folder, Shard()).write(chunk=64)
    dataset, made = LayoutDataset(folder), make_table(compiled, 16, SEED, split="eval")
    read = dataset.table()
    assert 0 < read.valid.sum() < 16
    for name in columns("draw"):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
    assert read.split == "eval"
    assert ((read.draw_seed == read.seed) == read.valid).all()
