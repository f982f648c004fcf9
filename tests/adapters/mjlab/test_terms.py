"""mjlab's environments with `PlaceLayouts`: nothing overlaps at a start, and what places again is noticed.

mjlab needs MuJoCo 3.11, so this runs in a venv of its own: `make test-mjlab`.
"""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.errors import ArgumentError, NotSupportedError, SceneKeyError, SceneMismatchError, UnknownNameError

pytest.importorskip("mjlab", reason="needs mjlab: make test-mjlab")
from mjlab.entity import EntityCfg
from mjlab.envs import ManagerBasedRlEnv, ManagerBasedRlEnvCfg, mdp
from mjlab.envs.mdp import dr
from mjlab.managers.curriculum_manager import CurriculumTermCfg
from mjlab.managers.event_manager import EventTermCfg
from mjlab.managers.scene_entity_config import SceneEntityCfg
from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
from mjlab.scene import SceneCfg
from mjlab.tasks.manipulation.config.yam.env_cfgs import (
    get_cube_spec,
    yam_multi_cube_seg_env_cfg,
)
from mjlab.tasks.manipulation.config.yam.rl_cfg import (
    yam_multi_cube_seg_ppo_runner_cfg,
)
from mjlab.terrains import TerrainEntityCfg

from sceniris_gym.adapters.mjlab import PlaceLayoutsCfg, keep_layouts, scene_param_stages

PAGE = Path(__file__).parents[3] / "docs" / "mjlab.md"
NEAR = {"box": [[0.25, -0.15], [0.40, 0.15]]}
NUM_ENVS = 6
CABINET = """
<mujoco><worldbody><body name="case" pos="0 0 0"><geom name="top" type="box" size=".2 .2 .1" pos="0 0 .1"/>
  <body name="drawer" pos="0 0 .25"><joint name="slide" type="slide" axis="1 0 0" range="0 .2"/>
    <geom name="tray" type="box" size=".1 .1 .01"/></body></body></worldbody></mujoco>
"""


def cubes_on(support: str = "terrain", count: int = 2, **words: Any) -> dict[str, Any]:
    """Return a scene with cubes, which are entities of these names."""
    return {"objects": {f"cube_{i}": {"on": support, "region": NEAR, **words} for i in range(count)}, "bank": 4}


def plain_cfg(scene: dict[str, Any], **entities: EntityCfg) -> ManagerBasedRlEnvCfg:
    """Return the cfg of an environment of two cubes and other entities, without a task."""
    cubes = {f"cube_{i}": EntityCfg(spec_fn=get_cube_spec) for i in range(2)}
    scene_cfg = SceneCfg(
        num_envs=NUM_ENVS, env_spacing=3.0, terrain=TerrainEntityCfg(terrain_type="plane"), entities=cubes | entities
    )
    cfg = ManagerBasedRlEnvCfg(decimation=1, scene=scene_cfg, seed=5)
    cfg.events["layouts"] = PlaceLayoutsCfg(scene=scene)
    return cfg


def lifting_cfg(cubes: int, *, kept: bool = True) -> ManagerBasedRlEnvCfg:
    """Return the cfg of mjlab's task with several cubes, with their layouts."""
    cfg = yam_multi_cube_seg_env_cfg(num_cubes=cubes)
    cfg.scene.num_envs, cfg.seed = NUM_ENVS, 0
    cfg.events["layouts"] = PlaceLayoutsCfg(scene=cubes_on(count=cubes))
    if kept:
        cfg.commands["lift_height"] = keep_layouts(cfg.commands["lift_height"])
    return cfg


def deepest(env: ManagerBasedRlEnv) -> float:
    """Return the deepest contact [m] of a cube in any environment, by MuJoCo C."""
    mjm = env.sim.mj_model
    data, worst = mujoco.MjData(mjm), 0.0
    state = {name: getattr(env.sim.wp_data, name).numpy() for name in ("qpos", "mocap_pos", "mocap_quat")}
    for world in range(env.num_envs):
        for name, values in state.items():
            getattr(data, name)[:] = values[world]
        mujoco.mj_fwdPosition(mjm, data)
        for contact in data.contact:
            if any("cube" in mjm.body(mjm.geom_bodyid[geom]).name for geom in contact.geom):
                worst = max(worst, -contact.dist)
    return worst


def local(env: ManagerBasedRlEnv, entity: str) -> np.ndarray:
    """Return where a free entity is in each environment, relative to its origin [m]."""
    adr = env.scene[entity].indexing.free_joint_q_adr[:3]
    return (env.sim.data.qpos[:, adr] - env.scene.env_origins).cpu().numpy()


def test_episodes_start_with_the_fingers_around_a_cube():
    """The event writes the arm and the fingers, and tells the kind; in the other worlds the arm is at home."""
    cfg, scene = lifting_cfg(1), cubes_on(count=1, reachable="ik")
    scene["robot"] = {"in_model": "robot/arm", "tcp": {"site": "robot/grasp_site"}}
    scene["start"] = [{"weight": 1}, {"robot": "grasp", "of": "cube_0"}]
    cfg.events["layouts"] = PlaceLayoutsCfg(scene=scene)
    cfg.scene.num_envs = 12
    env = ManagerBasedRlEnv(cfg, device="cpu")
    env.reset()
    term = env.event_manager.get_term_cfg("layouts").func
    kinds, layouts = env.extras["layout"]["start"].numpy(), term.layouts.qpos.cpu().numpy()
    assert set(kinds) == {0, 1}
    mjm = env.sim.mj_model
    arm = [mjm.joint(f"robot/joint{i}").qposadr[0] for i in range(1, 7)]
    fingers = [mjm.joint(f"robot/{side}_finger").qposadr[0] for side in ("left", "right")]
    qpos = env.sim.data.qpos.numpy()
    np.testing.assert_array_equal(qpos[:, arm + fingers], layouts[:, arm + fingers])
    assert np.ptp(qpos[kinds == 0][:, arm], axis=0).max() == 0.0
    assert np.ptp(qpos[kinds == 1][:, arm], axis=0).max() > 0.1
    env.close()


def test_variants_that_no_entity_has_are_refused():
    """The model has one body for them only if the entity has them; the error says what redraws others."""
    variants = {"can": {"asset": "can"}, "mug": {"asset": "mug"}}
    scene = {"objects": {"cube_0": {"on": "terrain", "region": NEAR, "variants": variants}}, "bank": 4}
    group = r"groups: {cube_0: {of: \[can, mug\], count: 1}}\. Call edit_spec\(spec, scene\)"
    with pytest.raises(NotSupportedError, match=rf"objects\.cube_0: has variants.*VariantEntityCfg.*{group}"):
        ManagerBasedRlEnv(plain_cfg(scene), "cpu")


def test_a_group_of_entities_is_another_thing_at_every_reset():
    """One of them is in the region, and the other is parked on the plane."""
    scene = cubes_on() | {"groups": {"thing": {"of": ["cube_0", "cube_1"], "count": 1}}}
    env = ManagerBasedRlEnv(plain_cfg(scene), "cpu")
    layouts, found = env.event_manager.get_term_cfg("layouts").func.layouts, []
    for _ in range(3):
        env.reset()
        poses = [env.scene[name].data.root_link_pos_w - env.scene.env_origins for name in scene["objects"]]
        found.append(np.stack(poses, axis=1)[..., 0] < 1.0)
        np.testing.assert_array_equal(found[-1], layouts.present.cpu().numpy()[:, :2] == 1)
        assert (found[-1].sum(axis=1) == 1).all()
    assert (found[0] != found[1]).any()
    assert deepest(env) == 0.0
    env.close()


def test_entities_are_absent_with_their_conditions():
    """One cube on another that may be absent is absent with it, and a third is there only with it: all parked apart."""
    scene = cubes_on(count=3) | {"groups": {"some": {"of": ["cube_0"], "count": [0, 1]}}}
    scene["objects"]["cube_1"] = {"on": "cube_0"}
    scene["objects"]["cube_2"]["if"] = "cube_0"
    env = ManagerBasedRlEnv(plain_cfg(scene, cube_2=EntityCfg(spec_fn=get_cube_spec)), "cpu")
    seen = []
    for _ in range(3):
        env.reset()
        poses = np.stack([local(env, name) for name in scene["objects"]])
        near = np.abs(poses[..., 0]) < 1.0
        assert (near == near[0]).all()
        np.testing.assert_allclose(poses[1, near[0], 2] - poses[0, near[0], 2], 0.04, atol=2e-3)
        seen += near[0].tolist()
        assert deepest(env) == 0.0
    assert 0 < sum(seen) < len(seen)
    env.close()


def test_several_supports_are_refused():
    """An entity has one body, so the object should have one support; also on an object with variants."""
    case = EntityCfg(spec_fn=lambda: mujoco.MjSpec.from_string(CABINET))
    for words in ({"on": ["terrain", "case"]}, {"on": ["terrain", "case"], "asset": "block"}):
        scene = {"objects": {"cube_0": words, "cube_1": {"on": "terrain"}}, "bank": 2}
        with pytest.raises(NotSupportedError, match=r"objects\.cube_0: has several supports.*Name one support"):
            ManagerBasedRlEnv(plain_cfg(scene, case=case), "cpu")


def test_entities_start_apart_at_their_origins():
    """Two cubes on a small part of the plane, in environments three metres apart; at rest."""
    env = ManagerBasedRlEnv(plain_cfg(cubes_on()), "cpu")
    _, extras = env.reset()
    assert deepest(env) == 0.0
    places = np.stack([local(env, f"cube_{i}") for i in range(2)])
    assert (places[..., 0] >= 0.25).all() and (places[..., 0] <= 0.40).all() and (np.abs(places[..., 1]) <= 0.15).all()
    np.testing.assert_allclose(places[..., 2], 0.0205, atol=1e-6)
    assert len(np.unique(env.scene.env_origins.numpy(), axis=0)) == NUM_ENVS
    assert not np.any(env.sim.data.qvel[:].numpy())
    assert extras["layout"]["seed"].tolist() == list(range(5, 5 + NUM_ENVS))  # from the seed of the environment on
    assert extras["layout"]["seed"].dtype == extras["layout"]["episode"].dtype == torch.int64
    assert extras["layout"]["episode"].tolist() == [0] * NUM_ENVS
    assert not extras["layout"]["fallback"].any()
    assert float(extras["log"]["Layouts/fallback_rate"]) == 0.0


def test_only_environments_that_are_reset_get_a_new_layout():
    """By their numbers in any order; the others keep their bits."""
    env = ManagerBasedRlEnv(plain_cfg(cubes_on()), "cpu")
    env.reset()
    before = env.sim.data.qpos[:].clone()
    _, extras = env.reset(env_ids=torch.tensor([4, 1]))
    changed = (env.sim.data.qpos[:] != before).any(dim=1)
    assert changed.tolist() == [i in (1, 4) for i in range(NUM_ENVS)]
    assert extras["layout"]["episode"].tolist() == [int(i in (1, 4)) for i in range(NUM_ENVS)]
    assert deepest(env) == 0.0


def test_layouts_made_ahead_are_those_made_in_place():
    """Reset after reset, with a curriculum that sets a param in each."""
    found, name = [], "objects.cube_0.region"
    for prefetch in (False, True):
        cfg = plain_cfg(cubes_on())
        cfg.events["layouts"] = PlaceLayoutsCfg(scene=cubes_on(), prefetch=prefetch, scene_params=[name])
        stages = [{"step": 0, "params": {name: [[0.3, -0.1], [0.4, 0.1]]}}]
        cfg.curriculum["param"] = CurriculumTermCfg(func=scene_param_stages, params={"param_stages": stages})
        env = ManagerBasedRlEnv(cfg, device="cpu")
        for step in range(4):
            env.reset(env_ids=torch.arange(NUM_ENVS)[:: step + 1])
            found.append(env.sim.data.qpos.clone())
        env.close()
    assert all(torch.equal(plain, ahead) for plain, ahead in zip(found[:4], found[4:], strict=True))


def test_words_of_randomize_are_refused():
    """By the name of the first, as nothing draws them here."""
    scene = cubes_on(randomize={"mass": {"scale": [0.5, 2.0]}})
    with pytest.raises(NotSupportedError, match=r"PlaceLayouts: .* has 'randomize' \(cube_0\.mass\), .* mjlab's `dr`"):
        ManagerBasedRlEnv(plain_cfg(scene), device="cpu")


def test_the_same_seed_gives_the_same_layouts_and_another_split_others():
    """Whatever torch's random numbers are, as layouts have their own."""
    found = []
    for split in ("train", "train", "eval"):
        cfg = plain_cfg(cubes_on())
        cfg.events["layouts"] = PlaceLayoutsCfg(scene=cubes_on(), seed=3, split=split)
        env = ManagerBasedRlEnv(cfg, "cpu")
        env.reset()
        found.append(env.sim.data.qpos[:].numpy().copy())
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


def test_chosen_environments_get_the_layouts_of_ids():
    """At their next reset, and go on from there; what `extras` tells until then is of the present layouts."""
    env = ManagerBasedRlEnv(plain_cfg(cubes_on()), "cpu")
    env.reset()
    term = env.event_manager.get_term_cfg("layouts").func
    env.reset(env_ids=torch.arange(NUM_ENVS))
    wanted = term.layouts.pose("cube_0")[2].clone()
    term.reseed(layouts=[term.compiled.layout_id(7, 1), term.compiled.layout_id(7, 0)], env_ids=[4, 0])
    env.reset(env_ids=torch.tensor([1]))
    assert env.extras["layout"]["seed"].tolist() == [5, 6, 7, 8, 9, 10]
    env.reset(env_ids=torch.tensor([0, 4]))
    assert env.extras["layout"]["seed"].tolist() == [7, 6, 7, 8, 7, 10]
    assert env.extras["layout"]["episode"].tolist() == [0, 2, 1, 1, 1, 1]
    assert torch.equal(term.layouts.pose("cube_0")[4], wanted)
    with pytest.raises(ArgumentError, match="or a list of 6, one for each world, got a list of 1"):
        term.reseed(layouts=[term.compiled.layout_id(7, 1)])
    with pytest.raises(SceneMismatchError, match="belongs to scene"):
        term.reseed(layouts=["a:train:0:0"], env_ids=[1])


def test_a_later_choice_replaces_an_earlier_one():
    """In the environments that it names, also by None, which is the next layout. The others keep the earlier one."""
    env = ManagerBasedRlEnv(plain_cfg(cubes_on()), "cpu")
    env.reset()
    term = env.event_manager.get_term_cfg("layouts").func
    term.reseed(layouts=term.compiled.layout_id(70, 4))
    term.reseed(layouts=[None, term.compiled.layout_id(80, 2)], env_ids=[1, 2])
    term.reseed(layouts={"seed": [90, 91], "episode": 3}, env_ids=slice(4, 6))
    for env_ids in ([0, 1, 2], [3, 4, 5], [0, 5]):
        env.reset(env_ids=torch.tensor(env_ids))
    assert env.extras["layout"]["seed"].tolist() == [70, 6, 80, 70, 90, 91]
    assert env.extras["layout"]["episode"].tolist() == [5, 1, 2, 4, 3, 4]


def test_a_curriculum_sets_a_param_by_steps():
    """Ids name it, and give the same layouts again whatever the curriculum asks for by then."""
    name, narrow = "objects.cube_0.region", [[0.30, -0.05], [0.35, 0.05]]
    cfg = plain_cfg(cubes_on())
    cfg.events["layouts"] = PlaceLayoutsCfg(scene=cubes_on(), scene_params=[name])
    stages = [{"step": 2, "params": {name: narrow}}, {"step": 4, "params": {name: NEAR["box"]}}]
    cfg.curriculum["wider"] = CurriculumTermCfg(func=scene_param_stages, params={"param_stages": stages})
    env = ManagerBasedRlEnv(cfg, "cpu")
    env.reset()
    term, (low, high) = env.event_manager.get_term_cfg("layouts").func, np.array(narrow)
    found = []
    for step in (0, 2, 4):
        env.common_step_counter = step
        env.reset(env_ids=torch.tensor([1, 3]))
        ids, at = term.layout_ids(), local(env, "cube_0")[:, :2]
        assert [name.count("=") for name in ids] == [0, int(step == 2), 0, int(step == 2), 0, 0]
        found.append(
            (ids, bool(((low <= at[[1, 3]]) & (at[[1, 3]] <= high)).all()), term.layouts.qpos.cpu().numpy().copy())
        )
    assert [narrowed for _, narrowed, _ in found] == [False, True, False]
    term.reseed(layouts=found[1][0])
    for env_ids in (torch.tensor([0, 1, 2]), torch.tensor([3, 4, 5])):
        env.reset(env_ids=env_ids)
    assert np.array_equal(term.layouts.qpos.cpu().numpy(), found[1][2])


def test_extras_name_the_layouts_with_their_params():
    """So `reseed` makes them again, whatever the params are by then."""
    name = "objects.cube_0.region"
    cfg = plain_cfg(cubes_on())
    cfg.events["layouts"] = PlaceLayoutsCfg(scene=cubes_on(), scene_params=[name])
    env = ManagerBasedRlEnv(cfg, "cpu")
    term = env.event_manager.get_term_cfg("layouts").func
    term.set_param(name, [[0.30, -0.05], [0.35, 0.05]], torch.tensor([1, 3]))
    env.reset()
    wanted, layout = term.layouts.qpos.clone(), env.extras["layout"]
    term.set_param(name, NEAR["box"])
    env.reset()
    assert (term.layouts.qpos != wanted).any(dim=1).all()
    term.reseed(layouts=layout)
    env.reset()
    assert torch.equal(term.layouts.qpos, wanted)
    assert torch.equal(env.extras["layout"]["params"][name], layout["params"][name])
    with pytest.raises(UnknownNameError, match=r"unknown param 'objects\.cube_1\.region'"):
        term.set_param("objects.cube_1.region", NEAR["box"])


def test_a_mocap_root_and_drawn_joints_are_written_by_their_entity():
    """A cabinet without a freejoint, which mjlab gives a mocap root, with its drawer drawn and a cube on its tray."""
    scene = {
        "objects": {
            "cabinet": {
                "kind": "fixture",
                "on": "terrain",
                "region": {"box": [[-0.3, -0.3], [0.3, 0.3]]},
                "joints": {"slide": {"range": [0.05, 0.15]}},
            },
            "cube_0": {"on": "cabinet/drawer"},
            "cube_1": {"on": "terrain", "region": {"box": [[0.8, 0.8], [1.0, 1.0]]}},
        },
        "bank": 2,
    }
    cfg = plain_cfg(scene, cabinet=EntityCfg(spec_fn=lambda: mujoco.MjSpec.from_string(CABINET)))
    env = ManagerBasedRlEnv(cfg, "cpu")
    env.reset()
    cabinet = env.scene["cabinet"]
    slide = env.sim.data.qpos[:, cabinet.indexing.joint_q_adr][:, 0].numpy()
    assert (slide >= 0.05).all() and (slide <= 0.15).all() and len(np.unique(slide)) == NUM_ENVS
    base = (env.sim.data.mocap_pos[:, cabinet.indexing.mocap_id] - env.scene.env_origins).numpy()
    assert np.abs(base).max() <= 0.3 and len(np.unique(base[:, 0])) == NUM_ENVS
    np.testing.assert_allclose(local(env, "cube_0")[:, 2], base[:, 2] + 0.25 + 0.01 + 0.0205, atol=1e-5)
    assert deepest(env) == 0.0


def test_a_command_that_places_again_is_refused_and_one_that_keeps_layouts_is_taken():
    """MultiCubeLiftingCommand places its cubes after all events; with the mixin it draws targets alone."""
    env = ManagerBasedRlEnv(lifting_cfg(4, kept=False), "cpu")
    with pytest.raises(ArgumentError, match=r"'lift_height' \(MultiCubeLiftingCommand\).*keep_layouts"):
        env.reset()
    env = ManagerBasedRlEnv(lifting_cfg(4), "cpu")
    env.reset()
    assert deepest(env) == 0.0
    command = env.command_manager.get_term("lift_height")
    places = [local(env, f"cube_{i}") for i in range(4)]
    before = command.target_pos.clone()
    command._resample(torch.arange(NUM_ENVS))  # as when its timer has run out
    assert (command.target_pos != before).any(dim=1).all()
    assert all(np.array_equal(local(env, f"cube_{i}"), places[i]) for i in range(4))


def test_the_arm_of_mjlab_can_grasp_what_is_reachable():
    """With the joints that a layout has for it, MuJoCo C has the tool at the cube and its approach axis downwards."""
    scene = cubes_on(reachable="clear") | {"robot": {"in_model": "robot/arm", "tcp": "robot/grasp_site"}}
    cfg = lifting_cfg(2)
    cfg.events["layouts"] = PlaceLayoutsCfg(scene=scene)
    env = ManagerBasedRlEnv(cfg, "cpu")
    env.reset()
    layouts = env.event_manager.get_term_cfg("layouts").func.layouts
    mjm = env.sim.mj_model
    data, tool = mujoco.MjData(mjm), mjm.site("robot/grasp_site").id
    qpos, joints = layouts.qpos.cpu().numpy(), layouts.grasp_qpos.cpu().numpy()
    assert layouts.reaching.names == ("cube_0", "cube_1")
    for world in range(NUM_ENVS):
        for i, name in enumerate(("cube_0", "cube_1")):
            data.qpos[:] = qpos[world]
            data.qpos[:6] = joints[world, i, :6]
            mujoco.mj_kinematics(mjm, data)
            assert (data.qpos[:6] >= mjm.jnt_range[:6, 0]).all() and (data.qpos[:6] <= mjm.jnt_range[:6, 1]).all()
            assert np.linalg.norm(data.site_xpos[tool] - data.xpos[mjm.body(f"{name}/cube").id]) < 0.03
            assert data.site_xmat[tool].reshape(3, 3)[2, 2] < 0.2  # no approach from below


def test_without_layouts_a_kept_command_places_as_ever():
    """So the event can be taken out for comparison."""
    cfg = lifting_cfg(2)
    del cfg.events["layouts"]
    env = ManagerBasedRlEnv(cfg, "cpu")
    env.reset()
    assert (local(env, "cube_0")[:, 0] >= 0.25).all()


def test_a_later_event_that_places_again_is_refused():
    """It should be listed before."""
    cfg = plain_cfg(cubes_on())
    cfg.events["home"] = EventTermCfg(func=mdp.reset_scene_to_default, mode="reset")
    with pytest.raises(ArgumentError, match="event 'home', list it before"):
        ManagerBasedRlEnv(cfg, "cpu").reset()


def test_sizes_that_startup_events_change_are_refused():
    """Layouts are made for the sizes of the compiled model."""
    cfg = plain_cfg(cubes_on())
    cfg.events["size"] = EventTermCfg(
        func=dr.geom_size,
        mode="startup",
        params={"asset_cfg": SceneEntityCfg("cube_0", geom_names=(".*",)), "ranges": (1.5, 2.0), "operation": "scale"},
    )
    with pytest.raises(SceneMismatchError, match=r"PlaceLayouts: model\.geom_size of geom 'cube_0/cube_geom'"):
        ManagerBasedRlEnv(cfg, "cpu").reset()


def test_bodies_that_no_entity_writes_are_refused():
    """A part of an entity cannot be placed, as the entity writes its root alone."""
    two = "<mujoco><worldbody><body name='a'/><body name='b'><freejoint/><geom size='.02'/></body></worldbody></mujoco>"
    scene = {"objects": {"ball": {"body": "pair/b", "on": "terrain", "region": NEAR}}}
    cfg = plain_cfg(scene, pair=EntityCfg(spec_fn=lambda: mujoco.MjSpec.from_string(two)))
    with pytest.raises(SceneKeyError, match=r"objects\.ball: body 'pair/b' should be the root body of an entity"):
        ManagerBasedRlEnv(cfg, "cpu")


@pytest.mark.slow
@pytest.mark.parametrize("cubes", [2, 4, 6])
def test_mjlab_trains_ten_iterations(cubes: int):
    """Its own runner and networks, in short episodes, so that environments are reset in between."""
    cfg, agent = lifting_cfg(cubes), yam_multi_cube_seg_ppo_runner_cfg()
    cfg.episode_length_s = 0.1
    agent.num_steps_per_env = 8
    env = RslRlVecEnvWrapper(ManagerBasedRlEnv(cfg, "cpu"))
    runner = MjlabOnPolicyRunner(env, asdict(agent), None, "cpu")
    runner.learn(10)
    assert runner.current_learning_iteration == 9
    assert env.unwrapped.extras["layout"]["episode"].min() >= 10


@pytest.mark.slow
def test_the_program_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As it stands, with fewer environments and iterations."""
    program = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[0]
    lines = program.splitlines()
    assert len(lines) <= 40
    assert len([line for line in lines if re.search("sceniris|region|cubes =|layouts", line)]) == 5  # as the page says
    monkeypatch.chdir(tmp_path)
    exec(compile(program.replace("4096", "2").replace("learn(1000)", "learn(1)"), "mjlab.md", "exec"), {})
