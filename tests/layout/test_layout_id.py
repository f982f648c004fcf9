"""Names of layouts: what is read is what was written, and anything else is refused."""

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.scene.build import build_model


@pytest.mark.parametrize("split", ["train", "eval"])
@pytest.mark.parametrize(("seed", "episode"), [(0, 0), (2**64 - 1, 2**31 - 2), (42, 7)])
def test_an_id_is_read_as_it_was_written(split: str, seed: int, episode: int):
    """Up to the largest numbers."""
    assert LayoutId.parse(f"abc:{split}:{seed}:{episode}") == LayoutId("abc", split, seed, episode)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "a:train:1",
        "a:test:1:0",
        "a:train:-1:0",
        f"a:train:{2**64}:0",
        f"a:train:0:{2**31 - 1}",
        f"a:train:{'9' * 6000}:0",
    ],
)
def test_anything_else_is_refused(text: str):
    """With the form that it should have."""
    with pytest.raises(ArgumentError, match="should be scenehash:split:seed:episode"):
        LayoutId.parse(text)


@pytest.mark.parametrize("again", ["groups.some.count", "groups.some%2Ecount"])
def test_an_id_names_each_param_once(again: str):
    """Two numbers for one param are refused, however it is written."""
    bits = "3f80000040400000"
    assert LayoutId.parse(f"a:train:1:0:groups.some.count={bits},groups.any.count={bits}").params
    with pytest.raises(ArgumentError, match=r"each param once, got: groups\.some\.count, groups\.some\.count"):
        LayoutId.parse(f"a:train:1:0:groups.some.count={bits},{again}={bits}")


def test_an_id_is_of_a_scene_as_it_is_now():
    """One of another scene is refused."""
    scene = build_model(SceneConfig.load("mid"))
    assert LayoutId.of_scene(f"{scene.hash}:train:1:0", scene, "").seed == 1
    with pytest.raises(
        SceneMismatchError, match=rf"belongs to scene 0+, but 'mid' is now scene {scene.hash}\. Open it\."
    ):
        LayoutId.of_scene(f"{'0' * 16}:train:1:0", scene, "Open it.")
