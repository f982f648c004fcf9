"""mjlab's entities with variants: a reset brings others, and each world is the one that mjlab would have made of them.

mjlab needs MuJoCo 3.11, so this runs in a venv of its own: `make test-mjlab`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentError, NotSupportedError, SceneMismatchError, UnknownNameError

pytest.importorskip("mjlab", reason="needs mjlab: make test-mjlab")
from mjlab.entity import EntityCfg, VariantEntityCfg
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg
from mjlab.envs.mdp import dr
from mjlab.managers.event_manager import EventTermCfg
from mjlab.managers.scene_entity_config import SceneEntityCfg
from mjlab.scene import Scene, SceneCfg
from mjlab.terrains import TerrainEntityCfg
from mjlab.utils.spec_config import CollisionCfg

from sceniris_gym.adapters.mjlab import PlaceLayoutsCfg, RedrawObjectsCfg

PAGE = Path(__file__).parents[3] / "docs" / "mjlab.md"
NUM_ENVS = 6
NEAR = {"box": [[0.2, -0.15], [0.5, 0.15]]}
BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
WEDGE = np.array([[x, y, -1.0] for x in (-1, 1) for y in (-1, 1)] + [[0.0, y, 1.5] for y in (-1, 1)])
CABINET = """
<mujoco><worldbody><body name="case" pos="0.3 -0.6 0"><geom name="top" type="box" size=".1 .1 .05" pos="0 0 .06"/>
  <body name="drawer" pos="0 0 .15"><joint name="slide" type="slide" axis="1 0 0" range="0 .1"/>
    <geom name="tray" type="box" size=".05 .05 .01"/></body></body></worldbody></mujoco>
"""


def thing(vertices: np.ndarray, scale: float, *, head: bool = False, knob: float = 0.0) -> Callable[[], mujoco.MjSpec]:
    """Return the function that makes a thing: a mesh, perhaps a smaller one above, and perhaps a ball on it."""

    def spec() -> mujoco.MjSpec:
        made = mujoco.MjSpec()
        made.add_mesh(name="hull", uservert=(scale * vertices).ravel())
        root = made.worldbody.add_body(name="root")
        root.add_freejoint()
        root.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hull")
        if head:
            made.add_mesh(name="head", uservert=(0.5 * scale * BOX).ravel())
            root.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="head", pos=[0.3 * scale, 0.0, 1.4 * scale])
        if knob:
            root.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[knob, 0, 0], pos=[0.0, 0.0, 2.0 * knob], margin=knob)
        return made

    return spec


THINGS = {"brick": thing(BOX, 0.02), "wedge": thing(WEDGE, 0.03, head=True), "chip": thing(WEDGE, 0.008)}
SMALL = {"die": thing(BOX, 0.01), "roof": thing(WEDGE, 0.012)}


def cabinet() -> EntityCfg:
    """Return an entity whose joint is drawn, and which is between entities with variants in qpos."""
    return EntityCfg(spec_fn=lambda: mujoco.MjSpec.from_string(CABINET))


def cfg_of(scene: dict[str, Any] | None, **entities: Any) -> ManagerBasedRlEnvCfg:
    """Return the cfg of an environment with entities, and with layouts of a scene."""
    scene_cfg = SceneCfg(
        num_envs=NUM_ENVS, env_spacing=3.0, terrain=TerrainEntityCfg(terrain_type="plane"), entities=entities
    )
    cfg = ManagerBasedRlEnvCfg(decimation=1, scene=scene_cfg, seed=5)
    if scene is not None:
        cfg.events["layouts"] = PlaceLayoutsCfg(scene=scene)
    return cfg


def two_slots(layouts: bool = True, **assignments: Any) -> ManagerBasedRlEnvCfg:
    """Return the cfg of an environment with two entities that have variants, and a cabinet between them."""
    place = {"on": "terrain", "region": NEAR}
    drawn = {"roof": {"weight": 3}, "die": {}}  # in another order than in the entity
    fixed = {"kind": "static", "joints": {"slide": {"range": [0.02, 0.08]}}}
    scene = {"objects": {"thing": place, "cabinet": fixed, "small": {**place, "variants": drawn}}, "bank": 4}
    slots = {"thing": THINGS, "small": SMALL}
    made = {name: VariantEntityCfg(variants=of, assignment=assignments.get(name)) for name, of in slots.items()}
    return cfg_of(scene if layouts else None, thing=made["thing"], cabinet=cabinet(), small=made["small"])


def arrays_of(env: ManagerBasedRlEnv) -> dict[str, np.ndarray]:
    """Return copies of all arrays of the environment's Model."""
    model = env.sim.wp_model
    held = {field.name: getattr(model, field.name) for field in fields(model)}
    return {name: array.numpy().copy() for name, array in held.items() if isinstance(array, wp.array)}


def test_a_reset_writes_the_model_that_mjlab_makes_of_its_variants():
    """All arrays of the Model, and the defaults of `dr`, to the bit, in three resets; every variant comes up."""
    env, seen = ManagerBasedRlEnv(two_slots(), "cpu"), {"thing": set(), "small": set()}
    for _ in range(3):
        env.reset()
        chosen = {name: variant.tolist() for name, variant in env.sim.world_to_variant.items()}
        for name, variants in chosen.items():
            seen[name] |= set(variants)
        assigned = {name: lambda _, variants=variants: variants for name, variants in chosen.items()}
        other = ManagerBasedRlEnv(two_slots(layouts=False, **assigned), "cpu")
        ours, theirs = arrays_of(env), arrays_of(other)
        assert len(ours) > 100
        for name, array in theirs.items():
            np.testing.assert_array_equal(ours[name], array, err_msg=name)
        assert env.sim.per_world_default_fields == other.sim.per_world_default_fields
        for name, default in other.sim.default_model_fields.items():
            assert torch.equal(env.sim.default_model_fields[name], default), name
        other.close()
    assert seen == {"thing": {0, 1, 2}, "small": {0, 1}}
    env.close()


def test_layouts_fit_the_variants_that_are_there():
    """Judged by MuJoCo C on a scene of mjlab of these things alone: nothing overlaps, and all rest on the plane."""
    env = ManagerBasedRlEnv(two_slots(), "cpu")
    slots, models = {"thing": THINGS, "small": SMALL}, {}
    for _ in range(4):
        env.reset()
        origins, qpos = env.scene.env_origins.numpy(), env.sim.data.qpos[:].numpy()
        for world in range(NUM_ENVS):
            key = tuple(list(of)[env.sim.world_to_variant[name][world]] for name, of in slots.items())
            if key not in models:
                one = [EntityCfg(spec_fn=of[name]) for name, of in zip(key, slots.values(), strict=True)]
                entities = {"thing": one[0], "cabinet": cabinet(), "small": one[1]}
                models[key] = Scene(cfg_of(None, **entities).scene, "cpu").compile()
            mjm = models[key]
            data = mujoco.MjData(mjm)
            data.qpos[:] = qpos[world]
            slide = mjm.joint("cabinet/slide").qposadr[0]
            assert 0.02 <= data.qpos[slide] <= 0.08
            data.mocap_pos[:] = env.sim.data.mocap_pos[world].numpy()
            mjm.geom_margin[:] = 0.002
            mujoco.mj_fwdPosition(mjm, data)
            at = data.body("thing/root").xpos - origins[world]
            assert 0.15 < at[0] < 0.55
            assert abs(at[1]) < 0.2
            pairs = {frozenset(mjm.body(mjm.geom_bodyid[g]).name for g in c.geom): c.dist for c in data.contact}
            assert all(dist >= 0.0 for dist in pairs.values())
            assert {frozenset((f"{name}/root", "terrain")) for name in slots} <= set(pairs)
    assert len(models) > 3
    env.close()


def test_an_entity_with_variants_may_be_absent():
    """And another one with it; both are parked then, far from the origin of their environment."""
    cfg = two_slots()
    scene = cfg.events["layouts"].scene
    scene["groups"] = {"some": {"of": ["thing"], "count": [0, 1]}}
    scene["objects"]["thing"] = {**scene["objects"]["thing"], "variants": {key: {} for key in THINGS}}
    scene["objects"]["small"] = {**scene["objects"]["small"], "if": "thing"}
    env, seen = ManagerBasedRlEnv(cfg, "cpu"), []
    for _ in range(4):
        env.reset()
        places = [env.scene[name].data.root_link_pos_w - env.scene.env_origins for name in ("thing", "small")]
        near = torch.stack(places)[..., 0].abs() < 1.0
        assert torch.equal(near[0], near[1])
        layouts = env.event_manager.get_term_cfg("layouts").func.layouts
        there = {name: layouts.present[:, i] for i, name in enumerate(layouts.compiled.slots)}
        for row, name in enumerate(("thing", "small")):
            members = [column for slot, column in there.items() if slot.startswith(f"{name}/")]
            assert torch.equal(torch.stack(members).sum(dim=0) == 1, near[row])
        seen += near[0].tolist()
    assert 0 < sum(seen) < len(seen)
    env.close()


def test_environments_that_are_not_reset_keep_every_bit():
    """Of their state, their variants and their model."""
    env = ManagerBasedRlEnv(two_slots(), "cpu")
    env.reset()
    qpos, arrays = env.sim.data.qpos[:].clone(), arrays_of(env)
    variants = {name: variant.clone() for name, variant in env.sim.world_to_variant.items()}
    changed = False
    for _ in range(3):
        env.reset(env_ids=torch.tensor([4, 1]))
        changed |= any((env.sim.world_to_variant[name] != before).any() for name, before in variants.items())
    assert changed
    kept = [0, 2, 3, 5]
    assert torch.equal(env.sim.data.qpos[kept], qpos[kept])
    assert all(torch.equal(env.sim.world_to_variant[name][kept], before[kept]) for name, before in variants.items())
    for name, array in arrays_of(env).items():
        per_world = array.shape[:1] == (NUM_ENVS,)
        np.testing.assert_array_equal(
            array[kept] if per_world else array, arrays[name][kept] if per_world else arrays[name]
        )
    env.close()


def test_layouts_know_the_primitives_that_all_worlds_have():
    """In mjlab all variants have the primitives of the first one, and its contacts."""
    variants = {"large": thing(BOX, 0.01, knob=0.015), "less": thing(WEDGE, 0.01, knob=0.005)}
    scene = {"objects": {"thing": {"on": "terrain", "region": NEAR}}, "bank": 4}
    rough = CollisionCfg((".*",), contype=1, conaffinity=1, condim=3, priority=0, friction=(0.7,))
    env = ManagerBasedRlEnv(cfg_of(scene, thing=VariantEntityCfg(variants=variants, collisions=(rough,))), "cpu")
    mjm = env.event_manager.get_term_cfg("layouts").func.compiled.mjm
    assert mjm.body("thing/root").geomnum == 0
    for name in variants:
        body = mjm.body(f"thing/{name}").id
        ball = np.flatnonzero((mjm.geom_bodyid == body) & (mjm.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE))[0]
        assert mjm.geom_size[ball, 0] == mjm.geom_margin[ball] == 0.015
        assert mjm.geom_pos[ball, 2] == 0.03
        assert (mjm.geom_friction[mjm.geom_bodyid == body, 0] == 0.7).all()
    env.close()


def test_masses_that_events_draw_are_those_of_the_variant():
    """An event after the layouts scales what the variant has; one at startup would be lost, and is refused."""
    params = {"ranges": (2.0, 2.0), "operation": "scale", "asset_cfg": SceneEntityCfg("thing")}
    scene = {"objects": {"thing": {"on": "terrain", "region": NEAR}}, "bank": 4}
    cfg = cfg_of(scene, thing=VariantEntityCfg(variants=THINGS))
    cfg.events["mass"] = EventTermCfg(func=dr.body_mass, mode="reset", params=params)
    env = ManagerBasedRlEnv(cfg, "cpu")
    body = env.scene["thing"].indexing.root_body_id
    masses = torch.tensor([spec().compile().body_mass[1] for spec in THINGS.values()], dtype=torch.float32)
    for _ in range(2):
        env.reset()
        assert torch.equal(env.sim.model.body_mass[:, body], 2.0 * masses[env.sim.world_to_variant["thing"]])
    env.close()
    cfg.events["mass"] = EventTermCfg(func=dr.body_mass, mode="startup", params=params)
    env = ManagerBasedRlEnv(cfg, "cpu")
    with pytest.raises(SceneMismatchError, match=r"not change model\.body_mass of the entity 'thing'"):
        env.reset()
    env.close()


def test_what_cannot_be_redrawn_is_refused_by_name():
    """A variant that the entity lacks, things of several bodies, and redraws between resets."""
    place = {"on": "terrain", "region": NEAR}
    entity = VariantEntityCfg(variants=THINGS)
    scene = {"objects": {"thing": {**place, "variants": {"brick": {}, "wedgy": {}}}}, "bank": 4}
    with pytest.raises(UnknownNameError, match=r"objects\.thing/wedgy: .*Did you mean 'thing/wedge'"):
        ManagerBasedRlEnv(cfg_of(scene, thing=entity), "cpu")

    def lamp() -> mujoco.MjSpec:
        made = THINGS["brick"]()
        made.body("root").add_body(name="shade").add_geom(size=[0.01, 0, 0], pos=[0.0, 0.0, 0.05])
        return made

    scene = {"objects": {"thing": place}, "bank": 4}
    with pytest.raises(NotSupportedError, match=r"objects\.thing/lamp: has several bodies"):
        ManagerBasedRlEnv(cfg_of(scene, thing=VariantEntityCfg(variants={"lamp": lamp})), "cpu")
    cfg = cfg_of(scene, thing=entity)
    # pyrefly: ignore[unexpected-keyword]
    cfg.commands["moved"] = RedrawObjectsCfg(objects=("thing",), resampling_time_range=(1.0, 2.0))
    with pytest.raises(ArgumentError, match=r"RedrawObjects: .*whose scene has no variants"):
        ManagerBasedRlEnv(cfg, "cpu")


def test_the_program_of_the_page_runs():
    """As it stands; the bricks stand at half their heights."""
    programs = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec(compile(next(text for text in programs if "VariantEntityCfg" in text), "mjlab.md", "exec"), names)
    env = names["env"]
    heights = torch.tensor([0.01, 0.04])[env.sim.world_to_variant["thing"]]
    np.testing.assert_allclose(env.scene["thing"].data.root_link_pos_w[:, 2], heights, atol=0.001)
    env.close()
