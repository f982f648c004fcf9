"""The hash of the sources that results depend on."""

from __future__ import annotations

import shutil
from pathlib import Path

from sceniris_gym.training.sources import source_hash


def test_the_hash_of_the_sources_depends_on_what_results_depend_on(tmp_path: Path):
    """On a line of a task, and not on a line of the docs; links into the package count once."""
    package = tmp_path / "sceniris_gym"
    for name in ("envs/task.py", "docs/page.md", "sceniris_gym/cli.py", "assets/cup.obj"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("1")
    first = source_hash(package=package)
    (tmp_path / "docs/page.md").write_text("2")
    (package / "envs").symlink_to(tmp_path / "envs")
    assert source_hash(package=package) == first
    (tmp_path / "envs/task.py").write_text("2")
    second = source_hash(package=package)
    assert second != first
    assert source_hash(tmp_path / "docs/page.md", package=package) != second


def test_an_installed_package_has_the_hash_of_its_repository(tmp_path: Path):
    """There tasks and assets lie inside of the package, and neither benchmarks nor docs are."""
    for name in ("envs/task.py", "benchmarks/run.py", "sceniris_gym/cli.py", "sceniris_gym/layout/seeds.py"):
        (tmp_path / "repository" / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / "repository" / name).write_text(name)
    shutil.copytree(tmp_path / "repository" / "sceniris_gym", tmp_path / "site" / "sceniris_gym")
    shutil.copytree(tmp_path / "repository" / "envs", tmp_path / "site" / "sceniris_gym" / "envs")
    hashes = {source_hash(package=tmp_path / where / "sceniris_gym") for where in ("repository", "site")}
    assert len(hashes) == 1
