"""Fields that follow from those of a thousand worlds, against `mj_setConst` of MuJoCo C in double precision.

    python -m tests.stress.fields                          # three scenes, about a minute on one CPU core
    python -m tests.stress.fields kitchen --worlds 100

Every field that something follows from is drawn for all elements of the model, by factors from 0.5 to 2 or by turns and
shifts where it is a pose. Errors are relative to the greatest value of an output in its world.
"""

from __future__ import annotations

import argparse
import copy

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from sceniris_gym.sim.derived import FOLLOWS
from sceniris_gym.sim.model_fields import ModelFields

SCENES = ("tabletop_lift", "drawer_pick", "clutter_extract")


def redraw(mjm: mujoco.MjModel, rng: np.random.Generator, fields: list[str]) -> mujoco.MjModel:
    """Return a copy of a model with fields of its own."""
    mjm = copy.copy(mjm)
    full = np.flatnonzero((mjm.body_simple == 0) & (mjm.body_weldid > 0))
    for name in fields:
        values = getattr(mjm, name)
        if name.endswith("quat"):
            rows = full if name == "body_iquat" else np.arange(len(values))
            values[rows] += 0.2 * rng.normal(size=values[rows].shape)
            values[:] /= np.linalg.norm(values, axis=1, keepdims=True)
        elif name == "body_ipos":
            values[full] += rng.uniform(-0.01, 0.01, (len(full), 3))
        elif name.endswith(("pos", "dir")):
            values += rng.uniform(-0.1, 0.1, values.shape)
        else:
            values *= rng.uniform(0.5, 2.0, (len(values), *[1] * (values.ndim - 1)))
    return mjm


def worst(scene: str, worlds: int, seed: int = 0) -> dict[str, float]:
    """Return the greatest relative error of each output."""
    built, rng = build_model(SceneConfig.load(scene)), np.random.default_rng(seed)
    sources = sorted({name for names in FOLLOWS.values() for name in names if hasattr(built.mjm, name)})
    outputs = [name for name in FOLLOWS if getattr(built.mjm, name).size]
    models = [redraw(built.mjm, rng, sources) for _ in range(worlds)]
    with wp.ScopedDevice("cpu"):
        m, d = mjw.put_model(built.mjm), mjw.make_data(built.mjm, worlds, nconmax=1, njmax=1)
        fields = ModelFields(built, m, d, grow=True)
        for name in sources:
            array = fields.wide(name)
            if array.size:
                array.assign(np.stack([getattr(each, name) for each in models]).reshape(array.numpy().shape))
        fields.launch_follow(wp.ones(worlds, dtype=wp.bool))
    errors = dict.fromkeys(outputs, 0.0)
    for world, mjm in enumerate(models):
        mujoco.mj_setConst(mjm, mujoco.MjData(mjm))
        for name in outputs:
            wanted = getattr(mjm, name)
            found = getattr(m, name).numpy()[world].reshape(wanted.shape)
            error = np.abs(found - wanted).max() / max(np.abs(wanted).max(), 1e-9)
            errors[name] = max(errors[name], float(error))
    return errors


def main() -> None:
    """Print the greatest errors of each scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--worlds", type=int, default=1000)
    given = parser.parse_args()
    for scene in given.scenes:
        errors = worst(scene, given.worlds)
        print(f"{scene}, {given.worlds} worlds:", ", ".join(f"{name} {error:.1e}" for name, error in errors.items()))


if __name__ == "__main__":
    main()
