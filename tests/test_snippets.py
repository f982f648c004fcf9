"""Short programs that show the public names: each runs as written, on a small scene."""

from __future__ import annotations

import ast
import importlib.util
import json
import shlex
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import mujoco_warp as mjw
import pytest
import torch

import sceniris_gym
from sceniris_gym import (
    LayoutGenerator,
    LevelReplay,
    State,
    Task,
    cli,
    compile_scene,
)

ROOT = Path(__file__).parents[1]
TERMS = ROOT / "sceniris_gym" / "adapters" / "mjlab" / "terms.py"
ID = "snippets/Cup-v0"
SCENE = {
    "name": "cup",
    "model": str(ROOT / "tests" / "data" / "small_arm.xml"),
    "floor": {"size": [1.6, 1.6]},
    "objects": {
        "block": {"on": "floor", "region": {"box": [[-0.3, -0.6], [-0.1, 0.6]]}},
        "can": {"asset": "can", "on": "floor", "region": {"box": [[0.5, -0.5], [0.7, 0.5]]}},
    },
    "cameras": {"front": {"pos": [2.0, 0.0, 1.0], "look_at": [0.0, 0.0, 0.0]}},
    "bank": 4,
}
FEWER = {"num_envs=64": "num_envs=4, device='cpu'", "num_envs=4096": "num_envs=4, device='cpu'", "envs, 256": "envs, 6"}
"""Numbers of worlds and of layouts that suffice here."""

# The snippets. Each line is a statement or a few of them.
IMAGES_AND_CURRICULUM = """
images, replay = ImageConfig(cameras={"front": {"size": (96, 96)}}, every=2), LevelReplay("learnability", replay_prob=0.5)
envs = gym.make_vec(ID, num_envs=64, images=images, curriculum=replay, sim_config={"nconmax": 64}); info["layout"]["level"]
"""  # noqa: E501
OWN_LOOP = """
model, data = make_worlds(compiled, 8)
randomizer = ResetRandomizer(compiled, model, data); randomizer.reset(); print(randomizer.variants)
"""
CHOSEN_IDS = """
randomizer.reset(mask, layouts=ids); term.reseed(layouts=ids, env_ids=env_ids); envs.reset(options={"layouts": info["layout"]})
"""  # noqa: E501
REDRAW = """
envs.unwrapped.redraw(["can"], timer); randomizer.redraw_status; layouts = generator.redraw(layouts, name); info["layout"]["redraw_failed"]
"""  # noqa: E501
SNAPSHOT = """
snap = envs.unwrapped.snapshot([0, 3]); envs.reset(options={"state": snap})
"""
OWN_SCORES = """
envs.unwrapped.randomizer.levels.update(info["final_info"]["layout"], score, worlds=info["_final_info"])
"""
MJLAB = """
cfg.events["layouts"] = PlaceLayoutsCfg(scene=scene, scene_params=[name])
stages = [{"step": 0, "params": {name: a}}, {"step": 20_000, "params": {name: b}}]
cfg.curriculum["wider"] = CurriculumTermCfg(func=scene_param_stages, params={"param_stages": stages})
"""
RSL_RL = """
envs = RslRlVecEnvWrapper(gym.make_vec(ID, num_envs=4096), seed=0)
policy = sceniris_gym.training.load_policy("results/drawer"); policy.export("policy.pt")
"""
DATA_SET = """
envs = gym.make_vec(ID, num_envs=64, layout_source=LayoutDataset("layouts/mid"))
"""
EVALUATION = """
failed = [result.id for result in evaluate(policy, envs, 256) if not result.success]
"""
COMMANDS = (
    "sceniris-gym evaluate results/cup -n 16 --failed failed.txt && "
    "sceniris-gym view --env ID --policy results/cup/model.pt --layout failed.txt"
)


class Lower(Task):
    """Lowers the tool of an arm, which never succeeds within two steps."""

    substeps = 2

    def observe(self, s: State) -> dict[str, Any]:
        """The policy sees the joints of the arm."""
        return {"policy": {"arm": s.qpos("arm")}}

    def reward(self, s: State, action: torch.Tensor) -> dict[str, torch.Tensor]:
        """A lower tool earns more."""
        return {"low": -s.site("arm/tcp")[:, 2]}

    def success(self, s: State) -> torch.Tensor:
        """The tool is below the floor."""
        return s.site("arm/tcp")[:, 2] < 0.0


@pytest.fixture(autouse=True)
def _task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Register the task, and keep files in a folder of the test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SCENIRIS_GYM_CACHE", str(tmp_path / "cache"))
    words = {"task": Lower, "scene": SCENE}
    gym.register(ID, vector_entry_point="sceniris_gym:SceneVectorEnv", max_episode_steps=2, kwargs=words)
    yield
    gym.registry.pop(ID)


@pytest.fixture(scope="module")
def compiled():
    """Return the compiled scene of the task."""
    return compile_scene(SCENE, "cpu")


def make(num_envs: int = 4, **kwargs: Any) -> Any:
    """Return environments of the task."""
    return gym.make_vec(ID, num_envs=num_envs, device="cpu", **kwargs)


def run(snippet: str, given: dict[str, Any]) -> dict[str, Any]:
    """Run a snippet with fewer worlds after an import of all public names, and return its names."""
    for before, after in FEWER.items():
        snippet = snippet.replace(before, after)
    public = {name: getattr(sceniris_gym, name) for name in sceniris_gym.__all__}
    names = {**public, "gym": gym, "sceniris_gym": sceniris_gym, "ID": ID, **given}
    exec(compile(snippet, "snippet", "exec"), names)
    return names


def test_images_and_a_curriculum(tmp_path: Path):
    """`info` has the level of each world, and images come in every second step."""
    _, info = make(curriculum=LevelReplay()).reset(seed=0)
    envs = run(IMAGES_AND_CURRICULUM, {"info": info})["envs"]
    observation, info = envs.reset(seed=0)
    assert observation["images"]["front"]["rgb"].shape == (4, 96, 96, 3)
    assert info["layout"]["level"].shape == (4,)
    assert (envs.unwrapped.image_config.every, envs.unwrapped.sim_config.nconmax) == (2, 64)


def test_an_own_loop(compiled: Any):
    """Eight worlds are reset; a scene with variants names the variant of each world."""
    names = run(OWN_LOOP, {"compiled": compiled})
    assert names["randomizer"].variants.shape == (8, 0)
    assert names["randomizer"].layouts.episode.tolist() == [0] * 8
    mjw.step(names["model"], names["data"])
    variants = {
        **SCENE,
        "objects": {"cup": {"variants": {"can": {"asset": "can"}, "tin": {"asset": "tin"}}, "on": "floor"}},
    }
    names = run(OWN_LOOP, {"compiled": compile_scene(variants, "cpu")})
    assert names["randomizer"].variants.shape == (8, 1)


def test_chosen_ids():
    """By an id in a loop, and by the layouts of an `info`; mjlab's term is checked by the names of its arguments."""
    envs = make()
    _, info = envs.reset(seed=3)
    ids, randomizer = envs.unwrapped.layout_ids(), envs.unwrapped.randomizer
    envs.reset(seed=50)
    term, mask = SimpleNamespace(reseed=lambda *, layouts, env_ids: None), torch.ones(4, dtype=torch.bool)
    given = {"envs": envs, "info": info, "ids": ids, "mask": mask, "term": term, "env_ids": [0, 1, 2, 3]}
    run(CHOSEN_IDS, {**given, "randomizer": randomizer})
    assert envs.unwrapped.layout_ids() == ids
    (reseed,) = (node for node in defined("PlaceLayouts").body if getattr(node, "name", "") == "reseed")
    assert isinstance(reseed, ast.FunctionDef)
    assert [each.arg for each in reseed.args.kwonlyargs] == ["layouts", "env_ids"]


def test_a_redraw(compiled: Any):
    """Of an environment, whose `info` names the worlds without a new place, and of a generator."""
    envs, generator, timer = make(max_episode_steps=9), LayoutGenerator(compiled, 4), torch.tensor([True, False] * 2)
    envs.reset(seed=0)
    envs.unwrapped.redraw(["can"], timer)
    info = envs.step(envs.action_space.sample())[4]
    generator.generate()
    given = {"envs": envs, "generator": generator, "layouts": generator.layouts, "info": info, "name": "can"}
    names = run(REDRAW, {**given, "timer": timer, "randomizer": envs.unwrapped.randomizer})
    assert envs.step(envs.action_space.sample())[4]["layout"]["redraws"].tolist() == [2, 0, 2, 0]
    assert info["layout"]["redraw_failed"].tolist() == [False] * 4
    assert (names["layouts"].qpos != generator.layouts.qpos).any()


def test_a_snapshot():
    """Of two worlds, which go on there."""
    envs = make(max_episode_steps=9)
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())
    before = envs.unwrapped.layout_ids()
    names = run(SNAPSHOT, {"envs": envs})
    assert len(names["snap"]) == 2
    assert envs.unwrapped.layout_ids() == before


def test_own_scores():
    """Of all episodes that ended in this step."""
    envs = make(curriculum=LevelReplay("custom", replay_prob=0.0))
    envs.reset(seed=0)
    for _ in range(2):
        info = envs.step(envs.action_space.sample())[4]
    assert info["_final_info"].all()
    run(OWN_SCORES, {"envs": envs, "info": info, "score": torch.tensor([0.25, 0.5, 0.75, 1.0])})
    assert sorted(envs.unwrapped.randomizer.levels.state()["value"].tolist())[-4:] == [0.25, 0.5, 0.75, 1.0]


def defined(name: str) -> Any:
    """Return the definition of a class or function of the adapter for mjlab."""
    (node,) = (node for node in ast.parse(TERMS.read_text()).body if getattr(node, "name", "") == name)
    return node


def test_the_names_of_mjlab_are_those_of_the_adapter():
    """Without mjlab: the fields of the event, and the argument of the curriculum."""
    ast.parse(MJLAB)
    fields = [ast.unparse(node.target) for node in defined("PlaceLayoutsCfg").body if isinstance(node, ast.AnnAssign)]
    assert {"scene", "scene_params"} <= set(fields)
    assert [each.arg for each in defined("scene_param_stages").args.args] == ["env", "env_ids", "param_stages"]


def test_layouts_and_stages_of_mjlab():
    """With mjlab: its configs take both."""
    managers = pytest.importorskip("mjlab.managers.curriculum_manager", reason="needs mjlab: make test-mjlab")
    from sceniris_gym.adapters.mjlab import PlaceLayoutsCfg, scene_param_stages

    cfg = SimpleNamespace(events={}, curriculum={})
    given = {"cfg": cfg, "scene": SCENE, "name": "objects.can.region", "a": None, "b": None}
    given |= {"PlaceLayoutsCfg": PlaceLayoutsCfg, "scene_param_stages": scene_param_stages}
    run(MJLAB, {**given, "CurriculumTermCfg": managers.CurriculumTermCfg})
    assert (list(cfg.events), list(cfg.curriculum)) == (["layouts"], ["wider"])


def train(out: str) -> None:
    """Train for a moment."""
    small = ("--num-envs", "2", "-n", "2", "--device", "cpu", "--every", "1", "--million-steps", "0.000001")
    cli.main(["train", ID, "--out", out, *small, "--set", "hidden=[8]", "--set", "steps=4"])


def test_a_policy_of_rsl_rl():
    """It acts on the observations of the wrapper's environments, and its export is a file."""
    pytest.importorskip("rsl_rl")
    from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper

    train("results/drawer")
    names = run(RSL_RL, {"RslRlVecEnvWrapper": RslRlVecEnvWrapper})
    assert names["policy"](names["envs"].get_observations()).shape == (4, 5)
    assert Path("policy.pt").stat().st_size > 0


def test_a_data_set():
    """Its rows are the layouts of the environments."""
    Path("cup.yaml").write_text(json.dumps(SCENE))
    cli.main(["generate", "cup.yaml", "-n", "8", "-o", "layouts/mid", "--device", "cpu"])
    envs = run(DATA_SET, {})["envs"]
    envs.reset()
    rows = {envs.unwrapped.compiled.layout_id(seed, 0, "train") for seed in range(8)}
    assert set(envs.unwrapped.layout_ids()) <= rows


def test_an_evaluation():
    """No episode of two steps succeeds, so all ids are there."""
    failed = run(EVALUATION, {"policy": lambda observation: torch.zeros(4, 5), "envs": make()})["failed"]
    assert failed == [make().unwrapped.compiled.layout_id(seed, 0, "train") for seed in range(6)]


@pytest.mark.skipif(importlib.util.find_spec("mjviser") is None, reason="needs the extra 'viewer'")
def test_an_evaluation_on_the_command_line(monkeypatch: pytest.MonkeyPatch):
    """The failures of a task of one's own are listed, and the page opens with them and is closed."""
    pytest.importorskip("rsl_rl")
    from sceniris_gym.layout.layout_id import LayoutId
    from sceniris_gym.viewer.env_view import EnvView

    train("results/cup")
    shown: list[EnvView] = []

    def tick(view: EnvView) -> None:
        shown.append(view)
        raise RuntimeError("closed")

    monkeypatch.setattr(EnvView, "tick", tick)
    judged, seen = (shlex.split(part)[1:] for part in COMMANDS.replace("ID", ID).split("&&"))
    cli.main(judged)
    failed = Path("failed.txt").read_text().split()
    assert len(failed) == 16
    with pytest.raises(RuntimeError, match="closed"):
        cli.main(seen)
    (view,) = shown
    assert view.ids == [LayoutId.parse(each) for each in failed]
