"""`LayoutId`: a text that identifies a layout and suffices to reproduce it."""

import re
from dataclasses import dataclass
from typing import Any, Self
from urllib.parse import unquote

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.layout.params import PARTS
from sceniris_gym.program.compiled import MOST_EPISODES, USER_SPLITS
from sceniris_gym.scene.model import SceneModel

_FORM = re.compile(rf"([^:]*):({'|'.join(USER_SPLITS)}):([0-9]{{1,20}}):([0-9]{{1,20}})(?::({PARTS}))?")


@dataclass(frozen=True)
class LayoutId:
    """The parts of a layout id, which `CompiledScene.layout_id` writes as a text. They determine the layout."""

    scene: str
    split: str
    seed: int
    episode: int
    params: str = ""

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read `scenehash:split:seed:episode`, followed by `:params` if some params differ from the scene file.

        Raises:
            ArgumentError: The text does not have this form, or repeats a param.
        """
        found = _FORM.fullmatch(text)
        if found is None or int(found[3]) >= 2**64 or int(found[4]) >= MOST_EPISODES:
            raise ArgumentError(
                f"layout id {short(text)} should be scenehash:split:seed:episode, as in '0123456789abcdef:train:42:0'. "
                f"Splits: {', '.join(USER_SPLITS)}. The seed is below 2^64, the episode below 2^31 - 1. Params may "
                "follow as name=hex, with 8 hexadecimal digits per number."
            )
        names = [unquote(part.partition("=")[0]) for part in (found[5] or "").split(",")]
        if len({*names}) < len(names):
            raise ArgumentError(f"layout id '{text}' should have each param once, got: {', '.join(names)}.")
        return cls(found[1], found[2], int(found[3]), int(found[4]), found[5] or "")

    @classmethod
    def of_scene(cls, text: Any, scene: SceneModel, cure: str, split: str | None = None) -> Self:
        """Read an id, and check its scene and optionally its split. A LayoutId is not parsed again.

        Raises:
            ArgumentError: The text does not have the form of an id.
            SceneMismatchError: The id belongs to another scene or split, or to a version that makes other layouts of
                this scene. The message ends with `cure`.
        """
        found = text if isinstance(text, cls) else cls.parse(str(text))
        if found.scene != scene.hash:
            raise SceneMismatchError(f"layout '{text}': {scene.mismatch(found.scene, cure)}")
        if split not in (None, found.split):
            raise SceneMismatchError(f"layout '{text}' has the split '{found.split}', not '{split}'. {cure}")
        return found
