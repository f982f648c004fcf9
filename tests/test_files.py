"""Files that are whole or not there, and paths that are refused before the work."""

import errno
import json
import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest

from sceniris_gym.errors import NotSupportedError, OutputError
from sceniris_gym.files import (
    as_json,
    check_picture,
    check_writable,
    no_file,
    opened,
    read_bytes,
    replacing,
    write_text,
)


def test_a_file_is_replaced_when_the_block_ends(tmp_path: Path):
    """Until then the old one is there, and nothing is left beside it."""
    path = tmp_path / "new" / "folder" / "file.txt"
    for words in ("first", "second"):
        before = path.read_text() if path.exists() else None
        with replacing(path) as temporary:
            temporary.write_text(words)
            assert (path.read_text() if path.exists() else None) == before
        assert path.read_text() == words
    write_text(path, "third")
    assert path.read_text() == "third"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(("umask", "mode"), [(0o077, 0o600), (0o022, 0o644), (0o002, 0o664)])
def test_others_may_do_with_a_file_what_the_user_lets_them(tmp_path: Path, umask: int, mode: int):
    """The umask holds for what is written here, as for what any program writes."""
    before = os.umask(umask)
    try:
        write_text(tmp_path / "file.txt", "words")
    finally:
        os.umask(before)
    assert (tmp_path / "file.txt").stat().st_mode & 0o777 == mode


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_block_that_is_stopped_leaves_the_old_file(tmp_path: Path, stop: type[BaseException]):
    """By an error or by the user: half of the new one is nowhere."""
    path = tmp_path / "file.txt"
    path.write_text("old")

    def write() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half of the ne")
            raise stop

    with pytest.raises(stop):
        write()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_path_that_can_be_written_is_let_through_and_left_alone(tmp_path: Path):
    """Neither the file nor its folders are made, and one that is there is not touched."""
    check_writable(tmp_path / "a" / "b" / "file.txt")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "old.txt").write_text("old")
    check_writable(tmp_path / "old.txt")
    assert (tmp_path / "old.txt").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_path_that_cannot_be_written_is_named(tmp_path: Path):
    """A folder, and a file inside of a file; checked before, or found out when written."""
    (tmp_path / "file").write_text("kept")
    with pytest.raises(OutputError, match=f"{tmp_path}.* folder"):
        check_writable(tmp_path)
    inside = tmp_path / "file" / "inside.txt"
    with pytest.raises(OutputError, match=r"inside\.txt"):
        check_writable(inside)
    with pytest.raises(OutputError, match=r"inside\.txt"), replacing(inside):
        pytest.fail("there is nothing to write to")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("name", ["picture.jpg", "picture", "picture.png.pdf"])
def test_a_picture_ends_with_png(tmp_path: Path, name: str):
    """In capitals too; another suffix is named, with the right one."""
    check_picture(tmp_path / "picture.png")
    check_picture(tmp_path / "picture.PNG")
    with pytest.raises(NotSupportedError, match=rf"{name}.*\.png"):
        check_picture(tmp_path / name)
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(OutputError, match="folder"):
        check_picture(tmp_path / "folder.png")


def test_what_a_killed_process_left_behind_is_removed(tmp_path: Path):
    """By the next one that writes the same file; files of running processes and of other machines stay."""
    script = (
        "import os, sys; from pathlib import Path; from sceniris_gym.files import replacing\n"
        "with replacing(Path(sys.argv[1])) as file: file.write_text('half'); os.kill(os.getpid(), 9)"
    )
    target = tmp_path / "layouts.npz"
    subprocess.run([sys.executable, "-c", script, str(target)], check=False)
    (left,) = tmp_path.iterdir()
    assert left.name.endswith(".tmp")
    boot = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    assert boot in left.name
    other = tmp_path / left.name.replace(boot, "another")
    other.touch()
    with replacing(target) as file:
        assert not left.exists()
        assert file.exists()
        with replacing(target) as beside:
            assert file.exists()
            beside.write_text("first")
        file.write_text("whole")
    assert target.read_text() == "whole"
    assert sorted(tmp_path.iterdir()) == sorted([target, other])


def test_a_file_of_another_container_is_not_removed(tmp_path: Path):
    """A process there does not know the number of one here, which may still write."""
    script = (
        "import sys; from pathlib import Path; from sceniris_gym.files import *; write_text(Path(sys.argv[1]), 'x')"
    )
    target, apart = tmp_path / "part.npy", ["unshare", "--pid", "--fork", "--mount-proc"]
    try:
        subprocess.run([*apart, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("needs the right to make a namespace of processes")
    with replacing(target) as file:
        subprocess.run([*apart, sys.executable, "-c", script, str(target)], check=True)
        assert target.read_text() == "x"
        assert file.exists()
        file.write_text("here")
    assert target.read_text() == "here"


def test_what_may_have_no_end_is_not_read(tmp_path: Path):
    """Neither a device, nor a pipe to which nobody writes, nor a link to one."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/zero")
    (tmp_path / "file").write_text("words")
    assert read_bytes(tmp_path / "file") == b"words"
    for path in (tmp_path, tmp_path / "pipe", tmp_path / "link"):
        with pytest.raises(OSError, match="a folder, a pipe or a device, not a file"):
            read_bytes(path)


def test_a_file_that_others_may_write_is_no_file_of_ones_own(tmp_path: Path):
    """By its permissions or by its owner; what the system's administrator wrote counts as one's own."""
    path = tmp_path / "file"
    path.write_text("words")
    for mode, mine in ((0o600, True), (0o644, True), (0o664, False), (0o646, False)):
        path.chmod(mode)
        with nullcontext() if mine else pytest.raises(OSError, match="no other user may write to"):
            opened(path, own=True).close()
    path.chmod(0o600)
    if os.geteuid() == 0:
        os.chown(path, 12345, -1)
        with pytest.raises(OSError, match="no other user may write to"):
            opened(path, own=True)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_a_full_disk_is_told_with_its_file(tmp_path: Path, number: int):
    """And nothing is left behind."""
    with pytest.raises(OutputError, match=r"a\.png cannot be written: .*Give --out"), replacing(tmp_path / "a.png"):
        raise OSError(number, os.strerror(number))
    assert not list(tmp_path.iterdir())


def test_what_is_written_is_strict_json():
    """Numbers that JSON does not have are null; digits beyond those asked for are left out."""
    text = as_json({"a": [float("nan"), 1.5], "b": {"c": float("inf"), "d": (1, Path("x/y"))}, "e": None})
    assert json.loads(text, parse_constant=pytest.fail) == {
        "a": [None, 1.5],
        "b": {"c": None, "d": [1, "x/y"]},
        "e": None,
    }
    assert as_json([1 / 3, 2, float("inf")], digits=3) == "[0.333, 2, null]"


def test_what_is_no_file_is_said(tmp_path: Path):
    """A pipe is there, so it is not missing."""
    os.mkfifo(tmp_path / "pipe")
    assert no_file(tmp_path / "pipe") == "it is a folder, a pipe or a device, not a file"
    assert no_file(tmp_path / "gone", "map") == "there is no such map"
