"""Pictures: the camera sees everything, tiles are where their captions are, and what is drawn is what is there."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.pictures.layout_picture import _seen, captioned, contact_sheet, render, save
from sceniris_gym.scene.layout_table import LayoutTable
from tests.commands.scenes import MODEL, layout, small_model, with_row


def model_with_camera() -> mujoco.MjModel:
    """Return the small scene with the camera that scenes have."""
    spec = mujoco.MjSpec.from_string(MODEL)
    spec.worldbody.add_camera(name="overview", fovy=40.0)
    return spec.compile()


def test_pictures_show_where_things_are():
    """A red gem moves from the left to the right; its red pixels do so too."""
    mjm = model_with_camera()
    rows = with_row(layout(mjm, 2, gem=(-0.4, -0.3, 0.0, 0)), 1, layout(mjm, gem=(0.4, -0.3, 0.0, 0)))
    pictures = render(mjm, rows, size=(120, 90), device="cpu").astype(int)
    assert pictures.shape == (2, 90, 120, 3)
    red = (
        (pictures[..., 0] > 60) & (pictures[..., 0] > 2 * pictures[..., 1]) & (pictures[..., 0] > 2 * pictures[..., 2])
    )
    columns = [np.flatnonzero(picture.any(0)).mean() for picture in red]
    assert columns[0] < 50 < 70 < columns[1]


def test_absent_objects_do_not_move_the_camera_away():
    """The boxes that the camera sees of all layouts of `clutter_extract` are less than 5 m apart."""
    compiled = compile_scene("clutter_extract", "cpu")
    generator = LayoutGenerator(compiled, 4)
    generator.generate()
    _, corners = _seen(compiled.mjm, generator.table())
    assert np.ptp(corners, axis=0).max() < 5.0


def test_a_large_ground_does_not_move_the_camera_away():
    """A plane of 40 m under a scene of 1 m; a plane that is all there is stays in the picture."""
    text = "<mujoco><worldbody><geom name='ground' type='plane' size='20 20 1'/>BOX</worldbody></mujoco>"
    for box, most in (("<geom type='box' size='.5 .5 .5'/>", 1.1), ("", 41.0)):
        mjm = mujoco.MjModel.from_xml_string(text.replace("BOX", box))
        rows = LayoutTable.from_states(
            mjm.qpos0[None], np.zeros((1, 0, 3)), np.zeros((1, 0, 4)), np.zeros((1, 0), bool)
        )
        _, corners = _seen(mjm, rows)
        assert 0.9 * most < np.ptp(corners, axis=0).max() < most


def test_a_room_does_not_move_the_camera_away():
    """Walls of 6 m around a scene of 1 m, which nothing touches, are not framed. A visual goal of an object is."""
    wall = "<body><geom type='box' size='3 .1 1.5' pos='0 3 1.5' contype='0' conaffinity='0'/></body>"
    goal = "<body mocap='true' pos='.8 0 0'><geom type='sphere' size='.1' contype='0' conaffinity='0'/></body>"
    text = f"<mujoco><worldbody><geom type='box' size='.5 .5 .5'/>{wall}{goal}</worldbody></mujoco>"
    mjm = mujoco.MjModel.from_xml_string(text)
    at, turn = np.array([[[0.8, 0.0, 0.0]]]), np.array([[[1.0, 0.0, 0.0, 0.0]]])
    _, corners = _seen(mjm, LayoutTable.from_states(mjm.qpos0[None], at, turn, np.zeros((1, 0), bool)))
    np.testing.assert_allclose(np.ptp(corners, axis=0), [1.4, 1.0, 1.0])


def test_a_model_without_the_camera_is_refused():
    """The error names the camera that is missing."""
    with pytest.raises(UnknownNameError, match="overview"):
        render(small_model(), layout(small_model()))


def test_a_contact_sheet_has_every_picture_and_is_written_whole(tmp_path: Path):
    """Tiles keep their colours and order; the file is a PNG, and there is nothing beside it."""
    pictures = np.stack([np.full((30, 40, 3), 10 * i, np.uint8) for i in range(6)])
    sheet = contact_sheet(pictures, [f"world {i}" for i in range(6)])
    save(sheet, tmp_path / "sheets" / "sheet.png")
    pixels = np.asarray(Image.open(tmp_path / "sheets" / "sheet.png"))
    assert [path.name for path in (tmp_path / "sheets").iterdir()] == ["sheet.png"]
    height, width = pixels.shape[0] // 2, pixels.shape[1] // 4
    middles = [pixels[(i // 4) * height + 20, (i % 4) * width + 25, 0] for i in range(6)]
    assert middles == [0, 10, 20, 30, 40, 50]


@pytest.mark.parametrize(("number", "columns", "rows"), [(3, 3, 1), (16, 4, 4), (17, 5, 4), (64, 8, 8)])
def test_many_pictures_make_a_square(number: int, columns: int, rows: int):
    """Rows of four up to 16 pictures; 64 pictures are not four columns of 16."""
    sheet = contact_sheet(np.zeros((number, 90, 120, 3), np.uint8), ["a"] * number)
    assert (sheet.width // 120, sheet.height // (90 + 22)) == (columns, rows)


def test_a_single_row_is_drawn_larger():
    """One world fills a sheet of its own."""
    mjm = model_with_camera()
    one, two = (captioned(mjm, layout(mjm, n), ["a"] * n, device="cpu").size for n in (1, 2))
    assert one[0] == pytest.approx(two[0], abs=10)
    assert one[1] > 1.5 * two[1]


@pytest.mark.cuda
def test_a_gpu_draws_the_same_pictures():
    """The same rows on both devices differ by rounding at edges only."""
    mjm = model_with_camera()
    cpu, gpu = (render(mjm, layout(mjm, 2), size=(120, 90), device=d).astype(int) for d in ("cpu", "cuda:0"))
    assert np.mean(np.abs(cpu - gpu) > 8) < 0.01
