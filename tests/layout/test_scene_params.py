"""The params of a scene: their names, the values that they take, and the reasons for what is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.world_columns import search_columns
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import box_mjcf, write_mjcf


def test_what_cannot_be_a_param_says_so(param_scene: CompiledScene):
    """By its name, with the reason or the nearest names; and values that a param cannot have are refused."""
    with pytest.raises(ArgumentError, match=r"'objects\.near\.region' cannot be a param: .*relations"):
        LayoutGenerator(param_scene, 2, params=["objects.near.region"])
    tumbled = compile_scene(SceneConfig.load(param_scene.config, {"objects.a.orientation": "any"}), "cpu")
    with pytest.raises(ArgumentError, match=r"'objects\.a\.orientation\.yaw' cannot be a param: .*any"):
        LayoutGenerator(tumbled, 2, params=["objects.a.orientation.yaw"])
    with pytest.raises(UnknownNameError, match=r"'groups\.same\.count'.* Did you mean 'groups\.some\.count'"):
        LayoutGenerator(param_scene, 2, params=["groups.same.count"])
    generator = LayoutGenerator(param_scene, 2, params=["groups.*", "objects.cabinet.joints.*", "objects.a.clearance"])
    wrong: dict[str, list[Any]] = {
        "groups.some.count": [[-1, 2], [0, 5], [1.5, 2], [3, 2], [1], "two", [1, np.nan]],
        "groups.some.weights": [[1, 1, 0, 0], [1, 1, 1, -1]],
        "objects.cabinet.joints.door": [[0.0, 0.9]],
        "objects.a.clearance": [0.0, 11.0, np.nan, [0.1, 0.2, 0.3]],
    }
    for name, values in wrong.items():
        for value in values:
            with pytest.raises(ArgumentError, match=name.replace(".", r"\.")):
                generator.set_params({name: value})
    with pytest.raises(ArgumentError, match=r"groups\.some\.weights should be from 0 to 1e\+06, got "):
        generator.set_params({"groups.some.weights": [1, 1, 1, -1]})
    with pytest.raises(UnknownNameError, match=r"'objects\.spot\.region'"):
        generator.set_params({"objects.spot.region": [[0, 0], [1, 1]]})
    generator.set_params({"groups.some.count": np.array([[0, 1], [2, 2]])})  # a value for each world
    assert generator.layouts.view.next_param.numpy()[:, 0].tolist() == [0.0, 2.0]


def test_weights_keep_an_object_that_no_layout_lacks():
    """The apple is near the block without `if`, because the block is also on the floor: this weight stays above 0."""
    parts = {name: {"asset": name, "on": "floor"} for name in ("block", "apple", "mug")}
    objects: dict[str, Any] = {
        "tray": {"asset": "book", "scale": 1.2, "on": "floor"},
        "unit": {"asset": "book", "scale": [0.9, 1.2], "on": "floor"},
        "block": {**parts["block"], "on": {"floor": 1, "tray": 1}, "ratio_on_support": 1},
        "apple": {**parts["apple"], "relations": [{"near": "block", "distance": {"max": 0.5}}]},
        "cup": {**parts["mug"], "on": "unit", "ratio_on_support": 1},
    }
    groups = {"maybe": {"of": ["tray"], "count": [0, 1]}}
    scene = {"floor": {"size": [2, 2]}, "objects": objects, "groups": groups, "bank": 2}
    generator = LayoutGenerator(compile_scene(scene, "cpu"), 64, params="*.weights")
    wrong = {"objects.block.weights": [0, 1], "objects.cup.weights": [1, 0]}
    for name, weights in wrong.items():
        with pytest.raises(
            ArgumentError, match=rf"{name} should be above 0 for members that are never absent together"
        ):
            generator.set_params({name: weights})
        with pytest.raises(ArgumentError, match=name):
            generator.set_params({name: np.tile([[1, 1], weights], (32, 1))})
    generator.set_params(
        {"objects.block.weights": [1, 0], "objects.unit.weights": [0, 1], "objects.cup.weights": [3, 1]}
    )
    generator.generate()
    there = dict(zip(generator.compiled.slots, generator.layouts.present.cpu().numpy().T, strict=True))
    assert (there["block/@floor"] == 1).all() and (there["cup/@unit:book-120"] == 1).all()


CLEARANCES = {
    "param_scene": {"objects.a.clearance": 0.02, "objects.cabinet.clearance": 0.15, "objects.high.clearance": 0.4},
    "crane": {"robot.clearance": 0.03, "objects.other.clearance": 0.05},
}


@pytest.mark.parametrize("scene", CLEARANCES)
def test_pairs_keep_the_larger_of_two_clearances(request: pytest.FixtureRequest, scene: str):
    """In the masked worlds, as the host packs it for a file that says so; the others keep what the scene file says."""
    compiled, values = request.getfixturevalue(scene), CLEARANCES[scene]
    other = compile_scene(SceneConfig.load(compiled.config, values), "cpu")
    wanted, usual = other.program.pair_margin.numpy()[0], compiled.program.pair_margin.numpy()[0]
    generator, mask = LayoutGenerator(compiled, 4, params="*.clearance"), np.array([True, False, False, True])
    generator.set_params(values, mask)
    columns, program, _ = search_columns(compiled, 4, generator.layouts.params)
    columns.launch(None, generator.layouts.view, opens=True)
    np.testing.assert_array_equal(program.pair_margin.numpy(), np.where(mask[:, None], wanted, usual))
    assert (wanted != usual).any()


def _generous_scene(folder: Path) -> dict[str, Any]:
    """Words of which the model has less, or has in single precision, or that are written in another form."""
    crate = box_mjcf(folder, "crate", 0.02, 0.02, 0.02)
    flap = """<geom type="box" size=".05 .05 .05" pos="0 0 .05"/><body name="flap">
    <joint name="flap" type="hinge" axis="0 0 1" range="0 70"/>
    <joint name="pin" type="slide" axis="0 0 1" range="0 .0333333333"/>
    <geom type="box" size=".01 .01 .01" pos="0 0 .2" contype="0" conaffinity="0"/></body>"""
    drawn = {"mass": {"scale": [0.8, 1.2]}, "friction": {"abs": [[0.1, 0.003, 1e-7], [0.7, 0.006, 1.1e-4]]}}
    objects: dict[str, Any] = {
        "chest": {
            **{"asset": write_mjcf(folder, "chest", flap), "kind": "fixture", "on": "floor"},
            **{"joints": {"flap": {"fraction": [0.1, 1.0]}, "pin": {"noise": 0.05}}},
        },
        "wide": {"asset": crate, "on": "floor", "region": {"box": [[-0.4, -0.36], [0.56, 0.36]]}, "randomize": drawn},
        "level": {"asset": crate, "region": {"box": [[-0.3, -0.3, 0.7], [0.3, 0.3, 0.7]]}, "clearance": 0.0033},
        "near": {"asset": crate, "on": "floor", "relations": [{"near": "chest", "distance": {"min": 0.1, "max": 0.7}}]},
        "exact": {"asset": crate, "on": "floor", "relations": [{"near": "chest", "distance": {"equal": 0.3}}]},
        **{name: {"asset": crate, "on": "floor"} for name in ("a", "b", "c")},
    }
    groups = {"two": {"of": ["a", "b", "c"], "count": 2, "weights": {"a": 0.1}}}
    return {"floor": {"size": [0.9, 0.7]}, "objects": objects, "groups": groups, "bank": 2}


WRITTEN = {
    "objects.chest.joints.flap": [np.radians(7.0), np.radians(70.0)],
    "objects.chest.joints.pin": [-0.05, 0.05],
    "objects.wide.region": [[-0.4, -0.36], [0.56, 0.36]],
    "objects.wide.randomize.mass": [0.8, 1.2],
    "objects.wide.randomize.friction": [[0.1, 0.003, 1e-7], [0.7, 0.006, 1.1e-4]],
    "objects.wide.orientation.yaw": [-np.pi, np.pi],
    "objects.level.region": [[-0.3, -0.3, 0.7], [0.3, 0.3, 0.7]],
    "objects.level.clearance": 0.0033,
    "objects.near.relations.0.distance": [0.1, 0.7],
    "objects.exact.relations.0.distance": [0.29, 0.31],
    "groups.two.count": 2,
    "groups.two.weights": [0.1, 1, 1],
}


def test_every_param_takes_what_the_scene_file_says(tmp_path: Path):
    """In double precision, in every form: with the bits of the scene file. Six digits are taken as well."""
    generator = LayoutGenerator(compile_scene(_generous_scene(tmp_path), "cpu"), 2, params="*")
    params = generator.layouts.params.params
    for name, value in WRITTEN.items():
        np.testing.assert_array_equal(params[name].checked(value, 2)[0], params[name].default, err_msg=name)
        told = np.vectorize(lambda x: float(f"{x:g}"))(params[name].default)
        rows = np.tile(told, (2, 1)).astype(float)
        np.testing.assert_allclose(params[name].checked(rows, 2)[1], params[name].default, rtol=5e-6, err_msg=name)
    generator.set_params(WRITTEN)
    generator.set_params({"objects.wide.region": [[-0.4, -0.36], [0.1, 0.36]]})  # narrowed along x alone
    wide = generator.layouts.params.named(generator.layouts.view.next_param.numpy())["objects.wide.region"]
    np.testing.assert_array_equal(wide[0], np.array([-0.4, -0.35, 0.1, 0.35], np.float32))


def test_messages_of_params_have_the_numbers_of_the_scene_file(tmp_path: Path):
    """Rather than the edges of a support, or more digits than anyone wrote; and rows that are no rows are refused."""
    generator = LayoutGenerator(compile_scene(_generous_scene(tmp_path), "cpu"), 4, params="*")
    with pytest.raises(ArgumentError, match=r"low and high from \[-0\.4, -0\.36\] to \[0\.56, 0\.36\], as in the"):
        generator.set_params({"objects.wide.region": [[-0.4, -0.36], [0.5601, 0.36]]})
    with pytest.raises(ArgumentError, match=r"from \[0\.122173\] to \[1\.22173\], as in the scene file"):
        generator.set_params({"objects.chest.joints.flap": [0.12, 1.2]})
    with pytest.raises(ArgumentError, match=r"from \[-0\.4, -0\.36\]"):
        generator.set_params({"objects.wide.region": [[0.46, 0.0], [0.56, 0.1]]})  # all of it beyond the edge
    strange = [10**400, [[0.2], [0.3, 0.4]], np.full((2, 4), 0.3), [True, True], "ab", torch.ones(2, device="meta")]
    for value in strange:
        with pytest.raises(ArgumentError, match=r"joints\.flap should be \[low, high\], or one such value for each of"):
            generator.set_params({"objects.chest.joints.flap": value})
