"""One line about compiling, instead of Warp's own about every module."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import warp as wp

from sceniris_gym.device import kernel_log
from sceniris_gym.device.kernel_log import KernelLog, tell_of_compiling, use_kernel_log


@wp.kernel(module="unique")
def _count(out: wp.array[int]):
    out[0] = out[0] + 1


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nobody was told of anything yet, and Warp has its own logger before and after."""
    monkeypatch.setattr(kernel_log, "_told", set())
    monkeypatch.setattr(wp.config, "log_level", wp.LOG_INFO)  # commands raise it
    wp.init()
    before = wp.get_logger()
    wp.set_logger(None)
    yield
    wp.set_logger(before)


@pytest.mark.parametrize(("long", "told"), [(0.0, True), (1e6, False)])
def test_warp_s_lines_about_modules_are_one_of_ours(
    long: float, told: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    """Warp compiles a kernel and then loads it: nothing on stdout, and a line on stderr if it took long."""
    monkeypatch.setattr(kernel_log, "_LONG", long)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    use_kernel_log()
    for _ in range(2):
        _count.module.unload()
        wp.launch(_count, dim=1, inputs=[wp.zeros(1, dtype=int, device="cpu")], device="cpu")
    said = capsys.readouterr()
    assert list(tmp_path.iterdir())
    assert said.out == ""
    assert said.err.count("\n") == told
    assert ("compiling kernels for 'cpu'" in said.err and str(tmp_path) in said.err) is told


def test_all_else_is_passed_on(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """Other lines always, and those about modules to whoever asks for all that Warp says."""
    log = KernelLog(wp.get_logger())
    line = "Module thing 1234567 load on device 'cpu' took 2.15 ms  (cached)"
    log.info("Warp initialized")
    log.info(line)
    log.error("broken")
    said = capsys.readouterr()
    assert said.out == "Warp initialized\n"
    assert "broken" in said.err
    monkeypatch.setattr(wp.config, "log_level", wp.LOG_DEBUG)
    log.info(line)
    assert capsys.readouterr().out == f"{line}\n"


def test_a_logger_of_the_user_s_own_stays():
    """And ours is put before Warp's only once."""
    use_kernel_log()
    first = wp.get_logger()
    use_kernel_log()
    assert isinstance(first, KernelLog)
    assert wp.get_logger() is first

    class Mine:
        def debug(self, message: str) -> None: ...

        def info(self, message: str) -> None: ...

        def warning(self, message: str, category=None, stacklevel: int = 1) -> None: ...

        def error(self, message: str) -> None: ...

    mine = Mine()
    wp.set_logger(mine)
    use_kernel_log()
    assert wp.get_logger() is mine


def test_each_device_is_told_of_once(capsys: pytest.CaptureFixture):
    """However often kernels are compiled for it."""
    for device in ("cpu", "cuda:0", "cpu"):
        tell_of_compiling(device, 3)
    said = capsys.readouterr().err.splitlines()
    assert ["'cpu' (3 modules" in line for line in said] == [True, False]
    assert ["'cuda:0' (3 modules" in line for line in said] == [False, True]
