"""The state of a long build in a file: what was done is not done again, and nothing of another build is taken."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.errors import MapError, OutputError
from sceniris_gym.reach import checkpoint
from sceniris_gym.reach.checkpoint import Checkpoint


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write at every step."""
    monkeypatch.setattr(checkpoint, "_SECONDS", 0.0)


def _work(state: Path | None, stop: tuple[str, int] | None = None) -> tuple[dict[str, np.ndarray], list[str]]:
    """Fill two arrays in two tasks of five steps each, and note the steps; stop within a task, or never."""
    arrays = {"first": np.zeros(5), "second": np.zeros((5, 2), np.uint8)}
    done: list[str] = []
    progress = Checkpoint(state, "a build")
    for task, array in arrays.items():
        if not progress.enter(task, {task: array}):
            continue
        for i in range(progress.done, 5):
            if (task, i) == stop:
                return arrays, done
            array[i] = 10 * i + len(task)
            done.append(f"{task} {i}")
            progress.reached(i + 1)
        progress.leave(task)
    return arrays, done


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("stop", [(task, i) for task in ("first", "second") for i in (0, 1, 4)], ids=str)
def test_what_was_stopped_goes_on_and_ends_as_if_it_had_not_been(
    tmp_path: Path, stop: tuple[str, int], capsys: pytest.CaptureFixture
):
    """Every step is done once, and both arrays are filled as by one build without a stop. A line names the file."""
    whole, steps = _work(None)
    before = _work(tmp_path / "state", stop)[1]
    found, after = _work(tmp_path / "state")
    assert before + after == steps
    assert all(np.array_equal(found[name], whole[name]) for name in whole)
    assert all(found[name].dtype == whole[name].dtype for name in whole)
    said = f"sceniris_gym: {tmp_path / 'state'} keeps the progress, so the same command resumes.\n"
    assert capsys.readouterr().err == said


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("done", [10**12, 6, -1])
def test_more_than_there_is_cannot_be_done(tmp_path: Path, done: int):
    """The task would be passed over, and its arrays stay empty."""
    stopped = Checkpoint(tmp_path / "state", "a build")
    stopped.enter("first", {"first": np.zeros(5)}, 5)
    stopped.reached(done)
    with pytest.raises(MapError, match=f"'first' has 5 parts, but {done} are stored as done. Remove the file"):
        Checkpoint(tmp_path / "state", "a build").enter("first", {"first": np.zeros(5)}, 5)


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("array", [np.zeros(4), np.zeros((1, 5)), np.zeros(5, np.float32)])
def test_arrays_of_another_form_are_refused(tmp_path: Path, array: np.ndarray):
    """One that NumPy would broadcast, too."""
    stopped = Checkpoint(tmp_path / "state", "a build")
    stopped.enter("first", {"first": array})
    stopped.reached(1)
    with pytest.raises(MapError, match=r"'first' should be float64 \(5,\), got"):
        Checkpoint(tmp_path / "state", "a build").enter("first", {"first": np.zeros(5)})


@pytest.mark.usefixtures("hasty")
def test_what_is_finished_is_not_done_again(tmp_path: Path):
    """Its arrays come back whole."""
    whole, _ = _work(tmp_path / "state")
    found, steps = _work(tmp_path / "state")
    assert steps == []
    assert all(np.array_equal(found[name], whole[name]) for name in whole)


def test_a_build_writes_now_and_then_and_not_at_every_step(tmp_path: Path):
    """Within the first minute nothing; without a path never."""
    _work(tmp_path / "state")
    assert not (tmp_path / "state").exists()


@pytest.mark.usefixtures("hasty")
def test_a_build_that_keeps_nothing_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """No file appears anywhere."""
    monkeypatch.chdir(tmp_path)
    _work(None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("hasty")
def test_a_write_that_fails_leaves_the_state_before_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The disk is full in the middle of a write: the build goes on from the last whole one."""
    _work(tmp_path / "state", ("first", 3))
    with monkeypatch.context() as patch:

        def full(file: object, **arrays: object) -> None:
            raise OSError("no space left")

        patch.setattr(np, "savez", full)
        with pytest.raises(OSError, match="no space left"):
            _work(tmp_path / "state")
    assert _work(tmp_path / "state")[1][0] == "first 3"
    assert [path.name for path in tmp_path.iterdir()] == ["state"]


@pytest.mark.usefixtures("hasty")
def test_the_state_of_another_build_is_refused_and_kept(tmp_path: Path):
    """Its file is as it was, and the message says what may be done."""
    state = tmp_path / "state"
    _work(state, ("second", 2))
    before = state.read_bytes()
    with pytest.raises(MapError, match=r"state: .*different build.*Remove the file"):
        Checkpoint(state, "another build")
    assert state.read_bytes() == before


@pytest.mark.usefixtures("hasty")
@pytest.mark.parametrize("share", [0.0, 0.2, 0.6, 0.99])
def test_a_file_that_is_no_state_is_refused(tmp_path: Path, share: float):
    """Cut off anywhere, a text, an array, or another archive."""
    state = tmp_path / "state"
    _work(state, ("second", 2))
    state.write_bytes(state.read_bytes()[: int(share * state.stat().st_size)])
    other = tmp_path / "other.npz"
    np.savez(other, allow_pickle=False, values=np.zeros(3))
    text = tmp_path / "text"
    text.write_text("nothing")
    for path in (state, other, text):
        with pytest.raises(MapError, match="not the saved state of a build"):
            Checkpoint(path, "a build")


@pytest.mark.usefixtures("hasty")
def test_nothing_is_left_of_a_process_that_was_killed(tmp_path: Path):
    """It was writing its state; the next build removes that file before it writes anything itself."""
    program = "import os, pathlib, sys; from sceniris_gym.files import replacing\n"
    program += "with replacing(pathlib.Path(sys.argv[1])) as file:\n    file.touch()\n    os._exit(0)"
    subprocess.run([sys.executable, "-c", program, str(tmp_path / "state")], check=True)
    assert list(tmp_path.iterdir())
    Checkpoint(tmp_path / "state", "a build")
    assert not list(tmp_path.iterdir())


def test_a_state_that_cannot_be_written_is_refused_at_once(tmp_path: Path):
    """Not after the first minute of the build."""
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="state"):
        Checkpoint(tmp_path / "file" / "state", "a build")
