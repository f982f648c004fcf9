"""Sentences are read once: turns of phrase that slow a reader down have a budget in each file."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

from tests import prose

WRITE = "run `python -m tests.prose --write`"
FIRST_READ = ("README.md", "CONTRIBUTING.md", "docs/*.md", "docs/language/*.md") + tuple(
    f"sceniris_gym/{name}.py" for name in ("sim/randomizer", "vector/vector_env", "cli")
)
SAID_AGAIN = {
    "that of": ("Its height is that of the table.", "It is as high as the table, so that it fits."),
    "what is": ("It holds what is needed.", "What is a level?"),
    "own": ("A class of its own.", "A separate class. Its own seed is fixed."),
    "anew": ("The object is drawn anew.", "The object is drawn again, as well as its mass."),
    "thing": ("The thing is on the table.", "The object is on the table. Everything is free."),
    "so many": ("A value for as many worlds.", "The same number of values, and as few as possible."),
    "of which": ("The world that it belongs to.", "Its world, in which case the mask is set."),
    "go on": ("The rows go on until the end.", "The rows continue until the end."),
    "nothing": ("Nothing is allocated.", "A launch does not allocate memory."),
    "semicolon": ("It is set; the others stay.", "The mask, shape (n,), bool; None for all. A gap [m]; 0 by default."),
    "says": ("The file says where.", "If you want a file, the user asks for its path."),
    "one(s)": ("The first ones are free.", "The first candidates are free, one at a time."),
    "there": ("Write the file that is there.", "If there is a file, there are two."),
}


@pytest.fixture(scope="module")
def over_budget() -> dict[str, int]:
    """Return the excess of each file over its budget."""
    return prose.over_budget()


MOST_WORDS = 49_000
"""Words of all pages below docs/, tables and code included."""


def found(text: str, *, markdown: bool = False) -> list[list[str]]:
    """Return the markers of each sentence of a text that has some."""
    return [sentence.markers for sentence in prose.sentences(text, markdown=markdown) if sentence.markers]


def test_no_file_is_further_over_its_budget_than_listed(over_budget: dict[str, int]):
    """`python -m tests.prose PATH` prints the sentences to say again; files that are not listed are within budget."""
    listed = prose.listed()
    worse = {path: f"{n} over budget, at most {listed.get(path, 0)}" for path, n in over_budget.items()}
    assert {path: text for path, text in worse.items() if over_budget[path] > listed.get(path, 0)} == {}


def test_the_list_keeps_each_file_that_became_better(over_budget: dict[str, int]):
    """Its number is lowered, or its line removed, so that it does not become worse again."""
    better = {path: over_budget.get(path, 0) for path, n in prose.listed().items() if over_budget.get(path, 0) < n}
    assert better == {}, WRITE


def test_at_most_one_file_in_twenty_is_listed():
    """Of those that have the fewest words to be judged."""
    judged = [path for path in prose.judged() if sum(s.words for s in prose.read(path)) >= prose.FEWEST_WORDS]
    assert len(judged) > 300
    assert len(prose.listed()) <= len(judged) / 20


def test_files_that_users_read_first_are_never_listed():
    """The pages, and the modules of the classes and commands that everyone meets."""
    first = {path.relative_to(prose.ROOT).as_posix() for pattern in FIRST_READ for path in prose.ROOT.glob(pattern)}
    assert len(first) > 50
    assert sorted(first & set(prose.listed())) == []


def test_the_pages_have_a_budget_of_words():
    """A page that grows takes its words from what stands twice."""
    words = sum(len(page.read_text().split()) for page in (prose.ROOT / "docs").rglob("*.md"))
    assert words <= MOST_WORDS


@pytest.mark.parametrize("marker", prose.MARKERS)
def test_a_marker_is_hit_by_its_turn_of_phrase_and_not_by_its_rewrite(marker: str):
    """In Markdown and in a docstring."""
    slow, read_once = SAID_AGAIN[marker]
    assert found(slow, markdown=True) == found(f'"""{slow}"""') == [[marker]]
    assert found(read_once, markdown=True) == found(f'"""{read_once}"""') == []


def test_docstrings_comments_and_errors_are_read_with_their_lines():
    """Also comments behind code, strings below attributes, and f-strings; other strings and names are not."""
    text = '''"""Draw anew.

count: First line of an entry, and of
  the last thing in it.
"""
thing = "a thing"  # the thing
"""A list of things."""
# A comment
# on a thing.
raise Error(f"{thing}: no thing " "called {name}")
'''
    lines = [(sentence.line, sentence.markers) for sentence in prose.sentences(text) if sentence.markers]
    assert sorted(lines) == [(1, ["anew"])] + [(line, ["thing"]) for line in (3, 6, 7, 8, 10)]


def test_code_tables_directives_and_access_comments_are_no_prose():
    """Nor are links, and comments that tools write or read."""
    page = "A [page](the-thing.md) and `thing`.\n\n```\na thing\n```\n\n| thing |\n\n    thing\n\n<!-- thing -->\n"
    module = "# Search in: row, obj; out: cause;\n#   both: best; none\n# noqa: thing\n# type: thing\nx = 1\n"
    assert found(page, markdown=True) == found(module) == []
    assert found("# in this thing; out of it\nx = 1\n") == [["thing", "semicolon"]]


def test_a_reason_on_the_line_before_excuses_one_sentence():
    """Of a page, a docstring, a comment or an error; without a reason it does not."""
    thing = "A thing. Another thing."
    assert found(f"<!-- prose: ok, its name -->\n{thing}", markdown=True) == [["thing"]]
    assert found(f'# prose: ok, its name\n"""{thing}"""') == found(f"# prose: ok, its name\n# {thing}") == [["thing"]]
    assert found(f'# prose: ok, its name\nraise Error("{thing}")') == [["thing"]]
    assert found(f"# prose: ok\n# {thing}") == [["thing"], ["thing"]]


def test_a_budget_grows_with_the_words_of_a_file():
    """One hit of a marker and two in all are free; a file with few words is not judged."""

    def excess(words: int, hits: dict[str, int]) -> int:
        return prose.excess([prose.Sentence(1, "", words, list(Counter(hits).elements()))])

    assert excess(39, {"thing": 9}) == 0
    assert excess(100, {"thing": 2}) == 1
    assert excess(1000, {"thing": 2, "semicolon": 7}) == 0
    assert excess(1000, {"thing": 2, "semicolon": 8, "of which": 5}) == 2
    assert excess(1000, dict.fromkeys(prose.MARKERS, 1)) == 0
    assert excess(1000, dict.fromkeys(prose.MARKERS, 2)) == 13


def test_the_list_is_only_lowered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """`--write` adds no file to a list; without one it makes it."""
    monkeypatch.setattr(prose, "RATCHET", tmp_path / "ratchet.json")
    prose.write({"b.py": 3, "a.py": 2})
    assert prose.listed() == {"a.py": 2, "b.py": 3}
    prose.write({"b.py": 1, "c.py": 4, "a.py": 5})
    assert json.loads(prose.RATCHET.read_text()) == {"a.py": 2, "b.py": 1}
