"""A hash of the sources that results depend on, so that those of two versions are never mixed."""

from __future__ import annotations

import hashlib
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = {
    "sceniris_gym": (".py",),
    "envs": (".py", ".yaml"),
    "assets": (".xml", ".obj", ".reach"),
    "benchmarks": (".py",),
}


def source_hash() -> str:
    """Return the hash of package, tasks, assets and benchmarks, whether they are in a repository or not."""
    digest = hashlib.sha256()
    for folder, endings in FOLDERS.items():
        for path in sorted((ROOT / folder).rglob("*")):
            parts = path.relative_to(ROOT).parts
            linked = parts[0] == "sceniris_gym" and len(parts) > 1 and parts[1] in ("envs", "assets")
            if path.suffix in endings and not linked:
                digest.update("/".join(parts).encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


if __name__ == "__main__":
    print(source_hash())
