"""The refused candidates of a generator's last wave, as states of the model."""

from __future__ import annotations

import numpy as np

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.device import Cause
from tests.layout.scenes import Rows


def refused(generator: LayoutGenerator) -> tuple[Rows, np.ndarray]:
    """Return the refused candidates of the last wave, and their causes, shape (n,).

    They are free or fixtures. The wave drew one trial for each of its rows; all else is as it is in the row.
    """
    search, view, mjm = generator._work.search, generator.layouts.view, generator.compiled.mjm
    wave = search.queue.numpy()[search.source.numpy()[0], : search.rows.numpy()[0]]
    assert (search.row_trials.numpy()[wave] == 1).all()
    candidates = search.row_first.numpy()[wave]
    causes = search.cause.numpy()
    candidates = np.sort(candidates[causes[candidates] != Cause.NONE])
    rows = search.row.numpy()[candidates]
    names = [generator.compiled.placed[i] for i in search.obj.numpy()[candidates]]
    qpos, mocap_pos, mocap_quat = (a.numpy()[rows] for a in (view.qpos, view.mocap_pos, view.mocap_quat))
    drawn, pos, quat = (a.numpy()[candidates] for a in (search.qpos, search.body_pos, search.body_quat))
    for i, name in enumerate(names):
        body = mjm.body(name).id
        own = [mjm.jnt_qposadr[j] for j in range(mjm.njnt) if mjm.body_rootid[mjm.jnt_bodyid[j]] == body]
        qpos[i, own] = drawn[i, own]
        mocap = mjm.body_mocapid[body]
        if mocap >= 0:
            mocap_pos[i, mocap], mocap_quat[i, mocap] = pos[i, body], quat[i, body]
        else:
            qpos[i, own[0] : own[0] + 7] = [*pos[i, body], *quat[i, body]]
    return Rows(qpos, mocap_pos, mocap_quat, *[np.zeros(len(rows))] * 2), causes[candidates]
