"""Warnings of what is accepted but was probably not meant."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ModelWarning
from sceniris_gym.program.oddities import warn_of_oddities
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.model import build_model
from tests.layout.scenes import write_mjcf

# A cube with a vertex in the middle of an edge, closed by a face without area.
_CORNERS = [(x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (0.0, 0.2)] + [(-0.1, -0.1, 0.1)]
_FACES = "0 2 6 0 6 4 1 5 7 1 7 3 2 3 7 2 7 6 4 6 7 4 7 5 0 1 3 0 3 2 0 4 8 8 4 5 8 5 1 0 8 1"


def warned(objects: dict, **others: object) -> list[str]:
    """The texts of all warnings about a scene of these objects."""
    scene = build_model(SceneConfig.load({"objects": objects, **others}))
    plan = build_plan(scene)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_oddities(scene, plan)
    assert all(w.category is ModelWarning for w in caught)
    return [str(w.message) for w in caught]


@pytest.mark.parametrize("scene", shipped("envs", ".yaml"))
def test_shipped_scenes_give_no_warning(scene: str):
    """Nor do the assets in them."""
    model = build_model(SceneConfig.load(scene))
    plan = build_plan(model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_oddities(model, plan)


def test_faces_without_area_are_named_with_their_number(tmp_path: Path):
    """With the visual geometry alone, which has faces."""
    vertices = " ".join(f"{v}" for corner in _CORNERS for v in corner)
    rest = f'<asset><mesh name="cube" vertex="{vertices}" face="{_FACES}"/></asset>'
    asset = write_mjcf(tmp_path, "crate", '<geom name="skin" type="mesh" mesh="cube"/>', rest)
    objects = {"crate": {"asset": asset, "kind": "static"}}
    assert warned(objects) == []
    (text,) = warned(objects, geometry="visual")
    assert "faces without area are left out: 1 of geom 'crate/skin'" in text
    assert "remove degenerate faces" in text
