"""Bodies that can support others, of a cabinet with drawers, and scenes that name them all at once."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene import assemble
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.level_bodies import level_bodies
from tests.audit.judging import judge_language
from tests.layout.scenes import compile_on_cpu

CABINET = {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0.5, 1]}}}
SCENE = {
    "floor": {"size": [3, 3]},
    "objects": {"cabinet": CABINET, "apple": {"asset": "apple", "on": {"any": "cabinet"}}},
}


def test_drawers_are_level_and_handles_are_not():
    """By the names of bodies inside the object; a ball has no level body, so its own name remains."""
    scene = build_model({**SCENE, "objects": {**SCENE["objects"], "ball": {"asset": "orange", "on": "floor"}}})
    found = level_bodies(scene, "cabinet", "in")
    assert {"cabinet", "cabinet/upper_drawer", "cabinet/lower_drawer"} <= set(found)
    assert set(found) <= {"cabinet", *(f"cabinet/{name}" for name in scene.parts("cabinet"))}
    assert level_bodies(scene, "ball", "on") == ["ball"]
    assert level_bodies(scene, "nobody", "on") == ["nobody"]


def test_each_asset_is_attached_once(monkeypatch: pytest.MonkeyPatch):
    """Only the support is also built by itself, before the scene: its bodies decide on the members of the apple."""
    attached: list[str] = []

    load = assemble._load_asset
    monkeypatch.setattr(assemble, "_load_asset", lambda asset, where: attached.append(asset) or load(asset, where))
    alone = build_model(SCENE, {"objects.apple.on": ["cabinet", "cabinet/upper_drawer", "cabinet/lower_drawer"]})
    listed = attached[:]
    assert build_model(SCENE).hash == alone.hash
    assert attached == [*listed, "cabinet", *listed]


def test_a_support_may_get_another_asset():
    """Its bodies are then found again, also of a scene whose model was built."""
    still = {name: words for name, words in CABINET.items() if name != "joints"}
    config = build_model({**SCENE, "objects": {**SCENE["objects"], "cabinet": still}}).config
    assert config.any_supports == set()
    other = build_model(config, {"objects.cabinet.asset": "shelf"}).config
    bodies = {other.objects[name].on for name in other.variants["apple"]}
    assert "cabinet" in bodies
    assert "cabinet/upper_drawer" not in bodies


def test_an_object_is_on_each_level_body():
    """By area, as in a list of them; and the audit agrees."""
    compiled = compile_on_cpu(SCENE, bank=4)
    members = compiled.config.variants["apple"]
    assert len(members) >= 3
    listed = [part.on for name, part in compiled.config.objects.items() if name in members]
    table = make_table(compiled, 400, 0)
    same = make_table(
        compile_on_cpu({**SCENE, "objects": {**SCENE["objects"], "apple": {"asset": "apple", "on": listed}}}), 400, 0
    )
    np.testing.assert_array_equal(table.present, same.present)
    there = table.present[:, [compiled.slots.index(name) for name in members]]
    assert (there.sum(axis=1) == 1).all()
    assert there.any(axis=0).all()
    auditor = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)
    assert auditor.judge(table[:100]).misplaced == []
    assert not [k for k in judge_language(auditor, table) if k.broken]


def test_an_object_is_on_each_level_body_of_the_present_variant():
    """On drawers of a cabinet, on the lid of a chest, and the audit agrees."""
    opened = {"asset": "cabinet", "joints": CABINET["joints"]}
    units = {"kind": "fixture", "on": "floor", "variants": {"cabinet": opened, "chest": {"asset": "chest"}}}
    compiled = compile_on_cpu({**SCENE, "objects": {"cabinet": units, "apple": SCENE["objects"]["apple"]}}, bank=4)
    members = compiled.config.variants["apple"]
    parents = {part.on for name, part in compiled.config.objects.items() if name in members}
    assert {f"cabinet/cabinet/{side}_drawer" for side in ("upper", "lower")} | {"cabinet/chest/lid"} <= parents
    table = make_table(compiled, 400, 0)
    there = table.present[:, [compiled.slots.index(name) for name in members]]
    assert table.valid.mean() > 0.9
    assert (there.sum(axis=1) == 1).all()
    assert [compiled.config.objects[members[i]].on for i in np.flatnonzero(~there.any(axis=0))] == ["cabinet/chest"]
    for name in members:
        carrier = compiled.config.presence.carrier(name)
        on = table.present[:, compiled.slots.index(name)]
        assert table.present[on, compiled.slots.index(carrier)].all()
    auditor = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)
    assert auditor.judge(table[:200]).misplaced == []
    assert not [k for k in judge_language(auditor, table) if k.broken]


def test_a_body_that_cannot_hold_an_object_is_left_out():
    """The floor of a closed drawer is covered; a list of the same bodies is refused, since the user named them."""
    closed = {**CABINET, "joints": {"upper": {"value": 0.25}, "lower": {"value": 0.0}}}
    apple = {"asset": "apple", "on": {"any": "cabinet"}}
    scene = {**SCENE, "objects": {"cabinet": closed, "apple": apple}}
    compiled = compile_on_cpu(scene, bank=4)
    table = make_table(compiled, 300, 0)
    there = table.present[:, [compiled.slots.index(name) for name in compiled.config.variants["apple"]]]
    assert (there.sum(axis=1) == 1).all()
    assert there.any(axis=0).sum() == there.shape[1] - 1
    listed = [compiled.config.objects[name].on for name in compiled.config.variants["apple"]]
    with pytest.raises(InfeasibleSceneError, match="lower_drawer"):
        compile_on_cpu({**scene, "objects": {"cabinet": closed, "apple": {"asset": "apple", "on": listed}}})
