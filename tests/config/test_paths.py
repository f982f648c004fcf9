"""Paths as users write them: what no file system takes is refused in our words, wherever it stands."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.config.paths import user_path
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneFileError
from tests.config.scenes import SMALL


def test_a_path_is_below_its_folder_unless_it_is_absolute(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """And `~` is the home folder."""
    monkeypatch.setenv("HOME", "/home/somebody")
    assert user_path("a/b.xml", tmp_path, "scene") == tmp_path / "a/b.xml"
    assert user_path("/a/b.xml", tmp_path, "scene") == Path("/a/b.xml")
    assert user_path("~/b.xml", tmp_path, "scene") == Path("/home/somebody/b.xml")


@pytest.mark.parametrize(
    ("text", "says"), [("~nosuchuser/a.xml", "there is no such user"), ("a/" * 3000 + "a.xml", "name too long")]
)
def test_what_is_no_path_is_refused_by_its_key(text: str, says: str):
    """As the scene itself, as a model, and as an asset; a long one is not shown whole."""
    apple = {"asset": text, "on": "floor"}
    for scene, key in (
        (text, "scene"),
        ({**SMALL, "model": text}, "scene: model"),
        ({**SMALL, "objects": {"apple": apple}}, "scene: asset"),
    ):
        with pytest.raises(SceneFileError, match=f"{key}: .*{says}") as found:
            SceneConfig.load(scene)
        assert len(str(found.value)) < 300
