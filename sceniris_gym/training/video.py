"""Videos of the first worlds of an environment while a policy plays (extra `video`)."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from torch import Tensor

from sceniris_gym.errors import import_extra
from sceniris_gym.files import replacing
from sceniris_gym.vector.settings import RenderConfig
from sceniris_gym.vector.vector_env import SceneVectorEnv

COLUMNS = 4
"""Number of columns and rows of the grid of worlds."""
PICTURES = RenderConfig(num_envs=COLUMNS**2, size=(240, 180))
"""The pictures of the worlds."""


@contextmanager
def filming(path: Path, envs: SceneVectorEnv, captions: Sequence[str] = ()) -> Iterator[Callable[[Tensor], None]]:
    """Write a video with a grid of the first worlds, and yield a function that adds a frame in real time.

    The function takes booleans of shape (num_envs,), and waits for the device. Where the boolean is False, the frame
    keeps the last picture of the world, because the episode to be shown has ended.

    Args:
        path: The .mp4 file.
        envs: Environment with the render_mode "rgb_array" and the `PICTURES`.
        captions: Texts for the pictures of the first worlds.

    Raises:
        OutputError: The file cannot be written.
        MissingExtraError: imageio-ffmpeg is not installed.
    """
    ffmpeg, (width, height) = import_extra("imageio_ffmpeg", "video", "imageio-ffmpeg"), PICTURES.size
    tiles = np.zeros((COLUMNS, COLUMNS, height, width, 3), np.uint8)
    size, options = (COLUMNS * width, COLUMNS * height), {"output_params": ["-f", "mp4"]}
    with (
        replacing(path) as file,
        closing(ffmpeg.write_frames(str(file), size, fps=envs.metadata["render_fps"], **options)) as writer,
    ):
        writer.send(None)

        def add(running: Tensor) -> None:
            for i, picture in enumerate(envs.render() or ()):
                if running[i]:
                    drawn = Image.fromarray(picture)
                    ImageDraw.Draw(drawn).text((4, 4), "".join(captions[i : i + 1]), "black")
                    tiles[divmod(i, COLUMNS)] = np.asarray(drawn)
            writer.send(np.ascontiguousarray(tiles.swapaxes(1, 2)))

        yield add
