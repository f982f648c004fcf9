"""Scaled assets: what MuJoCo compiles of them has the proportions of solid bodies of the same density."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import write_mjcf

FACTOR = 1.3


def built(asset: str, scale: float) -> SceneModel:
    """An asset alone."""
    return build_model(SceneConfig.load({"objects": {"thing": {"asset": asset, "scale": scale}}}))


@pytest.mark.parametrize("asset", ["can", "book", "mug", "own"])
def test_a_scaled_asset_is_the_same_body_in_another_size(asset: str, tmp_path: Path):
    """Places and sizes by the factor, mass by its third power, inertia by its fifth; boxes, capsules and meshes."""
    if asset == "own":
        capsule = '<geom type="capsule" fromto="0 0 0 .1 0 .02" size=".01" mass=".2"/><site pos=".1 0 0" size=".01"/>'
        inertial = '<inertial pos=".01 0 0" mass=".5" fullinertia=".01 .011 .012 .001 0 .002"/>'
        asset = write_mjcf(tmp_path, "own", inertial + capsule)
    one, other = built(asset, 1.0).mjm, built(asset, FACTOR).mjm
    for power, names in {
        0: ("body_iquat", "geom_quat", "geom_type", "geom_rgba", "site_quat"),
        1: ("geom_size", "geom_pos", "geom_rbound", "site_pos", "site_size", "mesh_vert", "mesh_pos", "body_ipos"),
        3: ("body_mass",),
        5: ("body_inertia",),
    }.items():
        for name in names:
            wanted = FACTOR**power * getattr(one, name)
            np.testing.assert_allclose(getattr(other, name), wanted, rtol=1e-5, atol=1e-7, err_msg=name)


def test_what_cannot_be_scaled_is_refused():
    """Assets with joints, objects without an asset, and factors that are no sizes."""
    with pytest.raises(
        NotSupportedError, match=r"objects\.thing\.scale: is for rigid assets, but this asset has joints"
    ):
        build_model(SceneConfig.load({"objects": {"thing": {"asset": "cabinet", "kind": "static", "scale": 2.0}}}))
    with pytest.raises(SceneKeyError, match="only together with an 'asset'"):
        SceneConfig.load({"objects": {"thing": {"kind": "marker", "scale": 2.0}}})
    with pytest.raises(SceneKeyError, match=r"objects\.thing\.scale: 0\.0 should be from 0\.01 to 100"):
        SceneConfig.load({"objects": {"thing": {"asset": "can", "scale": 0.0}}})


def test_a_list_of_scales_means_variants():
    """Each in the size of its own, named after it in percent, and the scene's hash knows them."""
    words = {"asset": "can", "scale": [0.5, 1.0], "region": {"box": [[0, 0, 1], [1, 1, 2]]}}
    scene = build_model(SceneConfig.load({"objects": {"thing": words}}))
    small, large = (scene.mjm.body(name).mass[0] for name in ("thing/can-50", "thing/can-100"))
    assert large == pytest.approx(8.0 * small, rel=1e-5)
    other = {**words, "scale": [0.6, 1.0]}
    assert build_model(SceneConfig.load({"objects": {"thing": other}})).hash != scene.hash
