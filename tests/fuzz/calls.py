"""Calls and files gone wrong: arguments of every kind, YAML, maps and data sets with bytes that were changed."""

from __future__ import annotations

import functools
import io
import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import warp as wp

from sceniris_gym.commands.reach import read_poses
from sceniris_gym.commands.replay import LayoutId
from sceniris_gym.config.fields import short
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.dataset.manifest import MANIFEST, part_name, row_of
from sceniris_gym.dataset.reader import LayoutDataset, verify
from sceniris_gym.layout.compile import compile_scene, device_name
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.masks import as_rows, as_worlds
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.map import ReachMap
from sceniris_gym.vector.arguments import as_action, as_autoreset_mode, as_reset_mask, as_reset_seeds
from sceniris_gym.vector.ranks import Rank
from sceniris_gym.vector.settings import as_size
from tests.fuzz.scenes import base_scene, write_assets
from tests.fuzz.values import value
from tests.reach.shapes import gantry


@functools.cache
def compiled() -> CompiledScene:
    """A scene that all calls are about."""
    folder = Path(tempfile.mkdtemp())
    write_assets(folder)
    return compile_scene(base_scene(folder), "cpu")


@functools.cache
def generator() -> LayoutGenerator:
    """Layouts of it."""
    return LayoutGenerator(compiled(), 4)


@functools.cache
def _arm() -> SerialArm:
    return gantry()[1]


def some_array(draws: np.random.Generator) -> Any:
    """An array of some library, of a shape and type that may fit."""
    shape = [(4,), (4, 1), (3,), (), (0,), (4, 4)][int(draws.integers(6))]
    dtype = [bool, np.int64, np.float32, np.uint8, np.uint64][int(draws.integers(5))]
    array = np.ones(shape, dtype)
    forms: list[Callable[[], Any]] = [
        lambda: array,
        lambda: array[::-1] if array.ndim else array,
        lambda: np.ma.array(array),
        lambda: array.tolist(),
        lambda: torch.ones(shape, dtype=torch.bool),
        lambda: torch.ones(shape, dtype=torch.bool, device="meta"),
        lambda: torch.ones(shape, dtype=torch.int32).to_sparse(),
        lambda: wp.ones(max(len(shape), 1), dtype=wp.bool, device="cpu"),
        lambda: value(draws),
    ]
    return forms[int(draws.integers(len(forms)))]()


def _calls(draws: np.random.Generator) -> list[Callable[[], object]]:
    cpu, space = torch.device("cpu"), _space()
    wrong, array = (lambda: value(draws)), (lambda: some_array(draws))
    return [
        lambda: SceneConfig.load(wrong()),
        lambda: SceneConfig.load({"objects": {}}, wrong()),
        lambda: SceneConfig.load({"objects": {}}, {short(wrong()): wrong()}),
        lambda: device_name(wrong()),
        lambda: LayoutGenerator(compiled(), wrong()) if not _large(draws) else None,
        lambda: LayoutGenerator(compiled(), 1, seed=wrong()),
        lambda: LayoutGenerator(compiled(), 1, split=wrong()),
        lambda: LayoutGenerator(wrong(), 1),
        lambda: generator().reseed(seed=array()),
        lambda: generator().reseed(array(), seed=0),
        lambda: generator().generate(array()),
        lambda: as_worlds(array(), 4, wp.get_device("cpu")),
        lambda: as_rows(array(), 4, 4, wp.get_device("cpu")),
        lambda: as_reset_mask({"reset_mask": array()}, 4),
        lambda: as_reset_seeds(array(), 4, Rank(), first=True),
        lambda: as_action(array(), space, cpu),
        lambda: as_size(wrong(), "size"),
        lambda: as_autoreset_mode(wrong()),
        lambda: LayoutId.parse(short(wrong())),
    ]


def _large(draws: np.random.Generator) -> bool:
    """Leave a tenth of the counts out at random, so that the rest vary."""
    return bool(draws.random() < 0.1)


@functools.cache
def _space() -> Any:
    from gymnasium.spaces import Box

    return Box(-1.0, 1.0, (4, 3), np.float32)


def wrong_call(draws: np.random.Generator) -> None:
    """Call something with what it does not take, or does by chance."""
    calls = _calls(draws)
    calls[int(draws.integers(len(calls)))]()


def wrong_file(draws: np.random.Generator, folder: Path) -> None:
    """Read a scene, a map, poses or a data set from a file in which bytes were changed, or that is no such file."""
    path = folder / "file"
    match int(draws.integers(5)):
        case 0:
            text = json.dumps(base_scene(folder), indent=1).encode()
            path.write_bytes(changed(text, draws))
            SceneConfig.load(path)
        case 1:
            path.write_bytes(changed(_map_bytes(draws), draws))
            ReachMap.load(path, _arm())
        case 2:
            path.write_bytes(_map_bytes(draws))
            ReachMap.load(path, _arm())
        case 3:
            _wrong_dataset(draws, folder)
        case _:
            file = io.BytesIO()
            np.save(file, np.tile(np.eye(4), (3, 1, 1)))
            path.write_bytes(changed(file.getvalue(), draws))
            read_poses(path)


def _wrong_dataset(draws: np.random.Generator, folder: Path) -> None:
    """Read a data set of two parts in which a word of the manifest is anything, or bytes of a file were changed."""
    columns = {"seed": ("uint64", []), "qpos": ("float32", [3]), "mocap_pos": ("float32", [0, 3])}
    columns |= {"mocap_quat": ("float32", [0, 4]), "present": ("bool", [2])}
    held: dict[str, Any] = {
        **{"format": 1, "scene": "mid", "hash": "0", "split": "train", "seed": 0, "layouts": 7, "rows_of_a_part": 4},
        "columns": {name: {"dtype": kind, "shape": shape} for name, (kind, shape) in columns.items()},
        **{
            "object_names": ["a"],
            "reachable_names": [],
            "formats": [],
            "versions": {},
            "scene_sha256": "0",
            "files": {},
        },
        "parts": [{"rows": n, "sha256": "0", "files": {}, "valid": n, "first_pass_valid": n} for n in (4, 3)],
    }
    for part, n in enumerate((4, 3)):
        np.save(folder / part_name(part), np.zeros(n, row_of(held["columns"])))
    path = folder / (MANIFEST, part_name(0), part_name(1))[int(draws.integers(3))]
    if path.name == MANIFEST and draws.random() < 0.5:
        inside = (held, held["columns"]["qpos"], held["parts"][1])[int(draws.integers(3))]
        inside[list(inside)[int(draws.integers(len(inside)))]] = value(draws)
    try:
        (folder / MANIFEST).write_text(json.dumps(held))
    except (TypeError, ValueError, RecursionError):  # JSON has no such value
        return
    if draws.random() < 0.7:
        path.write_bytes(changed(path.read_bytes(), draws))
    dataset = LayoutDataset(folder)
    dataset.rows(range(len(dataset)))
    dataset.table()
    verify(folder)


def changed(text: bytes, draws: np.random.Generator) -> bytes:
    """The same bytes with some changed, cut off, or put in."""
    found = bytearray(text)
    for _ in range(int(draws.integers(1, 8))):
        at = int(draws.integers(len(found) or 1))
        match int(draws.integers(4)):
            case 0 if found:
                found[at] = int(draws.integers(256))
            case 1:
                del found[at : at + int(draws.integers(1, 40))]
            case 2:
                found[at:at] = draws.bytes(int(draws.integers(1, 9)))
            case _:
                found[at:at] = b"[{&*<:!%"[int(draws.integers(8)) :][:1] * int(draws.integers(1, 50))
    return bytes(found)


def _map_bytes(draws: np.random.Generator) -> bytes:
    """A map of the right form, one field of which may be anything."""
    arm = _arm()
    held: dict[str, Any] = {
        **{"step": 0.1, "tilt_step": 0.5, "z_low": 0.0, "u_low": -0.5, "nz": 3, "ntilt": 3, "nu": 3, "pole_step": 0.1},
        **{"pole_z_low": 0.0, "turn_error": 0.0, "seed": 0, "format": 1, "arm": arm.hash},
        "rows": np.zeros((9, 3), np.int32),
        "codes": np.ones(2, np.uint32),
        "poles": np.ones((2, 3, 3), np.uint8),
        "wit_cells": np.zeros((1, 1, 1, 1, 2), np.int32),
        "wit_joints": np.zeros((1, len(arm.joints)), np.float16),
    }
    name = list(held)[int(draws.integers(len(held)))]
    if isinstance(held[name], np.ndarray) and draws.random() < 0.5:
        held[name].flat[0] = int(draws.integers(0, 100))
    elif draws.random() < 0.7:
        found = value(draws)
        held[name] = found if isinstance(found, int | float | str) and abs(hash(found)) >= 0 else 0
    file = io.BytesIO()
    try:
        np.savez(file, allow_pickle=False, **held)
    except (ValueError, OverflowError):  # NumPy keeps no such value
        return b""
    return file.getvalue()
