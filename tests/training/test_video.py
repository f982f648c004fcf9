"""Videos: a grid of worlds in real time, in which a world stops with its episode."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from sceniris_gym.training.video import COLUMNS, PICTURES, filming


def test_a_world_keeps_the_last_picture_of_its_episode(tmp_path: Path):
    """Of five worlds that become brighter, the second ends after the first frame; the other tiles are black."""
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed (extra 'video')")
    width, height = PICTURES.size
    envs: Any = SimpleNamespace(metadata={"render_fps": 20}, grey=50)
    envs.render = lambda: tuple(np.full((5, height, width, 3), envs.grey, np.uint8))
    running = torch.ones(5, dtype=torch.bool)
    with filming(tmp_path / "a.mp4", envs) as add:
        for grey, runs in ((50, True), (200, False)):
            envs.grey, running[1] = grey, runs
            add(running)
    about, *frames = ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    assert (about["size"], about["fps"], len(frames)) == ((COLUMNS * width, COLUMNS * height), 20, 2)
    last = np.frombuffer(frames[1], np.uint8).reshape(COLUMNS, height, COLUMNS, width, 3)
    tiles = last.mean(axis=(1, 3, 4)).ravel()
    np.testing.assert_allclose(tiles, [200, 50, 200, 200, 200, *[0] * 11], atol=6)


def test_a_failure_leaves_no_file(tmp_path: Path):
    """Nor half a video."""
    pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed (extra 'video')")
    # pyrefly: ignore[bad-argument-type]
    with pytest.raises(RuntimeError), filming(tmp_path / "a.mp4", SimpleNamespace(metadata={"render_fps": 20})):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
