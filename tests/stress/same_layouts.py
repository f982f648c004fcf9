"""Are the layouts of one device those of another? The first one's are saved, the second one's compared with them.

python -m tests.stress.same_layouts save FOLDER mid kitchen --device cpu
python -m tests.stress.same_layouts compare FOLDER mid kitchen --device cuda:0
"""

from __future__ import annotations

import argparse
from pathlib import Path

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene

_POSITION, _ANGLE = 1.0e-6, 1.0e-6
_COUNTED = ("attempts", "status", "present", "grasp")
"""What has to be equal if the same trials were accepted."""


def layouts_of(compiled: CompiledScene, worlds: int) -> dict[str, np.ndarray]:
    """The first episode of so many worlds."""
    generator = LayoutGenerator(compiled, worlds)
    generator.generate()
    names = ("qpos", "mocap_pos", "mocap_quat", *_COUNTED)
    return {name: getattr(generator.layouts, name).numpy() for name in names}


def differences(
    mjm: mujoco.MjModel, a: dict[str, np.ndarray], b: dict[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """By how much layouts differ at most: in positions [m] and in angles [rad], shape (n,) each."""
    position = np.abs(a["mocap_pos"] - b["mocap_pos"]).reshape(len(a["qpos"]), -1).max(axis=1, initial=0.0)
    angle = np.zeros(len(position))
    turns = [[x["mocap_quat"] for x in (a, b)]]
    for kind, adr in zip(mjm.jnt_type, mjm.jnt_qposadr, strict=True):
        far = np.abs(a["qpos"][:, adr : adr + 3] - b["qpos"][:, adr : adr + 3])
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            position = np.maximum(position, far.max(axis=1))
            turns.append([x["qpos"][:, None, adr + 3 : adr + 7] for x in (a, b)])
        elif kind == mujoco.mjtJoint.mjJNT_BALL:
            turns.append([x["qpos"][:, None, adr : adr + 4] for x in (a, b)])
        else:
            angle = np.maximum(angle, far[:, 0])
    for one, other in turns:
        q, r = one.astype(float), other.astype(float)
        between = np.minimum(np.linalg.norm(q - r, axis=2), np.linalg.norm(q + r, axis=2))
        angle = np.maximum(angle, 2.0 * between.max(axis=1, initial=0.0))
    return position, angle


def main() -> None:
    """Print a line for each scene that is compared."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("save", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="+")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--worlds", type=int, default=2048)
    words = parser.parse_args()
    wp.config.quiet = True
    if words.what == "save":
        words.folder.mkdir(parents=True, exist_ok=True)
    for scene in words.scenes:
        compiled = compile_scene(scene, words.device)
        made, file = layouts_of(compiled, words.worlds), words.folder / f"{scene}.npz"
        if words.what == "save":
            np.savez_compressed(file, allow_pickle=False, **made)
            continue
        if not file.exists():
            parser.error(f"there is no {file}: save the layouts of '{scene}' first")
        saved = dict(np.load(file))
        if len(saved["qpos"]) != words.worlds:
            parser.error(f"{file} has {len(saved['qpos'])} worlds: give --worlds {len(saved['qpos'])}")
        same = np.all([(made[n] == saved[n]).reshape(words.worlds, -1).all(axis=1) for n in _COUNTED], axis=0)
        position, angle = differences(compiled.mjm, made, saved)
        beyond = same & ((position > _POSITION) | (angle > _ANGLE))
        print(
            f"{scene}: of {words.worlds} layouts {int((~same).sum())} of other trials; of the same ones "
            f"{int(beyond.sum())} beyond 1 um or 1e-6 rad, at most {position[same].max(initial=0.0):.2g} m "
            f"and {angle[same].max(initial=0.0):.2g} rad; rows {np.flatnonzero(beyond)[:8].tolist()}",
            flush=True,
        )


if __name__ == "__main__":
    main()
