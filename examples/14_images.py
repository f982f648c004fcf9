"""A task with two cameras, one of them on the arm's hand. The program saves pictures of a few worlds."""

import torch
import tyro
from PIL import Image
from torch import Tensor

from sceniris_gym import ArmController, SceneVectorEnv, State, Task

SCENE = {
    "robot": {"asset": "panda", "base": [-0.3, 0.0, 0.4]},
    "objects": {
        "table": {"asset": "table", "kind": "static"},
        "mug": {"asset": "mug", "on": "table", "ratio_on_support": 1},
        "orange": {"asset": "orange", "on": "table", "ratio_on_support": 1, "reachable": "map"},
    },
    "cameras": {
        "side": {"pos": [0.75, -1.0, 1.2], "look_at": [0.0, 0.0, 0.5]},
        "wrist": {"body": "robot/hand", "pos": [0.09, 0.0, 0.0], "look_at": [0.02, 0.0, 0.2], "fovy": 75},
    },
}
IMAGES = {"side": {"size": (96, 96), "data": ("rgb", "depth"), "shadows": True}, "wrist": {"size": (96, 96)}}


class SeeOrange(Task):
    """Task of moving the fingertips to within 6 cm of an orange, which the policy sees only in pictures."""

    action_size = 7

    def bind(self, s: State) -> None:
        self.arm = ArmController(s)

    def apply(self, s: State, action: Tensor) -> None:
        self.arm.move_joints(s, action)

    def observe(self, s: State) -> dict[str, dict[str, Tensor]]:
        return {"policy": {"arm_qpos": self.arm.qpos(s)}, "critic": {"distance": self.distance(s)}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        return {"near": 1.0 - torch.tanh(5.0 * self.distance(s))}

    def success(self, s: State) -> Tensor:
        return self.distance(s) < 0.06

    def distance(self, s: State) -> Tensor:
        return (s.site("orange/grasp")[:, :3] - self.arm.tool(s)[:, :3]).norm(dim=1)


def main(num_envs: int = 6, device: str | None = None, out: str = "images.png") -> None:
    """Save the first pictures in one file: rows for colours, depth and the wrist camera, and a column per world."""
    envs = SceneVectorEnv(SeeOrange, num_envs, scene=SCENE, images=IMAGES, device=device)
    images = envs.reset(seed=0)[0]["images"]
    depth = images["side"]["depth"]
    rows = (images["side"]["rgb"], (255 * depth / depth.max()).byte().expand(-1, -1, -1, 3), images["wrist"]["rgb"])
    Image.fromarray(torch.cat([torch.cat(list(row), dim=1) for row in rows]).cpu().numpy()).save(out)


if __name__ == "__main__":
    tyro.cli(main)
