"""Layout ids: what they say, and that they make the same layout again."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.commands.replay import LayoutId, default_picture, describe, drawn, find_scene, replay, report, shown
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, SceneMismatchError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.progress import listening
from sceniris_gym.scene.build import build_model
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.layout.scenes import box_mjcf
from tests.layout.starting import starting


@pytest.mark.parametrize("split", ["train", "eval"])
def test_an_id_makes_the_same_layout_again(split: str):
    """World 5 of 8 in its third episode, and the same from its id alone."""
    compiled = compile_scene("mid", "cpu")
    generator = LayoutGenerator(compiled, 8, seed=2**63, split=split)
    for _ in range(3):
        generator.generate()
    table = generator.table()
    again = replay(compiled, LayoutId.parse(compiled.layout_id(2**63 + 5, 2, split)))
    for name in ("qpos", "mocap_pos", "mocap_quat", "status", "attempts", "seed", "episode"):
        assert np.array_equal(getattr(again, name)[0], getattr(table, name)[5]), name


def test_a_shipped_scene_is_found_by_its_hash():
    """The hash of a shipped scene is enough."""
    assert find_scene(compile_scene("mid", "cpu").hash).config.name == "mid"


@pytest.mark.parametrize(
    "text",
    ["", "abc:train:1", "abc:test:1:2", "abc:bank:1:2", "abc:train:-1:2", "abc:train:x:2", f"abc:train:{2**64}:0"]
    + ["a:eval:0:1:2"],
)
def test_other_texts_are_no_ids(text: str):
    """The error says what an id looks like, and names the splits that there are for users."""
    with pytest.raises(ArgumentError, match=r"scenehash:split:seed:episode.* The split is train or eval"):
        LayoutId.parse(text)


def test_an_id_is_read_as_it_is_written():
    """Of numbers, and of what an environment's info gives: tensors, with seeds in two's complement."""
    compiled = compile_scene("mid", "cpu")
    assert LayoutId.parse(compiled.layout_id(42, 7, "eval")) == LayoutId(compiled.hash, "eval", 42, 7)
    assert compiled.layout_id(42, 7) == f"{compiled.hash}:train:42:7"
    seed, episode = torch.tensor([5, -1]), torch.tensor([0, 3], dtype=torch.int32)
    assert compiled.layout_id(seed[1], episode[1]) == compiled.layout_id(2**64 - 1, 3)
    assert compiled.layout_id(np.uint64(2**64 - 1), np.int32(3)) == compiled.layout_id(2**64 - 1, 3)


def test_a_replay_names_the_grasp(crane: CompiledScene):
    """In numbers and in the report; joints are null where none were solved for."""
    table = make_table(crane, 1, 0)
    found = describe(crane, table)
    grasp = found["objects"]["thing"]["grasp"]
    assert grasp["name"] == "top 0"
    assert grasp["pos"] == pytest.approx(table.grasp_pose[0, 0, :3].tolist())
    assert grasp["qpos"] is grasp["pregrasp_qpos"] is None
    assert "grasp" not in found["objects"]["other"]
    assert "grasp 'top 0'" in report({"layouts": [{"id": "x", **found}], "picture": "y"})


def test_a_scene_of_ones_own_is_found_by_its_hash(tmp_path: Path):
    """If it is given; the hash of another one is refused with those that there are."""
    cube = box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    config = SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": {"thing": {"asset": cube, "on": "floor"}}})
    own = compile_scene(config, "cpu").hash
    assert find_scene(own, config).config is config
    with pytest.raises(UnknownNameError, match=r"^replay: give --scene if the scene is your own: .* \(mid\), "):
        find_scene(own)
    (tmp_path / "changed.yaml").write_text("base: mid\nobjects: {apple: {clearance: 0.02}}\n")
    config = SceneConfig.load(tmp_path / "changed.yaml")
    now = build_model(config).hash
    with pytest.raises(
        SceneMismatchError, match=rf"scene {own}, but 'changed' is now scene {now}\. Give the scene file as"
    ):
        find_scene(own, config)


def test_poses_are_told_in_words_and_numbers():
    """Of a cabinet with drawers and of fruit: what MuJoCo says of the row; in the report the yaw is in degrees."""
    compiled = compile_scene("mid", "cpu")
    table = make_table(compiled, 1, 4)
    found = describe(compiled, table)
    data = mujoco.MjData(compiled.mjm)
    table.put(data, 0)
    mujoco.mj_forward(compiled.mjm, data)
    for name in ("cabinet", "apple", "banana"):
        assert found["objects"][name]["pos"] == data.body(name).xpos.tolist()
        assert found["objects"][name]["quat"] == pytest.approx(data.body(name).xquat.tolist(), abs=1e-7)
    assert found["objects"]["cabinet"]["joints"]["upper"] == data.joint("cabinet/upper").qpos[0]
    lines = report({"layouts": [{"id": "x", **found}], "picture": "y"}).split("\n")
    (apple,) = [line for line in lines if line.split()[0] == "apple"]
    found["objects"]["a_name_of_twenty_ch"] = found["objects"]["apple"]
    listed = report({"layouts": [{"id": "x", **found}], "picture": "y"}).split("\n")[1:-1]
    assert len({line.index(" x ") for line in listed}) == 1
    x = data.body("apple").xmat.reshape(3, 3)[:, 0]
    assert f"yaw {np.degrees(np.arctan2(x[1], x[0])):+7.1f} deg" in apple
    assert "tilt" not in apple
    found["objects"]["apple"]["quat"] = [np.cos(0.3), np.sin(0.3), 0.0, 0.0]
    assert f"tilt {np.degrees(0.6):.1f} deg" in report({"layouts": [{"id": "x", **found}], "picture": "y"})


def test_absent_objects_are_named():
    """An object of an optional group, and an object with variants of which none is present."""
    scene = {"floor": {"size": [1.0, 1.0]}, "objects": {n: {"asset": "can", "on": "floor"} for n in ("a", "b")}}
    compiled = compile_scene({**scene, "groups": {"one": {"of": ["a", "b"], "count": 1}}}, "cpu")
    table = make_table(compiled, 1, 0)
    found = describe(compiled, table)
    assert sorted([*found["objects"], *found["absent"]]) == ["a", "b"]
    (absent,) = found["absent"]
    assert re.search(rf"^  {absent} +absent$", report({"layouts": [{"id": "x", **found}], "picture": "y"}), re.M)


def test_of_many_layouts_a_few_lines_are_printed():
    """A line for each of the first five, their number, and how to get the rest: not a screen for each failure."""
    one = describe(compile_scene("mid", "cpu"), make_table(compile_scene("mid", "cpu"), 1, 0))
    several = {"layouts": [{"id": f"h:eval:{i}:0", **one} for i in range(96)], "picture": "y"}
    *first, more, picture = report(several).split("\n")
    assert first == [f"h:eval:{i}:0 of scene 'mid': valid, {one['attempts']} candidates" for i in range(5)]
    assert (more, picture) == ("and 91 more. Poses of all layouts: --json, or a single ID", "picture: y")
    assert report(several | {"layouts": several["layouts"][:2]}).count("\n") == 2


def test_the_kind_of_start_is_told():
    """By its number in the scene, from 0."""
    compiled = starting()
    table = replay(compiled, LayoutId.parse(compiled.layout_id(3, 0)))
    text = report({"layouts": [{"id": "an id", **describe(compiled, table)}], "picture": "a.png"})
    assert f"\n  start        {table.start[0]}\n" in text


def test_numbers_are_those_of_the_layout_bit_for_bit():
    """Of free objects and of mocap bodies, before MuJoCo normalizes their quaternions anew."""
    compiled = compile_scene("mid", "cpu")
    mjm = compiled.mjm
    for seed in range(4):
        table = make_table(compiled, 1, seed)
        found = describe(compiled, table)["objects"]
        for name in ("apple", "banana"):
            adr = mjm.jnt_qposadr[mjm.body_jntadr[compiled.scene.bodies[name]]]
            assert [*found[name]["pos"], *found[name]["quat"]] == table.qpos[0, adr : adr + 7].tolist()
        mocap = mjm.body_mocapid[compiled.scene.bodies["cabinet"]]
        assert found["cabinet"]["pos"] == table.mocap_pos[0, mocap].tolist()
        assert found["cabinet"]["quat"] == table.mocap_quat[0, mocap].tolist()


def test_the_picture_of_a_layout_is_named_after_its_id():
    """Without the colons, which not every file system takes."""
    assert default_picture(["0123:eval:4:5"]).name == "0123-eval-4-5.png"
    assert default_picture(["0123:eval:4:5", "0123:eval:4:6"]).name == "replay.png"


def test_a_replay_has_the_physics_and_looks_of_its_episode():
    """The numbers of a world that was reset, a model with its values, and a picture with its colours."""
    looks = {"mass": {"scale": [0.5, 2.0]}, "rgba": {"abs": [[0.0] * 3, [1.0] * 3]}}
    variants = {"lemon": {"asset": "lemon"}, "brick": {"asset": "brick"}}
    things = {"can": {"randomize": looks}, "extra": {"variants": variants, "on": "table", "randomize": looks}}
    scene = {"gravity": {"scale": [0.5, 1.0]}, "materials": {"table/wood": {"rgba": {"scale": [0.5, 1.0]}}}}
    compiled = compile_scene({"base": "tabletop_lift", "bank": 8, "objects": things, "randomize": scene}, "cpu")
    batch = Batch(compiled.scene, 3, "cpu")
    randomizer = ResetRandomizer.of_batch(batch, compiled, seed=4)
    for _ in range(2):
        randomizer.reset()
    name = LayoutId.parse(randomizer.pipeline.ids(randomizer.split)[2])
    mjm, numbers = drawn(compiled, replay(compiled, name))
    assert set(numbers) == {"can.mass", "can.rgba", "extra.mass", "extra.rgba", "gravity", "materials.table/wood.rgba"}
    for draw, found in numbers.items():
        assert found == batch.fields.parameter(draw, "test").numpy()[2].tolist(), draw
    present = f"extra/{list(variants)[randomizer.variants.cpu().numpy()[2, 0]]}"
    for ours, theirs in (("can", "can"), ("extra", present)):
        masses = batch.model.body_mass.numpy()[2, batch.scene.bodies[ours]]
        assert mjm.body_mass[compiled.scene.bodies[theirs]] == masses
        colour = mjm.geom_rgba[mjm.body(theirs).geomadr.item(), :3]
        assert colour.tolist() == numbers[f"{ours}.rgba"]
    assert (mjm.opt.gravity == batch.model.opt.gravity.numpy()[2]).all()
    material = mjm.material("table/wood").id
    assert (mjm.mat_rgba[material] == batch.model.mat_rgba.numpy()[2, material]).all()
    assert (compiled.mjm.mat_rgba[material] != mjm.mat_rgba[material]).any()
    told = {"layouts": [describe(compiled, replay(compiled, name)) | {"id": "x", "drawn": numbers}], "picture": "y"}
    assert f"  can.mass     {numbers['can.mass'][0]:.4g}" in report(told)


def test_drawing_tells_how_far_it_is(tmp_path: Path):
    """Each layout may take a second."""
    compiled, heard = compile_scene("mid", "cpu"), []
    with listening(lambda *words: heard.append(words)):
        shown([compiled.layout_id(seed, 0) for seed in range(3)], compiled.config, tmp_path / "three.png", "cpu")
    assert [words for words in heard if words[0] == "layouts"] == [("layouts", done, 3) for done in (1, 2, 3)]
