"""Clearances as knobs: pairs keep the distances that a scene file with these clearances has packed for them."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.margins import Margins

CLEARANCES = {
    "knobbed": {"objects.a.clearance": 0.02, "objects.cabinet.clearance": 0.15, "objects.high.clearance": 0.4},
    "crane": {"robot.clearance": 0.03, "objects.other.clearance": 0.05},
}


@pytest.mark.parametrize("scene", CLEARANCES)
def test_pairs_keep_the_larger_of_two_clearances(request: pytest.FixtureRequest, scene: str):
    """In the masked worlds, as the host packs it; the others keep what the scene file says."""
    compiled, values = request.getfixturevalue(scene), CLEARANCES[scene]
    other = compile_scene(SceneConfig.load(compiled.config, values), "cpu")
    wanted, usual = other.program.pair_margin.numpy()[0], compiled.program.pair_margin.numpy()[0]
    generator, mask = LayoutGenerator(compiled, 4, knobs="*.clearance"), np.array([True, False, False, True])
    generator.set_knobs(values, mask)
    table, view = generator.layouts.knobs, generator.layouts.view
    program, _ = table.fill(compiled.program, 4)
    Margins(compiled, table, program.pair_margin).launch(None, view.next_knob)
    np.testing.assert_array_equal(program.pair_margin.numpy(), np.where(mask[:, None], wanted, usual))
    assert (wanted != usual).any()
