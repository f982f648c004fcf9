"""The site: it builds without a warning, is whole by itself, and has an entry for every public name."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import sceniris_gym
from docs.repository_pages import EXAMPLES, PAGES
from sceniris_gym import errors

ROOT = Path(__file__).parents[2]
LOADED = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src"}
"""Elements that load something, and the attribute that says from where; links to elsewhere load nothing."""
IMPORT = re.compile(r"from (sceniris_gym[\w.]*) import (?:\(([\w\s,]+)\)|([\w, ]+))")


class Html(HTMLParser):
    """The links, loaded addresses and anchors of a page.

    Attributes:
        links: Targets of all links.
        loaded: Addresses that a browser loads with the page.
        ids: Anchors.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.ids: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect what a tag refers to."""
        found = {key: value or "" for key, value in attrs}
        self.ids.update(found[key] for key in ("id", "name") if key in found)
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        if tag in LOADED and found.get(LOADED[tag]) and found.get("rel") != "canonical":
            self.loaded.append(found[LOADED[tag]])


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site, as `make docs` does, into a folder of its own; what MkDocs printed is in its build.log."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    (folder / "build.log").write_text(done.stderr, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def pages(site: Path) -> dict[Path, Html]:
    """Return all pages by their paths."""
    return {path: Html(path) for path in site.rglob("*.html")}


def test_the_site_builds_without_a_warning(site: Path):
    """MkDocs warns of dead links and anchors, of pages that no one finds, and of names without a definition."""
    log = (site / "build.log").read_text(encoding="utf-8")
    assert "Documentation built" in log
    assert "WARNING" not in log


def test_every_page_is_in_the_navigation(site: Path, pages: dict[Path, Html]):
    """The start page's navigation leads to every page of docs/, and to those of files beside it."""
    start = site / "index.html"
    led_to = {os.path.normpath(site / urlsplit(link).path / "index.html") for link in pages[start].links}
    written = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")} | {*PAGES.values()}
    built = {site / page.removesuffix("index.md").removesuffix(".md") / "index.html" for page in written}
    assert sorted(str(path) for path in built if str(path) not in led_to | {str(start)}) == []


def test_every_example_has_a_page(pages: dict[Path, Html]):
    """A program or notebook of examples/ is listed, with its text."""
    assert len(EXAMPLES) == len([*(ROOT / "examples").glob("*.py"), *(ROOT / "examples").glob("*.ipynb")]) > 13
    lists = next(html for path, html in pages.items() if path.parts[-2:] == ("examples", "index.html"))
    assert {f"{Path(example).stem}/" for example in EXAMPLES} <= set(lists.links)


def test_every_link_leads_somewhere(site: Path, pages: dict[Path, Html]):
    """Pages, files and anchors of the site exist."""
    dead = []
    for path, html in pages.items():
        folder = site if path.name == "404.html" else path.parent
        for link in html.links + html.loaded:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            found = path if not parts.path else Path(os.path.normpath(folder / unquote(parts.path).lstrip("/")))
            found = found / "index.html" if found.is_dir() else found
            anchor = unquote(parts.fragment)
            if not found.is_file() or (anchor and found in pages and anchor not in pages[found].ids | {"__skip"}):
                dead.append(f"{path.relative_to(site)}: {link}")
    assert dead == []


def test_nothing_is_loaded_from_another_server(site: Path, pages: dict[Path, Html]):
    """Fonts, styles, scripts, pictures and the search come with the site."""
    elsewhere = [(path.name, link) for path, html in pages.items() for link in html.loaded if urlsplit(link).netloc]
    for path in site.rglob("*.css"):
        text = path.read_text(encoding="utf-8")
        elsewhere += [
            (path.name, found) for found in re.findall(r"(?:url\(|@import)\s*['\"]?((?:https?:)?//[^)'\"]+)", text)
        ]
    assert elsewhere == []
    assert (site / "search" / "search_index.json").is_file()


CHROMIUM = next((path for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if path), None)
WIDER = """() => [...document.querySelectorAll(".md-typeset pre > code, .md-typeset__scrollwrap")]
    .filter(found => found.scrollWidth > found.clientWidth + 1).map(found => found.textContent.slice(0, 60))"""
"""Beginnings of the programs and tables that a reader has to scroll sideways."""


@pytest.mark.skipif(CHROMIUM is None, reason="there is no browser")
def test_programs_fit_a_window_and_cards_fit_a_telephone(site: Path):
    """Programs of 120 columns at 1,280 pixels, and the systems' cards at 390."""
    sync_playwright = pytest.importorskip("playwright.sync_api").sync_playwright
    cut = {}
    with sync_playwright() as driver:
        page = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]).new_page()
        for name, width in (("own_task", 1280), ("examples/04_own_task", 1280), ("systems", 1280), ("systems", 390)):
            page.set_viewport_size({"width": width, "height": 900})
            page.goto((site / name / "index.html").as_uri())
            cut[name, width] = page.evaluate(WIDER)
    assert cut == {key: [] for key in cut}


def errors_of_the_package() -> set[str]:
    """Return the names of all errors and warnings."""
    classes = [value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, Exception)]
    return {value.__name__ for value in classes if value.__module__ == errors.__name__ and value.__name__[0] != "_"}


def of_adapters() -> Iterator[str]:
    """Yield the full names of the public classes and functions of adapters, some of which need their library."""
    for path in (ROOT / "sceniris_gym" / "adapters").glob("[a-z]*.py"):
        for name in re.findall(r"^(?:class|def) ([A-Za-z]\w*)", path.read_text(encoding="utf-8"), re.MULTILINE):
            yield f"sceniris_gym.adapters.{path.stem}.{name}"


def told() -> Iterator[str]:
    """Yield the full names that pages, the README and examples import."""
    texts = [*(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.*"), ROOT / "README.md"]
    for path in texts:
        for module, several, one in IMPORT.findall(path.read_text(encoding="utf-8")):
            for name in (several or one).split(","):
                if name.strip():
                    yield f"{module}.{name.strip().split(' as ')[0]}"


def test_every_public_name_has_an_entry(pages: dict[Path, Html]):
    """Names of the package, errors, adapters, and others that a page or an example imports. Tasks have other pages."""
    entries = set().union(*(html.ids for path, html in pages.items() if "api" in path.parts))
    entries |= {f"sceniris_gym.{name}" for name in errors_of_the_package()}  # `sceniris_gym` has two of them as well
    public = {f"sceniris_gym.{name}" for name in sceniris_gym.__all__}
    public |= {f"sceniris_gym.errors.{name}" for name in errors_of_the_package()} | set(of_adapters()) | set(told())
    assert len(public) > 70
    modules = {name for name in public if any(entry.startswith(f"{name}.") for entry in entries)}
    assert sorted(name for name in public - entries - modules if not name.startswith("sceniris_gym.envs.")) == []


def test_links_of_the_readme_lead_somewhere(site: Path, pages: dict[Path, Html]):
    """Files of the repository exist, and anchors of pages do."""
    links = re.findall(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"", (ROOT / "README.md").read_text(encoding="utf-8"))
    targets = [urlsplit(a or b) for a, b in links]
    ours = [t for t in targets if not t.scheme and t.path]
    assert [t.path for t in ours if not (ROOT / t.path).exists()] == []
    for target in ours:
        if target.fragment and target.path.startswith("docs/"):
            page = site / target.path.removeprefix("docs/").removesuffix(".md").removesuffix("index") / "index.html"
            assert target.fragment in pages[page].ids, target


def test_links_of_pages_lead_somewhere_in_the_repository():
    """A forge shows the pages, too: links are paths of files, and names of the API are links to its pages."""
    dead = []
    for path in [*(ROOT / "docs").rglob("*.md"), *(ROOT / "benchmarks").glob("*.md")]:
        text = re.sub(r"^```.*?^```$|`[^`]*`", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        targets = [urlsplit(link) for link in re.findall(r"\]\(([^)\s]+)\)", text)]
        dead += [(path.name, t.path) for t in targets if not t.scheme and not (path.parent / t.path).exists()]
        dead += [(path.name, name) for name in re.findall(r"\]\[(sceniris_gym[^]]*)\]", text)]
    assert dead == []
