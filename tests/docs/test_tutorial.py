"""The tutorial: its files and commands, run in the order of the page with a training of seconds."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from tests.docs.walk import BLOCK, walk

PAGE = Path(__file__).parents[2] / "docs" / "tutorial.md"
SMALLER = {
    "--minutes 2": "--million-steps 0.0005 --device cpu",
    "--num-envs 64": "--num-envs 8",
    "-n 64": "-n 8",
    "num_envs=4)": "num_envs=4, device='cpu')",
}


@pytest.mark.slow
def test_every_step_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """From an empty folder to a policy that was judged; what the page says is printed is printed, and ids are right."""
    pytest.importorskip("rsl_rl", reason="needs the extra 'rsl-rl'")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    page, printed = PAGE.read_text(encoding="utf-8"), ""

    def heard(kind: str, text: str) -> None:
        nonlocal printed
        printed = capsys.readouterr().out or printed
        assert kind != "text" or printed.startswith(text)
        for first in re.findall(r"first one is (.+)", printed):
            assert f"replay {first} --scene" in page

    walk(PAGE, tmp_path, SMALLER, heard)
    failed = (tmp_path / "failed.txt").read_text().split()
    assert failed
    assert all(re.fullmatch(r"11b8031e193d8421:eval:\d+:0", name) for name in failed)
    assert (
        re.findall(r"^(\S+) of scene 'arm_scene'", capsys.readouterr().out, re.MULTILINE) == failed[:5]
    )  # then their number
    names = {path.name for path in tmp_path.iterdir()}
    assert {"layout.png", "arm.png", "failed.png", "results"} <= names
    sys.modules.pop("my_tasks")


def test_the_picture_takes_seven_steps():
    """As the page says, with at most one file or command each but for the two objects."""
    text = PAGE.read_text(encoding="utf-8").split("\n## ")[1]
    assert re.findall(r"\*\*Step (\d)\.\*\*", text) == list("1234567")
    assert len(BLOCK.findall(text)) == 9  # two objects, and a block of what is printed
    assert "seven steps" in PAGE.read_text(encoding="utf-8")
