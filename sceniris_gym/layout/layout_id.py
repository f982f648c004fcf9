"""`LayoutId`: the name of a layout, by which it can be made again."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.layout.params import PARTS
from sceniris_gym.program.compiled import MOST_EPISODES, USER_SPLITS
from sceniris_gym.scene.model import SceneModel

_FORM = re.compile(rf"([^:]*):({'|'.join(USER_SPLITS)}):([0-9]{{1,20}}):([0-9]{{1,20}})(?::({PARTS}))?")


@dataclass(frozen=True)
class LayoutId:
    """A layout id as `CompiledScene.layout_id` writes it: its parts determine the layout."""

    scene: str
    split: str
    seed: int
    episode: int
    params: str = ""

    @classmethod
    def parse(cls, text: str) -> LayoutId:
        """Read `scenehash:split:seed:episode`, and `:params` where some differ from the scene file.

        Raises:
            ArgumentError: The text is not of this form, or has a param twice.
        """
        found = _FORM.fullmatch(text)
        if found is None or int(found[3]) >= 2**64 or int(found[4]) >= MOST_EPISODES:
            raise ArgumentError(
                f"layout id {short(text)} should be scenehash:split:seed:episode, as in '0123456789abcdef:train:42:0'. "
                f"Splits: {', '.join(USER_SPLITS)}. The seed is below 2^64, the episode below 2^31 - 1. Params may "
                "follow as name=hex, with 8 digits a number."
            )
        names = [unquote(part.partition("=")[0]) for part in (found[5] or "").split(",")]
        if len({*names}) < len(names):
            raise ArgumentError(f"layout id '{text}' should have each param once, and has: {', '.join(names)}.")
        return cls(found[1], found[2], int(found[3]), int(found[4]), found[5] or "")

    @classmethod
    def of_scene(cls, text: Any, scene: SceneModel, cure: str, split: str | None = None) -> LayoutId:
        """Read the id of a layout of a scene, and of a split if one is given; a LayoutId is taken as it is.

        Raises:
            ArgumentError: The text is not of the form of an id.
            SceneMismatchError: It is of another scene or split; the message ends with the cure. Or it is an id of a
                version with other layouts of this one.
        """
        found = text if isinstance(text, cls) else cls.parse(str(text))
        if found.scene != scene.hash:
            raise SceneMismatchError(f"layout '{text}': {scene.mismatch(found.scene, cure)}")
        if split not in (None, found.split):
            raise SceneMismatchError(f"layout '{text}' is of the split '{found.split}', not of split '{split}'. {cure}")
        return found
