"""Every file in examples/ runs, and says what it is there to show."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import nn

from docs.make_examples import example as load
from sceniris_gym import SceneVectorEnv

EXAMPLES = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_is_short_and_has_a_test(path: Path):
    """Less than 60 lines, except for all of PPO; a first line that says what it shows; a test here or of ranks."""
    text = path.read_text()
    doc = ast.get_docstring(ast.parse(text))
    assert doc is not None
    assert len(doc.splitlines()[0]) < 120
    assert len(text.splitlines()) < (74 if path.stem == "06_own_ppo" else 60)
    tests = Path(__file__).with_name("vector") / "two_processes.py" if path.stem == "08_all_gpus" else Path(__file__)
    assert path.stem in tests.read_text()


@pytest.mark.slow
def test_the_vector_env_is_stepped_and_reset_in_part(capsys: pytest.CaptureFixture[str]):
    """Worlds outside of a reset mask keep their observations."""
    load("01_vector_env").main(num_envs=4, steps=3, device="cpu")
    out = capsys.readouterr().out
    assert "policy: (4, 47) critic: (4, 68) on cpu" in out
    assert "layouts: seeds [0, 1, 2, 3] episodes [0, 0, 0, 0]" in out
    assert "masked reset of 2 worlds; the others kept their observations: True" in out


@pytest.mark.slow
def test_the_own_loop_resets_the_worlds_whose_crate_fell(capsys: pytest.CaptureFixture[str]):
    """The paddle has crossed the bench once in each world."""
    load("02_own_loop").main(nworld=2, steps=900, device="cpu")
    out = capsys.readouterr().out
    assert "2 crates fell in 900 steps of 2 worlds; episodes are now [1 1]" in out


def test_the_data_set_opens_in_stock_mujoco(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Layouts touch nothing at first, and hardly move when they settle."""
    load("03_data_set").main(scene="mid", n=8, folder=tmp_path, device="cpu")
    out = capsys.readouterr().out
    assert "8 layouts, 100.0% of them fresh and valid" in out
    assert "before the first step: 0.000 mm" in out
    moved = [float(found) for found in re.findall(r"moved ([0-9.]+) mm", out)]
    assert len(moved) == 3
    assert max(moved) < 10.0


@pytest.mark.slow
def test_the_own_task_starts_at_a_distance_from_the_orange(capsys: pytest.CaptureFixture[str]):
    """The task works on the scene that it brings, and a few random actions do not reach the orange."""
    load("04_own_task").main(num_envs=4, steps=3, device="cpu")
    found = re.search(r"orange: ([0-9.]+) m at the start, ([0-9.]+) m at best", capsys.readouterr().out)
    assert found is not None
    assert 0.1 < float(found[2]) <= float(found[1]) < 0.9


@pytest.mark.slow
def test_the_own_ppo_learns_from_what_it_collects(capsys: pytest.CaptureFixture[str]):
    """Episodes end and are told of; what it computes is compared with sums written out for one world."""
    ppo = load("06_own_ppo")
    ppo.main(num_envs=4, iterations=5, steps=24)
    assert "480 steps: 4 episodes, success 0.00" in capsys.readouterr().out
    rewards, values = torch.tensor([[1.0], [2.0], [3.0]]), torch.tensor([[0.5], [0.25], [0.125], [4.0]])
    done = torch.tensor([[False], [True], [False]])
    last = 3.0 + ppo.GAMMA * 4.0 - 0.125
    second = 2.0 - 0.25  # nothing comes after the end of an episode
    first = 1.0 + ppo.GAMMA * 0.25 - 0.5 + ppo.GAMMA * ppo.LAMBDA * second
    assert ppo.advantages(rewards, values, done).flatten().tolist() == pytest.approx([first, second, last])


@pytest.mark.slow
def test_a_broken_world_does_not_spoil_the_own_ppo(monkeypatch: pytest.MonkeyPatch):
    """One world breaks while another is cut short: only what the latter would still have got is added to its reward."""
    ppo, networks, collected = load("06_own_ppo"), [], []
    network, advantages, step = ppo.network, ppo.advantages, SceneVectorEnv.step

    def sure_of_100(size: int, out: int) -> nn.Sequential:
        networks.append(network(size, out))
        nn.init.constant_(networks[-1][-1].bias, 100.0 if out == 1 else 0.0)
        return networks[-1]

    def broken(envs: SceneVectorEnv, action: torch.Tensor) -> tuple:
        if not collected:
            qpos = envs.batch.data.qpos.numpy()
            qpos[1] = float("nan")
            envs.batch.data.qpos.assign(qpos)
            envs.state.elapsed[2] = 10_000
        return step(envs, action)

    def noted(rewards: torch.Tensor, values: torch.Tensor, done: torch.Tensor) -> torch.Tensor:
        collected.append((rewards, done))
        return advantages(rewards, values, done)

    monkeypatch.setattr(ppo, "network", sure_of_100)
    monkeypatch.setattr(ppo, "advantages", noted)
    monkeypatch.setattr(SceneVectorEnv, "step", broken)
    ppo.main(num_envs=4, iterations=2, steps=3)
    rewards, done = collected[0]
    assert done[0].tolist() == [False, True, True, False]
    assert (rewards[0] > 90.0).tolist() == [False, False, True, False]
    assert all(weights.isfinite().all() for net in networks for weights in net.state_dict().values())
    assert len(collected) == 2


@pytest.mark.slow
def test_the_tour_runs_from_top_to_bottom(capsys: pytest.CaptureFixture[str]):
    """All cells of the notebook in order, without Jupyter; they print what the stored outputs say."""
    notebook = json.loads((EXAMPLES / "tour.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    names: dict = {}
    for cell in cells:
        exec("".join(cell["source"]), names)
        stored = ["".join(out["text"]) for out in cell["outputs"] if out["output_type"] == "stream"]
        if stored and "rewards" not in stored[0]:  # of actions that nobody seeded
            assert stored[0] in capsys.readouterr().out
    assert len(cells) == 8


@pytest.mark.slow
def test_stable_baselines_trains_and_is_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A few steps: statistics come out of the device, and the policy is kept."""
    load("05_stable_baselines").main(num_envs=4, steps=1600, device="cpu", out=str(tmp_path))
    out = capsys.readouterr().out
    assert re.search(r"before: return -?\d\.\d+ \+- \d\.\d+, success 0\.00", out)
    assert re.search(r"\n480 steps: return -?\d\.\d+, success 0\.00; reaching \d\.\d+, hovering", out)
    assert re.search(r"\nafter: return -?\d\.\d+ \+- \d\.\d+, success [01]\.\d+", out)
    assert {path.name for path in tmp_path.iterdir()} == {"model.zip", "normalize.pkl"}


@pytest.mark.slow
def test_the_viewer_shows_every_step(capsys: pytest.CaptureFixture[str]):
    """The address is said, and worlds are shown until the end."""
    pytest.importorskip("mjviser", reason="needs the extra 'viewer'")
    load("07_view").main(num_envs=2, steps=3, device="cpu")
    found = capsys.readouterr()
    assert "the environment is shown at http://127.0.0.1:" in found.err
    assert "3 steps of 2 worlds were shown" in found.out


def test_npz_and_json_are_read_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """In stock MuJoCo, at the same places for everything."""
    load("09_formats").main(n=8, folder=tmp_path / "set", device="cpu")
    out = capsys.readouterr().out
    assert "json: 8 layouts, poses within 0." in out
    assert "16 joint positions" in out
    assert "npz: poses of cabinet, apple, banana; set by name, qpos is as written: True" in out


def test_formats_are_read_back_of_a_scene_without_fixtures(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Nothing has a mocap body there."""
    load("09_formats").main(scene="tabletop_reach", n=2, folder=tmp_path / "set", device="cpu")
    assert "json: 2 layouts, poses within 0." in capsys.readouterr().out


@pytest.mark.parametrize("scene", ["mid", "tabletop_reach"])
def test_usd_is_read_back(scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A stage has the poses of the npz file, and a row alone is a stage; also where nothing has a mocap body."""
    pytest.importorskip("pxr", reason="needs the extra 'import'")
    load("10_usd").main(scene=scene, n=8, folder=tmp_path / "set", device="cpu")
    assert re.search(r"usd: 8 frames, the last of seed 7; \d+ meshes; poses within 0\.\d um", capsys.readouterr().out)
    assert (tmp_path / "set" / "layout-0.usda").exists()


@pytest.mark.slow
def test_failures_are_judged_again_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A policy that moves at random fails on some layout, which has a picture."""
    load("11_replay_failures").main(num_envs=4, layouts=8, picture=tmp_path / "failure.png", device="cpu")
    assert re.search(r"of 8 succeed; the first failure is \w{16}:eval:\d:0", capsys.readouterr().out)
    assert (tmp_path / "failure.png").exists()


@pytest.mark.slow
def test_a_model_in_memory_keeps_its_ball_rolling(capsys: pytest.CaptureFixture[str]):
    """Cups stand after every reset, and the ball, which is not in the scene, never goes back."""
    load("12_model_in_memory").main(nworld=4, steps=100, device="cpu")
    out = capsys.readouterr().out
    assert out.count("100% of the cups stand") == 3
    places = [float(x) for x in re.findall(r"x = ([0-9.]+) m", out)]
    assert places == sorted(set(places))
    assert places[-1] > 1.2


@pytest.mark.slow
def test_an_own_mesh_becomes_an_asset_and_is_placed(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """All layouts are valid, and drawn."""
    load("13_own_mesh").main(folder=tmp_path, device="cpu")
    assert "16 of 16 layouts are valid" in capsys.readouterr().out
    assert (tmp_path / "layouts.png").exists()


def test_images_are_saved(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Three rows of pictures, which differ from world to world; the orange is seen by the camera at the side."""
    load("14_images").main(num_envs=3, device="cpu", out=str(tmp_path / "images.png"))
    pixels = np.asarray(Image.open(tmp_path / "images.png")).reshape(3, 96, 3, 96, 3).astype(int)
    red, green, blue = pixels[0].transpose(3, 1, 0, 2)
    assert ((red > 150) & (green < 0.75 * red) & (blue < 0.4 * red)).any(axis=(1, 2)).sum() >= 2
    for row in pixels:
        assert len(np.unique(row.transpose(1, 0, 2, 3).reshape(3, -1), axis=0)) == 3


@pytest.mark.slow
def test_pixels_train_a_policy_of_stable_baselines(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """A few steps: the policy is saved, and judged on as many layouts as there are worlds."""
    pytest.importorskip("stable_baselines3")
    load("15_pixels").main(num_envs=2, steps=480, device="cpu", out=str(tmp_path / "pixels.zip"))
    out = capsys.readouterr().out
    assert "480 steps: return" in out
    assert "of 2 unseen layouts" in out
    assert (tmp_path / "pixels.zip").is_file()


@pytest.mark.slow
def test_a_scene_and_a_task_draw_physics_from_the_seed(capsys: pytest.CaptureFixture[str]):
    """Masses within their range, contacts with tables that are rough, and a reset that leaves other worlds alone."""
    example = load("16_randomised_task")
    example.main(num_envs=16, device="cpu")
    out = capsys.readouterr().out
    low, high = map(float, re.findall(r"are ([0-9.]+) to ([0-9.]+) of", out)[0])
    assert 0.5 <= low < 0.8
    assert 1.3 < high <= 2.0
    assert "of 16 tables are rough" in out
    assert "after a reset of 2 worlds, 14 keep their masses" in out
    envs = SceneVectorEnv(example.RoughLift, 8, scene=example.SCENE, device="cpu")
    envs.reset(seed=0)
    envs.step(torch.from_numpy(np.zeros_like(envs.action_space.sample())))
    contact, count = envs.state.data.contact, int(envs.state.data.nacon.numpy()[0])
    found = (contact.geom.numpy()[:count] == envs.state.mjm.geom("table/top").id).any(axis=1)
    worlds, sliding = contact.worldid.numpy()[:count][found], contact.friction.numpy()[:count][found, 0]
    rough = envs.state.model_field("geom_friction", "table/top").numpy()[worlds, 0] > 1.0
    assert 0 < rough.sum() < len(rough)
    assert sliding[rough].min() > 2.0 > 1.2 > sliding[~rough].max()


def test_an_own_loop_draws_masses_and_frictions(capsys: pytest.CaptureFixture[str]):
    """Blocks of little friction come further."""
    load("17_randomised_loop").main(nworld=8, device="cpu")
    found = float(re.findall(r"correlation of friction and way: ([-0-9.]+)", capsys.readouterr().out)[0])
    assert found < -0.8


@pytest.mark.slow
def test_things_of_worlds_are_others_after_every_reset(capsys: pytest.CaptureFixture[str]):
    """Each of them has the mass of its own, wherever it comes up, and stays on the table."""
    load("18_variants").main(nworld=12, resets=2, seconds=0.2, device="cpu")
    found = re.findall(r"(\w+): (\d+) worlds, ([0-9.]+) kg, 100% still", capsys.readouterr().out)
    assert sum(int(number) for _, number, _ in found) == 24
    assert len({name for name, _, _ in found}) == len({(name, mass) for name, _, mass in found}) > 4


@pytest.mark.slow
def test_the_regions_widen_and_a_narrow_layout_comes_back(capsys: pytest.CaptureFixture[str]):
    """By params and by an id that names them."""
    load("19_params").main(num_envs=32, resets=2, device="cpu")
    out = capsys.readouterr().out
    sizes = [list(map(float, found)) for found in re.findall(r"within ([0-9.]+) by ([0-9.]+) m", out)]
    assert sizes[0][0] < sizes[1][0]
    assert sizes[0][1] < sizes[1][1]
    assert "the first narrow layout again: True" in out
    assert "its id has 5 params" in out


@pytest.mark.slow
def test_levels_are_played_again_and_resumed(capsys: pytest.CaptureFixture[str]):
    """About half of the later episodes, out of a buffer that a second environment goes on with."""
    load("20_levels").main(num_envs=8, episodes=4, device="cpu")
    out = capsys.readouterr().out
    played, size, again = (re.search(text, out) for text in (r"(\d+)% of the", r"(\d+) levels", r"has (\d+) of them"))
    assert played is not None
    assert 5 < int(played[1]) < 60
    assert size is not None
    assert again is not None
    assert size[1] == again[1]


@pytest.mark.slow
def test_the_region_grows_as_far_as_the_player_succeeds(capsys: pytest.CaptureFixture[str]):
    """To 0.2 m along x, and all the way along y."""
    load("21_adr").main(num_envs=64, device="cpu")
    last = capsys.readouterr().out.splitlines()[-1]
    low_x, high_x, low_y, high_y = (float(end) for end in re.findall(r"-?[0-9.]+(?= to| m)", last))
    assert -0.3 < low_x < -0.15 < 0.15 < high_x < 0.3
    assert (low_y, high_y) == (-0.4, 0.4)
