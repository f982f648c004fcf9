"""npz and JSON beside the parts: what is in them is what MuJoCo makes of `qpos`; and the bytes are the same again."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.loader import shipped
from sceniris_gym.dataset import manifest
from sceniris_gym.dataset.formats import check_formats, parse_formats
from sceniris_gym.dataset.manifest import DatasetPlan
from sceniris_gym.dataset.reader import LayoutDataset, verify
from sceniris_gym.dataset.shard import Shard
from sceniris_gym.dataset.writer import DatasetWriter
from sceniris_gym.errors import DatasetError, MissingExtraError, UnknownNameError
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import compile_on_cpu

ASSETS = shipped("assets", ".xml")
ALL = ("json", "mjcf", "npz", "usd")


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of a few rows."""
    monkeypatch.setattr(manifest, "PART_ROWS", 16)


def write(
    compiled: CompiledScene,
    folder: Path,
    formats: tuple[str, ...] = ("json", "npz"),
    shard: Shard | None = None,
    resume: bool = False,
) -> bool:
    """Write forty layouts, and return whether each part has a record now."""
    plan = DatasetPlan.of(compiled, 40, 3, "train", formats)
    writer = DatasetWriter(compiled, plan, folder, shard or Shard(), resume=resume)
    return len(writer.write(chunk=64)) == plan.parts


def contents(folder: Path) -> dict[str, str]:
    """Checksums of all files of a folder."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def check_poses(compiled: CompiledScene, layout: dict, poses: dict) -> None:
    """Compare poses by name with those of MuJoCo C."""
    mjm, data = compiled.mjm, mujoco.MjData(compiled.mjm)
    data.qpos[:] = layout["qpos"]
    data.mocap_pos.flat, data.mocap_quat.flat = np.ravel(layout["mocap_pos"]), np.ravel(layout["mocap_quat"])
    mujoco.mj_kinematics(mjm, data)
    assert set(poses) == set(compiled.slots)
    for name, pose in poses.items():
        body = compiled.scene.bodies[name]
        np.testing.assert_allclose(pose[:3], data.xpos[body], atol=1e-6)
        assert abs(np.dot(pose[3:], data.xquat[body])) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("scene", ["mid", "clutter", "tabletop_lift"])
def test_states_by_name_are_those_of_mujoco(scene: str, tmp_path: Path):
    """Objects on joints of fixtures, members that are absent, a robot; and every column beside them."""
    compiled = compile_on_cpu(scene)
    write(compiled, tmp_path)
    rows, arrays = np.load(tmp_path / "layouts-00001.npy"), np.load(tmp_path / "layouts-00001.npz")
    layouts = json.loads((tmp_path / "layouts-00001.json").read_text())
    assert len(layouts) == len(rows) == 16
    for name in rows.dtype.names or ():
        np.testing.assert_array_equal(arrays[name], rows[name], err_msg=name)
        if name != "present":
            told = np.array([layout[name] for layout in layouts])
            told = told.astype(float).astype(rows[name].dtype) if told.dtype == object else told  # null is nan
            np.testing.assert_array_equal(told.astype(rows[name].dtype).ravel(), rows[name].ravel(), err_msg=name)
    mjm = compiled.mjm
    for i, layout in enumerate(layouts):
        assert layout["present"] == dict(zip(compiled.slots, rows["present"][i], strict=True))
        check_poses(compiled, layout, layout["poses"])
        by_name = {key.removeprefix("pose/"): arrays[key][i] for key in arrays if key.startswith("pose/")}
        check_poses(compiled, layout, by_name)
        for joint in np.flatnonzero(mjm.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)):
            name, position = mjm.joint(joint).name, rows["qpos"][i, mjm.jnt_qposadr[joint]]
            assert np.float32(layout["joints"][name]) == arrays[f"joint/{name}"][i] == position


OPENS = {"cabinet": "upper", "cupboard": "door", "chest": "lid", "shelf": None}
"""Unit -> the joint that its part `opening` is."""


def test_stock_models_and_parts_are_those_of_each_layouts_own_unit(tmp_path: Path):
    """In the scene for MuJoCo, the present unit moves as its own file, and the others are far away.

    Joints and parts have NaN, or null in JSON, in rows without the unit that has them.
    """
    words = {"asset": [*OPENS], "kind": "fixture", "on": "floor", "region": {"box": [[-1, -1], [1, 1]]}}
    words |= {"parts": {"opening": dict(OPENS)}, "joints": {"opening": {"fraction": [0.2, 0.9]}}}
    compiled = compile_on_cpu({"bank": 4, "floor": {"size": [8, 8]}, "objects": {"unit": words}})
    write(compiled, tmp_path)
    rows, arrays = np.load(tmp_path / "layouts-00000.npy"), np.load(tmp_path / "layouts-00000.npz")
    layouts, seen = json.loads((tmp_path / "layouts-00000.json").read_text()), set()
    with (tmp_path / "scene.zip").open("rb") as file:
        mjm = mujoco.MjSpec.from_zip(file).compile()
    data, models = mujoco.MjData(mjm), {name: mujoco.MjModel.from_xml_path(str(ASSETS[name])) for name in OPENS}
    for i, layout in enumerate(layouts):
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = (rows[name][i] for name in manifest.STATE)
        mujoco.mj_kinematics(mjm, data)
        (unit,) = (name.removeprefix("unit/") for name, there in layout["present"].items() if there)
        own, opening, joints = models[unit], OPENS[unit], dict.fromkeys(layout["joints"], np.nan)
        alone = mujoco.MjData(own)
        own.body_pos[1], own.body_quat[1] = layout["poses"][f"unit/{unit}"][:3], layout["poses"][f"unit/{unit}"][3:]
        for joint in range(own.njnt):
            name = own.joint(joint).name
            alone.qpos[own.jnt_qposadr[joint]] = joints[f"unit/{unit}/{name}"] = layout["joints"][f"unit/{unit}/{name}"]
            if name == opening:
                low, high = own.jnt_range[joint]
                joints["unit/opening"] = alone.qpos[own.jnt_qposadr[joint]]
                assert 0.2 - 1e-6 <= (joints["unit/opening"] - low) / (high - low) <= 0.9 + 1e-6
        assert {name: np.nan if q is None else q for name, q in layout["joints"].items()} == pytest.approx(
            joints, nan_ok=True
        )
        assert {name: arrays[f"joint/{name}"][i] for name in joints} == pytest.approx(joints, nan_ok=True)
        mujoco.mj_kinematics(own, alone)
        for other in OPENS:
            if other != unit:
                assert np.abs(data.body(f"unit/{other}").xpos[:2]).max() > 30.0
        for body in range(2, own.nbody):
            found = data.body(f"unit/{unit}/{own.body(body).name}")
            np.testing.assert_allclose(found.xpos, alone.xpos[body], atol=1e-6)
        seen.add(unit)
    assert seen == {*OPENS}


def test_all_formats_are_resumed_shared_and_verified(tmp_path: Path):
    """The same bytes in shares, and after files were lost; damage to any of them is told by name."""
    pytest.importorskip("pxr", reason="usd-core is not installed (extra 'import')")
    compiled, alone, shared = compile_on_cpu("mid"), tmp_path / "alone", tmp_path / "shared"
    assert write(compiled, alone, ALL)
    names = [f"layouts-{i:05}{end}" for i in range(3) for end in (".json", ".npy", ".npz", ".usdc", ".zip")]
    assert sorted(path.name for path in alone.iterdir()) == ["dataset.json", *names, "scene.usdc", "scene.zip"]
    for number in (1, 0):
        write(compiled, shared, ALL, Shard(number, 2))
    before = contents(alone)
    assert contents(shared) == before
    assert verify(shared)["formats"] == list(ALL)
    lost = ("scene.usdc", "layouts-00000.usdc", "layouts-00002.json")
    for name in lost:
        (alone / name).write_bytes(b"damaged")
    with pytest.raises(DatasetError, match=r"scene\.usdc, layouts-00000\.usdc, layouts-00002\.json are damaged"):
        verify(alone)
    for name in lost:
        (alone / name).unlink()
    write(compiled, alone, ALL, resume=True)
    assert contents(alone) == before
    with pytest.raises(DatasetError, match=r"formats = \['json', 'mjcf', 'npz', 'usd'\], not \['npz'\]"):
        write(compiled, alone, ("npz",), resume=True)
    assert len(LayoutDataset(alone)) == 40


def test_formats_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """In any order, once each; others are unknown, and one that needs a library says how to install it."""
    assert parse_formats("usd, npz,npz") == ("npz", "usd")
    with pytest.raises(UnknownNameError, match=r"--format: unknown format 'nzp'.*'npz'"):
        parse_formats("nzp")
    for nothing in ("", "npz,"):
        with pytest.raises(UnknownNameError, match="unknown format ''"):
            parse_formats(nothing)
    monkeypatch.setitem(__import__("sys").modules, "pxr", None)
    with pytest.raises(MissingExtraError, match=r"usd-core is not installed.*\.\[import\]"):
        check_formats(["usd"])
    compiled = compile_on_cpu("mid")
    with pytest.raises(MissingExtraError):
        DatasetWriter(compiled, DatasetPlan.of(compiled, 4, 0, "train", ("usd",)), tmp_path / "none", Shard())
    assert not (tmp_path / "none").exists()
