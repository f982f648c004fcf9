"""A hash of the sources that a training depends on, so that results of two versions are never mixed."""

from __future__ import annotations

import hashlib
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
ENDINGS = {"sceniris_gym": (".py",), "envs": (".py", ".yaml"), "assets": (".xml", ".obj", ".reach")}


def source_hash(*more: Path, package: Path = PACKAGE) -> str:
    """Return the hash of package, tasks and assets, the same in a repository and where its wheel is installed.

    Args:
        more: Other files that results depend on.
        package: The folder of the package. Tasks and assets lie in it or, in a repository, beside it.
    """
    digest = hashlib.sha256()
    for name, endings in ENDINGS.items():
        inside = package / name
        folder = package if name == "sceniris_gym" else inside if inside.exists() else package.parent / name
        for path in sorted(folder.rglob("*")):
            parts = path.relative_to(folder).parts
            if path.suffix in endings and not (folder == package and parts[0] in ENDINGS):
                digest.update("/".join((name, *parts)).encode())
                digest.update(path.read_bytes())
    for path in more:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    print(source_hash())
