"""Pictures of the first worlds of a batch."""

import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.model import build_model
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.pictures import FrameCamera


def test_worlds_without_mocap_bodies_have_pictures():
    """Nothing but a free object on the floor: there are no mocap poses to copy."""
    scene = build_model(
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"block": {"asset": "block", "on": "floor"}}})
    )
    assert scene.mjm.nmocap == 0
    batch = Batch(scene, 3, "cpu", graph=False)
    pictures = FrameCamera(scene.mjm, batch.model, 2, 32, 24).take(batch.data)
    assert pictures.shape == (2, 24, 32, 3)
    assert len(np.unique(pictures)) > 2
