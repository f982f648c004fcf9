"""Demonstrations as a LeRobot data set, by LeRobot's own writer: `python -m sceniris_gym.dataset.lerobot DEMOS OUT`.

The module needs only NumPy and the extra `lerobot`, whose versions of other libraries exclude the rest of this package.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from sceniris_gym.errors import import_extra

MANIFEST = "demos.json"
NAMES = {"observation/policy": "observation.state", "action": "action", "reward": "next.reward"}
"""Names of the arrays in a LeRobot data set. `image/CAMERA/rgb` becomes `observation.images.CAMERA`."""


def import_lerobot() -> Any:
    """Return LeRobot's class of data sets.

    Raises:
        MissingExtraError: LeRobot is not installed.
    """
    return import_extra("lerobot.datasets.lerobot_dataset", "lerobot", "lerobot").LeRobotDataset


def convert(demos: Path, out: Path) -> None:
    """Write a LeRobot data set with the group `policy`, the actions, the rewards and the pictures.

    Args:
        demos: Folder with demos.json and demos-*.npz.
        out: Folder of the data set, which must not exist.

    Raises:
        MissingExtraError: LeRobot is not installed.
    """
    writer, told, made = import_lerobot(), json.loads((demos / MANIFEST).read_text()), None
    for file in told["files"]:
        with np.load(demos / file) as part:
            pictures = {name: f"observation.images.{name.split('/')[1]}" for name in part if name.endswith("/rgb")}
            rows = {new: part[old] for old, new in (NAMES | pictures).items()}
            rows["next.reward"] = rows["next.reward"][:, None]
            ends = part["length"].cumsum()
        if made is None:
            features = {name: _feature(name, values, told) for name, values in rows.items()}
            made = writer.create(out.name, told["fps"], features, root=out)
        for first, last in zip([0, *ends[:-1]], ends, strict=True):
            for i in range(first, last):
                made.add_frame({"task": told["language"] or told["task"], **{name: rows[name][i] for name in rows}})
            made.save_episode()
    if made is not None:
        made.finalize()


def _feature(name: str, values: np.ndarray, told: dict[str, Any]) -> dict[str, Any]:
    """Return LeRobot's description of an array with a row for each step."""
    if values.ndim == 4:
        return {"dtype": "video", "shape": values.shape[1:], "names": ["height", "width", "channels"]}
    parts = told["observations"]["policy"] if name == "observation.state" else [(name, values.shape[1:])]
    names = [f"{part}.{i}" for part, shape in parts for i in range(int(np.prod(shape)))]
    return {"dtype": "float32", "shape": values.shape[1:], "names": names}


if __name__ == "__main__":
    convert(Path(sys.argv[1]), Path(sys.argv[2]))
