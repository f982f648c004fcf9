"""Blame for collisions: the pairs of geoms that a rejected candidate hits, by their distances in closed form."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from sceniris_gym.layout.blame import Blame
from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.scenes import full_tray, make, posed, valid

SIZE, CLEARANCE = 0.1, 0.001


def test_a_rejected_candidate_hits_what_it_is_too_near_to(tmp_path: Path):
    """Crates along the axes: those placed before that are within the clearance, the worst first, and no others."""
    compiled = full_tray(tmp_path)
    generator = LayoutGenerator(compiled, 100, seed=1, rejected=200)
    generator.generate()
    view, mjm, data = generator.layouts.view, compiled.mjm, mujoco.MjData(compiled.mjm)
    count, blame = int(view.rejected_count.numpy()[0]), Blame(compiled)
    assert 20 < count < 200
    for number, qpos in zip(view.rejected_object.numpy()[:count], view.rejected_qpos.numpy()[:count], strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(mjm, data)
        centres = qpos.reshape(3, 7)[:, :2]
        gaps = np.abs(centres - centres[number]) - SIZE  # along x and y; negative where shadows overlap
        apart = np.where(gaps.max(axis=1) > 0, np.linalg.norm(np.maximum(gaps, 0.0), axis=1), gaps.max(axis=1))
        expected = sorted((float(apart[i]), i) for i in range(number) if apart[i] < CLEARANCE)
        hits = blame.hits(data, int(number))
        assert [hit.words.count("geom") for hit in hits] == [2] * len(expected) != []
        bodies = [[mjm.body(int(mjm.geom_bodyid[g])).name for g in hit.geoms] for hit in hits]
        assert bodies == [[f"crate_{number}", f"crate_{i}"] for _, i in expected]
        for hit, (gap, _) in zip(hits, expected, strict=True):
            assert hit.margin == CLEARANCE
            # crates of 5 cm height: none is deeper than that
            assert abs(hit.distance - max(gap, -0.05)) < 1e-5


def test_nothing_is_to_blame_in_a_layout(tmp_path: Path):
    """For any of its objects."""
    compiled = full_tray(tmp_path)
    blame, rows = Blame(compiled), valid(make(compiled, 100))
    assert len(rows.qpos) > 10
    for data in posed(compiled, rows):
        assert not any(blame.hits(data, number) for number in range(3))
