"""The table of all words of a scene file: each field of the models that validate it, with its default."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from sceniris_gym.config import loader, objects, orientation, relations, robot, variants
from sceniris_gym.config.groups import GroupConfig, HeapConfig, StackConfig
from sceniris_gym.config.randomize import DrawConfig, SceneDraws
from sceniris_gym.config.robot import StartConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import CameraConfig, Floor, SceneWords
from sceniris_gym.config.section import Section

PAGE = Path(__file__).parents[2] / "docs" / "language" / "words.md"
MODELS: dict[str, type[BaseModel]] = {
    "scene": SceneConfig,
    "floor": Floor,
    "object": objects.ObjectConfig,
    "region": objects.RegionConfig,
    "joint": objects.JointConfig,
    "orientation": orientation.Orientation,
    "stable": orientation.Stable,
    **{kind.__name__.lower(): kind for kind in relations.KINDS if kind is not relations.Joined},
    "beside at sites": relations.Joined,
    "sites": relations.Connection,
    "distance": relations.Distance,
    "robot": robot.RobotConfig,
    "tcp": robot.TcpConfig,
    "camera": CameraConfig,
    "group": GroupConfig,
    "stack": StackConfig,
    "start": StartConfig,
    "heap": HeapConfig,
    "draw": DrawConfig,
    "whole scene": SceneDraws,
}
"""The models, by their names in the table."""
FIELDS = {(place, field.alias or name): field for place, m in MODELS.items() for name, field in m.model_fields.items()}
del FIELDS["group", "by_area"]  # only objects on several supports have it
READ_BEFORE = {
    ("scene", "base"),
    *(("object", word) for word in (loader.VARIANTS, loader.HOLDOUT, loader.TAGS)),
    *(("variant", word) for word in variants.DRAWN),
    *(("orientation", word) for word in orientation._WORDS),
    *(("reachable", word) for word in objects._REACH_WORDS),
}
"""Words that are read before a model sees them."""
ROW = re.compile(r"^\| \[`(?P<word>\w+)`\]\([^)]+\) \| (?P<places>[^|]+) \| [^|]+ \| (?P<default>[^|]*)\| [^|]+ \|$")


def table() -> dict[tuple[str, str], str]:
    """Return the default of each word, by its place and its name."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| [")]
    rows = [(line, ROW.match(line)) for line in lines]
    assert [line for line, row in rows if row is None] == []
    cells = [
        (place, row["word"], row["default"].strip()) for _, row in rows if row for place in row["places"].split(", ")
    ]
    assert len(cells) == len({cell[:2] for cell in cells})
    return {(place, word): default for place, word, default in cells}


def as_written(field: FieldInfo) -> str | None:
    """Return the default of a field as the table has it; None where the table may say what stands for None."""
    default = field.get_default(call_default_factory=True)
    if field.is_required() or field.validate_default:  # a default that is validated fails, and says what is missing
        return "*required*"
    if default is None:
        return None
    text = default if isinstance(default, str) else json.dumps(default)
    return f"`{re.sub(r'(?<=[0-9])[.]0(?![0-9])', '', text)}`"


def test_the_table_has_all_words_and_no_others():
    """Every field of every model, in the mapping that it belongs to."""
    assert set(table()) == set(FIELDS) | READ_BEFORE


def test_all_models_are_named():
    """No part of a scene file is forgotten, except bases of others."""

    def below(model: type[Section]) -> set[type[Section]]:
        return {model}.union(*map(below, model.__subclasses__()))

    abstract = {Section, SceneWords, relations.Relation, relations.Sector}
    ours = {model for model in below(Section) if model.__module__.startswith("sceniris_gym.")}
    assert ours - abstract == set(MODELS.values())


@pytest.mark.parametrize(("place", "word"), sorted(FIELDS), ids=" ".join)
def test_the_table_has_the_defaults_of_the_models(place: str, word: str):
    """Numbers, names and empty collections, and the words that have no default."""
    expected = as_written(FIELDS[place, word])
    assert expected is None or table()[place, word] == expected
