"""The `view` command: the address comes first, Ctrl-C ends it, and wrong options are refused."""

from __future__ import annotations

import importlib.util
import signal
import socket
import subprocess
import sys
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from sceniris_gym.cli import main
from sceniris_gym.commands.options import read_ids
from sceniris_gym.errors import ArgumentError, ScenirisError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.params import ParamTable
from sceniris_gym.vector.vector_env import SceneVectorEnv
from sceniris_gym.viewer import env_view
from sceniris_gym.viewer.command import view_env
from tests.training.scenes import write_task
from tests.viewer.pages import free_port, page


@pytest.mark.skipif(importlib.util.find_spec("mjviser") is None, reason="needs the extra 'viewer'")
def test_the_address_comes_first_and_ctrl_c_ends_it():
    """Alone on stdout, before the scene is compiled; with status 130, and without a traceback."""
    port = free_port()
    command = [sys.executable, "-m", "sceniris_gym", "view", "mid", "--port", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == f"http://127.0.0.1:{port}\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert out == ""
    assert "Traceback" not in err


@pytest.mark.skipif(importlib.util.find_spec("mjviser") is None, reason="needs the extra 'viewer'")
def test_a_port_in_use_is_said():
    """The page takes the next free one, which would else be overlooked."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        command = [sys.executable, "-m", "sceniris_gym", "view", "mid", "--port", str(port)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            assert process.stderr is not None
            found = process.stdout.readline().strip().rpartition(":")[2]
            assert found != str(port)
            assert process.stderr.readline() == f"Port {port} is in use, so the page is at port {found}.\n"
        finally:
            process.kill()
            process.communicate()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "give either a SCENE or --env"),
        (["mid", "--env", "sceniris_gym/TabletopLift-v0"], "give either a SCENE or --env"),
        (["mid", "--policy", "a.pt"], "--policy and --layout need --env"),
        (["mid", "--num-envs", "65"], "--num-envs 65"),
        (["mid", "--port", "0"], "--port 0"),
        (["mid", "--seed", "-1"], "--seed -1"),
        (["--env", "sceniris_gym/TabletopLift-v0", "--seed", "5"], "need a SCENE"),
        (["mid", "--set", "objects"], "KEY=VALUE"),
    ],
)
def test_wrong_options_are_refused(options: list[str], words: str, capsys: pytest.CaptureFixture):
    """Before anything is opened."""
    with pytest.raises(SystemExit) as ended:
        main(["view", *options])
    assert ended.value.code == 2
    assert words in capsys.readouterr().err


def test_ids_come_from_options_and_files(tmp_path: Path):
    """A file has one a line."""
    (tmp_path / "failed.txt").write_text("a:train:1:0\nb:train:2:0\n")
    with pytest.raises(ArgumentError, match="should be a layout id"):
        read_ids(["nofile.txt"])
    assert read_ids(["c:eval:3:1", str(tmp_path / "failed.txt")]) == ["c:eval:3:1", "a:train:1:0", "b:train:2:0"]


@pytest.mark.skipif(importlib.util.find_spec("mjviser") is None, reason="needs the extra 'viewer'")
def test_a_task_of_ones_own_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As `module:ID`, which is imported from where the program is started, as `train` does."""
    task = write_task(tmp_path, "own_task_on_a_page")
    monkeypatch.chdir(tmp_path)
    shown: list[SceneVectorEnv] = []

    def show(_server: object, envs: SceneVectorEnv, *_: object) -> None:
        shown.append(envs)
        raise InterruptedError

    monkeypatch.setattr(env_view, "EnvView", show)
    with pytest.raises(InterruptedError):
        view_env(MagicMock(), task, None, [], num_envs=2, split="train", device="cpu")
    (envs,) = shown
    assert (type(envs.task).__name__, envs.num_envs) == ("Lower", 2)


@pytest.mark.skipif(importlib.util.find_spec("mjviser") is None, reason="needs the extra 'viewer'")
@pytest.mark.parametrize(("split", "shown"), [(None, "eval"), ("train", "train")])
def test_chosen_layouts_decide_the_split(split: str | None, shown: str, monkeypatch: pytest.MonkeyPatch):
    """Unless it is given: the failures that `evaluate` lists are of the split "eval"."""
    found: list[str] = []

    def show(_server: object, envs: SceneVectorEnv, *_: object) -> None:
        found.append(envs.split)
        raise InterruptedError

    monkeypatch.setattr(env_view, "EnvView", show)
    with pytest.raises(InterruptedError):
        view_env(
            *(MagicMock(), "sceniris_gym/TabletopReach-v0", None, ["0123456789abcdef:eval:1:0"]),
            **{"num_envs": 1, "split": split, "device": "cpu"},
        )
    assert found == [shown]


@pytest.mark.skipif(importlib.util.find_spec("mjviser") is None, reason="needs the extra 'viewer'")
def test_layouts_with_params_are_shown():
    """The page makes worlds with the params that the ids have, so it shows the layout of each."""
    compiled = compile_scene("tabletop_reach", "cpu")
    names = ("objects.apple.region", "objects.can.region")
    table = ParamTable(compiled, names)
    rows = table.rows({names[0]: [[0.0, -0.1], [0.1, 0.0]]}, 1), table.rows({names[1]: [[0.3, 0.0], [0.4, 0.2]]}, 1)
    ids = [compiled.layout_id(i, 0, "eval", table.text(row[0])) for i, row in enumerate(rows)]
    with page() as server:
        view = view_env(server, "sceniris_gym/TabletopReach-v0", None, ids, num_envs=2, device="cpu")
        assert view.envs.layout_ids() == ids
        view.envs.close()


@pytest.mark.parametrize(
    ("env", "error", "words"),
    [
        ("nowhere_at_all:Task-v0", ArgumentError, "'nowhere_at_all' should be a module that Python can import"),
        ("sceniris_gym/DrawerPik-v0", UnknownNameError, "--env sceniris_gym/DrawerPik-v0: .*Did you mean 'DrawerPick"),
    ],
)
def test_what_is_no_environment_is_refused(env: str, error: type[ScenirisError], words: str):
    """With what could not be imported, or with the nearest id."""
    with pytest.raises(error, match=words):
        view_env(MagicMock(), env, None, [], num_envs=1, split="train", device="cpu")
