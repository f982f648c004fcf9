"""Record states and images of LIBERO's own environments, with robosuite, for `benchmarks.libero_views`.

Runs in a separate venv, in which nothing of this package is:

    pip install robosuite==1.4.0 mujoco==3.2.7 bddl==1.0.1 gym==0.25.2 gymnasium "numpy<2" easydict future matplotlib
    pip install --no-deps hf-libero==0.1.4 robomimic==0.2.0
    MUJOCO_GL=egl python -P benchmarks/libero_robosuite.py BDDL_FILES -n 20 -o views.npz

LIBERO's models have to be where its `config.yaml` says. Files are evenly spaced among all below BDDL_FILES. Each is
reset once, and its robot stands still for ten actions, in which objects that LIBERO drops come to rest.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from libero.libero.envs import OffScreenRenderEnv  # pyrefly: ignore[missing-import]

SIZE, STILL = 256, 10
GEOM = 5
"""MuJoCo's number of the object type geom."""
CAMERA = "agentview"


def record(file: Path, seed: int) -> dict[str, np.ndarray]:
    """Return an image and the body at each of its pixels, row by row from the top, and the poses behind them.

    The body is -1 where robosuite draws a site.
    """
    env = OffScreenRenderEnv(bddl_file_name=str(file), camera_heights=SIZE, camera_widths=SIZE)
    env.seed(seed)
    env.reset()
    for _ in range(STILL):
        env.step([0.0] * 7)
    sim = env.env.sim
    names = [sim.model.body_id2name(body) or "" for body in range(sim.model.nbody)]
    shown = {"width": SIZE, "height": SIZE, "camera_name": CAMERA}
    rgb, seen = sim.render(**shown)[::-1], sim.render(**shown, segmentation=True)[::-1]
    bodies = np.where(seen[..., 0] == GEOM, np.asarray(sim.model.geom_bodyid)[seen[..., 1]], -1)
    bodies[seen[..., 1] < 0] = 0
    scalar = [joint for joint in range(sim.model.njnt) if sim.model.jnt_type[joint] >= 2]  # slides and hinges
    found = {
        "rgb": np.ascontiguousarray(rgb),
        "bodies": bodies.astype(np.int16),
        "names": np.array(names),
        "xpos": np.array(sim.data.body_xpos),
        "xquat": np.array(sim.data.body_xquat),
        "joints": np.array([sim.model.joint_id2name(joint) for joint in scalar]),
        "qpos": np.array([sim.data.qpos[sim.model.jnt_qposadr[joint]] for joint in scalar]),
    }
    env.close()
    return found


def main() -> None:
    """Record the views, and write them to a file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path)
    parser.add_argument("-n", type=int, default=20)
    parser.add_argument("-o", "--out", type=Path, default=Path("views.npz"))
    given = parser.parse_args()
    files = sorted(given.files.rglob("*.bddl"))
    kept: dict[str, np.ndarray] = {}
    for number, index in enumerate(np.linspace(0, len(files) - 1, given.n).round().astype(int)):
        file = files[index]
        kept |= {f"{number}/{name}": value for name, value in record(file, number).items()}
        kept[f"{number}/file"] = np.array(str(file.relative_to(given.files)))
        print(file.name, flush=True)
    np.savez_compressed(given.out, **kept)  # pyrefly: ignore[bad-argument-type]


if __name__ == "__main__":
    main()
