"""Pages of files, commands and programs, run in the order of the page in one folder."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from sceniris_gym import cli

BLOCK = re.compile(r'^```(?P<kind>\w+)(?: title="(?P<title>[^"]+)")?\n(?P<text>.*?)^```$', re.MULTILINE | re.DOTALL)
ELSEWHERE = ("pip install ", "mkdir ", "cd ")  # the package is installed, and the folder is the test's


def smaller(text: str, sizes: Mapping[str, str]) -> str:
    """Return a command or program with fewer worlds, layouts and steps."""
    for before, after in sizes.items():
        text = text.replace(before, after)
    return text


def run(command: str, folder: Path, sizes: Mapping[str, str]) -> None:
    """Run one line of a page in `folder`, the working folder."""
    words = shlex.split(smaller(command, sizes))
    if words[0] == "sceniris-gym":
        cli.main(words[1:])
    elif words[0] == "python":
        exec(compile((folder / words[1]).read_text(), words[1], "exec"), {})
    elif words[0] == "sed":
        subprocess.run(words, check=True)
    else:
        assert command.startswith(ELSEWHERE), command


def walk(page: Path, folder: Path, sizes: Mapping[str, str], heard: Callable[[str, str], None]) -> None:
    """Write the files of a page to `folder`, and run its commands and programs.

    A program with the title of a file that exists is appended. `heard` gets each command before it runs as ("sh",
    command), and each block of expected output as ("text", output).
    """
    for block in BLOCK.finditer(page.read_text(encoding="utf-8")):
        kind, title, text = block["kind"], block["title"], smaller(block["text"], sizes)
        file = folder / (title or "")
        if kind == "text":
            heard(kind, text)
        elif title and kind == "python" and file.exists():
            file.write_text(f"{file.read_text()}\n{text}", encoding="utf-8")
            sys.modules.pop(file.stem, None)  # the next import runs it again
        elif title:
            file.write_text(text, encoding="utf-8")
        elif kind == "python":
            exec(compile(text, str(page), "exec"), {})
        else:
            for command in block["text"].splitlines():
                heard(kind, command)
                run(command, folder, sizes)
