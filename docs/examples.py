"""The examples of the pages on the scene language: every YAML block with its picture below it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ruamel.yaml import YAML

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.variants import with_variants

FOLDER = Path(__file__).parent / "language"
PAGES = sorted(FOLDER.glob("*.md"))
TEXT_KEY = "Scene"
"""Key of the PNG text that holds the example from which the picture was drawn."""
_BLOCK = re.compile(r"^```yaml\n(?P<text>.*?)^```$(?P<rest>[^`]*)", re.MULTILINE | re.DOTALL)
_PICTURE = re.compile(r"\n!\[(?P<caption>[^\]]+)\]\((?P<path>[^)\s]+)\)\n")


@dataclass(frozen=True)
class Example:
    """A scene file within a page.

    Attributes:
        text: The YAML as written on the page. Paths in it are relative to the picture's folder.
        caption: What the picture shows.
        picture: Its path.
    """

    text: str
    caption: str
    picture: Path

    @property
    def name(self) -> str:
        """The picture's name, which no two examples share."""
        return self.picture.stem

    @property
    def own_objects(self) -> list[str]:
        """The objects and robots that the example itself mentions; all objects if it mentions none of them."""
        data = self._data()
        robots = ["robot"] if "robot" in data else list(data.get("robots", {}))
        scene = self.load()
        names = data.get("objects") or ([] if robots else scene.objects)
        return [*with_variants(names, scene.variants), *robots]

    @property
    def jointed_objects(self) -> list[str]:
        """The objects whose joints it samples."""
        return [name for name, words in self._data().get("objects", {}).items() if "joints" in words]

    def load(self) -> SceneConfig:
        """Read the scene.

        Raises:
            ScenirisError: the scene is wrong.
        """
        data = self._data()
        for words, key in ((data, "base"), (data, "model"), (data.get("robot", {}), "model")):
            if (self.picture.parent / str(words.get(key))).is_file():
                words[key] = str(self.picture.parent / words[key])
        return SceneConfig.load({"name": self.name, **data})

    def _data(self) -> dict:
        return YAML(typ="safe", pure=True).load(self.text)


def read_examples(*pages: Path) -> list[Example]:
    """Return the examples of pages in order.

    Raises:
        ValueError: an example without a picture, or two with the same one.
    """
    found: dict[Path, Example] = {}
    for page in pages:
        for block in _BLOCK.finditer(page.read_text(encoding="utf-8")):
            picture = _PICTURE.match(block["rest"])
            if picture is None:
                raise ValueError(f"{page}: an example has no picture below it:\n{block['text']}")
            path = page.parent / picture["path"]
            if path in found:
                raise ValueError(f"{page}: '{picture['path']}' is the picture of two examples.")
            found[path] = Example(block["text"], picture["caption"], path)
    return list(found.values())
