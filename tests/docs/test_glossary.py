"""The glossary: a sentence for each word of the project, linked from the page that uses it first."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
WORDS = (
    *("layout", "level", "param", "split", "bank", "fallback", "redraw", "variant", "stable pose", "marker", "parked"),
    *("candidate", "restart", "wave", "tier"),
)
ROW = re.compile(
    r'^\| <a id="(?P<anchor>[\w-]+)"></a>(?P<word>[\w ]+) \| (?P<meaning>[^|]+) \| \[[^|]+\) \|$', re.MULTILINE
)


def test_the_glossary_has_a_sentence_for_each_word():
    """These 15, each below its anchor, with a link to its page."""
    page = (DOCS / "glossary.md").read_text(encoding="utf-8")
    rows = ROW.findall(page)
    assert [word for _, word, _ in rows] == list(WORDS)
    assert [anchor for anchor, *_ in rows] == [word.replace(" ", "-") for word in WORDS]
    assert [meaning for *_, meaning in rows if not re.fullmatch(r"[A-Z][^.]+\.", meaning)] == []
    assert page.count("\n| ") == len(WORDS) + 1


@pytest.mark.parametrize("word", WORDS)
def test_a_word_of_the_glossary_is_linked(word: str):
    """From a guide, or from a page on the scene language."""
    link = re.compile(rf"\]\((\.\./)?glossary\.md#{word.replace(' ', '-')}\)")
    pages = [path for path in DOCS.rglob("*.md") if path.name != "glossary.md"]
    assert any(link.search(path.read_text(encoding="utf-8")) for path in pages)
