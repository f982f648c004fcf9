"""Demonstrations as a LeRobot data set: the same numbers, by episodes, with names, tasks and videos.

All but the first test need the extra `lerobot`: `make test-lerobot`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.dataset.lerobot import convert
from sceniris_gym.errors import MissingExtraError


def test_without_lerobot_the_error_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As for other extras."""
    monkeypatch.setitem(sys.modules, "lerobot", None)
    with pytest.raises(MissingExtraError, match=r"lerobot is not installed. .* pip install -e '.\[lerobot\]'"):
        convert(tmp_path, tmp_path / "out")


def write_demos(folder: Path) -> dict[str, Any]:
    """Write a folder of three demonstrations in two parts, and return its rows."""
    rng, lengths = np.random.default_rng(0), [5, 3, 4]
    observed = {"policy": [["arm", [2]], ["width", []]], "critic": [["all", [2, 2]]]}
    folder.mkdir()
    told = {
        "task": "Lift-v0",
        "language": "",
        "fps": 50,
        "observations": observed,
        "files": ["demos-0.npz", "demos-1.npz"],
    }
    (folder / "demos.json").write_text(json.dumps(told))
    shapes = {"observation/policy": (3,), "observation/critic": (4,), "action": (2,), "reward": ()}
    rows: dict[str, Any] = {name: rng.normal(size=(12, *shape)).astype(np.float32) for name, shape in shapes.items()}
    # smooth pictures, which a video keeps
    ramp = np.linspace(0, 255, 64, dtype=np.uint8)[None, :, None] // np.array([1, 2, 4], np.uint8)
    rows["image/overview/rgb"] = np.repeat(np.broadcast_to(ramp, (1, 64, 64, 3)), 12, axis=0)
    for file, first, last, length in (("demos-0.npz", 0, 8, lengths[:2]), ("demos-1.npz", 8, 12, lengths[2:])):
        part: dict[str, Any] = {name: values[first:last] for name, values in rows.items()}
        np.savez(folder / file, length=np.array(length), id=np.array(["a"] * len(length)), **part)
    return rows


def test_lerobot_reads_what_was_written(tmp_path: Path):
    """States, actions and rewards bit for bit, episodes and tasks in order, and frames of the videos."""
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason="needs lerobot: make test-lerobot")
    rows = write_demos(tmp_path / "demos")
    convert(tmp_path / "demos", tmp_path / "out")
    # PyAV brings its own FFmpeg, and torchcodec needs one of the system
    data = lerobot.LeRobotDataset("out", root=tmp_path / "out", video_backend="pyav")
    assert (data.num_episodes, data.num_frames, data.fps) == (3, 12, 50)
    assert data.features["observation.state"]["names"] == ["arm.0", "arm.1", "width.0"]
    frames = [data[i] for i in range(12)]
    for name, new in (("observation/policy", "observation.state"), ("action", "action"), ("reward", "next.reward")):
        read = np.array([frame[new].numpy() for frame in frames])
        np.testing.assert_array_equal(read.reshape(rows[name].shape), rows[name])
    assert [int(frame["episode_index"]) for frame in frames] == [0] * 5 + [1] * 3 + [2] * 4
    assert {frame["task"] for frame in frames} == {"Lift-v0"}
    picture = frames[6]["observation.images.overview"].numpy()
    np.testing.assert_allclose(picture, rows["image/overview/rgb"][6].transpose(2, 0, 1) / 255.0, atol=0.08)
