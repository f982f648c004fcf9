"""Messages of commands: a full disk, a folder for kernels that cannot be written, and warnings, each in words."""

import errno
import os
import warnings
from pathlib import Path

import pytest

from sceniris_gym import cli
from sceniris_gym.errors import ScenirisWarning


def test_a_full_disk_is_told_in_words(capfd: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The error has the system's words, and no half written file is left."""

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(SystemExit) as stop:
        cli.main(["generate", "mid", "-n", "1", "-o", str(tmp_path), "--device", "cpu"])
    assert stop.value.code == 2
    assert "scene.zip cannot be written: no space left on device. Give --out" in capfd.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [".progress"]


@pytest.mark.parametrize("code", [errno.EACCES, errno.EPERM, errno.ENOENT])
def test_a_folder_for_kernels_that_cannot_be_written_is_told_with_the_way_out(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
):
    """Whichever folder on the way to it the system names; an input that is missing keeps its own words."""
    file = tmp_path / "kernels"

    def start() -> None:
        raise OSError(code, os.strerror(code), str(file))

    monkeypatch.setattr("sceniris_gym.device.kernel_log.start_warp", start)
    for cache, unwritable in ((tmp_path / "kernels" / "1.0", True), (tmp_path, False)):
        monkeypatch.setattr("warp.config.kernel_cache_dir", str(cache))
        with pytest.raises(SystemExit) as stop:
            cli.main(["demo"])
        err = capfd.readouterr().err
        assert stop.value.code == 2
        assert f"{file}: " in err
        assert os.strerror(code).lower() in err
        assert ("kernels cannot be written" in err) is unwritable
        assert ("Set WARP_CACHE_PATH to a folder" in err) is unwritable


def test_a_warning_is_one_line(capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """Without the place in the code, and once for each text."""

    def warned() -> cli.Answer:
        for text in ("half.yaml: few", "half.yaml: few", "other.yaml: few"):
            warnings.warn(text, ScenirisWarning, stacklevel=1)
        return cli.Answer("done")

    monkeypatch.setitem(cli.COMMANDS, "demo", warned)
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        cli.main(["demo"])
    assert capfd.readouterr().err == "warning: half.yaml: few\nwarning: other.yaml: few\n"
