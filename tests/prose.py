"""Turns of phrase that slow a reader down, counted for each file against a budget.

    python -m tests.prose             # the files over budget
    python -m tests.prose PATH ...    # each sentence with a marker, in files or folders
    python -m tests.prose --write     # lower the excess of files in tests/prose_ratchet.json

It reads docstrings, comments and texts of raised errors (.py), and Markdown without code and tables (.md). A line
`# prose: ok, WHY` or `<!-- prose: ok, WHY -->` excuses the sentence that begins on the next line.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import re
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
RATCHET = ROOT / "tests" / "prose_ratchet.json"
JUDGED = ("sceniris_gym", "envs", "assets", "examples", "docs", "README.md", "CHANGELOG.md", "CONTRIBUTING.md")

PREP = "at|by|for|from|in|of|on|to|with"
OF = "by|for|from|in|of|on|to|with"
VERBS = "are|can|comes|does|follows|has|have|holds|is|may|needs|stands|was|were|will|would"
SAYING = "asked|asks?|believes?|knew|knows|said|says?|speaks?|tells?|told|wants?"
EACH = "an|each|every|first|fresh|last|latest|new|next|old|other|same|second|that|the|this"
THAN = "and|as|by|from|like|of|on|or|than|to|with"
CLOSE = "(?=[.,;:)]|$)"
MARKERS: dict[str, tuple[float, str]] = {
    "that of": (0, rf"\b(that of|those ({PREP}|that|wh(ich|o|ose))|({THAN}) that (at|for|from|in|on|which|with))\b"),
    "what is": (1, rf"\b(what|whatever) ({VERBS}|an?|each|it|no|that|the|they|you)\b(?![^.]*\?)"),
    "own": (0, r"\b(of (his|its|my|one's|their|your)|an|no) own\b"),
    "anew": (
        2.75,
        r"\b(alike|alone|anew|besides?|by (it|them)sel(f|ves)|else|for ever|hence|likewise|as well(?! as))\b",
    ),
    "thing": (1, r"\bthings?\b"),
    "so many": (0, r"\b((as|so) (few|little|many|much)\b(?! as possible)|so long\b(?! as))"),
    "of which": (4, rf"\b(({OF}) wh(om|ose|ich)\b(?! case)|(that|wh(at|ich|o))( [\w']+){{1,6}} ({PREP}){CLOSE})"),
    "go on": (2.25, r"\b(go|goes|going|gone|went) on\b"),
    "nothing": (0.75, rf"\b([Nn](either|obody|ot one|othing)|none|None of)\b|^No [a-z]+ ([a-z]+ )?({VERBS}|[a-z]+s)\b"),
    "semicolon": (6.25, ";"),
    "says": (1.75, rf"(?<!\bI )(?<!\bwe )(?<!\byou )(?<!user )(?<!users )\b({SAYING})\b"),
    "one(s)": (0.25, rf"\b({EACH}) ones?\b( (are|by|for|from|i[nst]|of|that|to|which|with)\b|{CLOSE})"),
    "there": (0, r"\b((that|wh(at|ich|o)) (are|is|was|were) there|(are|is) there(?! (an?|any|no)\b))\b"),
}
"""Turns of phrase: the hits that a file may have for each 1,000 words beyond the free ones, and their pattern."""
TOTAL_RATE, FREE, FREE_TOTAL, FEWEST_WORDS = 11, 1, 2, 40

EXCUSE = re.compile(r"\s*(?:#|<!--) prose: ok, \w")
SHAPE = r"\([\w*+./-]+,(?: [\w*+./-]+,?)*\)"
TYPE = r"\b(?:bool|bytes|float\d*|int\d*|str|uint\d+)"
UNIT = r"\[[^\s\]]{1,8}\]|, (?:m?m|m?s|rad|kg|N)(?:/s2?)?"
CLEAN = (
    (re.compile(rf"({SHAPE}|{TYPE}|{UNIT}|`{SHAPE}`|`{TYPE}`);"), r"\1,"),  # a semicolon that parts fields of an entry
    (re.compile(r"``[^`]*``|`[^`]*`|\$\$?[^$]+\$\$?"), "X"),
    (re.compile(r"!?\[([^\]]*)\](?:\([^)]*\)|\[[^\]]*\])?"), r"\1"),
    (re.compile(r"https?://\S+|<[^<>]+>|&\w+;"), "X"),
    (re.compile(r"[*_]{2,}"), ""),
)
LIST_MARK = re.compile(r"[-*+>] |\d+[.)] |#+ ")
ENTRY = re.compile(rf"{LIST_MARK.pattern}|\*{{0,2}}\w+(?: \([^)]*\))?: ")
NO_PROSE = ("|", ">>>", "...", "!!!", "???", "<", "#!", ".. ", "```", "~~~")
DIRECTIVE = re.compile(r"#+ ?(?:!|%|---|===|(?:fmt|pragma|pylint|pyrefly|ruff|type):|noqa)")
ACCESSES = re.compile(r"# [A-Z]\w* (?:in|out|both): [\w*]+(?:[,;:]? [\w*]+)*[,;:]?$")

Line = tuple[int, str]


class Sentence(NamedTuple):
    """A sentence, the line that it begins on, its words, and the names of the markers in it."""

    line: int
    text: str
    words: int
    markers: list[str]


def sentences(text: str, *, markdown: bool = False) -> list[Sentence]:
    """Return the sentences of a module or of a Markdown page; those that are excused have no markers."""
    excused = {number for number, line in enumerate(text.splitlines(), 2) if EXCUSE.match(line)}
    found = []
    for block in _markdown(text) if markdown else _python(text):
        for paragraph in _paragraphs(block):
            for line, sentence in _split(paragraph):
                names = [name for name, (_, pattern) in MARKERS.items() for _ in re.finditer(pattern, sentence)]
                words = len(re.findall(r"[A-Za-z']+", sentence))
                found.append(Sentence(line, sentence, words, [] if line in excused else names))
                excused.discard(line)
    return found


def excess(found: Sequence[Sentence]) -> int:
    """Return how many hits a file has to lose to be within its budget; 0 for a file with few words."""
    words = sum(sentence.words for sentence in found)
    hits = Counter(name for sentence in found for name in sentence.markers)
    by_marker = (hits[name] - int(FREE + rate * words / 1000) for name, (rate, _) in MARKERS.items())
    in_all = hits.total() - int(FREE_TOTAL + TOTAL_RATE * words / 1000)
    return 0 if words < FEWEST_WORDS else max(0, in_all, sum(number for number in by_marker if number > 0))


def _paragraphs(block: Iterable[Line]) -> Iterator[list[Line]]:
    """Yield paragraphs, list items and labelled entries; code and tables are left out."""
    held: list[Line] = []
    in_code = False
    for number, line in [*block, (0, "")]:
        bare = line.strip()
        if is_fence := bare.startswith(("```", "~~~")):
            in_code = not in_code
        is_prose = bool(bare) and not (in_code or is_fence or bare.startswith(NO_PROSE))
        if held and (not is_prose or ENTRY.match(bare)):
            yield held
            held = []
        if is_prose:
            held.append((number, LIST_MARK.sub("", bare, count=1) if LIST_MARK.match(bare) else bare))


def _split(paragraph: list[Line]) -> Iterator[Line]:
    """Yield the sentences of a paragraph with their lines, in which code, formulas and links are a word."""
    text = "\n".join(line for _, line in paragraph)
    for pattern, by in CLEAN:  # line breaks are kept, as they are counted
        text = pattern.sub(lambda m, by=by: "\n" * (m[0].count("\n") - (new := m.expand(by)).count("\n")) + new, text)
    start = 0
    for part in re.split(r"(?<=[.!?])(?=\s[A-Z\"'(])", text):
        lead = len(part) - len(part.lstrip())
        yield paragraph[min(text.count("\n", 0, start + lead), len(paragraph) - 1)][0], " ".join(part.split())
        start += len(part)


def _markdown(text: str) -> Iterator[list[Line]]:
    """Yield the whole page, without its front matter, comments and indented code."""
    text = re.sub(r"\A---\n.*?\n---\n|<!--.*?-->", lambda m: "\n" * m[0].count("\n"), text, flags=re.DOTALL)
    code = re.compile(r"(?: {4,}|\t)\s*(?![-*+] |\d+\. )\S")
    yield [(number, "" if code.match(line) else line) for number, line in enumerate(text.splitlines(), 1)]


def _python(text: str) -> Iterator[list[Line]]:
    """Yield docstrings, also below attributes, texts of raised errors, and comments."""
    for node in ast.walk(ast.parse(text)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(doc))):
                yield list(enumerate(doc.splitlines(), node.lineno))
            case ast.Raise(exc=ast.Call() as call):
                yield [(node.lineno, " ".join(part for part in _strings(call) if " " in part))]
    yield from _comments(text)


def _strings(node: ast.AST) -> Iterator[str]:
    """Yield the strings of an expression; a value in an f-string is an X."""
    if isinstance(node, ast.JoinedStr):
        yield "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    else:
        for child in ast.iter_child_nodes(node):
            yield from _strings(child)


def _comments(text: str) -> Iterator[list[Line]]:
    """Yield comments behind code one by one, and those on lines of their own as blocks; licences are left out."""
    blocks: list[list[Line]] = []
    last, is_access = -1, False
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            number, is_whole = token.start[0], token.line.lstrip().startswith("#")
            if not (is_whole and last == number - 1):
                blocks.append([])
            last = number if is_whole else -1
            is_access = bool(ACCESSES.match(token.string)) or (is_access and token.string.startswith("#   "))
            is_prose = not (is_access or DIRECTIVE.match(token.string) or EXCUSE.match(token.string))
            blocks[-1].append((number, token.string.lstrip("# ") if is_prose else ""))
    yield from (block for block in blocks if not re.search("copyright|licen[cs]e", str(block), re.IGNORECASE))


def judged() -> Iterator[Path]:
    """Yield the files that have a budget, each once where a folder is also reached by a link."""
    for path in (ROOT / name for name in JUDGED):
        found = [path] if path.is_file() else sorted([*path.rglob("*.py"), *path.rglob("*.md")])
        yield from (path for path in found if path.resolve() == path)


@cache
def read(path: Path) -> list[Sentence]:
    """Return the sentences of a file."""
    return sentences(path.read_text(encoding="utf-8"), markdown=path.suffix == ".md")


def over_budget() -> dict[str, int]:
    """Return the excess of each file that is over its budget."""
    found = {path.relative_to(ROOT).as_posix(): excess(read(path)) for path in judged()}
    return {path: number for path, number in found.items() if number}


def listed() -> dict[str, int]:
    """Return the files that may be over budget, and by how much."""
    return json.loads(RATCHET.read_text(encoding="utf-8"))


def write(now: Mapping[str, int]) -> None:
    """Lower the numbers of the list, or make it where it is missing."""
    most = listed() if RATCHET.is_file() else now
    kept = {path: min(number, most[path]) for path, number in sorted(now.items()) if path in most}
    RATCHET.write_text(json.dumps(kept, indent=2) + "\n", encoding="utf-8")


def main() -> None:
    """Print sentences with a marker, or the files over budget."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", nargs="*", type=Path, metavar="PATH")
    parser.add_argument("--write", action="store_true", help="lower the numbers of files that got better")
    args = parser.parse_args()
    for path in (path for root in args.paths for path in judged() if path.is_relative_to(root.resolve())):
        for sentence in (sentence for sentence in read(path) if sentence.markers):
            print(f"{path.relative_to(ROOT)}:{sentence.line} [{', '.join(sentence.markers)}] {sentence.text}")
    if args.write or not args.paths:
        now = over_budget()
        for path, number in now.items():
            print(f"{path}: {number} over budget")
        if args.write:
            write(now)


if __name__ == "__main__":
    main()
