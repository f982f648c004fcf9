"""The page on one's own arm and mesh: its files and commands, run in its order with an arm of six axes and a bottle."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.docs.walk import BLOCK, walk

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "own_arm.md"
SMALLER = {
    "--minutes 5": "--million-steps 0.00005 --device cpu",
    "--num-envs 64": "--num-envs 4",
    "--num-envs 16": "--num-envs 4",
    "-n 64": "-n 4",
    "-n 16": "-n 4",
    "num_envs=64": "num_envs=4, device='cpu'",
    "num_envs=8": "num_envs=8, device='cpu'",
    "n_steps=24, batch_size=384": "n_steps=24, batch_size=48",
    "max_episode_steps=150": "max_episode_steps=6",
    "(64, 64)": "(24, 24)",
    "learn(20_000": "learn(96",
    "sceniris-gym check pick_bottle.yaml": "sceniris-gym check pick_bottle.yaml -n 256 --device cpu",
}


def masked(text: str) -> str:
    """Return a text without its numbers, hashes and runs of blanks."""
    return re.sub(r" +", " ", re.sub(r"\b[0-9a-f]{16}\b|\d[\d.,]*", "#", text))


@pytest.mark.slow
def test_every_step_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """From the two files to three policies: outputs begin as the page has them, and pictures show what they should."""
    for library in ("rsl_rl", "stable_baselines3", "coacd", "imageio_ffmpeg"):
        pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "arm.xml").write_bytes((ROOT / "tests" / "data" / "six_axes.xml").read_bytes())
    profile = [[0, 0], [2.8, 0], [2.8, 11], [1.3, 14], [1.3, 18], [0, 18]]  # radius and height, cm
    trimesh.creation.revolve(profile, sections=24).export(tmp_path / "bottle.obj")
    sizes, printed = dict(SMALLER), ""

    def heard(kind: str, text: str) -> None:
        nonlocal printed
        printed = capsys.readouterr().out or printed
        for first in re.findall(r"first one is (.+)", printed):
            sizes["replay ID"] = f"replay {first}"
        if text.startswith("sceniris-gym check"):
            task = tmp_path / "pick_bottle.py"
            task.write_text(task.read_text().replace('"max_episode_steps": 150', '"max_episode_steps": 6'))
        assert kind != "text" or masked(printed).startswith(masked(text).rstrip())

    walk(PAGE, tmp_path, sizes, heard)
    wider = [line for line in capsys.readouterr().out.splitlines() if ":objects.target.region=" in line]
    assert len({line.rpartition("=")[2] for line in wider}) == 3
    sides = [float(line[len("tensor(") : line.index(")")]) for line in wider]
    assert all(0.0 < side <= most + 1e-4 for side, most in zip(sides, (0.05, 0.1, 0.2), strict=True))
    names = {path.name for path in tmp_path.iterdir()}
    assert {"bottle.xml", "demo", "failed.png", "bottle.mp4", "wrist.png", "sb3.zip", "normalize.pkl"} <= names
    wrist = np.asarray(Image.open(tmp_path / "wrist.png"))
    assert wrist.shape == (24, 8 * 24, 3)
    assert wrist.std() > 10.0
    sys.modules.pop("pick_bottle")


def test_a_step_is_short():
    """Eight steps, each block at most a few lines that can be copied."""
    page = PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^## (\d)\. ", page, re.MULTILINE) == list("12345678")
    assert [block["text"] for block in BLOCK.finditer(page) if block["text"].count("\n") > 12] == []
    assert 450 <= len(page.split()) <= 650
