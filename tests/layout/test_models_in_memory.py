"""Layouts of models in memory, on static geoms: judged by MuJoCo C, by the audit, and by where they should be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from tests.layout.scenes import compiled_from
from tests.scene.memory import NEAR, cubes_on, model_text, spec_of

NWORLD = 500
HALF = 0.02


def deepest(model: mujoco.MjModel, qpos: np.ndarray) -> float:
    """Return the deepest penetration [m] in rows of qpos between what MuJoCo C finds to touch."""
    data, worst = mujoco.MjData(model), 0.0
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        worst = max([worst, *(-contact.dist for contact in data.contact)])
    return worst


@pytest.mark.oldest
@pytest.mark.parametrize("form", ["spec", "model"])
def test_cubes_of_a_model_in_memory_start_apart(form: str):
    """Four cubes on a crowded part of a welded plane: somebody else's MjModel finds none inside another."""
    given = mujoco.MjModel.from_xml_string(model_text(cubes=4))
    spec = mujoco.MjSpec.from_string(model_text(cubes=4))
    compiled = compiled_from(spec if form == "spec" else given, cubes_on("ground", 4, region=NEAR))
    generator = LayoutGenerator(compiled, NWORLD)
    generator.generate()
    qpos = generator.layouts.qpos.numpy()
    assert deepest(given, qpos) == 0.0
    at = qpos[:, 2:].reshape(NWORLD, 4, 7)
    assert np.abs(at[:, :, :2]).max() <= 0.15
    assert np.abs(at[:, :, :2]).max() > 0.14
    np.testing.assert_allclose(at[:, :, 2], HALF + 0.0005, atol=1e-6)
    np.testing.assert_array_equal(
        qpos[:, :2], np.full((NWORLD, 2), [0.05, 0.7], np.float32)
    )  # what is not in the scene


@pytest.mark.parametrize(
    ("support", "height", "low", "high"),
    [
        ("ledge", 0.32, (0.5, -0.2), (1.1, 0.2)),
        ("cab/case", 0.2, (-0.8, -0.2), (-0.4, 0.2)),
        ("cab/cabinet", 0.2, (-0.8, -0.2), (-0.4, 0.2)),
        ("roof", 0.82, (0.5, -0.2), (1.1, 0.2)),
    ],
)
def test_a_static_geom_carries(support: str, height: float, low: tuple, high: tuple):
    """One of the world below another one, one of a welded body, and the whole of such a body: on all of its top."""
    compiled = compiled_from(spec_of(), cubes_on(support, 2))
    table = make_table(compiled, 300, 0)
    at = table.qpos[:, 2:16].reshape(-1, 7)
    np.testing.assert_allclose(at[:, 2], height + HALF + 0.0005, atol=1e-6)
    assert np.all((at[:, :2] >= low) & (at[:, :2] <= high))
    assert np.all(np.ptp(at[:, :2], axis=0) > 0.8 * np.subtract(high, low)) or support == "cab/cabinet"
    assert deepest(compiled.mjm, table.qpos) == 0.0
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table, settled=60)
    assert (report.conflicts, report.misplaced) == ([], [])


def test_the_audit_sees_who_is_not_on_a_static_geom():
    """A cube beside its ledge, and one at another height."""
    compiled = compiled_from(
        spec_of(), {**cubes_on("ledge", 1), "b": {"body": "cube_1/cube", "on": "ground", "region": NEAR}}
    )
    table = make_table(compiled, 3, 0)
    table.qpos[0, 2] += 0.7
    table.qpos[1, 11] += 0.01
    found = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table).misplaced
    assert [(m.row, m.name, m.cause) for m in found] == [(0, "cube_0", "support"), (1, "b", "support")]


def test_an_endless_plane_needs_a_region():
    """A plane with sizes has none, and a fraction of what is endless means nothing."""
    for region in (None, {"fraction": [[0, 0], [0.5, 0.5]]}):
        words: dict[str, Any] = {} if region is None else {"region": region}
        with pytest.raises(SceneKeyError, match=r"cube_0\.on: the plane 'ground' is endless.*cube_0\.region: \{box"):
            compiled_from(spec_of(), cubes_on("ground", 1, **words))
    spec = spec_of()
    spec.geom("ground").size = [0.1, 0.2, 0.01]
    table = make_table(compiled_from(spec, cubes_on("ground", 1)), 200, 0)
    assert np.all(np.abs(table.qpos[:, 2:4]) <= [0.1, 0.2])
    assert np.all(np.abs(table.qpos[:, 2:4]).max(axis=0) > [0.09, 0.18])


def test_what_has_no_level_surface_is_told_what_has_one():
    """By a name each that the scene file can use: objects, their parts, bodies and geoms."""
    spec = spec_of()
    spec.worldbody.add_geom(name="ball", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], pos=[0, 0, 2])
    objects = {"cabinet": {"body": "cab/cabinet", "kind": "static"}, **cubes_on("ball", 1)}
    with pytest.raises(SceneKeyError) as caught:
        compiled_from(spec, objects)
    assert "'ball' has no level surface of 2 cm or more" in str(caught.value)
    listed = str(caught.value).split("Valid: ")[1].removesuffix(".").split(", ")
    assert listed == ["cabinet", "cabinet/drawer", "ledge", "roof", "terrain"]


def test_a_model_in_memory_is_compiled_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It goes into the cache of compiled scenes as others do, and another size of a geom is another scene."""
    monkeypatch.setenv("SCENIRIS_GYM_CACHE", str(tmp_path))
    for size, files in ((0.02, 1), (0.02, 1), (0.03, 2)):
        spec = spec_of(half=f"{size} {size} {size}")
        compiled_from(spec, cubes_on("ground", 1, region=NEAR))
        assert len(list((tmp_path / "scenes").iterdir())) == files
