"""`SimConfig`, `RenderConfig` and `ImageConfig`: settings of an environment, which can also be given as mappings."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.config.settings import as_config
from sceniris_gym.errors import ArgumentError, check_names, check_type
from sceniris_gym.layout.masks import as_count
from sceniris_gym.pictures.context import CHANNELS, Looks, Shot
from sceniris_gym.sim.sources import check_prefetch

ROOM = ("nconmax", "njmax", "nvmax")
"""Fields of SimConfig that depend on the scene."""
_Settings = TypeVar("_Settings", bound="SimConfig | ImageConfig")
_MOST_PIXELS = 1 << 14  # along an edge
_SETTINGS = ("size", "data", "shadows", "thin")


@dataclass(frozen=True, kw_only=True)
class SimConfig:
    """Settings that change the speed and memory of an environment, not its episodes.

    Attributes:
        nconmax: Contacts per world. None leaves room for a busy scene, as in `make_worlds`.
        njmax: Constraint rows per world. None leaves room for a busy scene.
        nvmax: Maximum number of degrees of freedom that are awake in a world, if the task's `options` let bodies sleep.
            None takes the scene's number of degrees of freedom.
        graph: Capture steps and resets into graphs, and replay them.
        prefetch: If true, the next layout of every world is made during the steps before its reset. A wp.Stream does
            the same and selects the stream. None prefetches on a GPU without a layout_source. See `ResetRandomizer`.
        copy: Return observations in new tensors, which are never overwritten. If false, observations are valid only
            until the next call.

    Raises:
        ArgumentError: `nconmax`, `njmax` or `nvmax` is neither a positive integer nor None.
        ArgumentTypeError: `graph` or `copy` is not a boolean. `prefetch` has another type.
    """

    nconmax: int | None = None
    njmax: int | None = None
    nvmax: int | None = None
    graph: bool = True
    prefetch: bool | wp.Stream | None = None
    copy: bool = True

    def __post_init__(self) -> None:
        for name in ROOM:
            if getattr(self, name) is not None:
                as_count(getattr(self, name), f"sim_config: {name}")
        for name in ("graph", "copy"):
            check_type(getattr(self, name), bool, f"sim_config: {name}")
        check_prefetch(self.prefetch, "sim_config: prefetch")


@dataclass(frozen=True, kw_only=True)
class RenderConfig:
    """The pictures that `render` returns, or the web page that the render_mode "human" opens.

    Attributes:
        num_envs: Number of worlds to show, starting with world 0. None shows all worlds, as wrappers that record videos
            expect. The page shows at most 64 worlds.
        size: Width and height of a picture [pixels].
        camera: Name of the camera.

    Raises:
        ArgumentError: `num_envs` is not a positive integer. `size` is not a pair of positive integers.
        ArgumentTypeError: `camera` is not a string.
    """

    num_envs: int | None = None
    size: tuple[int, int] = (320, 240)
    camera: str = "overview"

    def __post_init__(self) -> None:
        if self.num_envs is not None:
            as_count(self.num_envs, "render_config: num_envs")
        as_size(self.size, "render_config: size")
        check_type(self.camera, str, "render_config: camera")


@dataclass(frozen=True, kw_only=True)
class ImageConfig:
    """Camera images as observations.

    Attributes:
        cameras: Images by camera: {"overview": {"size": (width, height), "data": kinds}}, with kinds out of "rgb" (the
            default), "depth" and "segmentation".
        every: Number of control steps from one image of a world to the next. Each reset takes an image and restarts the
            count. The other steps observe the latest image again.
        final: Also take images of the last state of each episode, for `final_obs`. If false, `final_obs` has no images.

    Raises:
        ArgumentError: `every` is not a positive integer.
        ArgumentTypeError: `cameras` is not a mapping. `final` is not a boolean.
    """

    cameras: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    every: int = 1
    final: bool = False

    def __post_init__(self) -> None:
        check_type(self.cameras, Mapping, "images: cameras")
        as_count(self.every, "images: every")
        check_type(self.final, bool, "images: final")


def as_settings(default: _Settings, given: Any, where: str) -> _Settings:
    """Return the given instance of settings, or the task's settings changed by the given mapping of fields.

    Args:
        default: The settings of the task.
        given: The user's settings: an instance of the same class, a mapping of its fields, or None.
        where: Name of the argument in error messages.
    """
    given = {} if given is None else given
    config = as_config(type(default), given, where)
    # pyrefly: ignore[bad-return]
    return config if config is given else replace(default, **{name: getattr(config, name) for name in given})


def as_image_config(default: ImageConfig | None, given: Any) -> ImageConfig | None:
    """Return the ImageConfig that a user gave as an ImageConfig, as a mapping of its fields, or only as its `cameras`.

    None selects the images of the task, and an empty mapping selects no images. If the given images have no cameras,
    the result has the cameras of the task. Raises the errors of `as_shots`.
    """
    if given is None or given == {}:
        return default if given is None else None
    if isinstance(given, Mapping) and "cameras" not in given and all(isinstance(v, Mapping) for v in given.values()):
        given = {"cameras": given}
    config = as_settings(default or ImageConfig(), given, "images")
    if default and not config.cameras:
        config = replace(config, cameras=default.cameras)
    as_shots(config.cameras)
    return config


def as_shots(images: Any) -> dict[str, tuple[Shot, Looks]]:
    """Return the pictures to take with each camera, from {"wrist": {"size": (84, 84), "data": ("rgb", "depth")}}.

    Raises:
        ArgumentError: The images have another form. A camera has no size or no kind of picture. A size is not an
            integer, or out of range.
        ArgumentTypeError: `shadows` or `thin` is not a boolean.
        UnknownNameError: A key or a kind of picture does not exist.
    """
    if not isinstance(images, Mapping) or not images or not all(isinstance(v, Mapping) for v in images.values()):
        form = "{'camera': {'size': (width, height), 'data': ('rgb',)}}"
        raise ArgumentError(f"images: cameras should be {form}, got {short(images)}.")
    return {str(name): _as_shot(settings, f"images[{name!r}]") for name, settings in images.items()}


def _as_shot(settings: Mapping[str, Any], where: str) -> tuple[Shot, Looks]:
    check_names("key", settings, where, _SETTINGS)
    if "size" not in settings:
        raise ArgumentError(f"{where} should have a 'size', (width, height) in pixels.")
    data = settings.get("data", ("rgb",))
    kinds = tuple(data) if isinstance(data, Collection) and not isinstance(data, str) else (data,)
    check_names("kind of picture", kinds, f"{where}['data']", CHANNELS)
    if not kinds:
        raise ArgumentError(f"{where}['data'] should have at least one of {', '.join(CHANNELS)}.")
    flags = {word: settings.get(word, False) for word in ("shadows", "thin")}
    for word, value in flags.items():
        check_type(value, bool, f"{where}['{word}']")
    return Shot(as_size(settings["size"], f"{where}['size']"), tuple(dict.fromkeys(kinds))), Looks(**flags)


def as_size(value: Any, name: str) -> tuple[int, int]:
    """Return an image size as its width and height [pixels].

    Raises:
        ArgumentError: The size is not a pair. Its width or height is not an integer, or is out of range.
    """
    try:
        width, height = value
    except (TypeError, ValueError):
        raise ArgumentError(f"{name} should be (width, height), got {short(value)}.") from None
    return as_count(width, f"{name}[0]", most=_MOST_PIXELS), as_count(height, f"{name}[1]", most=_MOST_PIXELS)
