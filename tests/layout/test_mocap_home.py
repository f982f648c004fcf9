"""Mocap bodies of the user's own model that are not placed stand where its keyframe 'home' has them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.layout.scenes import compile_on_cpu, make, posed, valid

MODEL = """<mujoco><worldbody>
  <geom name="ground" type="plane" size="1 1 .1"/>
  <body name="fence" mocap="true" pos="5 0 .1"><geom type="box" size=".3 .02 .1"/></body>
  <body name="crate" pos="0 0 .05"><freejoint/><geom type="box" size=".05 .05 .05"/></body>
  <body name="desk" pos=".4 .4 0" euler="0 0 20"><geom type="box" size=".05 .05 .2" pos="0 0 .2"/></body>
  <frame pos="7 0 0" euler="0 0 40"><body mocap="true" pos="0 0 .1"><geom type="box" size=".1 .1 .1"/></body></frame>
</worldbody><keyframe>
  <key name="other" mpos="1 1 1 2 2 2" mquat="1 0 0 0 1 0 0 0"/>
  <key name="home" mpos="0 .1 .1 -.3 -.3 .1" mquat="1 0 0 1 2 0 0 1"/>
</keyframe></mujoco>"""


@pytest.fixture
def own(tmp_path: Path) -> str:
    """Return a model whose fence and unnamed post stand elsewhere than at their keyframe's."""
    path = tmp_path / "own.xml"
    path.write_text(MODEL)
    return str(path)


def _home(own: str) -> mujoco.MjData:
    """The keyframe in the user's own model, by MuJoCo C."""
    mjm = mujoco.MjModel.from_xml_path(own)
    data = mujoco.MjData(mjm)
    mujoco.mj_resetDataKeyframe(mjm, data, mjm.key("home").id)
    mujoco.mj_kinematics(mjm, data)
    return data


@pytest.mark.parametrize("desk", ["fixture", "static"])
def test_what_is_placed_keeps_clear_of_them(own: str, desk: str):
    """No crate touches the fence or the post; a body between them that becomes a fixture does not take their place."""
    box = {"box": [[-0.45, -0.45], [0.45, 0.45]]}
    objects = {"desk": {"kind": desk}, "crate": {"on": "floor", "region": box}}
    compiled = compile_on_cpu({"model": own, "floor": {"size": [1, 1]}, "objects": objects})
    home = _home(own)
    rows = valid(make(compiled, 300))
    assert len(rows.qpos) == 300
    for data in posed(compiled, rows):
        for name in ("fence", "desk"):
            np.testing.assert_allclose(data.body(name).xpos, home.body(name).xpos, atol=1e-6)
            np.testing.assert_allclose(data.body(name).xmat, home.body(name).xmat, atol=1e-6)
        np.testing.assert_allclose(data.xpos[-1], home.xpos[-1], atol=1e-6)
        np.testing.assert_allclose(data.xmat[-1], home.xmat[-1], atol=1e-6)
        mujoco.mj_collision(compiled.mjm, data)
        assert all(compiled.mjm.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE for g in data.contact.geom[:, 0])
    np.testing.assert_allclose(compiled.home_xpos[compiled.mjm.body("fence").id], [0, 0.1, 0.1])


def test_relations_see_a_marker_where_the_keyframe_has_it(own: str):
    """As an anchor that is not placed, and as a body that stays."""
    objects = {"fence": {"kind": "fixture"}, "crate": {"on": "floor", "relations": [{"back_of": "fence"}]}}
    compiled = compile_on_cpu({"model": own, "floor": {"size": [1, 1]}, "objects": objects})
    rows = valid(make(compiled, 100))
    fence = rows.mocap_pos[:, compiled.mjm.body("fence").mocapid[0]]
    np.testing.assert_allclose(fence, np.tile([0, 0.1, 0.1], (100, 1)))
    assert (rows.qpos[:, 0] < 0.0).all()  # the fence is turned by 90 degrees, so its back is at -x


def test_the_keyframe_of_the_scene_is_that_of_the_model(own: str):
    """In stock MuJoCo, also where there is one mocap body more."""
    compiled = compile_on_cpu({"model": own, "objects": {"desk": {"kind": "fixture"}}})
    mjm, home = compiled.mjm, _home(own)
    data = mujoco.MjData(mjm)
    mujoco.mj_resetDataKeyframe(mjm, data, mjm.key("home").id)
    mujoco.mj_kinematics(mjm, data)
    np.testing.assert_allclose(data.xpos, home.xpos, atol=1e-12)
    np.testing.assert_allclose(data.xquat, home.xquat, atol=1e-12)
