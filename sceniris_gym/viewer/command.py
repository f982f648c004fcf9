"""The `view` and `play` commands, which show a scene or a policy on a page until Ctrl-C."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sceniris_gym.collecting import uncollected
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.viewer.server import import_ahead

if TYPE_CHECKING:
    import viser

_KERNELS = "The first start compiles kernels, which takes a minute or two."


def view_scene(
    server: viser.ViserServer, scene: str, changes: Mapping[str, Any], *, split: str, seed: int, episode: int, num: int
) -> None:
    """Show the layouts of a scene on a page until Ctrl-C.

    Args:
        server: The viser server of the page.
        scene: Name of a shipped scene, or the path of a scene file.
        changes: Dotted keys and values that replace values in the scene file.
        split: Split of the first layouts, "train" or "eval".
        seed: Seed of the first world.
        episode: Episode of all worlds.
        num: Number of worlds.
    """
    print(f"Open the page in a browser to see '{scene}'. Ctrl-C closes the page.", file=sys.stderr, flush=True)
    with uncollected():
        drawing = import_ahead()
        from sceniris_gym.config.loader import read_scene, shipped
        from sceniris_gym.device.kernel_log import start_warp
        from sceniris_gym.viewer.deck import Where
        from sceniris_gym.viewer.scene_file import SceneFile
        from sceniris_gym.viewer.view import SceneView

        start_warp()
        drawing.join()
    view = SceneView(server, SceneFile(scene, changes), Where(split, seed, episode), num)
    if scene not in shipped("envs", ".yaml") and not Path(scene).expanduser().is_file():
        read_scene(scene)  # raises an error with the reason
    view.load()
    while True:
        view.tick()


def view_env(
    server: viser.ViserServer,
    env: str,
    policy: str | None,
    ids: Sequence[str],
    *,
    num: int,
    split: str | None,
    device: str | None,
    changes: Mapping[str, Any],
    trust: bool = False,
) -> None:
    """Show on a page how a policy plays an environment, until Ctrl-C.

    Args:
        server: The viser server of the page.
        env: Name or id of a registered environment.
        policy: Name of the policy for `policy_of`, or None for random actions.
        ids: Ids of the layouts to play. If empty, the layouts have the seeds 0, 1, 2, ...
        num: Number of worlds.
        split: Split of the layouts. If None, the split of the first id, or "train".
        device: Device of the simulation, or None for the default.
        changes: Dotted keys and values that replace values in the scene file.
        trust: Passed to `policy_of`.
    """
    print(f"Open the page in a browser to see '{env}'. Ctrl-C closes the page.", file=sys.stderr, flush=True)
    import gymnasium

    import sceniris_gym  # noqa: F401, registers the environments
    from sceniris_gym.device.kernel_log import start_warp
    from sceniris_gym.layout.layout_id import LayoutId
    from sceniris_gym.progress import listening
    from sceniris_gym.training.task_scenes import registered_id
    from sceniris_gym.viewer.env_view import EnvView, policy_of

    start_warp()
    try:
        spec = gymnasium.spec(registered_id(env))
    except gymnasium.error.Error as error:
        raise ArgumentError(f"--env {env}: {error}") from None
    said = server.gui.add_markdown(f"**{env}** is being compiled. {_KERNELS}")

    def tell(what: str, done: int, total: int) -> None:
        said.content = f"**{env}** is being compiled ({what}: {done} of {total}). {_KERNELS}"

    shown = LayoutId.parse(ids[0]).split if ids and split is None else split or "train"
    kwargs = {"split": shown, "device": device, "overrides": dict(changes), "autoreset_mode": "Disabled"}
    with listening(tell):
        envs: Any = gymnasium.make_vec(spec, num_envs=num, **kwargs).unwrapped
    plays = None if policy is None else policy_of(policy, envs.device, trust=trust)
    said.remove()
    view = EnvView(server, envs, plays, ids)
    while True:
        view.tick()


def play(server: viser.ViserServer, name: str) -> None:
    """Show on a page how a shipped policy plays its task, until Ctrl-C. MuJoCo C simulates the only world.

    Args:
        server: The viser server of the page.
        name: Name of a shipped policy, which is the name of its scene.

    Raises:
        UnknownNameError: There is no such policy.
        SceneMismatchError: The policy belongs to another version of the scene.
    """
    print(f"Open the page in a browser to see '{name}'. Ctrl-C closes the page.", file=sys.stderr, flush=True)
    said = server.gui.add_markdown(f"**{name}** is being loaded.")
    from sceniris_gym.config.loader import shipped
    from sceniris_gym.device.kernel_log import start_warp
    from sceniris_gym.viewer.env_view import EnvView, policy_of
    from sceniris_gym.viewer.played import PlayedWorld

    start_warp()
    check_names("policy", [name], "play", files := shipped("envs", ".pt"))
    world: Any = PlayedWorld(files[name])
    view = EnvView(server, world, policy_of(str(files[name])), world.ids)
    said.remove()
    while True:
        view.tick()
