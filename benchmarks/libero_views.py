"""LIBERO's camera `agentview` in this package beside robosuite's, in the same states.

    python -m benchmarks.libero_views BDDL_FILES --assets ASSETS --views views.npz --picture docs/libero.jpg

`views.npz` comes from `benchmarks/libero_robosuite.py`, whose head says how. The poses of objects and fixtures, the
joints of fixtures and the arm `panda` are set to robosuite's, and `Cameras` takes the image. For each thing that has at
least 50 pixels in one of the two images, IoU is the intersection of its pixels over their union. The work surface, the
furniture and the room are background, and pixels of robosuite's sites do not count. Prints a line of JSON for each
state, and one for all.
"""

from __future__ import annotations

import gc
import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from PIL import Image

from sceniris_gym.errors import ModelWarning
from sceniris_gym.geometry.rotations import product
from sceniris_gym.importers.libero.kinds import OBJECTS, ROTATION, WORKSPACES
from sceniris_gym.importers.libero.problem import Problem
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.pictures.camera import Cameras
from sceniris_gym.pictures.context import Looks, Shot
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.batch import Batch

CAMERA, SIZE, LEAST = "agentview", 256, 50
ROBOT = ("robot0_", "gripper0_")
_GAP = 4  # pixels between the images of the picture


@dataclass(frozen=True)
class Options:
    """Options of a run.

    Attributes:
        files: folder with the problem files
        assets: folder of LIBERO's models
        views: robosuite's states and images
        picture: file for a picture of some states, robosuite's images above
        shown: the states in the picture
    """

    files: tyro.conf.Positional[Path]
    assets: Path
    views: Path
    picture: Path | None = None
    shown: tuple[int, ...] = (2, 9, 16)


def owner(body: str, problem: Problem) -> str:
    """Return the name of the object or fixture, or 'robot', to which a body of robosuite's model belongs, or ''."""
    if body.startswith(ROBOT):
        return "robot"
    things = [*problem.objects, *(name for name, kind in problem.fixtures.items() if kind not in WORKSPACES)]
    return max((name for name in things if body.startswith(f"{name}_")), key=len, default="")


def set_state(scene: SceneModel, problem: Problem, data: Any, theirs: dict[str, np.ndarray]) -> None:
    """Set qpos and mocap poses of a Data of one world to robosuite's state."""
    mjm, number = scene.mjm, {name: i for i, name in enumerate(theirs["names"].tolist())}
    qpos, pos, quat = scene.home_qpos.copy(), data.mocap_pos.numpy(), data.mocap_quat.numpy()
    kinds = {**problem.objects, **problem.fixtures}
    for name, body in scene.bodies.items():
        if f"{name}_main" not in number:
            continue
        at = number[f"{name}_main"]
        kind = OBJECTS.get(kinds[name])
        back = np.multiply(ROTATION["z" if kind is None else kind.up], [1.0, -1.0, -1.0, -1.0])
        turn = product(theirs["xquat"][at], back)
        if (mocap := int(mjm.body_mocapid[body])) >= 0:
            pos[0, mocap], quat[0, mocap] = theirs["xpos"][at], turn
        elif mjm.body_jntnum[body]:
            adr = int(mjm.jnt_qposadr[mjm.body_jntadr[body]])
            qpos[adr : adr + 7] = [*theirs["xpos"][at], *turn]
    values = dict(zip(theirs["joints"].tolist(), theirs["qpos"].tolist(), strict=True))
    for joint in range(mjm.njnt):
        name = mjm.joint(joint).name
        for prefix in ("robot/", "panda/"):
            name = name.replace(f"{prefix}finger_", "gripper0_finger_").replace(f"{prefix}joint", "robot0_joint")
        if (name := name.replace("/", "_")) in values:
            qpos[mjm.jnt_qposadr[joint]] = values[name] * (-1.0 if name.endswith("finger_joint2") else 1.0)
    data.qpos.assign(qpos[None])
    data.mocap_pos.assign(pos)
    data.mocap_quat.assign(quat)


def compare(options: Options, views: dict[str, np.ndarray], state: int) -> tuple[dict[str, Any], np.ndarray]:
    """Return the figures of a state, and robosuite's image above this package's."""
    theirs = {name.partition("/")[2]: value for name, value in views.items() if name.startswith(f"{state}/")}
    file = str(theirs["file"])
    task = read_bddl(options.files / file, assets=options.assets, robot="panda", arena=True)
    scene = build_model(task.scene)
    batch = Batch(scene, 1, "cpu", substeps=1, graph=False)
    set_state(scene, task.problem, batch.data, theirs)
    batch.update()
    shots = {CAMERA: Shot((SIZE, SIZE), ("rgb", "segmentation"))}
    cameras = Cameras(scene, batch.model, batch.data, shots, Looks(), graph=False)
    cameras.launch()
    rgb, seen = (cameras.images[CAMERA][kind].numpy()[0] for kind in ("rgb", "segmentation"))
    ours = np.array(cameras.names)[seen[..., 0]]
    labels = np.array([owner(name, task.problem) for name in theirs["names"].tolist()])[theirs["bodies"]]
    ours[theirs["bodies"] < 0] = labels[theirs["bodies"] < 0] = ""
    row: dict[str, Any] = {"file": file, "iou": {}}
    for name in sorted({*labels.ravel().tolist()} - {""}):
        one, other = ours == name, labels == name
        if max(one.sum(), other.sum()) >= LEAST:
            row["iou"][name] = round(float((one & other).sum() / (one | other).sum()), 4)
    return row, np.vstack([theirs["rgb"], np.full((_GAP, SIZE, 3), 255, np.uint8), rgb])


def main() -> None:
    """Print a line for each state and a summary, and save the picture."""
    options = tyro.cli(Options, description=__doc__)
    views = dict(np.load(options.views))
    rows, shown = [], []
    for state in range(sum(name.endswith("/file") for name in views)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ModelWarning)
            row, pair = compare(options, views, state)
        rows.append(row)
        print(json.dumps(row), flush=True)
        gc.collect()  # models are in cycles of few objects
        if state in options.shown:
            shown += [pair, np.full((len(pair), _GAP, 3), 255, np.uint8)]
    things = [iou for row in rows for name, iou in row["iou"].items() if name != "robot"]
    robots = [row["iou"]["robot"] for row in rows]
    found = {"states": len(rows), "things": len(things), "mean": np.mean(things), "median": np.median(things)}
    found |= {"least": min(things), "share_095": np.mean(np.array(things) >= 0.95), "robot": np.mean(robots)}
    print(json.dumps({name: round(float(value), 4) for name, value in found.items()}))
    if options.picture is not None:
        Image.fromarray(np.hstack(shown[:-1])).save(options.picture, quality=88)


if __name__ == "__main__":
    main()
