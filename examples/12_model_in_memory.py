"""An existing simulation in memory: resets place some of its bodies, and keep the state of all others."""

import mujoco
import mujoco_warp as mjw
import tyro
import warp as wp

from sceniris_gym import ResetRandomizer, compile_scene

MJCF = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="2 2 .1"/>
    <geom name="top" type="box" size=".4 .3 .02" pos="0 0 .5"/>
    <body name="cup" pos="0 0 .56"><freejoint/><geom type="cylinder" size=".03 .04" mass=".2"/></body>
    <body name="brick" pos=".2 0 .54"><freejoint/><geom type="box" size=".05 .03 .02" mass=".4"/></body>
    <body name="ball" pos="1 0 .1"><freejoint/><geom size=".1" mass="1"/></body>
  </worldbody>
</mujoco>
"""
OBJECTS = {"cup": {"on": "top"}, "brick": {"on": "top", "relations": [{"left_of": "cup"}]}}


def main(nworld: int = 64, steps: int = 200, device: str | None = None) -> None:
    """Step a model with a rolling ball, while resets place cup and brick.

    Args:
        nworld: number of worlds.
        steps: physics steps between two resets, of 2 ms each.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    mjm = mujoco.MjModel.from_xml_string(MJCF)
    compiled = compile_scene({"model": mjm, "objects": OBJECTS}, device)
    with wp.ScopedDevice(compiled.device):
        model, data = mjw.put_model(mjm), mjw.make_data(mjm, nworld=nworld, nconmax=32, njmax=128)
        # "scene" writes only cup and brick. `mjm` has the names of the bodies of `model`.
        randomizer = ResetRandomizer(compiled, model, data, seed=0, scope="scene", mjm=mjm)
        wp.to_torch(data.qvel)[:, mjm.body("ball").dofadr[0]] = 0.5  # m/s, only once
        for _ in range(3):
            randomizer.reset()
            for _ in range(steps):
                mjw.step(model, data)
            pos = wp.to_torch(data.xpos)
            stand, ball = pos[:, mjm.body("cup").id, 2] > 0.5, pos[:, mjm.body("ball").id, 0]
            print(f"{stand.float().mean():.0%} of the cups stand; the ball of world 0 is at x = {ball[0]:.2f} m")
    print("brick:", randomizer.layouts.pose("brick")[:2].tolist())


if __name__ == "__main__":
    tyro.cli(main)
