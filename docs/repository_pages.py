"""Pages of the site from files outside docs/, and links to and from these pages.

This is a hook of MkDocs. Links in Markdown are paths in the repository, so that they also work on its web pages.
"""

from __future__ import annotations

import ast
import json
import os
import re
from pathlib import Path, PurePosixPath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
EXAMPLES = sorted(
    path.relative_to(ROOT).as_posix() for path in (ROOT / "examples").glob("*") if path.suffix in (".py", ".ipynb")
)
LIST = "examples/index.md"
"""The page that lists the examples. In the navigation, the examples follow it."""
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "assets/README.md": "assets.md",
    "benchmarks/NOTES.md": "experiments.md",
    "benchmarks/OTHER_RESULTS.md": "other_measurements.md",
    "benchmarks/RESULTS.md": "measurements.md",
    "benchmarks/TRAININGS.md": "trainings.md",
    "examples": LIST,
    **{path: PurePosixPath(path).with_suffix(".md").as_posix() for path in EXAMPLES},
}
"""Path in the repository -> page of the site."""
_PACKAGE = "sceniris_gym"
_SPELLED = {"env": "environment", "gpus": "GPUs", "ppo": "PPO", "usd": "USD"}
"""Words of file names with another spelling in titles."""
_SOURCES = {page: source for source, page in PAGES.items()}
_FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(?P<image>!?)\[(?P<text>[^\]]*)\]\((?P<target>[^)\s#:]+)(?P<anchor>#[^)\s]*)?\)")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the examples into the navigation, below their list."""
    config.nav = _with_examples(config.nav)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=_content(source)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Turn links to files of the repository into links to pages of the site."""
    parts = _FENCE.split(markdown)
    parts[::2] = [_LINK.sub(lambda link: _on_site(link, page.file.src_uri), part) for part in parts[::2]]
    return "".join(parts)


def _with_examples(nav: object) -> object:
    if isinstance(nav, list):
        return [_with_examples(entry) for entry in nav]
    if isinstance(nav, dict):
        return {title: _with_examples(entry) for title, entry in nav.items()}
    return [LIST, *({_title(path): PAGES[path]} for path in EXAMPLES)] if nav == LIST else nav


def _content(source: str) -> str:
    if source == "examples":
        rows = [
            f"| [{_title(path)}]({PurePosixPath(path).name}) | {_summary(path)} ![Three worlds of its scene]"
            f"(../docs/pictures/{PurePosixPath(path).stem}.jpg) |"
            for path in EXAMPLES
        ]
        return "\n".join(("# Examples\n", "| example | content |", "|---|---|", *rows, ""))
    text = (ROOT / source).read_text(encoding="utf-8")
    if source.endswith(".ipynb"):
        return "\n\n".join([*map(_cell, json.loads(text)["cells"]), f"This page is the notebook `{source}`.\n"])
    if source.endswith(".py"):
        doc = ast.get_docstring(ast.parse(text))
        return f"# {_title(source)}\n\n{doc}\n\nThe file `{source}`:\n\n```python\n{text}```\n"
    return text


def _cell(cell: dict) -> str:
    text = "".join(cell["source"])
    return text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```"


def _title(example: str) -> str:
    """Return the name of an example: 'Vector environment' for 'examples/01_vector_env.py'."""
    words = PurePosixPath(example).stem.lstrip("0123456789_").split("_")
    title = " ".join(_SPELLED.get(word, word) for word in words)
    return title[0].upper() + title[1:]


def _summary(example: str) -> str:
    """Return the first line of an example's description."""
    text = (ROOT / example).read_text(encoding="utf-8")
    if example.endswith(".py"):
        return (ast.get_docstring(ast.parse(text)) or "").splitlines()[0]
    first = json.loads(text)["cells"][0]["source"]
    return "".join(first[1:]).strip().replace("\n", " ")


def _on_site(link: re.Match, page: str) -> str:
    """Return a link of a page for the site. For a file without a page, return only the text of the link.

    A link to an entry of the API, such as `api/scenes.md#sceniris_gym.SceneModel`, becomes a cross-reference, because
    the page has its anchors only when the site is built.
    """
    if (link["anchor"] or "").startswith(f"#{_PACKAGE}."):
        return f"[{link['text']}][{link['anchor'][1:]}]"
    source = _SOURCES.get(page, f"docs/{page}")
    folder = PurePosixPath(source) if source == "examples" else PurePosixPath(source).parent
    target = os.path.normpath(folder / link["target"])
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
