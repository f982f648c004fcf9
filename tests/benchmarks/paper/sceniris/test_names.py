"""Names inside assets: those that scene files write, and that the built scene has."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.paper.sceniris.names import names_in
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.scene.build import build_model
from tests.scene.assets import CHEST, TETRAHEDRON, names


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a chest."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "knob.obj").write_text(TETRAHEDRON)
    (tmp_path / "chest.xml").write_text(CHEST)
    return tmp_path


def test_the_names_in_an_asset_are_those_of_its_joints_and_of_the_bodies_below_its_root(folder: Path):
    """As scene files write them, without a prefix: a free joint is none, and one without a name gets a number."""
    inside = names_in(str(folder / "chest.xml"), "here")
    assert (inside.joints, inside.bodies) == (("swing", "slide", "hinge"), ("tray", "lid"))
    loose = "<body name='b'><freejoint/><geom size='.1'/><body name='c'><joint/><geom size='.1'/></body></body>"
    (folder / "loose.xml").write_text(f"<mujoco><worldbody>{loose}</worldbody></mujoco>")
    inside = names_in(str(folder / "loose.xml"), "here")
    assert (inside.joints, inside.bodies) == (("joint1",), ("c",))
    with pytest.raises(UnknownNameError, match=r"here: unknown asset 'aple'.*mean 'apple'"):
        names_in("aple", "here")


def test_names_in_an_asset_are_found_again_in_the_scene(folder: Path):
    """Below the object's name, for a shipped asset and for a file."""
    for asset in ("cabinet", str(folder / "chest.xml")):
        scene = build_model(SceneConfig.load({"objects": {"a": {"asset": asset, "kind": "static"}}}))
        inside = names_in(asset, "here")
        assert {f"a/{name}" for name in inside.joints} == set(names(scene.mjm, "joint"))
        assert {"world", "a", *(f"a/{name}" for name in inside.bodies)} == set(names(scene.mjm, "body"))
