"""The MJCF of a unit: boxes between corners in the unit's frame, parts on axes, handles with grasps from the front."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.builders.unit import Handle, Hinge, Unit


def built(shape: str, hinge: Hinge, opens: str = "drawer") -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A unit of one box, and a part with a handle of 16 cm at (0.1, -0.3, 0.5)."""
    unit = Unit("unit", dict.fromkeys(("body", "metal"), "808080"))
    unit.root.box("board", (-0.2, -0.3, 0.0), (0.2, 0.3, 0.9))
    part = unit.opening("front_0", (-0.2, -0.3, 0.1), opens, 0.4)
    part.box("panel", (-0.2, -0.3, 0.1), (0.2, -0.28, 0.8))
    part.handle(Handle(shape, 0.012, 0.04, 0.16), 0.1, -0.3, 0.5, hinge)
    model = mujoco.MjModel.from_xml_string(unit.text())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_corners_are_in_the_frame_of_the_unit():
    """Also those of a part, whose body is elsewhere."""
    model, data = built("bar", "top")
    for name, low, high in (
        ("board", (-0.2, -0.3, 0), (0.2, 0.3, 0.9)),
        ("panel", (-0.2, -0.3, 0.1), (0.2, -0.28, 0.8)),
    ):
        geom = model.geom(name).id
        np.testing.assert_allclose(data.geom_xpos[geom] - model.geom_size[geom], low, atol=1e-9)
        np.testing.assert_allclose(data.geom_xpos[geom] + model.geom_size[geom], high, atol=1e-9)


@pytest.mark.parametrize("shape", ["bar", "rod", "knob"])
@pytest.mark.parametrize("hinge", ["top", "left", "right"])
def test_grasps_close_across_the_bar_from_the_front(shape: str, hinge: Hinge):
    """The first is level; the others turn about the bar, at a door towards its hinge."""
    model, data = built(shape, hinge)
    for i in range(3 if hinge == "top" else 2):
        site = data.site(f"grasp_front_0_{i}")
        np.testing.assert_allclose(site.xpos, (0.1, -0.34, 0.5), atol=1e-9)
        along, closing, approach = site.xmat.reshape(3, 3).T
        np.testing.assert_allclose(np.abs(along), (1, 0, 0) if hinge == "top" else (0, 0, 1), atol=1e-9)
        assert approach[1] > 0.8
        assert approach[1] == pytest.approx(1.0) if i == 0 else approach[1] < 0.9
        assert abs(closing[2 if hinge == "top" else 0]) > 0.8
        if i and hinge != "top":  # the hand is on the side of the hinge, and looks away from it
            assert np.sign(approach[0]) == (1 if hinge == "left" else -1)
    handle = [geom for geom in range(model.ngeom) if model.geom_matid[geom] == model.mat("metal").id]
    reach = data.geom_xpos[handle, 1] - model.geom_rbound[handle]
    assert len(handle) == (2 if shape == "knob" else 3)
    assert reach.min() < -0.34


@pytest.mark.parametrize("opens", ["drawer", "left", "right", "top"])
def test_positive_positions_open_to_the_front(opens: str):
    """Of a drawer and of leaves with hinges at each side: the handle moves to the front."""
    unit = Unit("unit", {"body": "808080", "metal": "808080"})
    axis = {"drawer": 0.0, "left": -0.2, "right": 0.2, "top": 0.0}[opens]
    part = unit.opening("front_0", (axis, -0.3, 0.8), opens, 0.4)
    part.box("panel", (-0.2, -0.3, 0.1), (0.2, -0.28, 0.8))
    model = mujoco.MjModel.from_xml_string(unit.text())
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    assert data.geom("panel").xpos[1] < -0.29 - 0.05
    assert list(unit.joints) == unit.sort_parts() == ["front_0"]
