"""Of the trials of a row the lowest that passed is placed, and what comes after it is as if it had not been drawn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.program.device import Cause
from sceniris_gym.scene.build import build_model
from tests.layout.related import Shapes, near_middle, related, scene
from tests.layout.scenes import FLOOR, box_mjcf

N, ATTEMPTS = 300, 8


def test_the_lowest_trial_that_passed_is_placed(tmp_path: Path):
    """All trials of a crate beside a block are drawn in one wave: pose, attempts and counts are of the first."""
    block, crate = box_mjcf(tmp_path, "block", 0.8, 0.8, 0.1), box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05)
    objects = {"block": {"asset": block, "kind": "static"}, "crate": {"asset": crate, "on": "floor"}}
    words = {"floor": FLOOR, "attempts": ATTEMPTS, "restarts": 0, "objects": objects}
    compiled = upload_scene(build_model(SceneConfig.load(words)), "cpu")  # without a bank
    size = replace(default_size("cpu"), busy=1 << 20, candidates=N * ATTEMPTS)
    generator = LayoutGenerator(compiled, N, size=size)
    generator.generate()
    search, layouts = generator._work.search, generator.layouts
    assert (search.row_trials.numpy() == ATTEMPTS).all()
    rows = search.row.numpy()[::ATTEMPTS]
    assert sorted(rows) == list(range(N))
    assert (search.row_first.numpy()[rows] == np.arange(0, N * ATTEMPTS, ATTEMPTS)).all()
    causes = search.cause.numpy().reshape(N, ATTEMPTS)
    passed = causes == Cause.NONE
    first = np.where(passed.any(1), passed.argmax(1), ATTEMPTS)
    assert 20 < (first == ATTEMPTS).sum() < N - 20
    assert len(np.unique(first)) == ATTEMPTS + 1
    assert (layouts.attempts.numpy()[rows] == np.minimum(first + 1, ATTEMPTS)).all()
    assert ((layouts.status.numpy()[rows] == LayoutStatus.VALID) == (first < ATTEMPTS)).all()
    drawn_in_vain = causes[np.arange(ATTEMPTS) < first[:, None]]
    expected = {cause: int((drawn_in_vain == cause).sum()) for cause in Cause}
    assert {cause: int(layouts.rejections.numpy()[0, cause]) for cause in Cause} == expected
    crate_body, some = compiled.mjm.body("crate").id, np.flatnonzero(first < ATTEMPTS)
    placed = some * ATTEMPTS + first[some]
    pose = [search.body_pos.numpy()[placed, crate_body], search.body_quat.numpy()[placed, crate_body]]
    assert (layouts.qpos.numpy()[rows[some]] == np.concatenate(pose, axis=1)).all()


def test_what_no_trial_can_open_is_not_tried_again(tmp_path: Path):
    """A region that the other objects leave empty: one trial of the last object, whatever is drawn at once."""
    shapes = Shapes(tmp_path)
    far = related(shapes.cube, {"right_of": "a", "frame": "world", "distance": {"min": 1.0}, "angle": 10})
    objects = {"a": near_middle(shapes.cube), "q": {**far, "orientation": "fixed"}}
    compiled = scene(objects, attempts=ATTEMPTS, restarts=0)
    for busy in (1, 4096):
        generator = LayoutGenerator(compiled, N, size=replace(default_size("cpu"), busy=busy, candidates=4096))
        generator.generate()
        counts, status = generator.rejection_counts()["q"], generator.layouts.status.numpy()
        assert counts["empty"] + counts["region"] == (status != LayoutStatus.VALID).sum()
        assert 20 < counts["empty"] < N - 20
        assert (generator.layouts.attempts.numpy() == 2).all()
