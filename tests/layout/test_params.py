"""Params: a world with a narrowed word has the layouts of a scene file that says so, and all others keep theirs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.commands.replay import replay
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.params import params_in
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.param_scenes import scene_with_params
from tests.layout.scenes import full_tray, prefetched

NWORLD = 40
EVEN = np.arange(NWORLD) % 2 == 0
PARTS = ("qpos", "mocap_pos", "mocap_quat", "present", "attempts", "status")


def _made(source: Any, episodes: int = 1) -> dict[str, np.ndarray]:
    for _ in range(episodes):
        source.generate()
    return {name: getattr(source.layouts, name).numpy().copy() for name in PARTS}


def _rows(made: dict[str, np.ndarray], rows: Any) -> list[bytes]:
    return [values[rows].tobytes() for values in made.values()]


def test_params_at_their_defaults_change_nothing(param_scene: CompiledScene):
    """Not a bit of any layout, nor of its id, with all params of the scene, made ahead or not."""
    generator = LayoutGenerator(param_scene, NWORLD, params="*")
    assert {"groups.some.count", "objects.spot.region", "objects.high.region"} < set(generator.layouts.params.names)
    plain = _made(LayoutGenerator(param_scene, NWORLD), 2)
    assert _rows(_made(generator, 2), slice(None)) == _rows(plain, slice(None))
    assert not any(generator.layouts.params.text(row) for row in generator.layouts.param.numpy())


NARROWED = {
    "objects.cabinet.joints.door": ({"objects__cabinet__joints__door__range": [0.25, 0.5]}, [0.25, 0.5]),
    "groups.some.count": ({"groups__some__count": [1, 2]}, [1, 2]),
    "objects.spot.orientation.yaw": ({"objects__spot__orientation": {"yaw": [30, 60]}}, [np.pi / 6, np.pi / 3]),
    "start.weights": ({"start": [{"weight": 7.0}, {"joints": {"cabinet/door": {"range": [0.9, 0.95]}}}]}, [7.0, 1.0]),
    "objects.spot.clearance": ({"objects__spot__clearance": 0.2}, 0.2),
    "objects.cabinet.clearance": ({"objects__cabinet__clearance": 0.15}, [0.15]),
    "groups.some.weights": ({"groups__some__weights": {"a": 0.5, "b": 3.0, "c": 0.0}}, [0.5, 3.0, 0.0, 1.0]),
}
OTHERS = {"groups.some.weights": {"groups__some__count": [0, 3]}, "objects.cabinet.clearance": {"geometry": "visual"}}


@pytest.mark.parametrize("name", NARROWED)
def test_a_narrowed_world_has_the_layouts_of_a_file_that_says_so(param_scene: CompiledScene, tmp_path: Path, name: str):
    """Bit for bit, in the masked worlds; the others keep theirs."""
    words, value = NARROWED[name]
    others = OTHERS.get(name, {})
    base = compile_scene(scene_with_params(tmp_path, **others), "cpu") if others else param_scene
    wanted = _made(LayoutGenerator(compile_scene(scene_with_params(tmp_path, **others, **words), "cpu"), NWORLD), 2)
    plain, generator = _made(LayoutGenerator(base, NWORLD), 2), LayoutGenerator(base, NWORLD, params=[name])
    generator.generate()
    generator.set_params({name: value}, EVEN)
    found = _made(generator)
    assert _rows(found, EVEN) == _rows(wanted, EVEN) != _rows(plain, EVEN)
    assert _rows(found, ~EVEN) == _rows(plain, ~EVEN)


def test_a_narrowed_distance_holds(param_scene: CompiledScene):
    """In the worlds of the mask; the others go beyond it."""
    name = "objects.near.relations.0.distance"
    generator = LayoutGenerator(param_scene, NWORLD, params=[name])
    generator.set_params({name: [0.3, 0.35]}, EVEN)
    generator.generate()
    valid = generator.layouts.status.numpy() == LayoutStatus.VALID
    away = generator.layouts.pose("near").numpy()[:, :2] - generator.layouts.pose("cabinet").numpy()[:, :2]
    distance = np.hypot(*away.T)
    assert ((distance > 0.3 - 1e-5) & (distance < 0.35 + 1e-5))[EVEN & valid].all()
    assert not ((distance > 0.3) & (distance < 0.35))[~EVEN & valid].all()


def test_layouts_made_ahead_follow_the_params(param_scene: CompiledScene):
    """Whatever was made ahead before they changed."""
    plain = LayoutGenerator(param_scene, NWORLD, params="*")
    ahead = prefetched(LayoutGenerator(param_scene, NWORLD, params="*"))
    rng = np.random.default_rng(0)
    for step in range(8):
        if step % 3 == 1:
            low = int(rng.integers(0, 3))
            for source in (plain, ahead):
                source.set_params(
                    {"groups.some.count": [low, low + 1], "objects.cabinet.joints.door": [0.1, 0.2]}, EVEN
                )
        mask = rng.random(NWORLD) < 0.6
        for source in (plain, ahead):
            source.generate(mask)
        for name in (*PARTS, "param"):
            mine, other = (getattr(source.layouts, name).numpy() for source in (plain, ahead))
            np.testing.assert_array_equal(mine, other, err_msg=f"{name}, step {step}")


def test_an_id_with_params_makes_its_layout_again(param_scene: CompiledScene):
    """In one world of another generator, from the text alone; float32 numbers are told exactly."""
    generator = LayoutGenerator(param_scene, 3, params="*", seed=7)
    values = {"objects.cabinet.joints.door": [0.1, 1.0 / 3.0], "groups.some.count": [1, 3]}
    generator.set_params(values)
    made = _made(generator)
    text = generator.layouts.params.text(generator.layouts.param.numpy()[2])
    told = param_scene.layout_id(9, 0, params=text)
    assert told.endswith(":groups.some.count=3f80000040400000,objects.cabinet.joints.door=3dcccccd3eaaaaab")
    table = replay(param_scene, LayoutId.parse(told))
    np.testing.assert_array_equal(table.qpos[0], made["qpos"][2])
    np.testing.assert_array_equal(params_in(text)["groups.some.count"], [1.0, 3.0])
    with pytest.raises(ArgumentError, match="Params may follow as ':name=hex', with 8 hexadecimal digits"):
        LayoutId.parse(f"{param_scene.hash}:train:1:0:groups.some.count=3f8")


def test_the_id_of_a_fallback_names_the_params_and_makes_it_again(tmp_path: Path):
    """Making it fails again, and falls back on the same layout."""
    full = full_tray(tmp_path)
    generator = LayoutGenerator(full, 16, params="*.region")
    generator.set_params({"objects.crate_0.region": [[-0.05, -0.05], [0.1, 0.1]]})
    generator.generate()
    fallback = generator.layouts.status.numpy() == LayoutStatus.FALLBACK
    assert 0 < fallback.sum() < 16
    for i, told in enumerate(generator.layouts.ids("train")):
        assert "objects.crate_0.region=" in told
        table = replay(full, LayoutId.parse(told))
        np.testing.assert_array_equal(table.qpos[0], generator.layouts.qpos.numpy()[i])
        assert (table.status[0] == LayoutStatus.FALLBACK) == fallback[i]
