"""Progress of long work: listeners hear it, each their own."""

from __future__ import annotations

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.progress import listening, tell


def test_only_who_listens_hears():
    """Within the block, the innermost listener; afterwards nobody."""
    heard: list[tuple] = []
    inner: list[tuple] = []
    tell("nobody", 1, 2)
    with listening(lambda *words: heard.append(words)):
        tell("a", 1, 2)
        with listening(lambda *words: inner.append(words)):
            tell("b", 1, 1)
        tell("a", 2, 2)
    tell("nobody", 2, 2)
    assert (heard, inner) == ([("a", 1, 2), ("a", 2, 2)], [("b", 1, 1)])


def test_compiling_a_scene_tells_how_far_it_is():
    """Every kind of work to its end, in the order of the work."""
    heard: list[tuple] = []
    with listening(lambda *words: heard.append(words)):
        compile_scene("mid", "cpu", cache=False)
    works = ["objects", "placed objects", "pairs", "train bank", "eval bank"]
    assert list(dict.fromkeys(what for what, _, _ in heard)) == works
    for what, done, total in heard:
        assert 0 < done <= total
        assert (what, total, total) in heard
