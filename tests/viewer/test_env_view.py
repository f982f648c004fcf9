"""The page on which a policy plays: chosen layouts one after another, and what is said of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from sceniris_gym.viewer import env_view
from sceniris_gym.viewer.env_view import EnvView
from tests.vector.conftest import SCENE, Reach
from tests.viewer.pages import chart, click, control, lines, page, press, text

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")


@pytest.fixture(scope="module")
def envs() -> Iterator[SceneVectorEnv]:
    """A small environment without autoreset, whose episodes take four steps."""
    scene = compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cpu")
    envs = SceneVectorEnv(Reach, 2, scene=scene, autoreset_mode="Disabled", max_episode_steps=4)
    yield envs
    envs.close()


def test_layouts_are_played_one_after_another(envs: SceneVectorEnv, monkeypatch: pytest.MonkeyPatch):
    """Two at a time, from the ids that were chosen; after the episodes of both the next two begin."""
    monkeypatch.setattr(env_view, "_LOOK", 0.0)
    torch.manual_seed(0)  # an action above 0.9 ends an episode
    ids = [envs.compiled.layout_id(seed, seed % 2) for seed in (5, 8, 9)]
    seen: list[tuple[list[int], list[int], str]] = []
    with page() as server:
        view = EnvView(server, envs, None, ids)
        view.speed = 1000.0
        assert control(server, "layout").value == ids[0]
        for _ in range(9):
            state = envs.state
            seen.append((state.seed.tolist(), state.episode.tolist(), text(server)))
            view.tick()
    assert seen[0][:2] == ([5, 8], [1, 0])
    assert "Layout 1 of the 3 chosen" in seen[0][2]
    assert seen[4][:2] == seen[0][:2], "how it ended is on show for a while"
    assert "first world ended" in seen[4][2]
    assert "2 episodes ended so far" in seen[4][2]
    assert seen[5][:2] == ([9, 5], [1, 1])
    assert "Layout 3 of the 3 chosen" in seen[5][2]


def test_each_episode_has_the_drawn_colours_of_its_layout():
    """As the environment's model has them."""
    colours = {"rgba": {"abs": [[0, 0, 0, 1], [1, 1, 1, 1]]}}
    scene = SceneConfig.load(SCENE, {"bank": 8, "objects.block.randomize": colours})
    envs = SceneVectorEnv(Reach, 2, scene=scene, device="cpu", autoreset_mode="Disabled")
    with page() as server:
        view = EnvView(server, envs, None)
        for first in (0, 2):
            view.start(first)
            shown = envs.batch.model.geom_rgba.numpy()
            painted = view._window.worlds._painted
            assert painted
            for geom, handle in painted.items():
                np.testing.assert_allclose(handle.batched_colors / 255.0, shown[:, geom, :3], atol=0.01)
    envs.close()


def test_the_policy_is_asked_and_what_it_gets_is_plotted(envs: SceneVectorEnv):
    """Its actions are taken; each step adds one to the plots."""
    asked: list[torch.Tensor] = []

    def policy(observation: dict[str, torch.Tensor]) -> torch.Tensor:
        asked.append(observation["policy"])
        return torch.zeros(2, 5)

    with page() as server:
        view = EnvView(server, envs, policy)
        view.running = False
        view.step()
        view.step()
        assert len(asked) == 2
        assert asked[0].shape == (2, sum(int(np.prod(shape)) for _, shape in envs.observation_names["policy"]))
        click(server, "Pause")
        view.tick()
        assert "step 2" in text(server)
        drawn = chart(server, "Observation")
        assert len(drawn.data[0]) == 2
        press(server, "part", control(server, "part").options[-1])
        view.tick()
        assert chart(server, "Observation") is not drawn, "a part that is chosen at a pause is drawn"
        for _ in range(4):
            view.step()
        assert len(lines(server, "Success")["step"]) == 4, "what comes after the end of the episode is no part of it"
        press(server, "layout", envs.compiled.layout_id(77, 0))
        view.tick()
        assert np.isnan(lines(server, "Success")["success"]).all(), "the curves are those of this layout"
        for _ in range(2):
            click(server, "Step")
            view.tick()
        assert len(lines(server, "Success")["step"]) == 2
        view.start(-1)
        assert view.first == 0
        assert np.isnan(lines(server, "Success")["success"]).all()


def test_ids_of_other_scenes_are_refused(envs: SceneVectorEnv):
    """At the start by an error, later on the page, until a user does something else."""
    other = r"belongs to scene 0123456789abcdef, but '.*' is now scene .*Open its environment"
    with page() as server, pytest.raises(SceneMismatchError, match=other):
        EnvView(server, envs, None, ["0123456789abcdef:train:0:0"])
    with page() as server, pytest.raises(SceneMismatchError, match="start the viewer with its --split"):
        EnvView(server, envs, None, [envs.compiled.layout_id(0, 0, "eval")])
    with page() as server:
        view = EnvView(server, envs, None)
        press(server, "layout", "apple")
        view.tick()
        assert "should be scenehash" in text(server)
        for _ in range(6):
            view.tick()
        assert "should be scenehash" in text(server), "while episodes go on"
        click(server, "Play")
        view.tick()
        assert "should be scenehash" not in text(server)
        press(server, "layout", "apple")
        view.tick()
        press(server, "layout", envs.compiled.layout_id(77, 0))
        view.tick()
        assert control(server, "layout").value == envs.compiled.layout_id(77, 0)
        assert "should be scenehash" not in text(server)
        view.start(2)
        assert control(server, "layout").value == envs.compiled.layout_id(2, 0), "then it goes on as before"


def test_a_policy_that_fails_is_said_on_the_page(envs: SceneVectorEnv, capsys: pytest.CaptureFixture):
    """And stops the episode, not the page."""

    def policy(observation: dict[str, torch.Tensor]) -> torch.Tensor:
        raise KeyError("no such layer")

    with page() as server:
        view = EnvView(server, envs, policy)
        view.tick()
        assert not view.running
        assert "no such layer" in text(server)
        assert "no such layer" in capsys.readouterr().err
