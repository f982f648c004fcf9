"""Ids of layouts in mjlab, valid and from the bank, with and without a param: each makes the same layout again.

python -m tests.stress.mjlab_ids --ids 10000

mjlab needs MuJoCo 3.11, so this runs in the venv of `make test-mjlab`. Four cubes have little room, so that many worlds
run out of restarts. In every other environment a param makes it narrower. The ids of their second episodes go back in
another order of environments. The exit status is 1 if a bit of the layout or of an entity's pose differs.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from typing import Any

import numpy as np
import torch
from mjlab.entity import EntityCfg
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg
from mjlab.scene import SceneCfg
from mjlab.tasks.manipulation.config.yam.env_cfgs import get_cube_spec
from mjlab.terrains import TerrainEntityCfg

from sceniris_gym.adapters.mjlab import PlaceLayoutsCfg
from tests.stress.mixed import STATUS

_PARAM = "objects.cube_0.region"
_NARROW = [[0.28, -0.04], [0.35, 0.04]]
_CUBES = tuple(f"cube_{i}" for i in range(4))
_AREA = {"box": [[0.27, -0.05], [0.36, 0.05]]}
_SCENE = {"objects": {name: {"on": "terrain", "region": _AREA} for name in _CUBES}, "restarts": 1, "bank": 64}
_NUM_ENVS = 2500


def environment(seed: int) -> ManagerBasedRlEnv:
    """Return environments of the scene."""
    cubes = {name: EntityCfg(spec_fn=get_cube_spec) for name in _CUBES}
    scene = SceneCfg(
        num_envs=_NUM_ENVS, env_spacing=3.0, terrain=TerrainEntityCfg(terrain_type="plane"), entities=cubes
    )
    cfg = ManagerBasedRlEnvCfg(decimation=1, scene=scene, seed=seed)
    cfg.events["layouts"] = PlaceLayoutsCfg(scene=_SCENE, seed=seed, scene_params=[_PARAM])
    return ManagerBasedRlEnv(cfg, "cpu")


def rows(env: ManagerBasedRlEnv, term: Any) -> np.ndarray:
    """Return the layouts and the cubes relative to their environments, a row for each environment."""
    places = [env.scene[name].data.root_link_pos_w - env.scene.env_origins for name in _CUBES]
    return np.concatenate([term.layouts.qpos.cpu().numpy(), torch.cat(places, dim=1).cpu().numpy()], axis=1)


def main() -> int:
    """Send ids back until there were enough; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ids", type=int, default=10_000)
    wanted = parser.parse_args().ids
    counts: Counter[str] = Counter()
    first, second = environment(100_000), environment(7)
    terms = [env.event_manager.get_term_cfg("layouts").func for env in (first, second)]
    terms[0].set_param(_PARAM, _NARROW, torch.arange(0, _NUM_ENVS, 2))
    rng = np.random.default_rng(0)
    first.reset()
    while counts.total() < wanted:
        first.reset()
        served, ids, order = rows(first, terms[0]), terms[0].layout_ids(), rng.permutation(_NUM_ENVS)
        terms[1].reseed(layouts=[ids[i] for i in order])
        second.reset()
        status = terms[0].layouts.status.cpu().numpy()
        told = terms[1].layout_ids()
        for row, (i, found) in enumerate(zip(order.tolist(), rows(second, terms[1]), strict=True)):
            half = len(found) - 3 * len(_CUBES)  # poses are rounded to their environments' origins
            same = found[:half].tobytes() == served[i, :half].tobytes() and told[row] == ids[i]
            near = np.abs(found[half:] - served[i, half:]).max() < 1e-4
            param = "param" if "=" in ids[i] else "none"
            counts[f"{STATUS.get(int(status[i]), 'none')} {param} {'equal' if same and near else 'differs'}"] += 1
    print("\n".join(f"{name}: {count}" for name, count in sorted(counts.items())))
    return int(any("differs" in name for name in counts))


if __name__ == "__main__":
    sys.exit(main())
