"""Grasp sites: the open hand fits around the object there, closing fingers touch it, and it can be lifted."""

from __future__ import annotations

from importlib.resources import files

import mujoco
import numpy as np
import pytest

from tests.assets.geometry import load
from tests.versions import OLD

GRASPED = [
    "apple", "banana", "block", "book", "bottle", "bowl", "brick", "can", "cereal_box", "glass", "lemon", "mug",
    "orange", "pan", "pear", "peg", "spatula",
]  # fmt: skip
FURNITURE = ["cabinet", "cupboard"]
ARMS = ["panda", "ur5e", "heron"]
LIFT = 0.1  # m
# How far the centre of mass rises at least [m]: what is held off its centre turns down a little, the pan to the floor.
RISES = {"mug": 0.07, "bowl": 0.075, "book": 0.075, "pan": -0.01}
# How much less [m] that may be in MuJoCo before 4.0, where the mug rises 6 mm less and the banana 1 mm.
LESS = 0.01 if OLD else 0.0


def sites(name: str) -> list[str]:
    """The grasp sites of an asset."""
    model, _ = load(name)
    return [site for site in (model.site(i).name for i in range(model.nsite)) if site.startswith("grasp_")]


class Hand:
    """An arm's hand alone, carried by a vertical slide, open around a grasp of an asset that stands on a floor."""

    def __init__(self, arm: str, asset: str, site: str):
        assets = files("sceniris_gym.assets")
        spec = mujoco.MjSpec()
        spec.option.timestep, spec.option.integrator = 0.004, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        # Nobody can take a book that lies flat on something by its edges.
        height = -1.0 if asset == "book" else 0.0
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], pos=[0, 0, height])
        thing = mujoco.MjSpec.from_file(str(assets / f"{asset}.xml"))
        for key in list(thing.keys):
            thing.delete(key)
        spec.attach(thing, prefix="o/", frame=spec.worldbody.add_frame(pos=[0, 0, 0.0005]))
        if asset in GRASPED:
            spec.body(f"o/{asset}").add_freejoint()
        place = spec.compile()
        data = mujoco.MjData(place)
        mujoco.mj_kinematics(place, data)
        frame, quat = data.site(f"o/{site}"), np.empty(4)
        mujoco.mju_mat2Quat(quat, frame.xmat)
        carrier = spec.worldbody.add_body(name="carrier")
        carrier.add_joint(name="lift", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1], armature=20)
        whole = mujoco.MjSpec.from_file(str(assets / f"{arm}.xml"))
        whole.delete(whole.keys[0])
        tcp, hand = whole.site("tcp").pos[2], whole.body("hand")
        hand.pos, hand.quat = [0, 0, 0], [1, 0, 0, 0]
        origin = frame.xpos - tcp * frame.xmat.reshape(3, 3)[:, 2]
        carrier.add_frame(pos=origin, quat=quat).attach_body(hand, "h/", "")
        spec.add_actuator(
            name="lift", target="lift", trntype=mujoco.mjtTrn.mjTRN_JOINT, gainprm=[4e4] + [0] * 9,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE, biasprm=[0, -4e4, -2e3] + [0] * 7,
        )  # fmt: skip
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.fingers = [self.model.joint(f"h/finger_joint{i}").qposadr[0] for i in (1, 2)]
        travel = self.model.joint("h/finger_joint1").range[1]
        self.data.qpos[self.fingers] = travel
        self.data.actuator("h/gripper").ctrl = travel
        self.thing = self.model.site(f"o/{site}").bodyid[0]
        mujoco.mj_forward(self.model, self.data)

    def touches(self) -> set[str]:
        """Return pairs in contact as names joined by a +: `hand`, `left_finger`, `right_finger`, `thing`, `floor`."""
        names = {0: "floor", self.thing: "thing"}
        pairs = self.model.geom_bodyid[self.data.contact.geom]
        return {"+".join(sorted(names.get(b, str(self.model.body(b).name)[2:]) for b in pair)) for pair in pairs}

    def close(self) -> None:
        """Close the fingers within 0.6 s, without gravity, which would take a book away meanwhile."""
        self.model.opt.gravity[2] = 0.0
        self.data.actuator("h/gripper").ctrl = 0.0
        mujoco.mj_step(self.model, self.data, nstep=150)
        self.model.opt.gravity[2] = -9.81

    def lift(self) -> None:
        """Rise by 10 cm within 1 s, and wait for 0.5 s."""
        for share in np.linspace(0.0, 1.0, 250):
            self.data.actuator("lift").ctrl = LIFT * share
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_step(self.model, self.data, nstep=125)

    def height(self) -> float:
        """Height of the object's centre of mass [m]."""
        return float(self.data.xipos[self.thing, 2])


HELD = {"left_finger+thing", "right_finger+thing"}


@pytest.mark.parametrize("asset", GRASPED)
@pytest.mark.parametrize("arm", ARMS)
def test_a_hand_fits_around_every_grasp_and_lifts_the_object(arm, asset):
    """Open, it touches nothing; closed, both fingers touch the object, which rises with the hand and stays in it."""
    for site in sites(asset):
        hand = Hand(arm, asset, site)
        assert hand.touches() <= {"floor+thing"}, site
        before = hand.height()
        hand.close()
        assert hand.touches() - {"floor+thing"} == HELD, site
        hand.lift()
        assert hand.height() - before > RISES.get(asset, 0.09) - LESS, site
        assert hand.touches() >= HELD, site
        assert asset == "pan" or "floor+thing" not in hand.touches(), site


@pytest.mark.parametrize("asset", FURNITURE)
@pytest.mark.parametrize("arm", ARMS)
def test_a_hand_fits_around_the_handles_of_furniture(arm, asset):
    """Before a shut drawer or door the open hand touches nothing; closed, both fingers touch its handle."""
    for site in sites(asset):
        hand = Hand(arm, asset, site)
        assert not any("hand" in touch or "finger" in touch for touch in hand.touches()), site
        hand.close()
        assert {touch for touch in hand.touches() if "hand" in touch or "finger" in touch} == HELD, site


@pytest.mark.parametrize("asset", GRASPED)
def test_grasps_belong_to_the_object_and_do_not_come_from_below(asset):
    """Sites are unit frames of the root body, and none approaches upward, so that a support is not in the way."""
    model, data = load(asset)
    chosen = [model.site(site) for site in sites(asset)]
    assert len(chosen) >= 2
    for site in chosen:
        assert site.bodyid[0] == model.body(asset).id
        np.testing.assert_allclose(np.linalg.norm(site.quat), 1.0, atol=1e-9)
        assert data.site(site.id).xmat[8] < 1e-6


@pytest.mark.parametrize("asset", ["apple", "orange", "banana", "mug", "bowl", "can"])
def test_a_fine_mesh_is_grasped_as_the_coarse_one(asset):
    """Both have the same sites at the same places."""
    coarse, fine = load(asset)[0], load(f"{asset}_16k")[0]
    assert [coarse.site(i).name for i in range(coarse.nsite)] == [fine.site(i).name for i in range(fine.nsite)]
    np.testing.assert_array_equal(coarse.site_pos, fine.site_pos)
    np.testing.assert_array_equal(coarse.site_quat, fine.site_quat)
