"""The demo: figures that belong together, and a picture of sixteen worlds."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sceniris_gym import cli
from sceniris_gym.commands.demo import report


@pytest.mark.slow
def test_the_demo_resets_worlds_and_shows_them(capfd: pytest.CaptureFixture, tmp_path: Path):
    """64 worlds three times: all valid, and the picture has four rows of four different tiles."""
    cli.main(["demo", "--out", str(tmp_path / "layouts.png"), "--device", "cpu", "--json"])
    figures = json.loads(capfd.readouterr().out)
    assert (figures["worlds"], figures["resets"]) == (64, 3)
    assert figures["valid"] == 1.0
    assert figures["first_pass_valid"] > 0.8
    assert figures["layouts_per_s"] > 100
    assert figures["rejections"]["banana"]["overhead"] > 0
    assert f"world 0 is {figures['hash']}:train:0:2" in report(figures)
    pixels = np.asarray(Image.open(tmp_path / "layouts.png")).astype(int)
    tiles = [tile for row in np.array_split(pixels, 4) for tile in np.array_split(row, 4, axis=1)]
    size = np.min([tile.shape for tile in tiles], axis=0)
    tiles = [tile[: size[0], : size[1]] for tile in tiles]
    assert min(np.abs(a - b).mean() for i, a in enumerate(tiles) for b in tiles[:i]) > 1.0
