"""The tutorial: its files and commands, run in the order of the page with a training of seconds."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import pytest

from sceniris_gym import cli

PAGE = Path(__file__).parents[2] / "docs" / "tutorial.md"
BLOCK = re.compile(r'^```(?P<kind>\w+)(?: title="(?P<title>[^"]+)")?\n(?P<text>.*?)^```$', re.MULTILINE | re.DOTALL)
SMALLER = {
    "--minutes 2": "--million-steps 0.0005 --device cpu",
    "--num-envs 64": "--num-envs 8",
    "-n 64": "-n 8",
    "num_envs=64": "num_envs=8",
    "envs, 64)": "envs, 8)",
    "num_envs=4)": "num_envs=4, device='cpu')",
}
ELSEWHERE = ("pip install ", "mkdir ", "cd ")  # the package is installed, and the folder is the test's


def smaller(text: str) -> str:
    """Return a command or program with fewer worlds, layouts and steps."""
    for before, after in SMALLER.items():
        text = text.replace(before, after)
    return text


def run(command: str, folder: Path) -> None:
    """Run one line of the page."""
    words = shlex.split(smaller(command))
    if words[0] == "sceniris-gym":
        cli.main(words[1:])
    elif words[0] == "python":
        exec(compile(smaller((folder / words[1]).read_text()), words[1], "exec"), {})
    else:
        assert command.startswith(ELSEWHERE), command


@pytest.mark.slow
def test_every_step_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    """From an empty folder to a policy that was judged; what the page says is printed is printed, and ids are right."""
    pytest.importorskip("rsl_rl", reason="needs the extra 'rsl-rl'")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    printed = ""
    for block in BLOCK.finditer(PAGE.read_text(encoding="utf-8")):
        kind, title, text = block["kind"], block["title"], block["text"]
        if kind == "text":
            assert printed.startswith(text)
        elif title:
            (tmp_path / title).write_text(text, encoding="utf-8")
        elif kind == "python":
            exec(compile(smaller(text), str(PAGE), "exec"), {})
        else:
            for command in text.splitlines():
                run(command, tmp_path)
                printed = capsys.readouterr().out
                if command.startswith("sceniris-gym check"):
                    (first,) = re.findall(r"first one is (.+)", printed)
                    assert f"replay {first} --scene" in PAGE.read_text(encoding="utf-8")
    assert re.fullmatch(r"\d of 8 layouts failed:( 11b8031e193d8421:eval:\d:0)*\n", printed)
    names = {path.name for path in tmp_path.iterdir()}
    assert {"layout.png", "arm.png", "verdicts.json", "results"} <= names
    sys.modules.pop("my_tasks")


def test_the_picture_takes_seven_steps():
    """As the page says, with at most one file or command each but for the two objects."""
    text = PAGE.read_text(encoding="utf-8").split("\n## ")[1]
    assert re.findall(r"\*\*Step (\d)\.\*\*", text) == list("1234567")
    assert len(BLOCK.findall(text)) == 9  # two objects, and a block of what is printed
    assert "seven steps" in PAGE.read_text(encoding="utf-8")
