"""Tests that import what changed: `python -m tests.changed [BASE]` prints their files.

Changed is what differs from BASE: by default from where the branch left origin/main, or else from the last commit but
one. A module changes its own tests and those that import it by name; any other file changes the tests of its folder.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from tests.sources import ROOT, imports

ALWAYS = {"tests/test_house.py", "tests/test_imports.py", "tests/test_prose.py"}


def git(*words: str) -> list[str]:
    """Return the lines that git prints, none if it fails."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout.splitlines()


def changed(base: str | None) -> list[str]:
    """Return the files that differ from a commit, new ones too."""
    start = [base] if base else git("merge-base", "origin/main", "HEAD")
    if not base and start == git("rev-parse", "HEAD") and not git("status", "--porcelain"):
        start = ["HEAD~1"]
    return git("diff", "--name-only", *(start or ["HEAD~1"])) + git("ls-files", "--others", "--exclude-standard")


def touching(files: Iterable[str], tests: Iterable[Path]) -> list[str]:
    """Return which of some test files test changed files, sorted."""
    files = set(files)
    modules = {file.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for file in files}
    folders = {file.split("/")[0] for file in files if not file.endswith(".py")}
    found = set()
    for path in tests:
        name = path.relative_to(ROOT).as_posix()
        own = name.replace("tests/", "sceniris_gym/", 1).replace("test_", "")
        if name in files | ALWAYS or own in files or name.split("/")[1] in folders or modules & set(imports(path)):
            found.add(name)
    return sorted(found)


if __name__ == "__main__":
    print(*touching(changed(sys.argv[1] if len(sys.argv) > 1 else None), (ROOT / "tests").rglob("test_*.py")))
