"""Names of layouts: what is read is what was written, and anything else is refused."""

import pytest

from sceniris_gym.errors import LayoutIdError
from sceniris_gym.layout.layout_id import LayoutId


@pytest.mark.parametrize("split", ["train", "eval"])
@pytest.mark.parametrize(("seed", "episode"), [(0, 0), (2**64 - 1, 2**31 - 1), (42, 7)])
def test_an_id_is_read_as_it_was_written(split: str, seed: int, episode: int):
    """Up to the largest numbers."""
    assert LayoutId.parse(f"abc:{split}:{seed}:{episode}") == LayoutId("abc", split, seed, episode)


@pytest.mark.parametrize("text", ["", "a:train:1", "a:test:1:0", "a:train:-1:0", f"a:train:{2**64}:0", "a:train:0:1.5"])
def test_anything_else_is_refused(text: str):
    """With the form that it should have."""
    with pytest.raises(LayoutIdError, match="should be scenehash:split:seed:episode"):
        LayoutId.parse(text)
