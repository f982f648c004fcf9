"""Features that only a GPU has: streams, and one graph of torch and Warp together."""

from __future__ import annotations

from typing import Any

import gymnasium
import pytest
import torch
import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.levels import ADR, LevelReplay
from sceniris_gym.vector.task import Task
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach

pytestmark = pytest.mark.cuda
SLIDE = "objects.cabinet.joints.slide"


def test_reset_states_have_the_same_bits_with_and_without_graphs(cuda_scene):
    """Recorded or not, 3 or 5 worlds: the same seed is the same observation."""
    envs = SceneVectorEnv(Reach, 3, scene=cuda_scene)
    other = SceneVectorEnv(Reach, 5, scene=cuda_scene, sim_config={"graph": False})
    for _ in range(2):
        first, _ = envs.reset(seed=[7, 8, 9])
        second, _ = other.reset(seed=[1, 9, 2, 7, 8])
        envs.step(torch.zeros(3, 5))
    for group in first:
        assert torch.equal(first[group], second[group][[3, 4, 1]])


def test_layouts_are_made_ahead_on_a_gpu_by_default(cuda_scene):
    """Unless a source of layouts is given, or it is asked not to."""
    assert SceneVectorEnv(Reach, 2, scene=cuda_scene).randomizer.pipeline.ahead is not None
    plain = SceneVectorEnv(Reach, 2, scene=cuda_scene, sim_config={"prefetch": False})
    given = SceneVectorEnv(Reach, 2, scene=cuda_scene, layout_source=LayoutGenerator)
    for envs in (plain, given):
        assert envs.randomizer.pipeline.ahead is None


def test_other_worlds_keep_their_bits(cuda_scene):
    """A masked reset leaves state and observation of the other worlds as they are, with the mask on the GPU."""
    envs = SceneVectorEnv(Reach, 4, scene=cuda_scene, autoreset_mode="Disabled")
    envs.reset(seed=0)
    for _ in range(5):
        before, *_ = envs.step(torch.full((4, 5), 0.2, device="cuda"))
    qpos = envs.batch.data.qpos.numpy()
    after, _ = envs.reset(options={"reset_mask": torch.tensor([True, False, False, True], device="cuda")})
    assert (envs.batch.data.qpos.numpy()[1:3] == qpos[1:3]).all()
    for group in before:
        assert torch.equal(after[group][1:3], before[group][1:3])
    assert not torch.equal(after["critic"], before["critic"])


@pytest.mark.parametrize("source", ["cpu", "cuda:0"])
def test_an_environment_continues_from_a_snapshot_of_another_device(cuda_scene, make_env, source: str):
    """With the memory of the task, the steps since the reset, and the layouts that follow."""
    cuda, cpu = SceneVectorEnv(Reach, 3, scene=cuda_scene, params=SLIDE), make_env(3, params=SLIDE)
    first, second = (cpu, cuda) if source == "cpu" else (cuda, cpu)
    first.reset(seed=4)
    first.set_param(SLIDE, [0.05, 0.06], [1])
    second.reset(seed=90)
    for _ in range(3):
        first.step(torch.full((3, 5), 0.2, device=first.device))
    kept = first.snapshot()
    _, info = second.reset(options={"state": kept})
    assert info["layout"]["seed"].tolist() == [4, 5, 6]
    assert second.state.elapsed.tolist() == [3, 3, 3]
    tasks: list[Any] = [first.task, second.task]
    for name in ("last", "drawn"):
        assert torch.equal(*(getattr(task, name).cpu() for task in tasks))
    assert torch.equal(*(envs.state.qpos("arm").cpu() for envs in (first, second)))
    for envs in (first, second):
        envs.reset()
    assert first.layout_ids() == second.layout_ids()
    assert torch.equal(*(envs.randomizer.layouts.qpos.cpu() for envs in (first, second)))


def test_a_redraw_has_the_bits_of_a_cpu_waits_for_nothing_and_can_be_captured(cuda_scene, make_env):
    """Directly and replayed, with a mask on the GPU that changes in between."""
    envs, cpu = SceneVectorEnv(Reach, 4, scene=cuda_scene), make_env(4)
    for each in (envs, cpu):
        each.reset(seed=4)
        each.redraw("block")
    mask = torch.tensor([True, False, True, False], device="cuda")
    torch.cuda.set_sync_debug_mode("error")
    try:
        envs.redraw("block", mask)
    finally:
        torch.cuda.set_sync_debug_mode("default")
    stream, graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
    torch.cuda.synchronize()
    with torch.cuda.graph(graph, stream=stream):
        warp_stream = wp.stream_from_torch(torch.cuda.current_stream())
        with wp.ScopedStream(warp_stream, sync_enter=False), wp.ScopedCapture(stream=warp_stream, external=True):
            envs.redraw("block", mask)
    cpu.redraw("block", mask.cpu())
    for _ in range(3):
        mask.logical_not_()
        graph.replay()
        cpu.redraw("block", mask.cpu())
    assert envs.randomizer.redraw_count.cpu().numpy().tolist() == [3, 3, 3, 3]
    torch.testing.assert_close(envs.state.pose("block").cpu(), cpu.state.pose("block"), rtol=0.0, atol=0.0)


class Hold(Reach):
    """The reaching task with the actions of Task."""

    apply = Task.apply


@pytest.mark.parametrize("mode", ["SameStep", "NextStep", "Disabled"])
def test_torch_waits_for_nothing_in_a_step(cuda_scene, mode):
    """With actions on the GPU, through ends of episodes, and with statistics that are not read."""
    envs = SceneVectorEnv(Hold, 4, scene=cuda_scene, max_episode_steps=3, autoreset_mode=mode)
    envs.reset(seed=0)
    action = torch.zeros(4, 5, device="cuda")
    envs.step(action)  # makes tables that the host has to fill
    torch.cuda.set_sync_debug_mode("error")
    try:
        for _ in range(7):
            envs.step(action)
            envs.statistics.latest()
    finally:
        torch.cuda.set_sync_debug_mode("default")


def test_levels_with_params_are_the_layouts_of_their_ids(cuda_scene):
    """Fresh and replayed, made ahead; torch waits for nothing while they are chosen."""
    words: dict[str, Any] = {"scene": cuda_scene, "params": "*", "max_episode_steps": 3}
    levels = LevelReplay(
        "failure", replay_prob=0.5, refresh_interval=1, capacity=64, adr=ADR({SLIDE: [0.05, 0.06]}, queue_length=4)
    )
    envs, plain = SceneVectorEnv(Hold, 4, **words, curriculum=levels), SceneVectorEnv(Hold, 4, **words)
    envs.reset(seed=5)
    action, seen = torch.zeros(4, 5, device=envs.device), []
    for _ in range(3):
        envs.step(action)
    for _ in range(8):
        torch.cuda.set_sync_debug_mode("error")
        try:
            for _ in range(3):
                *_, info = envs.step(action)
        finally:
            torch.cuda.set_sync_debug_mode("default")
        plain.reset(options={"layouts": envs.layout_ids()})
        found, wanted = (each.randomizer.layouts.qpos for each in (envs, plain))
        assert torch.equal(found, wanted)
        seen += info["layout"]["level"].tolist()
    assert len({level for level in seen if level >= 0}) > 3


@pytest.mark.slow
@pytest.mark.parametrize("prefetch", [True, False])
@pytest.mark.parametrize("task", sorted(i for i in gymnasium.registry if i.startswith("sceniris_gym/")))
def test_no_shipped_task_waits_in_a_step(task: str, prefetch: bool):
    """With layouts made ahead and in place, through ends of episodes: nothing waits for the device."""
    envs = gymnasium.make_vec(task, num_envs=8, device="cuda:0", max_episode_steps=3, sim_config={"prefetch": prefetch})
    envs.reset(seed=0)
    action = torch.zeros(8, *envs.single_action_space.shape, device="cuda")  # pyrefly: ignore[not-iterable]
    for _ in range(4):  # with the first reset of an episode that has ended
        envs.step(action)
    torch.cuda.set_sync_debug_mode("error")
    try:
        for _ in range(7):
            envs.step(action)
    finally:
        torch.cuda.set_sync_debug_mode("default")


def test_images_have_the_same_bytes_in_any_batch_and_nearly_those_of_a_cpu(cuda_scene, make_env):
    """With graphs and without, also where few worlds are due; on a CPU few pixels differ, at edges."""
    images = {"overview": {"size": (40, 30), "data": ("rgb", "depth", "segmentation")}}
    envs = SceneVectorEnv(Reach, 3, scene=cuda_scene, images={"cameras": images, "every": 2})
    other = SceneVectorEnv(Reach, 5, scene=cuda_scene, images=images, sim_config={"graph": False})
    envs.reset(seed=[7, 8, 9])
    first, _ = envs.reset()
    other.reset(seed=[1, 9, 2, 7, 8])
    for worlds in ([3], [1, 4], [0]):
        second, _ = other.reset(options={"reset_mask": torch.isin(torch.arange(5), torch.tensor(worlds))})
    cpu = make_env(3, images=images)
    cpu.reset(seed=[7, 8, 9])
    third, _ = cpu.reset()
    for kind, image in first["images"]["overview"].items():
        assert torch.equal(image, second["images"]["overview"][kind][[3, 4, 1]])
        far = (image.cpu().float() - third["images"]["overview"][kind].float()).abs().amax(dim=3)
        assert (far > {"rgb": 8.0, "depth": 2e-3, "segmentation": 0.0}[kind]).float().mean() < 0.02, kind
