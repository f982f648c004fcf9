"""A CompiledScene before its bank is filled: what it says of its scene, and that all of it is on the device."""

from __future__ import annotations

import ast
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp

from sceniris_gym import program
from sceniris_gym.collide.boxes import OWN_STACK
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError
from sceniris_gym.program.compiled import CHECKS, CompiledScene, upload_scene
from sceniris_gym.program.device import Program
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import bank_rows
from tests.program.scenes import scene_of

PROGRAM = Path(program.__file__).parent


def _uploaded(scene: str = "mid", geometry: str = "physics") -> CompiledScene:
    return upload_scene(build_model(SceneConfig.load(scene, {"geometry": geometry})), "cpu")


def test_every_check_of_the_folder_is_run_and_warnings_come_late():
    """Once each; the check of reach comes last, as arms are only planned for it."""
    found = [
        node.name
        for path in (PROGRAM / "checks").glob("*.py")
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.FunctionDef) and ast.unparse(node.args) == "plan: Plan" and node.name[0] != "_"
    ]
    assert sorted(check.__name__ for check in CHECKS) == sorted(found)
    assert [check.__name__ for check in CHECKS][-2:] == ["warn_of_oddities", "check_reach"]


@pytest.mark.parametrize("path", [p for p in PROGRAM.rglob("*.py") if p.parent.name != "checks"], ids=lambda p: p.stem)
def test_only_the_upload_knows_the_checks(path: Path):
    """Neither the plan nor a packer asks for one."""
    assert ("sceniris_gym.program.checks" in path.read_text()) == (path.name == "compiled.py")


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_every_list_of_the_program_is_in_the_array_that_it_addresses(geometry: str):
    """No address or index that a kernel follows leads out of an array."""
    compiled = _uploaded(geometry=geometry)
    held = {name: getattr(compiled.program, name) for name in Program.vars}  # pyrefly: ignore[missing-attribute]
    a = {name: value.numpy() for name, value in held.items() if isinstance(value, wp.array)}
    pieces, bodies = len(a["piece_type"]), compiled.mjm.nbody
    lists = {
        "obj_draw": "draw_qposadr", "draw_choice": "choice", "obj_stable": "stable_cdf", "obj_body": "body_list",
        "obj_piece": "piece_list", "obj_shadow": "shadow_list", "obj_overhead": "overhead_list", "obj_rel": "rel_type",
        "obj_pair": "pair_a", "obj_broad": "broad_pair", "stable_tri": "tri_cdf", "rel_anchor": "rel_anchor",
        "surface_edge": "edge_a", "piece_vert": "vert", "collider_point": "point",
        "body_jnt": "jnt_axis",
    }  # fmt: skip
    for name, values in lists.items():
        adr, num = a[f"{name}adr"], a[f"{name}num"]
        assert (num >= 0).all(), name
        assert ((adr + num)[num > 0] <= len(a[values])).all(), name
        assert (adr[num > 0] >= 0).all(), name
    assert (a["group"][:, :2].sum(axis=1) <= len(a["group_slot"])).all()
    roofs = pieces if geometry == "physics" else len(a["collider_body"])
    inside = {
        "body_list": bodies, "obj_body": bodies, "obj_ground": bodies, "piece_body": bodies, "collider_body": bodies,
        "body_parent": bodies, "piece_list": pieces, "shadow_list": pieces, "overhead_list": roofs,
        "collider_plane": pieces, "collider_root": len(a["node_child"]), "pair_a": len(a["collider_body"]),
        "pair_b": len(a["collider_body"]), "tri_surface": len(a["surface_height"]), "draw_qposadr": compiled.mjm.nq,
        "jnt_qposadr": compiled.mjm.nq, "obj_slot": len(compiled.slots), "rel_anchor": len(compiled.slots),
    }  # fmt: skip
    for name, size in inside.items():
        assert (a[name] < size).all(), name
    assert (a["broad_pair"] < [len(a["pair_a"]), *[len(a["node_child"])] * 2]).all()
    assert (a["broad_pair"] >= 0).all()


def test_its_start_is_that_of_the_model_s_keyframe():
    """Poses of all bodies by MuJoCo C."""
    compiled = _uploaded()
    data = mujoco.MjData(compiled.mjm)
    mujoco.mj_resetDataKeyframe(compiled.mjm, data, compiled.mjm.key("home").id)
    mujoco.mj_kinematics(compiled.mjm, data)
    np.testing.assert_allclose(compiled.home_qpos, data.qpos, atol=1e-6)
    np.testing.assert_allclose(compiled.home_xpos, data.xpos, atol=1e-6)
    np.testing.assert_allclose(compiled.home_xquat, data.xquat, atol=1e-6)
    np.testing.assert_allclose(compiled.program.home_qpos.numpy(), data.qpos, atol=1e-6)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_no_two_trees_are_deeper_than_a_lane_has_room_for(geometry: str):
    """By a walk through the boxes on the device: a descent leaves one pair behind for each level of both trees."""
    program = _uploaded(geometry=geometry).program
    child = program.node_child.numpy()

    def deep(node: int) -> int:
        return 0 if child[node] < 0 else 1 + max(deep(child[node]), deep(child[node] + 1))

    depths = sorted(deep(root) for root in program.collider_root.numpy())
    assert 1 + depths[-1] + depths[-2] < OWN_STACK


def test_its_bank_is_empty():
    """Layouts can be made after the upload, but there is nothing to fall back on yet."""
    compiled = _uploaded()
    assert bank_rows(compiled, "train") == bank_rows(compiled, "eval") == slice(0, 0)


def test_names_are_those_of_the_file_and_the_robot_comes_last(folder: Path):
    """Objects that are not placed have a slot too; what only draws joints is placed first."""
    objects = {
        "apple": {"asset": "apple", "on": "gadget"},
        "gadget": {"asset": str(folder / "gadget.xml"), "kind": "fixture", "on": "floor"},
        "wall": {"asset": str(folder / "box.xml"), "kind": "static"},
    }
    compiled = upload_scene(scene_of(objects, robot={"asset": "panda", "joints": {"*": {"noise": 0.1}}}), "cpu")
    assert compiled.object_names == ("apple", "gadget", "wall")
    assert compiled.slots == ("apple", "gadget", "wall", "robot")
    assert compiled.placed == ("robot", "gadget", "apple")
    assert compiled.reaching is None
    assert not compiled.related


def test_a_scene_is_related_where_a_region_is_not_the_same_in_every_world(folder: Path):
    """By a relation, or by a drawn turn that decides how far it keeps from an edge; else all worlds share it."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    for words, related in (
        ({}, False),
        ({"ratio_on_support": 1.0}, False),
        ({"ratio_on_support": 1.0, "orientation": "any"}, True),
        ({"relations": [{"near": "mark", "distance": {"max": 0.5}}]}, True),
    ):
        objects = {"mark": {"kind": "marker", "on": "floor"}, "box": {**box, **words}}
        assert upload_scene(scene_of(objects), "cpu").related is related


def test_a_layout_is_named_by_scene_split_seed_and_episode():
    """Seeds are 64 bits of whatever library; negative ones are read as two's complement."""
    compiled = _uploaded()
    assert compiled.hash == compiled.scene.hash
    for seed in (-1, np.int64(-1), np.uint64(2**64 - 1), 2**64 - 1):
        assert compiled.layout_id(seed, np.int32(3), "eval") == f"{compiled.hash}:eval:18446744073709551615:3"
    assert compiled.layout_id(0, 0) == f"{compiled.hash}:train:0:0"


@pytest.mark.parametrize("seed", [2**64, -(2**63) - 1, 10**400])
def test_a_seed_of_more_than_64_bits_names_no_layout(seed: int):
    """It would be the name of another one's."""
    with pytest.raises(ArgumentError, match=r"layout_id: seed=.{1,90} should be an integer of 64 bits"):
        _uploaded().layout_id(seed, 0)


@pytest.mark.parametrize("episode", [-1, -5, 2**31])
def test_an_episode_that_there_is_not_names_no_layout(episode: int):
    """Neither that of a world before its first reset, nor one that `LayoutId` does not read."""
    with pytest.raises(ArgumentError, match=rf"layout_id: episode={episode} should be from 0 to 2\^31 - 2"):
        _uploaded().layout_id(0, episode)


@pytest.mark.parametrize("params", ["foo", "a=1", "a=3f80000", "a=3F800000", {"a": 1.0}, 3, None])
def test_params_that_no_id_has_name_no_layout(params: Any):
    """They have the form of `LayoutId`."""
    with pytest.raises(ArgumentError, match="layout_id: params should be text such as 'name=3f800000', got"):
        _uploaded().layout_id(0, 0, params=params)
    assert _uploaded().layout_id(0, 0, params="a.b=3f800000,c=0000000040000000").count(":") == 4


@pytest.mark.parametrize("split", ["foo", "train_bank", "", None, ["train"]])
def test_another_split_names_no_layout(split: Any):
    """Those that there are are named."""
    with pytest.raises(ArgumentError, match=r"layout_id: unknown split .*Valid: train, eval\."):
        _uploaded().layout_id(0, 0, split)


def test_nothing_of_it_can_be_set_again():
    """It is frozen."""
    compiled = _uploaded()
    with pytest.raises(FrozenInstanceError):
        compiled.device = "cpu"  # pyrefly: ignore[read-only]
