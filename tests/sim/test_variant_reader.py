"""Worlds with variants as rows of layouts: after a reset they are the layouts that the worlds were reset to."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.variant_reader import VariantReader

NWORLD = 6
HALF = np.arange(NWORLD) % 2 == 0


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Things and fixtures with variants, between a fixture with drawers and a free object that may be absent."""
    objects = {
        "cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0.1, 0.4]}}},
        "target": {"asset": ["can", "mug", "book"], "on": "floor"},
        "stand": {"asset": ["tin", "bowl"], "kind": "fixture", "on": "floor"},
        "apple": {"asset": "apple", "on": "floor"},
    }
    groups = {"some": {"of": ["apple"], "count": [0, 1]}}
    return compile_scene({"floor": {"size": [1.5, 1.5]}, "objects": objects, "groups": groups, "bank": 4}, "cpu")


@pytest.mark.parametrize("stored", [False, True])
def test_worlds_are_read_as_the_layouts_that_were_written(compiled: CompiledScene, stored: bool):
    """Presence and poses; absent variants are far away, and other worlds are not read."""
    batch = Batch(compiled.scene, NWORLD, "cpu")
    randomizer = ResetRandomizer(compiled, batch.model, batch.data, seed=3)
    randomizer.reset()
    wanted = randomizer.layouts.present.numpy(), randomizer.layouts.qpos.numpy(), randomizer.layouts.mocap_pos.numpy()
    apple = compiled.slots.index("apple")
    if stored:  # presence of others than variants is that of the reset
        table = make_table(compiled, NWORLD, seed=40)
        randomizer.write(table, np.arange(NWORLD))
        present = np.where(np.arange(len(compiled.slots)) == apple, wanted[0], table.present)
        wanted = present, table.qpos.astype(np.float32), table.mocap_pos.astype(np.float32)
    variants = randomizer._writer.variants
    assert variants is not None
    reader = VariantReader(batch.data, variants, randomizer.layouts.view)
    reader.launch(wp.array(HALF, dtype=bool, device="cpu"))
    found = [getattr(reader.state, name).numpy() for name in ("present", "qpos", "mocap_pos")]
    assert not any(values[~HALF].any() for values in found)
    np.testing.assert_array_equal(found[0][HALF], wanted[0][HALF])
    mjm, members = compiled.mjm, [m for of in compiled.config.variants.values() for m in of]
    for world in np.flatnonzero(HALF):
        for body in range(1, mjm.nbody):
            name, mocap = mjm.body(body).name, int(mjm.body_mocapid[body])
            qpos = np.repeat(mjm.jnt_bodyid, np.diff([*mjm.jnt_qposadr, mjm.nq])) == body
            read, layout = (
                np.append(of[1][world, qpos], of[2][world, [mocap] * (mocap >= 0)]) for of in (found, wanted)
            )
            if name in members and not wanted[0][world, compiled.slots.index(name)]:
                assert (read > 1e3).all()
            else:
                np.testing.assert_array_equal(read, layout)
