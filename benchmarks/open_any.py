"""Success on furniture that training never saw, after training on 1, 8 and 64 units.

    python -m benchmarks.open_any --units 8 --seed 0 --out results/open_any/8_0 --device cuda:0

Generates 80 units with drawers, doors or a lid, of which 16 are held out. Trains OpenAny-v0 on some of the other 64,
all runs for the same number of control steps. Judges the policy on the 16 units, the same layouts for all runs, and on
layouts with the units that it was trained on. All runs simulate the same model, which has the joints of all units. A
run that was stopped goes on when started again, and `--minutes` stops it earlier. Prints a line of JSON, which it also
leaves in `open_any.json` in its folder: for both kinds of layouts the share of successes, its 95% interval, and the
share of each unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import tyro

import sceniris_gym
from benchmarks import lift_any
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.registration import ENTRY_POINTS

TASK = "OpenAny-v0"
KINDS = ("base_drawers", "base_doors", "base_lid")
"""A run with one unit has this kind, by the remainder of its seed."""
GENERATED = 158
"""Number of generated units, so that 80 have one of these kinds."""
CHANGES = ("gamma=0.985", "entropy=0.005", "steps=32")
"""The settings of DrawerPick-v0. They and the number of steps were fixed before the first run that counts."""


@dataclass(frozen=True)
class Options(lift_any.Options):
    """Options of a run.

    Attributes:
        units: number of units that the policy is trained on, at most 64
        minutes: stop a call after this time of training
        furniture: folder of the units, made if it is missing
    """

    units: int = 8
    out: Path = Path("results/open_any")
    million_steps: float = 26.2
    minutes: float = 600.0
    furniture: Path = Path("results/furniture")


def scene_with(units: int, seed: int, furniture: Path) -> dict[str, Any]:
    """Return overrides of the task's scene with all units, of which the split `train` has `units`."""
    scene = {"objects.unit.asset": str(furniture.resolve() / "base_[dl]*.xml")}
    splits = SceneConfig.load("open_any", scene).groups["unit"].splits
    known = [name for name, split in splits.items() if split == "train"]
    # by turns, a unit of each kind
    turns = [[name for name in known if name.startswith(f"unit/{kind}")] for kind in KINDS]
    first = seed % len(KINDS)
    place = {name: (at, (kind - first) % len(KINDS)) for kind, turn in enumerate(turns) for at, name in enumerate(turn)}
    order = sorted(known, key=place.__getitem__)
    return scene | {f"objects.{name}.weight": 0 for name in order[units:]}


def register(options: Options) -> str:
    """Register the task of a run, and return its id."""
    if not options.furniture.exists():
        sceniris_gym.furniture(options.furniture, GENERATED, seed=1)
    known, name = gymnasium.spec(f"sceniris_gym/{TASK}"), f"Open{options.units}x{options.seed}-v0"
    kwargs = {**known.kwargs, "overrides": scene_with(options.units, options.seed, options.furniture)}
    gymnasium.register(id=name, **ENTRY_POINTS, max_episode_steps=known.max_episode_steps, kwargs=kwargs)
    return name


def main(options: Options) -> None:
    """Train, judge and print."""
    found = lift_any.train(register(options), options, "unit", CHANGES, options.minutes)
    lift_any.tell({"units": options.units, **found}, options.out / "open_any.json")


if __name__ == "__main__":
    main(tyro.cli(Options))
