"""Physics and appearance from the layout's seed: the scene draws masses, gains and colours, the task draws friction."""

import torch
import tyro
from torch import Tensor

from sceniris_gym import SceneVectorEnv, State
from sceniris_gym.envs.tabletop_lift import TabletopLift

THING = {"mass": {"scale": [0.5, 2.0], "distribution": "log_uniform"}, "friction": {"scale": [0.7, 1.3]}}
COLOUR = {"rgba": {"abs": [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]]}}
SCENE = {
    "base": "tabletop_lift",
    "objects": {name: {"randomize": THING | COLOUR} for name in ("can", "lemon", "block")},
    "robot": {"randomize": {"gains": {"scale": [0.8, 1.2]}, "damping": {"scale": [0.5, 2.0], "each": True}}},
    "randomize": {
        "lights": {"lamp": {"dir": {"add": [[-0.5, -0.5, 0.0], [0.5, 0.5, 0.0]]}, "diffuse": {"scale": [0.3, 1.3]}}},
        "cameras": {"overview": {"quat": {"add": [[-4.0, -4.0, -4.0], [4.0, 4.0, 4.0]]}}},
        "materials": {"table/wood": {"rgba": {"scale": [[0.4, 0.4, 0.4], [1.1, 1.1, 1.1]]}}},
    },
}


class RoughLift(TabletopLift):
    """TabletopLift with a rough tabletop in half of the worlds. Contacts use the greater friction of two geoms."""

    model_fields = ("geom_friction",)

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Draw the tabletop's friction in the worlds that are reset."""
        super().on_reset(s, mask)
        s.scale_field("geom_friction", "table/top", torch.where(s.random("rough top") < 0.5, 3.0, 1.0), mask)


def main(num_envs: int = 16, device: str | None = None) -> None:
    """Reset some of the worlds, and compare the drawn values."""
    envs = SceneVectorEnv(RoughLift, num_envs, scene=SCENE, device=device)
    envs.reset(seed=0)
    factors = envs.state.randomized("can.mass")[:, 0].clone()
    print(f"masses of the can are {factors.min():.2f} to {factors.max():.2f} of the model's")
    top = envs.state.model_field("geom_friction", "table/top")
    print(f"{int((top[:, 0] > 1.0).sum())} of {num_envs} tables are rough")
    envs.reset(options={"reset_mask": torch.arange(num_envs) < 2})
    kept = envs.state.randomized("can.mass")[:, 0] == factors
    print(f"after a reset of 2 worlds, {int(kept.sum())} keep their masses")


if __name__ == "__main__":
    tyro.cli(main)
