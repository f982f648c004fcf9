"""Furniture: units move freely, join into rows, have handles that a hand fits around, and are fixtures of scenes."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import sceniris_gym
from sceniris_gym import SceneConfig, errors
from sceniris_gym.builders.furniture import KINDS
from tests.assets.test_grasps import HELD, Hand
from tests.builders.unit_scenes import layouts_of, reach_of, words_of
from tests.builders.units import DEEPEST, bounds, deepest, is_handle, load, mixed, opened
from tests.versions import since_3_12

KIND = {name: i for i, name in enumerate(KINDS)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of 24 units, four of each kind."""
    folder = tmp_path_factory.mktemp("furniture")
    sceniris_gym.furniture(folder, n=24, seed=7)
    return folder


@pytest.fixture(scope="module")
def units(folder: Path) -> list[Path]:
    """The units in the order of their numbers."""
    return sorted(folder.glob("*.xml"), key=lambda path: path.stem[-4:])


def test_a_unit_depends_on_the_seed_and_its_number(folder: Path, tmp_path: Path):
    """Not on how many are written; a second run writes the same bytes, another seed others."""
    few = sceniris_gym.furniture(tmp_path / "few", n=8, seed=7)
    files = [path.relative_to(tmp_path / "few") for path in (tmp_path / "few").rglob("*") if path.is_file()]
    assert len(files) == 17
    first = {file: (tmp_path / "few" / file).read_bytes() for file in files}
    assert sceniris_gym.furniture(tmp_path / "few", n=8, seed=7) == few
    for file, text in first.items():
        assert (tmp_path / "few" / file).read_bytes() == text
        assert (folder / file).read_bytes() == text or file.parts == ("manifest.json",)
    sceniris_gym.furniture(tmp_path / "other", n=8, seed=8)
    for file in (file for file in files if file.suffix == ".xml"):
        assert (tmp_path / "other" / file).read_bytes() != first[file]


def test_the_manifest_names_what_the_files_have(folder: Path, units: list[Path]):
    """Joints with types and ranges, parts in the order of the files (fixed, hinges, slides), and the root's bounds."""
    manifest = sceniris_gym.furniture(folder, n=24, seed=7)
    assert [unit["file"] for unit in manifest["units"]] == [path.name for path in units]
    for unit, path in zip(manifest["units"], units, strict=True):
        model, data = load(path)
        assert unit["parts"] == [model.body(i).name for i in range(2, model.nbody)]
        joints = [model.joint(i) for i in range(model.njnt)]
        assert list(unit["joints"]) == [joint.name for joint in joints]
        for joint, told in zip(joints, unit["joints"].values(), strict=True):
            assert told["type"] == {2: "slide", 3: "hinge"}[int(joint.type[0])]
            assert told["range"] == joint.range.tolist()
        below = [unit["joints"].get(part, {"type": ""})["type"] for part in unit["parts"] if "_handle" not in part]
        assert below == sorted(below)  # "" of fixed parts, "hinge", "slide"
        root = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 1]
        np.testing.assert_allclose(np.diff(bounds(model, data, root), axis=0)[0], unit["size"], atol=1e-9)


def test_a_unit_has_only_limited_joints_right_below_its_root(units: list[Path]):
    """Named by their parts, without anything that couples or drives them."""
    for path in units:
        model, _ = load(path)
        assert model.body_parentid[2:].tolist() == [1] * (model.nbody - 2)
        assert model.jnt_limited.all()
        assert all(model.body(model.jnt_bodyid[i]).name == model.joint(i).name for i in range(model.njnt))
        assert (model.jnt_range[:, 0] == 0.0).all()
        assert not (model.neq, model.ntendon, model.nu, model.nsensor, model.nmesh, model.nkey) > (0,) * 6


def test_handles_of_doors_turn(folder: Path, units: list[Path], tmp_path: Path):
    """The units differ in nothing else: each door has a handle on a hinge, at its bar, that no other part touches."""
    manifest = sceniris_gym.furniture(tmp_path / "turning", n=24, seed=7, turning=True)
    found = 0
    for path, unit in zip(units, manifest["units"], strict=True):
        (model, data), (before, _) = load(tmp_path / "turning" / path.name), load(path)
        fronts = [before.joint(i) for i in range(before.njnt)]
        doors = [joint.name for joint in fronts if joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE and joint.name != "lid"]
        joints = {model.joint(i).name: model.joint(i) for i in range(model.njnt)}
        assert {*joints} == {joint.name for joint in fronts} | {f"{door}_handle" for door in doors}
        assert (model.body(1).mass, unit["size"]) == (before.body(1).mass, pytest.approx(unit["size"]))
        for door in doors:
            handle = joints[f"{door}_handle"]
            assert model.body(model.body(handle.bodyid[0]).parentid[0]).name == door
            np.testing.assert_allclose(data.xanchor[handle.id], data.geom(f"{door}_handle_bar").xpos, atol=0.05)
            np.testing.assert_allclose(np.abs(data.xaxis[handle.id]), [0.0, 1.0, 0.0], atol=1e-9)
            spec = mujoco.MjSpec.from_file(str(tmp_path / "turning" / path.name))
            for other in doors:
                spec.add_exclude(bodyname1=other, bodyname2=f"{other}_handle")
            apart, where = deepest(turned := spec.compile(), opened(turned))
            assert apart > DEEPEST, f"{path.stem}: {where}"
            found += 1
    assert found > 12


def test_masses_are_those_of_furniture(units: list[Path]):
    """A front with its box weighs a few kilograms, a unit what two people carry."""
    for path in units:
        model, _ = load(path)
        assert 5.0 < model.body_mass.sum() < 300.0
        moving = model.jnt_bodyid
        assert (model.body_mass[moving] > 0.5).all() and (model.body_mass[moving] < 15.0).all()
        radius = np.sqrt(model.body_inertia[moving] / model.body_mass[moving, None])
        assert (radius > 0.02).all() and (radius < 0.6).all()


def test_parts_move_through_their_range_without_touching(units: list[Path]):
    """In no step of any joint is a geom of one part 0.1 mm inside of another part, or of the root.

    In base units and wall units all parts may be open at once. Open doors of a counter may meet at their handles.
    """
    for path in units:
        apart, where = deepest(model := load(path)[0], opened(model))
        assert apart > DEEPEST, f"{path.stem}: {where}"
        if not path.stem.startswith("counter"):
            apart, where = deepest(model, mixed(model))
            assert apart > DEEPEST, f"{path.stem}: {where}"


def test_the_judge_finds_a_part_that_touches(units: list[Path]):
    """A drawer that is 2 cm wider on each side is inside of the walls."""
    spec = mujoco.MjSpec.from_file(str(units[0]))
    spec.geom("front_0_floor").size[0] += 0.02
    model = spec.compile()
    apart, where = deepest(model, opened(model))
    assert apart < 10 * DEEPEST
    assert "front_0_floor" in where


@since_3_12("boxes 5 mm apart have the distance 0")
def test_units_join_into_a_row(units: list[Path]):
    """Closed, only handles leave the root's bounds; drawers and doors pass those of neighbours 4 mm apart."""
    for path in units:
        model, data = load(path)
        root = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 1]
        low, high = bounds(model, data, root)
        body = bounds(model, data, [geom for geom in range(model.ngeom) if not is_handle(model, geom)])
        np.testing.assert_allclose(body, [low, high], atol=1e-9)
        assert low[2] == pytest.approx(0.0, abs=1e-9)
        np.testing.assert_allclose(low[:2] + high[:2], 0.0, atol=1e-9)
        if not path.stem.startswith("wall"):
            assert high[2] == pytest.approx(0.9)
            assert high[1] - low[1] == pytest.approx(0.6)
        spec = mujoco.MjSpec.from_file(str(path))
        for side in (-1, 1):
            middle = (low + high) / 2 + [side * (high[0] - low[0] + 0.004), 0, 0]
            spec.worldbody.add_geom(
                name=f"next{side}", type=mujoco.mjtGeom.mjGEOM_BOX, size=(high - low) / 2, pos=middle
            )
        row = spec.compile()
        data, beside = mujoco.MjData(row), [row.geom("next-1").id, row.geom("next1").id]
        moving = [geom for geom in range(row.ngeom) if row.geom_bodyid[geom] > 1]
        for data.qpos[:] in opened(row):
            mujoco.mj_kinematics(row, data)
            apart = [mujoco.mj_geomDistance(row, data, a, b, 0.01, None) for a in beside for b in moving]
            assert min(apart, default=1.0) > 0.001, path.stem


def test_parts_stay_where_they_are_put(units: list[Path]):
    """Half open, nothing moves by 1 mm, or by 1 mrad, within a second: lids and flaps are balanced."""
    for path in units:
        model, data = load(path)
        data.qpos[:] = model.jnt_range[:, 1] / 2
        before = data.qpos.copy()
        mujoco.mj_step(model, data, nstep=500)
        np.testing.assert_allclose(data.qpos, before, atol=1e-3, err_msg=path.stem)


def test_the_hand_fits_around_every_handle(units: list[Path], tmp_path: Path):
    """The Panda's open hand touches nothing before the shut front; closed, both fingers touch the handle."""
    for path in units[:6]:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.body(path.stem).pos[2] = 1.0  # where a wall unit is
        (tmp_path / path.name).write_text(spec.to_xml())
        sites = [site.name for site in spec.sites if site.name.startswith("grasp_")]
        assert len(sites) >= 2 * len(spec.joints)
        for site in sites:
            hand = Hand("panda", str(tmp_path / path.stem), site)
            assert not any("hand" in touch or "finger" in touch for touch in hand.touches()), (path.stem, site)
            if site.endswith("_0"):
                hand.close()
                assert {t for t in hand.touches() if "hand" in t or "finger" in t} == HELD, (path.stem, site)


@pytest.mark.parametrize("kind", KINDS)
def test_a_unit_is_a_fixture_of_a_scene(kind: str, units: list[Path]):
    """Without a warning, with drawn joints, and with things on it, in each of its parts and behind its doors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        layouts = layouts_of(words_of(units[KIND[kind]]), 16)
    assert layouts.status.numpy().tolist() == [1] * 16


@pytest.mark.parametrize("kind", ["base_drawers", "base_lid", "wall"])
def test_an_arm_reaches_the_handle(kind: str, units: list[Path]):
    """The Panda grasps the handle of the shut front, with the arm free of collisions there and before it."""
    layouts = layouts_of(reach_of(units[KIND[kind]]), 8)
    assert layouts.status.numpy().tolist() == [1] * 8


def test_tags_select_units(folder: Path):
    """The folder is used as those that `import` writes; files with joints are variants of nothing yet."""
    words: dict[str, Any] = {"asset": str(folder / "base_*.xml"), "tags": ["shelves"], "kind": "fixture", "on": "floor"}
    config = SceneConfig.load({"floor": {"size": [3, 3]}, "objects": {"unit": words}})
    assert len(config.objects) == 4


def test_numbers_out_of_range_are_refused(tmp_path: Path):
    """And a folder with other units, whose names a pattern would find too."""
    with pytest.raises(errors.ArgumentError, match="n should be from 1 to 10000, got 0"):
        sceniris_gym.furniture(tmp_path, n=0)
    with pytest.raises(errors.ArgumentError, match="height should be from"):
        sceniris_gym.furniture(tmp_path, height=3.0)
    wrong: list[tuple[dict[str, Any], str]] = [({"n": 2.5}, "n should be an integer"), ({"num": 6}, "argument 'num'")]
    for words, told in wrong:
        with pytest.raises(errors.ArgumentTypeError, match=told):
            sceniris_gym.furniture(tmp_path, **words)
    sceniris_gym.furniture(tmp_path, n=12)
    with pytest.raises(errors.ArgumentError, match="has other files, such as base_doors_0007"):
        sceniris_gym.furniture(tmp_path, n=6)
