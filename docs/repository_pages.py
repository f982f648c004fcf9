"""Pages of the site that are made from files beside docs/, and links between the two.

A hook of MkDocs: links in Markdown are those of the repository, so that they also work where the files are read there.
"""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "examples").glob("*.py"))
PAGES = {
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "assets/README.md": "assets.md",
    "benchmarks/NOTES.md": "experiments.md",
    "benchmarks/RESULTS.md": "measurements.md",
    **{path: PurePosixPath(path).with_suffix(".md").as_posix() for path in EXAMPLES},
}
"""Paths in the repository, and the pages that are made from them."""
_SOURCES = {page: source for source, page in PAGES.items()}
_FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(?P<image>!?)\[(?P<text>[^\]]*)\]\((?P<target>[^)\s#:]+)(?P<anchor>#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=_content(source)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Return the page with links to files of the repository as links to pages of the site."""
    parts = _FENCE.split(markdown)
    parts[::2] = [_LINK.sub(lambda link: _on_site(link, page.file.src_uri), part) for part in parts[::2]]
    return "".join(parts)


def _content(source: str) -> str:
    text = (ROOT / source).read_text(encoding="utf-8")
    if not source.endswith(".py"):
        return text
    title = PurePosixPath(source).stem.partition("_")[2].replace("_", " ").capitalize()
    summary = text.split('"""')[1].strip()
    return f"# {title}\n\n{summary}\n\nThe file `{source}`:\n\n```python\n{text}```\n"


def _on_site(link: re.Match, page: str) -> str:
    """Return a link of a page as the site needs it; a file that is no page leaves its text alone."""
    source = _SOURCES.get(page, f"docs/{page}")
    target = os.path.normpath(PurePosixPath(source).parent / link["target"])
    if target.startswith("docs/"):
        found = target.removeprefix("docs/")
    elif target in PAGES:
        found = PAGES[target]
    elif (ROOT / target).exists():
        return link["text"]
    else:
        return link[0]
    relative = os.path.relpath(found, PurePosixPath(page).parent)
    return f"{link['image']}[{link['text']}]({relative}{link['anchor'] or ''})"
