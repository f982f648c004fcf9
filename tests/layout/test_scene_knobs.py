"""The knobs of a scene: their names, the values that they take, and the reasons for what is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.knobs import launch_write
from sceniris_gym.program.compiled import CompiledScene


def test_what_cannot_be_a_knob_says_so(knobbed: CompiledScene):
    """By its name, with the reason or the nearest names; and values that a knob cannot have are refused."""
    with pytest.raises(ArgumentError, match=r"'objects\.near\.region' cannot be a knob: .*relations"):
        LayoutGenerator(knobbed, 2, knobs=["objects.near.region"])
    with pytest.raises(UnknownNameError, match=r"'groups\.same\.count'.* Did you mean 'groups\.some\.count'"):
        LayoutGenerator(knobbed, 2, knobs=["groups.same.count"])
    generator = LayoutGenerator(knobbed, 2, knobs=["groups.*", "objects.cabinet.joints.*", "objects.a.clearance"])
    wrong: dict[str, list[Any]] = {
        "groups.some.count": [[-1, 2], [0, 5], [1.5, 2], [3, 2], [1], "two", [1, np.nan]],
        "groups.some.weights": [[1, 1, 0, 0], [1, 1, 1, -1]],
        "objects.cabinet.joints.door": [[0.0, 0.9]],
        "objects.a.clearance": [0.0, 11.0, np.nan, [0.1, 0.2, 0.3]],
    }
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(ArgumentError, match=name.replace(".", r"\.")):
                generator.set_knobs({name: value})
    with pytest.raises(ArgumentError, match=r"groups\.some\.weights should be from 0 to 1e\+06, got "):
        generator.set_knobs({"groups.some.weights": [1, 1, 1, -1]})
    with pytest.raises(UnknownNameError, match=r"'objects\.spot\.region'"):
        generator.set_knobs({"objects.spot.region": [[0, 0], [1, 1]]})
    generator.set_knobs({"groups.some.count": np.array([[0, 1], [2, 2]])})  # a value for each world
    assert generator.layouts.view.next_knob.numpy()[:, 0].tolist() == [0.0, 2.0]


CLEARANCES = {
    "knobbed": {"objects.a.clearance": 0.02, "objects.cabinet.clearance": 0.15, "objects.high.clearance": 0.4},
    "crane": {"robot.clearance": 0.03, "objects.other.clearance": 0.05},
}


@pytest.mark.parametrize("scene", CLEARANCES)
def test_pairs_keep_the_larger_of_two_clearances(request: pytest.FixtureRequest, scene: str):
    """In the masked worlds, as the host packs it for a file that says so; the others keep what the scene file says."""
    compiled, values = request.getfixturevalue(scene), CLEARANCES[scene]
    other = compile_scene(SceneConfig.load(compiled.config, values), "cpu")
    wanted, usual = other.program.pair_margin.numpy()[0], compiled.program.pair_margin.numpy()[0]
    generator, mask = LayoutGenerator(compiled, 4, knobs="*.clearance"), np.array([True, False, False, True])
    generator.set_knobs(values, mask)
    table, view = generator.layouts.knobs, generator.layouts.view
    program, targets = table.fill(compiled.program, 4)
    assert targets is not None
    launch_write(targets, 4, None, view.next_knob, view.default_knob)
    np.testing.assert_array_equal(program.pair_margin.numpy(), np.where(mask[:, None], wanted, usual))
    assert (wanted != usual).any()
