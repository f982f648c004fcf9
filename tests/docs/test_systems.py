"""The page on other systems has those of the paper's table, and others, each with the source it was read in."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "systems.md"
OF_THE_PAPER = {
    *("Sceniris", "Scene Synthesizer", "Infinigen Indoors", "Spatial Scene Grammars"),
    *("RoboGen", "GenSim2", "GenSim", "RoboTwin 2.0"),
    *("RoboCasa", "LIBERO", "VIMA", "RLBench", "ProcTHOR", "UE5 PCG"),
}
LATER = {"Isaac Lab Arena", "ManiSkill", "OmniGibson", "MolmoSpaces", "LIBERO-Infinity", "SceneSmith", "SAGE"}


def rows() -> list[list[str]]:
    """Return the cells of the tables, without their heads."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if row[0] != "system"]


def test_all_systems_are_there():
    """Each once, with all columns: a version or commit with its source, and what is missing here."""
    names = [row[0].partition(" (")[0] for row in rows()]
    assert sorted(names) == sorted({*OF_THE_PAPER, *LATER, "sceniris_gym"})
    assert all(len(row) == 7 and all(row) for row in rows())
    assert [row[0] for row in rows() if not re.search(r"\d.*; |this repository", row[1])] == []


def test_the_systems_of_the_paper_are_those_of_its_table():
    """By their names in the LaTeX source."""
    path = os.environ.get("SCENIRIS_PAPER")
    if path is None:
        pytest.skip("SCENIRIS_PAPER names no LaTeX source of arXiv:2512.16896")
    table = Path(path).read_text(encoding="utf-8").split(r"\midrule", 1)[1].split(r"\bottomrule")[0]
    names = [line.split("&")[0] for line in table.splitlines() if line.count("&") == 6]
    plain = re.compile("[^a-z0-9]|ours|cite{[^}]*}")
    theirs = [plain.sub("", name.lower()) for name in names]
    assert sorted(theirs) == sorted(plain.sub("", name.lower()) for name in OF_THE_PAPER)


def test_prose_is_wrapped():
    """As in the code, but for tables."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if len(line) > 120 and not line.startswith("|")] == []
