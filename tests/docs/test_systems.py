"""The page on other systems has those of the paper's table, in its order."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "systems.md"
SYSTEMS = (
    *("Sceniris", "Scene Synthesizer", "Infinigen Indoors", "Spatial Scene Grammars"),
    *("RoboGen", "GenSim2", "GenSim", "RoboTwin 2.0"),
    *("RoboCasa", "LIBERO", "VIMA", "RLBench", "ProcTHOR", "UE5 PCG"),
)


def rows() -> list[list[str]]:
    """Return the cells of the tables, without their heads."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if row[0] != "system"]


def test_all_systems_are_there():
    """Each with all columns, and with something that is missing here."""
    assert tuple(row[0] for row in rows()) == SYSTEMS
    assert all(len(row) == 7 and all(row) for row in rows())


def test_the_columns_are_those_of_the_paper():
    """Names, batches and reach as in the LaTeX source; what is a cross there is a `no` here."""
    path = os.environ.get("SCENIRIS_PAPER")
    if path is None:
        pytest.skip("SCENIRIS_PAPER names no LaTeX source of arXiv:2512.16896")
    table = Path(path).read_text(encoding="utf-8").split(r"\midrule", 1)[1].split(r"\bottomrule")[0]
    theirs = [line.split("&") for line in table.splitlines() if line.count("&") == 6]
    plain = re.compile("[^a-z0-9]|ours|cite{[^}]*}")
    assert len(theirs) == len(rows())
    for row, (name, _, sampling, collisions, batched, relations, reach) in zip(rows(), theirs, strict=True):
        assert plain.sub("", name.lower()) == plain.sub("", row[0].lower())
        assert (r"\xmark" not in batched) == (row[3] == "yes")
        assert (r"\cmark" in reach) == (row[5] == "yes")
        for cell, own in ((sampling, row[1]), (collisions, row[2]), (relations, row[4])):
            assert (r"\xmark" in cell) == (own == "no"), (name, cell, own)


def test_prose_is_wrapped():
    """As in the code, but for tables."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if len(line) > 120 and not line.startswith("|")] == []
