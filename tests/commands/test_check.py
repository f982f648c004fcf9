"""Causes that make a scene hard: their shares, and the report of them as text and as a picture."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from ruamel.yaml import YAML

from sceniris_gym.cli import main
from sceniris_gym.commands.check import _LEAST_VALID, check, judge, report, table_of_rejections
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import FallbackWarning
from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.crane import HEIGHT, crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu


def test_the_command_check_tells_and_draws_it(tmp_path: Path, capsys: pytest.CaptureFixture):
    """`sceniris-gym check SCENE --picture FILE`: causes of reach, areas, and a picture with both panels."""
    asset, cube = crane_mjcf(tmp_path), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    file, picture = tmp_path / "ring.yaml", tmp_path / "ring.png"
    with file.open("w") as stream:
        YAML().dump(crane_scene(asset, cube), stream)
    command = ["check", str(file), "--layouts", "200", "--device", "cpu", "--picture", str(picture)]
    main([*command, "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["rejections"]["thing"]["unreachable"] == found["narrowing"]["thing"]["unreachable"] > 0
    assert found["picture"] == str(picture)
    drawn = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    orange = (drawn[..., 0] > 190) & (drawn[..., 1] < 130) & (drawn[..., 2] < 80)
    middle = drawn.shape[1] // 2
    assert orange[:, middle:].sum() > 0
    assert orange[:, :middle].sum() > 0


def test_every_candidate_of_a_single_object_is_rejected_or_stays(tmp_path: Path):
    """One cube that a crane must reach: candidates are layouts and rejections, and most of them are out of reach."""
    asset, cube = crane_mjcf(tmp_path), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    compiled = compile_on_cpu({**crane_scene(asset, cube), "attempts": 2, "restarts": 60}, bank=4)
    found = check(compiled, 200, 7)
    rejected = found["rejections"]["thing"]
    assert (found["valid"], found["attempts"]) == (1.0, 2)
    assert 0.2 < found["first_pass_valid"] < 0.6  # two candidates, of which a fifth each is within reach
    assert found["attempts_per_layout"] * 200 == pytest.approx(200 + sum(rejected.values()))
    assert rejected["unreachable"] > 200
    assert found["first_id"] == f"{compiled.hash}:train:7:0"
    assert "picture" not in found


def test_a_start_that_few_layouts_allow_is_named_and_its_scene_is_not_ok(tmp_path: Path):
    """A cube anywhere around a crane: one restart finds few that start at a pre-grasp, and a low crane finds none."""
    file, cube = Path(crane_mjcf(tmp_path)), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    start = {"robot": "pregrasp", "of": "thing"}
    scene = {**crane_scene(str(file), cube, reachable="ik"), "start": [{"weight": 1}, start], "restarts": 1, "bank": 8}
    advice = "other grasps or a lower 'lift' in start.1, which accept only grasps that hold 'thing' without collisions"
    with pytest.warns(FallbackWarning, match=advice):
        found = judge(SceneConfig.load(scene), "cpu", 100, 0)
    assert 0.0 < found["valid"] < 0.5
    assert not found["ok"]
    assert judge(SceneConfig.load({**scene, "restarts": 50}), "cpu", 100, 0)["ok"]
    file.write_text(file.read_text().replace(f'{HEIGHT[1]}"', '0.075"').replace(" 0.3 0 0.04", " 0.05 0 0.04"))
    found = judge(SceneConfig.load({**scene, "restarts": 50}), "cpu", 100, 0)
    assert advice in found["error"]


def test_warnings_before_an_error_are_told(tmp_path: Path, capsys: pytest.CaptureFixture):
    """They may tell why the scene is refused."""
    body = '<body name="arm"><joint name="slide" type="slide" range="0 1"/><geom size="0.1"/></body>'
    wrong = '<equality><joint joint1="slide" joint2="slyde"/></equality>'
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{body}</worldbody>{wrong}</mujoco>")
    cube = {"asset": box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04), "on": "floor", "reachable": "ik"}
    scene = {
        "floor": {"size": [1.0, 1.0]},
        "robot": {"asset": "arm.xml", "base": [0, 0, 0.2]},
        "objects": {"cube": cube},
    }
    with (tmp_path / "cell.yaml").open("w") as stream:
        YAML().dump(scene, stream)
    with pytest.raises(SystemExit):
        main(["check", str(tmp_path / "cell.yaml"), "-n", "8", "--device", "cpu"])
    warned, refused = capsys.readouterr().err.splitlines()
    assert warned.startswith(f"warning: {tmp_path / 'cell.yaml'}: robot.asset: ") and "slyde" in warned
    assert refused.startswith("error: ")


def test_layouts_are_made_once_and_their_rejections_name_what_is_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Two crates on a small floor: the second one is told with the first, and a single generator made it all."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.1), "on": "floor"}
    compiled = compile_on_cpu({"floor": {"size": [0.3, 0.3]}, "objects": {"a": crate, "b": crate}}, bank=4)
    made: list[LayoutGenerator] = []
    monkeypatch.setattr(LayoutGenerator, "generate", _counted(LayoutGenerator.generate, made))
    found = check(compiled, 100, 5)
    assert len(made) == 1
    assert found["rejections"]["b"]["collision"] > 20
    assert list(found["in_the_way"]) == ["b"]
    assert "of body 'b' and geom '1' of body 'a'" in found["in_the_way"]["b"]
    assert "100% of collisions" in found["in_the_way"]["b"]


def test_a_scene_without_a_layout_has_the_table_and_all_that_is_in_the_way_with_sizes(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    """The verdict and the exit status are bad; the crate that is only hard is told too, not the last one only."""
    crate, post = ({"asset": box_mjcf(tmp_path, name, size, size, size)} for name, size in (("c", 0.1), ("p", 0.5)))
    objects = {
        "post": {**post, "kind": "static"},
        "hard": {**crate, "on": "floor", "region": {"box": [[-0.35, -0.2], [0.35, 0.2]]}},
        "never": {**crate, "on": "floor", "region": {"box": [[-0.1, -0.05], [0.1, 0.05]]}},
    }
    with (tmp_path / "full.yaml").open("w") as stream:
        YAML().dump({"floor": {"size": [1.0, 1.0]}, "objects": objects}, stream)
    with pytest.raises(SystemExit) as ended:
        main(["check", str(tmp_path / "full.yaml"), "-n", "8", "--device", "cpu"])
    lines = capsys.readouterr().out.splitlines()
    assert ended.value.code == 1
    assert lines[0].startswith("FAIL: ")
    assert [line.split()[0] for line in lines[1:4]] == ["rejected", "hard", "never"]
    assert [line.split(":")[0] for line in lines[4:]] == ["most in the way of hard", "most in the way of never"]
    for line, says in zip(
        lines[4:], ("'hard' is 10 x 10 cm wide, its region 70 x 40 cm", "region 20 x 10 cm"), strict=True
    ):
        assert says in line


RELATED = {
    "near": (
        {"can": [{"near": "post", "distance": {"max": 0.12}}]},
        "It has to be 'near post, at most 0.12 m'.",
    ),
    "beside": (
        {
            "wall": [{"beside": "post", "side": "right", "gap": 0.05}],
            "can": [{"beside": "post", "side": "right", "gap": 0.01}],
        },
        "It has to be 'beside post, right, gap 0.01 m'.",
    ),
    "both": (
        {
            "wall": [{"front_of": "post", "distance": {"min": 0.5}}],
            "can": [{"near": "post", "distance": {"max": 0.2}}, {"near": "wall", "distance": {"max": 0.15}}],
        },
        "It has to be 'near post, at most 0.2 m' and 'near wall, at most 0.15 m'.",
    ),
}


@pytest.mark.parametrize("tight", RELATED)
def test_a_relation_that_leaves_no_place_is_named(tight: str, tmp_path: Path, capsys: pytest.CaptureFixture):
    """Too near to another object, at a place that is taken, and in two rings that do not meet; the floor is large."""
    asset = {name: box_mjcf(tmp_path, name, size, size, size) for name, size in (("can", 0.1), ("post", 0.2))}
    relations, says = RELATED[tight]
    objects: dict[str, Any] = {"post": {"asset": asset["post"], "on": "floor"}}
    for name, words in relations.items():
        objects[name] = {"asset": asset["can" if name == "can" else "post"], "on": "floor", "relations": words}
    with (tmp_path / "tight.yaml").open("w") as stream:
        YAML().dump({"floor": {"size": [2.0, 2.0]}, "objects": objects}, stream)
    with pytest.raises(SystemExit) as ended:
        main(["check", str(tmp_path / "tight.yaml"), "-n", "8", "--device", "cpu"])
    verdict = capsys.readouterr().out.splitlines()[0]
    assert ended.value.code == 1
    assert "'can' could not be placed" in verdict
    assert f"{says} Widen or remove a relation" in verdict


def _counted(function: Callable, calls: list) -> Callable:
    """The same function, which notes what it was called on."""

    def counted(self: Any, *words: Any) -> Any:
        calls.append(self)
        return function(self, *words)

    return counted


def test_the_report_has_shares_causes_and_the_picture():
    """As text: percentages, a table of objects and causes with its columns in line, and what is within reach."""
    counts = {"mug": {"collision": 7, "roof": 0}, "long_named_pan": {"collision": 12345, "roof": 3}}
    found = {
        **{
            "ok": True,
            "scene": "desk",
            "hash": "0123",
            "first_id": "0123:train:4:0",
            "layouts": 8,
            "rejections": counts,
            "in_the_way": {},
        },
        **{"valid": 0.875, "first_pass_valid": 0.5, "attempts_per_layout": 2.25, "attempts": 40},
        "narrowing": {"mug": {"kept": 0.25, "candidates": 40}},
    }
    lines = report(found, "my desk.yaml", ("objects.mug.gap=0.01",)).split("\n")
    assert lines[0].startswith("ok: 8 layouts of 'desk': 87.50% valid, 50.00% on the first pass, 2.25 candidates")
    assert "40 attempts" in lines[1]
    assert lines[2].endswith("0123:train:4:0")
    assert [line.split() for line in lines[3:6]] == [
        ["rejected", "collision", "roof"],
        ["mug", "7", "0"],
        ["long_named_pan", "12345", "3"],
    ]
    assert len({len(line) for line in lines[3:6]}) == 1
    replay = "sceniris-gym replay 0123:train:4:0 --scene 'my desk.yaml' --set=objects.mug.gap=0.01"
    assert lines[6:] == ["mug: 25.0% of 40 candidates are within reach", f"draw the first one: {replay}"]
    with_picture = report({**found, "picture": "a.png"}, "desk").split("\n")
    assert with_picture[7:] == ["picture: a.png", "draw the first one: sceniris-gym replay 0123:train:4:0 --scene desk"]
    assert table_of_rejections({"mug": {"collision": 0}}) == "no candidate was rejected"
    found |= {"in_the_way": {"mug": "geom 'a' and geom 'b'"}}
    assert "most in the way of mug: geom 'a' and geom 'b'" in report(found, "desk").split("\n")
    assert "most in the way" not in report({**found, "valid": 1.0}, "desk")


def test_variants_that_fail_by_the_same_cause_share_a_row():
    """Sums, the first name and the number of the others; a variant that differs keeps its row, and JSON has all."""
    rejections = {
        "mug/a": {"collision": 3, "roof": 1},
        "mug/b": {"collision": 0, "roof": 9},
        "mug/c": {"collision": 5, "roof": 0},
        "mug/d": {"collision": 0, "roof": 0},
        "mug/@desk": {"collision": 6, "roof": 6},
        "pan": {"collision": 8, "roof": 0},
    }
    assert [line.split() for line in table_of_rejections(rejections).split("\n")] == [
        ["rejected", "collision", "roof"],
        ["mug/a", "+2", "14", "7"],
        ["mug/b", "0", "9"],
        ["pan", "8", "0"],
    ]
    found: dict[str, Any] = {"ok": True, "scene": "desk", "first_id": "0:train:0:0", "layouts": 8, "attempts": 40}
    found |= {"valid": 0.9, "first_pass_valid": 0.5, "attempts_per_layout": 2.0, "rejections": rejections}
    found["in_the_way"] = {"mug/b": "a lamp", "mug/c": "a pan", "mug/@desk": "a pot"}
    kept = {"mug/a": (0.25, 40), "mug/b": (0.0, 0), "mug/c": (0.5, 2), "pan": (0.75, 4)}
    found["narrowing"] = {name: {"kept": share, "candidates": n} for name, (share, n) in kept.items()}
    lines = report(found, "desk").split("\n")
    assert lines[7:9] == ["most in the way of mug/a +2: a pan", "most in the way of mug/b: a lamp"]
    assert lines[9:-1] == [
        "mug/a +1: 25.0% to 50.0% of 42 candidates are within reach",
        "mug/b: 0.0% of 0 candidates are within reach",
        "pan: 75.0% of 4 candidates are within reach",
    ]


def test_a_scene_without_an_object_to_place_is_told(tmp_path: Path, capsys: pytest.CaptureFixture):
    """Its layouts are valid, but they all are the same."""
    table = {"asset": box_mjcf(tmp_path, "table", 0.5, 0.5, 0.4), "kind": "static"}
    with (tmp_path / "bare.yaml").open("w") as stream:
        YAML().dump({"objects": {"table": table}}, stream)
    main(["check", str(tmp_path / "bare.yaml"), "-n", "8", "--device", "cpu"])
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("ok: 8 layouts of 'bare': 100.00% valid")
    assert first.endswith(", but the scene has no object to place")


def test_the_share_that_makes_the_verdict_bad_is_documented(capsys: pytest.CaptureFixture):
    """The help and the page name the share of the code."""
    with pytest.raises(SystemExit):
        main(["check", "--help"])
    text = "fewer than half of the layouts are valid"
    page = (Path(__file__).parents[2] / "docs" / "commands.md").read_text()
    assert _LEAST_VALID == 0.5
    assert text in " ".join(capsys.readouterr().out.split())
    assert text in " ".join(page.split())
