"""The examples on the pages of the scene language: every YAML block and the picture below it."""

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
"""Key of the PNG text with the example of the picture."""
_BLOCK = re.compile(r"^```yaml\n(?P<text>.*?)^```$(?P<rest>[^`]*)", re.MULTILINE | re.DOTALL)
_PICTURE = re.compile(r"\n!\[(?P<caption>[^\]]+)\]\((?P<path>[^)\s]+)\)\n")


@dataclass(frozen=True)
class Example:
    """A scene file within a page.

    Attributes:
        text: The YAML as written on the page. Paths in it are relative to the picture's folder.
        caption: Caption of the picture.
        picture: Path of the picture.
    """

    text: str
    caption: str
    picture: Path

    @property
    def name(self) -> str:
        """The unique name of the picture."""
        return self.picture.stem

    @property
    def own_objects(self) -> list[str]:
        """The objects and robots in the text of the example. For a text without them, all objects of the scene."""
        data = self._data()
        robots = ["robot"] if "robot" in data else list(data.get("robots", {}))
        scene = self.load()
        names = data.get("objects") or ([] if robots else scene.objects)
        return [*with_variants(names, scene.variants), *robots]

    @property
    def jointed_objects(self) -> list[str]:
        """The objects whose joints the example samples."""
        named = [name for name, words in self._data().get("objects", {}).items() if "joints" in words]
        return [*with_variants(named, self.load().variants)]

    def load(self) -> SceneConfig:
        """Read the scene.

        Raises:
            ScenirisError: the scene is wrong.
        """
        data = self._data()
        for words, key in ((data, "base"), (data, "model"), (data.get("robot", {}), "asset")):
            if (self.picture.parent / str(words.get(key))).is_file():
                words[key] = str(self.picture.parent / words[key])
        return SceneConfig.load({"name": self.name, **data})

    def _data(self) -> dict:
        return YAML(typ="safe", pure=True).load(self.text)


def read_examples(*pages: Path) -> list[Example]:
    """Return the examples of pages in order.

    Raises:
        ValueError: an example has no picture, or two examples have the same picture.
    """
    found: dict[Path, Example] = {}
    for page in pages:
        for block in _BLOCK.finditer(page.read_text(encoding="utf-8")):
            picture = _PICTURE.match(block["rest"])
            if picture is None:
                raise ValueError(f"{page}: an example should have a picture below it:\n{block['text']}")
            path = page.parent / picture["path"]
            if path in found:
                raise ValueError(f"{page}: '{picture['path']}' should be the picture of one example, got two.")
            found[path] = Example(block["text"], picture["caption"], path)
    return list(found.values())
