"""The views of the `view` and `play` commands, which show a scene or a policy on a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sceniris_gym.collecting import uncollected
from sceniris_gym.errors import check_names
from sceniris_gym.viewer.server import import_ahead

if TYPE_CHECKING:
    import viser

    from sceniris_gym.viewer.env_view import EnvView
    from sceniris_gym.viewer.view import SceneView

_KERNELS = "The first start compiles kernels, which takes a minute or two."


def view_scene(
    server: viser.ViserServer, scene: str, changes: Mapping[str, Any], device: str, num: int, **where: Any
) -> SceneView:
    """Show the layouts of a scene on a page, and return the view. Its `tick` handles the user's requests.

    Args:
        server: The viser server of the page.
        scene: Name of a shipped scene, or the path of a scene file.
        changes: Dotted keys and values that replace values in the scene file.
        device: Device on which layouts are made.
        num: Number of worlds.
        where: Split ("train" or "eval") of the first layouts, seed of the first world, and episode of all worlds.
    """
    with uncollected():
        drawing = import_ahead()
        from sceniris_gym.config.loader import read_scene, scene_files
        from sceniris_gym.device.kernel_log import start_warp
        from sceniris_gym.viewer.deck import Where
        from sceniris_gym.viewer.scene_file import SceneFile
        from sceniris_gym.viewer.view import SceneView

        start_warp()
        drawing.join()
    view = SceneView(server, SceneFile(scene, changes, device), Where(**where), num)
    if not scene_files(scene):
        read_scene(scene)  # raises an error with the reason
    view.load()
    return view


def view_env(
    server: viser.ViserServer, env: str, policy: str | None, ids: Sequence[str], *, trust: bool = False, **options: Any
) -> EnvView:
    """Show on a page how a policy plays an environment, and return the view.

    Args:
        server: The viser server of the page.
        env: Name or id of a registered environment.
        policy: Name of the policy for `policy_of`, or None for random actions.
        ids: Ids of the layouts to play. If empty, the layouts have the seeds 0, 1, 2, ...
        trust: Passed to `policy_of`.
        options: Arguments of the environment, such as `num_envs`, `device` and `overrides`. If the `split` is None, it
            is the split of the first id, or "train".
    """
    import gymnasium

    import sceniris_gym  # noqa: F401, registers the environments
    from sceniris_gym.device.kernel_log import start_warp
    from sceniris_gym.layout.layout_id import LayoutId
    from sceniris_gym.layout.params import params_in
    from sceniris_gym.progress import listening
    from sceniris_gym.training.policies import policy_of
    from sceniris_gym.training.task_scenes import spec_of
    from sceniris_gym.viewer.env_view import EnvView

    start_warp()
    spec = spec_of(env, f"--env {env}")
    said = server.gui.add_markdown(f"**{env}** is being compiled. {_KERNELS}")

    def tell(what: str, done: int, total: int) -> None:
        said.content = f"**{env}** is being compiled ({what}: {done} of {total}). {_KERNELS}"

    found = [LayoutId.parse(name) for name in ids]
    options["split"] = options.get("split") or (found[0].split if ids else "train")
    options |= {"params": names} if (names := sorted({name for one in found for name in params_in(one.params)})) else {}
    with listening(tell):
        envs: Any = gymnasium.make_vec(spec, autoreset_mode="Disabled", **options).unwrapped
    plays = None if policy is None else policy_of(policy, envs.device, trust=trust)
    said.remove()
    return EnvView(server, envs, plays, ids)


def play(server: viser.ViserServer, name: str) -> EnvView:
    """Show on a page how a shipped policy plays its task, and return the view. MuJoCo C simulates the only world.

    Args:
        server: The viser server of the page.
        name: Name of a shipped policy, which is the name of its scene.

    Raises:
        UnknownNameError: There is no such policy.
        SceneMismatchError: The policy belongs to another version of the scene.
    """
    said = server.gui.add_markdown(f"**{name}** is being loaded.")
    from sceniris_gym.config.loader import shipped
    from sceniris_gym.device.kernel_log import start_warp
    from sceniris_gym.training.policies import policy_of
    from sceniris_gym.viewer.env_view import EnvView
    from sceniris_gym.viewer.played import PlayedWorld

    start_warp()
    check_names("policy", [name], "play", files := shipped("envs", ".pt"))
    world: Any = PlayedWorld(files[name])
    said.remove()
    return EnvView(server, world, policy_of(str(files[name])), world.ids)
