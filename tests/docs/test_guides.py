"""The guides: programs run as they stand, pages name every command and scene, and prose is wrapped."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from docs.make_drawings import DRAWINGS, FILLS, FOLDER
from sceniris_gym import LayoutDataset, SceneConfig, cli
from sceniris_gym.cli import COMMANDS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
WITH_PROGRAMS = (
    "own_model",
    "own_task",
    "tasks",
    "levels",
    "images",
    "randomisation",
    "variants",
    "redraws",
    "starts",
    "api/scenes",
)
PAGES = (
    *(
        *WITH_PROGRAMS,
        "why",
        "install",
        "troubleshooting",
        "questions",
        "tutorial",
        "own_arm",
        "how_to",
        "glossary",
        "how_it_works",
        "commands",
        "viewer",
        "data_sets",
        "import",
    ),
    *("libraries", "mjlab", "jax", "newton", "training", "reach", "libero", "several_gpus"),
)
BLOCK = re.compile(r'^```(python|yaml)(?: title="([^"]+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def read(page: str) -> str:
    """Return the text of a page."""
    return (DOCS / f"{page}.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_PROGRAMS)
def test_the_programs_of_a_guide_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In their order, in a folder with the examples; files that the page names are written there first."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    found: list[dict] = []
    for kind, title, text in BLOCK.findall(read(page)):
        if title:
            (tmp_path / title).write_text(text, encoding="utf-8")
        if kind == "yaml":
            SceneConfig.load(tmp_path / title)
        elif title != "my_tasks.py":  # which the others import
            found.append({})
            exec(compile(text, f"{page}.md", "exec"), found[-1])
    sys.modules.pop("my_tasks", None)
    if page == "own_model":
        assert set(found[0]["randomizer"].layouts.episode.cpu().numpy()) == {1}
        assert found[1]["randomizer"].layouts.seed.tolist() == [0, 0, 0, 0]
        assert np.flatnonzero(found[-1]["randomizer"].layouts.episode.cpu().numpy() == 0).tolist() == [3, 5]
        assert found[-1]["poses"].shape == (64, 7)


@pytest.mark.slow
def test_the_programs_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In a folder with the scene file. The README is also the start page of the site, and has at most 8 KB."""
    monkeypatch.chdir(tmp_path)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(readme.encode()) <= 8192
    (_, _, environment), (_, _, scene), (_, _, loop) = BLOCK.findall(readme)
    Path("drawers.yaml").write_text(scene, encoding="utf-8")
    first: dict = {}
    exec(compile(environment, "README.md", "exec"), first)
    assert first["info"]["layout"]["episode"][6:10].tolist() == [1, 1, 0, 0]
    second: dict = {}
    exec(compile(loop, "README.md", "exec"), second)
    assert set(second["randomizer"].layouts.episode.cpu().numpy()) == {1}


def test_every_message_of_the_page_on_troubleshooting_is_in_the_source():
    """Each is quoted in the words of a raised error, a warning or a print, where `...` stands for the rest."""
    # Two strings that follow each other are one message.
    joined = re.compile(r'"\s*f?"')
    texts = [joined.sub("", path.read_text(encoding="utf-8")) for path in (ROOT / "sceniris_gym").rglob("*.py")]
    quoted = re.findall(r"^\| `([^`]+)` \|", read("troubleshooting"), re.MULTILINE)
    parts = {message: [part.strip() for part in message.split("...") if part.strip()] for message in quoted}
    assert len(parts) >= 15
    assert [
        message for message, words in parts.items() if not any(all(w in text for w in words) for text in texts)
    ] == []


def test_the_programs_of_the_page_on_data_sets_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On a data set of 16 layouts, read in one process; the source serves its rows. MuJoCo has the poses of a row."""
    monkeypatch.chdir(tmp_path)
    cli.main(["generate", "mid", "-n", "16", "-o", "layouts/mid", "--device", "cpu"])
    (_, _, stock), (_, _, program) = BLOCK.findall(read("data_sets"))
    assert "sceniris" not in stock
    exec(compile(stock, "data_sets.md", "exec"), names := {})
    assert not (names["data"].contact.dist < 0.0).any()
    layout = LayoutDataset("layouts/mid").table(5, 6)
    pose = np.concatenate([layout.mocap_pos[0, 0], layout.mocap_quat[0, 0]])
    cabinet = names["data"].body("cabinet")
    np.testing.assert_allclose(np.concatenate([cabinet.xpos, cabinet.xquat]), pose, atol=1e-6)
    assert np.abs(pose[:2]).max() > 0.01  # not at the origin
    smaller = {"100_000": "16", "4096": "4", '"mid"': '"mid", "cpu"', ", num_workers=4": ""}
    for before, after in smaller.items():
        program = program.replace(before, after)
    names: dict = {}
    exec(compile(program, "data_sets.md", "exec"), names)
    assert names["batch"]["qpos"].shape[0] == 16
    names["source"].generate()
    assert names["source"].layouts.seed.cpu().numpy().max() < 16


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_the_program_of_the_page_on_libero_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On the problem file of the page, without LIBERO's models; no world starts at its goal."""
    monkeypatch.chdir(tmp_path)
    page = read("libero")
    problem = re.search(r'^```lisp title="([^"]+)"\n(.*?)^```$', page, re.MULTILINE | re.DOTALL)
    assert problem is not None
    Path(problem[1]).write_text(problem[2], encoding="utf-8")
    ((_, _, program),) = BLOCK.findall(page)
    names: dict = {}
    exec(compile(program, "libero.md", "exec"), names)
    assert names["observations"]["policy"].shape == (16, 9 + 7 + 7 + 7)
    assert names["info"]["language"] == ["put the red mug on the plate and close the drawer"] * 16
    assert not names["env"].unwrapped.step(names["env"].action_space.sample())[4]["success"].any()


STOPPED = {"one", "with", "and", "the", "its", "for", "not", "use", "from"}


def stems(text: str) -> set[str]:
    """Return the first five letters of the words of a text, without small words and what is in brackets."""
    words = re.findall(r"[a-z]{3,}", re.sub(r"\(.*?\)", "", text.lower()))
    return {word.rstrip("s")[:5] for word in words if word not in STOPPED}


def test_what_is_missing_has_no_page():
    """No heading of a page, and no other row of the index, has all words of a row under "Not yet"."""
    index, _, missing = read("how_to").partition("## Not yet")
    rows = [re.findall(r"^\| (.*?) \| .*\|$", text, re.MULTILINE)[1:] for text in (index, missing)]
    pages = [path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md")]
    headings = [title for page in pages for title in re.findall(r"^#+ (.+)$", page, re.MULTILINE)]
    assert stems("camera poses") <= stems("randomise the pose of a camera")  # as a row of old denied
    assert len(rows[1]) >= 3
    assert {row: where for row in rows[1] for where in (*rows[0], *headings) if stems(row) <= stems(where)} == {}


def test_every_command_has_a_section():
    """And a row of the table that says what it is for."""
    page = read("commands")
    sections = {name for title in re.findall(r"^## (.+)$", page, re.MULTILINE) for name in title.split(", ")}
    assert sections == set(COMMANDS)
    assert [name for name in COMMANDS if f"`{name}`" not in page.split("\n## ")[0]] == []


def test_every_scene_is_named():
    """On the page of the commands, those of the tasks too."""
    named = re.findall(r"`(\w+)`", read("commands").partition("`SCENE`")[2].partition("An option")[0])
    assert sorted(named) == sorted(path.stem for path in ROOT.glob("envs/*.yaml"))


def test_every_example_is_linked_from_a_guide():
    """The numbered programs and the notebook."""
    linked = set(re.findall(r"\]\(\.\./examples/([\w.]+)\)", "".join(read(page) for page in PAGES)))
    assert {path.name for path in ROOT.glob("examples/[0-9]*.py")} | {"tour.ipynb"} <= linked


@pytest.mark.parametrize("page", PAGES)
def test_prose_is_wrapped(page: str):
    """As in the code, but for tables, pictures and programs."""
    text = re.sub(r"^```.*?^```$", "", read(page), flags=re.MULTILINE | re.DOTALL)
    assert [line for line in text.splitlines() if len(line) > 120 and not line.startswith(("|", "!["))] == []


@pytest.mark.parametrize("page", PAGES)
def test_rows_of_a_table_have_as_many_cells_as_its_rule(page: str):
    """Python-Markdown prints a table with another rule as text."""
    text = re.sub(r"^```.*?^```$", "", read(page), flags=re.MULTILINE | re.DOTALL)
    for table in re.findall(r"(?:^\|.*\n)+", text, flags=re.MULTILINE):
        rows = [len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()]
        assert len(set(rows)) == 1, table


@pytest.mark.parametrize("name", DRAWINGS)
def test_a_drawing_is_as_its_script_draws_it(name: str):
    """`python -m docs.make_drawings` draws it anew."""
    assert (FOLDER / f"{name}.svg").read_text(encoding="utf-8") == DRAWINGS[name]().text()
    assert f"drawings/{name}.svg" in read("how_it_works")


def test_white_text_is_readable_on_every_box():
    """The contrast of WCAG, at least 4.5, on boxes of all roles; so it is on light and on dark pages."""
    for colour in FILLS.values():
        channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)
        assert 1.05 / (0.2126 * red + 0.7152 * green + 0.0722 * blue + 0.05) >= 4.5, colour
