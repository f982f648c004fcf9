"""Layout ids: what they say, and that they make the same layout again."""

import numpy as np
import pytest
import torch

from sceniris_gym.errors import LayoutIdError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.tools.commands.replay import LayoutId, find_scene, replay
from sceniris_gym.tools.tables import read_table


@pytest.mark.parametrize("split", ["train", "eval"])
def test_an_id_makes_the_same_layout_again(split: str):
    """World 5 of 8 in its third episode, and the same from its id alone."""
    compiled = compile_scene("mid", "cpu")
    generator = LayoutGenerator(compiled, 8, seed=2**63, split=split)
    for _ in range(3):
        generator.generate()
    table = read_table(generator)
    again = replay(compiled, LayoutId.parse(compiled.layout_id(2**63 + 5, 2, split)))
    for name in ("qpos", "mocap_pos", "mocap_quat", "status", "attempts", "seed", "episode"):
        assert np.array_equal(getattr(again, name)[0], getattr(table, name)[5]), name


def test_a_shipped_scene_is_found_by_its_hash():
    """The hash of a shipped scene is enough."""
    assert find_scene(compile_scene("mid", "cpu").hash).config.name == "mid"


@pytest.mark.parametrize(
    "text",
    ["", "abc:train:1", "abc:test:1:2", "abc:bank:1:2", "abc:train:-1:2", "abc:train:x:2", f"abc:train:{2**64}:0"]
    + ["a:eval:0:1:2"],
)
def test_other_texts_are_no_ids(text: str):
    """The error says what an id looks like, and names the splits that there are for users."""
    with pytest.raises(LayoutIdError, match=r"scenehash:split:seed:episode.* Splits: train, eval\."):
        LayoutId.parse(text)


def test_an_id_is_read_as_it_is_written():
    """Of numbers, and of what an environment's info gives: tensors, with seeds in two's complement."""
    compiled = compile_scene("mid", "cpu")
    assert LayoutId.parse(compiled.layout_id(42, 7, "eval")) == LayoutId(compiled.hash, "eval", 42, 7)
    assert compiled.layout_id(42, 7) == f"{compiled.hash}:train:42:7"
    seed, episode = torch.tensor([5, -1]), torch.tensor([0, 3], dtype=torch.int32)
    assert compiled.layout_id(seed[1], episode[1]) == compiled.layout_id(2**64 - 1, 3)
    assert compiled.layout_id(np.uint64(2**64 - 1), np.int32(3)) == compiled.layout_id(2**64 - 1, 3)
