"""The package as it is shipped: what is in it, and that it works where nothing but its dependencies is."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from sceniris_gym import SceneConfig, __version__, build_model
from sceniris_gym.errors import old_names
from sceniris_gym.training.settings import source_hash
from tests.training.scenes import SMALL, write_task

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
MAPPED = {"envs": "sceniris_gym.envs", "assets": "sceniris_gym.assets"}  # top-level folders that are sub-packages


def run(*command: str | Path, cwd: Path) -> str:
    """Run a command and return what it prints; show its errors when it fails."""
    result = subprocess.run(command, cwd=cwd, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the sdist of the tree, and the wheel that was built from it."""
    tree = tmp_path_factory.mktemp("tree")
    for name in ("sceniris_gym", *MAPPED, "tests"):
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    run(sys.executable, "-m", "build", "--no-isolation", cwd=tree)
    return tree / "dist"


@pytest.fixture(scope="session")
def python(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the interpreter of a clean venv with the wheel, which sees this one's packages but not this checkout."""
    folder = tmp_path_factory.mktemp("venv")
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip())
    # A folder named in a .pth file is searched; its own .pth files, the editable install's among them, are not read.
    folders = [entry for entry in sys.path if Path(entry).name == "site-packages"]  # of a venv over another one: both
    (site / "dependencies.pth").write_text("\n".join(folders))
    wheel = next(built.glob("*.whl"))
    pip = [sys.executable, "-m", "pip", "--python", str(python)]
    run(*pip, "install", "--no-deps", "--no-index", "--ignore-installed", wheel, cwd=folder)
    return python


def test_the_wheel_holds_every_module(built: Path):
    """All Python files of the tree are in it, those of the folders beside the package too, and no other package."""
    wheel = zipfile.ZipFile(next(built.glob("*.whl")))
    packed = {name for name in wheel.namelist() if name.endswith(".py")}
    own = {str(path.relative_to(ROOT)) for path in (ROOT / "sceniris_gym").rglob("*.py")}
    beside = {f"sceniris_gym/{path.relative_to(ROOT)}" for name in MAPPED for path in (ROOT / name).rglob("*.py")}
    assert packed == own | beside
    assert {v: k for k, v in MAPPED.items()} == PROJECT["tool"]["setuptools"]["package-dir"]


def test_every_folder_with_code_is_a_package():
    """No module is left out because its folder has no __init__.py."""
    folders = {path.parent for path in (ROOT / "sceniris_gym").rglob("*.py")}
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_the_version_is_the_same_everywhere():
    """In pyproject.toml, in the package, in CITATION.cff and, once it is released, with its date in the changelog."""
    citation = YAML(typ="safe").load(ROOT / "CITATION.cff")
    assert PROJECT["project"]["version"] == __version__ == citation["version"]
    unreleased, *releases = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert unreleased == "Unreleased"
    if __version__.endswith(".dev0"):
        assert "date-released" not in citation
        assert __version__.removesuffix(".dev0") not in [release.split(" - ")[0] for release in releases]
    else:
        assert releases[0] == f"{__version__} - {citation['date-released']}"


@pytest.mark.parametrize("page", ["README.md", "CHANGELOG.md", "docs/install.md", "docs/tutorial.md"])
def test_pages_agree_on_whether_there_is_a_release(page: str):
    """They have the sentence that there is none yet until the changelog has a release."""
    is_released = "\n## " in (ROOT / "CHANGELOG.md").read_text().partition("## Unreleased")[2]
    assert ("no release" in (ROOT / page).read_text()) != is_released


def test_the_changelog_names_what_changes_for_users_first():
    """Unreleased begins with one table of old and new names; each row has both."""
    breaking = (ROOT / "CHANGELOG.md").read_text().split("\n## Unreleased\n")[1].split("\n### ")[1]
    title, *lines = breaking.splitlines()
    rows = [line for line in lines if line.startswith("|")]
    assert (title, rows[:2]) == ("Breaking", ["| old | new |", "|---|---|"])
    assert "\n".join(rows) in breaking
    assert [row for row in rows[2:] if row.count(" | ") != 1 or not row.endswith(" |")] == []
    words = {word for old in old_names() for word in re.findall(r"\w+", old)}
    assert words <= set(re.findall(r"\w+", breaking))


def test_every_dependency_is_pinned():
    """Each dependency and extra of pyproject.toml has its exact version in constraints.txt."""
    lines = (line.split("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line)
    pinned = {line.lower().replace("_", "-") for line in lines}
    extras = PROJECT["project"]["optional-dependencies"].values()
    wanted = [*PROJECT["project"]["dependencies"], *(text for extra in extras for text in extra)]
    names = {text.split(">")[0].split("[")[0].lower().replace("_", "-") for text in wanted}
    assert names - pinned == {PROJECT["project"]["name"]}  # whose extras the development environment has


@pytest.mark.slow
def test_the_page_of_a_package_index_has_no_dead_link_or_picture(built: Path):
    """It is the README without links to files of the repository."""
    wheel = zipfile.ZipFile(next(built.glob("*.whl")))
    metadata = wheel.read(next(name for name in wheel.namelist() if name.endswith("METADATA"))).decode()
    assert "Description-Content-Type: text/markdown" in metadata
    assert "randomises the scene at every reset" in metadata
    assert re.findall(r"\]\((?!https?:)[^)]*\)", metadata) == []


@pytest.mark.slow
def test_wheel_and_sdist_hold_all_modules_scenes_and_assets(built: Path):
    """Files of the tree are in both; tests and caches are in neither."""
    wheel = set(zipfile.ZipFile(next(built.glob("*.whl"))).namelist())
    with tarfile.open(next(built.glob("*.tar.gz"))) as archive:
        sdist = {name.partition("/")[2] for name in archive.getnames()}
    kinds = {
        "sceniris_gym": ["*.py", "__init__.pyi", "py.typed", "renamed.json", "first_task.*"],
        "envs": ["*.py", "*.yaml", "*.pt"],
        "assets": ["*.py", "*.xml", "meshes/*"],
    }
    files = [
        p.relative_to(ROOT) for folder, all_ in kinds.items() for kind in all_ for p in (ROOT / folder).rglob(kind)
    ]
    files = [path for path in files if "__pycache__" not in path.parts]
    assert len(files) > 30
    assert [str(path) for path in files if str(path) not in sdist] == []
    inside = ["/".join(["sceniris_gym", *p.parts] if p.parts[0] in MAPPED else p.parts) for p in files]
    assert [path for path in inside if path not in wheel] == []
    assert [path for path in wheel | sdist if path.startswith("tests") or path.endswith(".pyc")] == []


@pytest.mark.slow
def test_the_wheel_builds_the_same_scene_in_a_clean_venv(python: Path, tmp_path: Path):
    """The installed package, not the checkout, loads `mid`, and gives it the same hash."""
    code = (
        "import sceniris_gym as s; print(s.__file__); print(s.build_model(s.SceneConfig.load('mid')).hash); "
        "import importlib.metadata as m; print(m.version('sceniris-gym'))"
    )
    file, scene_hash, version = run(python, "-c", code, cwd=tmp_path).split()
    assert Path(file).is_relative_to(python.parents[1])
    assert scene_hash == build_model(SceneConfig.load("mid")).hash
    assert version == __version__


@pytest.mark.slow
def test_the_console_script_is_installed(python: Path, tmp_path: Path):
    """`sceniris-gym --help` lists its commands."""
    said = run(python.parent / "sceniris-gym", "--help", cwd=tmp_path)
    for command in ("demo", "generate", "audit", "bench", "replay"):
        assert command in said


COMMANDS = """
import json, runpy, sys
import sceniris_gym
import sceniris_gym.training.settings

program, lines = sys.argv[1:]
for words in json.loads(lines):
    sys.argv = [program, *words]
    try:
        runpy.run_path(program, run_name="__main__")
    except SystemExit as end:
        assert not end.code, end.code
    print("\\0", end="", flush=True)
print(sceniris_gym.__file__, sceniris_gym.training.settings.source_hash())
"""


@pytest.mark.slow
def test_the_wheel_alone_makes_layouts_trains_and_evaluates(python: Path, tmp_path: Path):
    """`demo`, and a small training and evaluation of a task that lies where the program is started.

    One process runs the console script three times, since most of each would be imports.
    """
    pytest.importorskip("rsl_rl")
    task = write_task(tmp_path, "own_task_of_the_wheel")
    demo = ["demo", "--device", "cpu", "--out", "demo.png", "--json"]
    train = ["train", task, *SMALL, "--out", "run", "--json"]
    evaluate = ["evaluate", "run", "--task", task, "--layouts", "3", "--device", "cpu"]
    program = str(python.parent / "sceniris-gym")
    said = run(python, "-c", COMMANDS, program, json.dumps([demo, train, evaluate]), cwd=tmp_path).split("\0")
    figures, trained = json.loads(said[0]), json.loads(said[1])
    assert (figures["valid"], (tmp_path / "demo.png").is_file()) == (1.0, True)
    assert (trained["task"], trained["valid"]["layouts"]) == (task, 3)
    assert [line.split(": ")[0] for line in said[2].splitlines()] == ["valid", "unfiltered"]
    file, sources = said[3].split()
    assert Path(file).is_relative_to(python.parents[1])
    assert sources == source_hash()
