"""A bin with three blocks in it, settled once for all tests that look at heaps."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.settling import settle

WALLS = "".join(
    f'<geom type="box" size="{half} .05" pos="{at} .05"/>'
    for half, at in ((".08 .005", "0 .075"), (".08 .005", "0 -.075"), (".005 .08", ".085 0"), (".005 .08", "-.085 0"))
)
BIN = f'<geom type="box" size=".08 .08 .005" pos="0 0 .005"/>{WALLS}'
THINGS = ("a", "b", "c")


@cache
def folder() -> Path:
    """A folder with the assets, and with the rows of five heaps."""
    made = Path(mkdtemp(prefix="heaps"))
    for name, inside in (("bin", BIN), ("block", '<geom type="box" size=".03 .02 .015"/>')):
        (made / f"{name}.xml").write_text(
            f'<mujoco><worldbody><body name="{name}">{inside}</body></worldbody></mujoco>'
        )
    settle(model(made), "pile", 5, seed=3).write(made / "pile.npz")
    return made


def words(at: Path, rows: str | None = "pile.npz", kind: str = "fixture", **changes: Any) -> dict[str, Any]:
    """A scene with a bin on the floor that is filled with the blocks."""
    things: dict[str, Any] = {name: {"asset": str(at / "block.xml")} for name in THINGS}
    pile: dict[str, Any] = {"fill": "bin", "of": list(THINGS)}
    if rows is not None:
        pile["rows"] = str(at / rows)
    container = {"asset": str(at / "bin.xml"), "kind": kind, "on": "floor"}
    return {"floor": {"size": [1, 1]}, "objects": {"bin": container, **things}, "heaps": {"pile": pile}, **changes}


def model(at: Path, **changes: Any) -> SceneModel:
    """The model of that scene without rows, as `settle` takes it."""
    return build_model(SceneConfig.load(words(at, rows=None), changes))
