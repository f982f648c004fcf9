"""The `suite` commands: the commands of the page, and what they refuse."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from sceniris_gym import RenderConfig, cli
from sceniris_gym.viewer import command
from tests.suites.conftest import suite, task

__all__ = ["suite", "task"]
PAGE = Path(__file__).parents[2] / "docs" / "evaluation.md"
STAND_INS = {
    "DrawerPick-v0": "SuiteReach-v0",
    "sceniris_gym/": "",
    "results/fresh": "tests.suites.conftest:act",
    "results/bank": "tests.suites.conftest:still",
    "my_policy": "tests.suites.conftest",
}
"""Names of the page, and smaller ones that stand in for them."""


def commands() -> list[str]:
    """Return the commands of the page's indented blocks."""
    return re.findall(r"^    (sceniris-gym suite .*|sceniris-gym view .*)$", PAGE.read_text(), re.MULTILINE)


def test_the_commands_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    """One after another, with a smaller task: suites, rows, a comparison with its plot, and films."""
    pytest.importorskip("imageio_ffmpeg", reason="needs the extra 'video'")
    pytest.importorskip("matplotlib", reason="needs the extra 'plots'")
    pytest.importorskip("viser", reason="needs the extra 'viewer'")
    monkeypatch.chdir(tmp_path)
    shown = []
    monkeypatch.setattr(cli, "show_page", lambda make, *_: shown.append(make) or cli.Answer(""))
    ran = []
    for line in commands():
        for name, other in STAND_INS.items():
            line = line.replace(name, other)
        words = shlex.split(line.partition(" #")[0])[1:]
        small = ["--cases", "1", "--grades", "1"] if words[1] == "make" else []
        small += ["--num-envs", "4"] if words[1] == "run" else []
        device = [] if words[1] in ("compare",) else ["--device", "cpu"]
        cli.main([*words, *small, *device])
        ran.append(words[1] if words[0] == "suite" else words[0])
    assert {*ran} == {"make", "run", "compare", "film", "view"}
    assert {path.suffix for path in tmp_path.rglob("*.*")} >= {".jsonl", ".png", ".mp4"}
    assert "p " in capsys.readouterr().out
    (make,) = shown
    assert make.func is command.view_env
    assert make.keywords["ids"]
    assert any("robot.joints" in key for key in make.keywords["overrides"])


def test_films_of_changed_suites_and_of_no_case_are_refused(
    suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    """And films without a camera, and a suite that exists already."""
    rows = tmp_path / "rows.jsonl"
    words = ["suite", "run", str(suite), "tests.suites.conftest:act", "-o", str(rows), "--device", "cpu"]
    head, *lines = suite.read_text().splitlines()
    suite.write_text("\n".join([head, lines[0]]) + "\n")
    cli.main(words)
    film = ["suite", "film", str(rows), "-o", str(tmp_path / "films"), "--device", "cpu"]
    monkeypatch.setattr("sceniris_gym.commands.suite.PICTURES", RenderConfig(num_envs=16, size=(8, 8), camera="none"))
    for change, more, message in (
        (lambda: None, (), "unknown camera 'none'"),
        (lambda: None, ("--failed",), "has no such case"),
        (lambda: suite.write_text(suite.read_text().replace('"tags": []', '"tags": ["a"]')), (), "changed since. Run"),
        (lambda: suite.unlink(), (), "should be a file of 'sceniris-gym suite'"),
    ):
        change()
        if more:
            text = rows.read_text().replace('"success": false', '"success": true')
            rows.write_text(text)
        with pytest.raises(SystemExit) as ended:
            cli.main([*film, *more])
        assert (ended.value.code, message in capsys.readouterr().err) == (2, True), message
    with pytest.raises(SystemExit):
        cli.main(["suite", "make", "SuiteReach-v0", "-o", str(rows), "--device", "cpu"])
    assert "exists" in capsys.readouterr().err


def test_names_of_suites_and_commands_are_checked(capsys: pytest.CaptureFixture):
    """With the nearest valid name."""
    for words, message in (
        (["suite", "mak"], "Did you mean 'suite make'"),
        (["suite"], "unknown command 'suite'"),
        (["suite", "run", "drawer_pik", "a:b"], "Did you mean 'drawer_pick'"),
        (["suite", "make", "SuiteReach-v0", "--grades", "6"], "--grades 6: should be at most 5"),
        (["suite", "make", "SuiteReach-v0", "--axes", "mass,"], "unknown axis ''"),
        (["suite", "make", "SuiteReach-v0", "--axes", "mas"], "Did you mean 'mass'"),
    ):
        with pytest.raises(SystemExit) as ended:
            cli.main(words)
        assert ended.value.code == 2
        assert message in capsys.readouterr().err


def test_json_has_the_shares(suite: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    """As one line."""
    head, *lines = suite.read_text().splitlines()
    suite.write_text("\n".join([head, *lines[:2]]) + "\n")
    cli.main(
        [
            "suite",
            "run",
            str(suite),
            "tests.suites.conftest:act",
            "-o",
            str(tmp_path / "r.jsonl"),
            "--device",
            "cpu",
            "--json",
        ]
    )
    found = json.loads(capsys.readouterr().out)
    assert [(one["axis"], one["cases"]) for one in found["parts"]] == [("all", 2), ("nominal", 2)]
