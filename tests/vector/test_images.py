"""Images as observations: what they show, when they are taken, and their spaces; MuJoCo's own rays are the oracle."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.pictures import context
from sceniris_gym.vector.observer import as_channels
from sceniris_gym.vector.settings import ImageConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach
from tests.vector.stepping import actions

SIZE = (32, 24)
KINDS = ("rgb", "depth", "segmentation")
IMAGES = {"overview": {"size": SIZE, "data": KINDS}}


def truth(envs: SceneVectorEnv, world: int) -> tuple[np.ndarray, np.ndarray]:
    """Return depth and body of every pixel of the camera 'overview' in a world, by rays of MuJoCo C from its state."""
    mjm, d = envs.compiled.mjm, envs.batch.data
    data = mujoco.MjData(mjm)
    data.qpos[:] = d.qpos.numpy()[world]
    data.mocap_pos[:], data.mocap_quat[:] = d.mocap_pos.numpy()[world], d.mocap_quat.numpy()[world]
    mujoco.mj_forward(mjm, data)
    camera = mjm.camera("overview").id
    eye, axes = data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3)
    width, height = SIZE
    edge = np.tan(np.radians(mjm.cam_fovy[camera]) / 2.0) / (height / 2.0)
    depth, body, hit = np.zeros((height, width)), np.zeros((height, width), int), np.zeros(1, np.int32)
    for row in range(height):
        for column in range(width):
            ray = np.array([(column + 0.5 - width / 2) * edge, (height / 2 - row - 0.5) * edge, -1.0])
            far = mujoco.mj_ray(mjm, data, eye, axes @ ray, None, 1, -1, hit, None)
            depth[row, column] = max(far, 0.0)  # in multiples of a ray that goes 1 m along the axis
            body[row, column] = mjm.geom_bodyid[hit[0]] if far > 0 else 0
    return depth, body


def assert_shown(envs: SceneVectorEnv, images: dict[str, Any], world: int) -> None:
    """Compare the pictures of a world with its state: all pixels but few at edges."""
    depth, body = truth(envs, world)
    seen = images["overview"]
    near = np.abs(np.asarray(seen["depth"])[world, ..., 0] - depth) < 2e-3
    assert near.mean() > 0.98
    owners = envs.compiled.scene.owners
    assert envs.images is not None
    names = np.array(envs.images.names)[np.asarray(seen["segmentation"])[world, ..., 0]]
    wanted = np.vectorize(lambda b: owners.get(b, ""))(body)
    assert (names == wanted).mean() > 0.98
    assert {"block", "cabinet"} <= set(wanted.flat)


def test_images_show_what_the_rays_of_mujoco_meet(make_env):
    """Depth and the object in every pixel, after a reset and after a step."""
    envs = make_env(3, images=IMAGES)
    observation, _ = envs.reset(seed=0)
    for world in range(3):
        assert_shown(envs, observation["images"], world)
    observation, *_ = envs.step(actions(3))
    assert_shown(envs, observation["images"], 1)
    rgb = observation["images"]["overview"]["rgb"].int()
    block = observation["images"]["overview"]["segmentation"][..., 0] == envs.images.names.index("block")
    assert (rgb[block][:, 0] > 2 * rgb[block][:, 1]).all()


def test_backs_of_faces_change_no_picture_from_outside(make_env, monkeypatch: pytest.MonkeyPatch):
    """Pictures are the same bytes if every hit is asked whether it is the back of a face, as for cameras inside."""
    seen = []
    for asked in (False, True):
        monkeypatch.setattr(context, "may_be_inside", lambda *_, asked=asked: asked)
        observation, _ = make_env(3, images=IMAGES).reset(seed=0)
        seen.append({kind: np.asarray(pictures) for kind, pictures in observation["images"]["overview"].items()})
    for kind in KINDS:
        np.testing.assert_array_equal(seen[0][kind], seen[1][kind], err_msg=kind)


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_the_first_image_shows_the_new_layout(make_env, mode: AutoresetMode):
    """In each mode, also where pictures are seldom taken; the worlds that go on keep theirs."""
    envs = make_env(3, images={"cameras": IMAGES, "every": 100}, autoreset_mode=mode)
    before, _ = envs.reset(seed=0)
    ends = torch.zeros(3, 5)
    ends[1, 0] = 1.0
    after, *_ = envs.step(ends)
    if mode is AutoresetMode.NEXT_STEP:
        after, *_ = envs.step(torch.zeros(3, 5))
    elif mode is AutoresetMode.DISABLED:
        after, _ = envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert_shown(envs, after["images"], 1)
    for kind, image in after["images"]["overview"].items():
        assert (image[1] != before["images"]["overview"][kind][1]).any()
        assert torch.equal(image[::2], before["images"]["overview"][kind][::2])


@pytest.mark.usefixtures("recorded")
def test_a_seed_gives_the_same_images_whatever_is_beside_it(make_env):
    """Other numbers of worlds, orders of resets, and no graph: the same bytes."""
    envs, other = make_env(3, images=IMAGES), make_env(5, images=IMAGES, sim_config={"graph": False})
    envs.reset(seed=[7, 8, 9])
    first, _ = envs.reset()
    other.reset(seed=[1, 9, 2, 7, 8])
    for worlds in ([3], [1, 4], [0]):
        mask = np.zeros(5, bool)
        mask[worlds] = True
        second, _ = other.reset(options={"reset_mask": mask})
    for kind in KINDS:
        assert torch.equal(first["images"]["overview"][kind], second["images"]["overview"][kind][[3, 4, 1]])


def test_cameras_that_are_drawn_show_what_they_see():
    """A lens of each episode, in one world as among three; an eye on the block, also one drawn to the inside."""
    eye = {"body": "block", "pos": [0, 0, 0.05], "look_at": [0, 0, 1]}
    draws = {"overview": {"fovy": {"abs": [45, 75]}}, "eye": {"pos": {"add": [[0, 0, -0.04], [0, 0, 0.04]]}}}
    config = SceneConfig.load({**SCENE, "cameras": {"eye": eye}, "randomize": {"cameras": draws}}, {"bank": 8})
    scene = compile_scene(config, "cpu")
    images = {"overview": {"size": SIZE, "data": KINDS}, "eye": {"size": (8, 8), "data": "depth"}}
    one, three = (SceneVectorEnv(Reach, n, scene=scene, images=images) for n in (1, 3))
    alone, among = (envs.reset(seed=[5, 6, 7][: envs.num_envs])[0]["images"] for envs in (one, three))
    for kind in KINDS:
        assert torch.equal(alone["overview"][kind][0], among["overview"][kind][0])
    mjm = three.compiled.mjm
    lens = mjm.cam_fovy.copy()
    for world, drawn in enumerate(three.batch.model.cam_fovy.numpy()[:, mjm.camera("overview").id]):
        mjm.camera("overview").fovy[:] = drawn  # which `truth` reads
        assert_shown(three, among, world)
    mjm.cam_fovy[:] = lens
    near = (among["eye"]["depth"] > 0.0) & (among["eye"]["depth"] < 0.1)
    assert not near.any()


def test_a_task_may_change_the_lens_of_a_camera(reach_scene):
    """As one of its fields of the model, which it names before it is bound."""

    class Zooms(Reach):
        model_fields = ("cam_fovy",)

        def on_reset(self, s: State, mask: Tensor) -> None:
            """Give the second world a narrow lens."""
            super().on_reset(s, mask)
            s.model_field("cam_fovy")[1] = 20.0

    images = SceneVectorEnv(Zooms, 2, scene=reach_scene, images=IMAGES).reset(seed=[3, 3])[0]["images"]["overview"]
    assert not torch.equal(images["depth"][0], images["depth"][1])


def test_pictures_are_taken_every_few_steps_of_a_world(make_env):
    """With 2 at the second step after a reset and not at the first, the same as those of every step."""
    often, seldom = make_env(2, images=IMAGES), make_env(2, images=ImageConfig(cameras=IMAGES, every=2))
    last = seldom.reset(seed=4)[0]["images"]["overview"]["depth"]
    often.reset(seed=4)
    for step in range(1, 5):
        given = torch.full((2, 5), 0.5)
        each, now = (envs.step(given)[0]["images"]["overview"]["depth"] for envs in (often, seldom))
        assert not torch.equal(each, last)
        assert torch.equal(now, each if step % 2 == 0 else last)
        last = now


def test_final_images_show_how_an_episode_ended(make_env):
    """On request alone; they are those of the state before the reset."""
    ends = torch.zeros(2, 5)
    ends[:, 0] = 1.0
    plain, kept, final = (
        make_env(2, images={"cameras": IMAGES, **more}, autoreset_mode=mode)
        for mode, more in (("SameStep", {}), ("Disabled", {}), ("SameStep", {"final": True}))
    )
    for envs in (plain, kept, final):
        envs.reset(seed=1)
    *_, without = plain.step(ends)
    last, *_ = kept.step(ends)
    first, *_, info = final.step(ends)
    assert "images" not in without["final_obs"]
    for kind, image in last["images"]["overview"].items():
        assert torch.equal(image, info["final_obs"]["images"]["overview"][kind])
        assert not torch.equal(image, first["images"]["overview"][kind])


def test_spaces_have_a_box_for_each_picture(make_env):
    """With bounds and types, as numpy arrays too; the pictures lie in them."""
    envs = make_env(2, images=IMAGES, output="numpy")
    observation, _ = envs.reset(seed=0)
    boxes = envs.single_observation_space["images"]["overview"]
    width, height = SIZE
    channels = {"rgb": (3, np.uint8, 255), "depth": (1, np.float32, np.inf), "segmentation": (1, np.int32, 2)}
    for kind, (number, dtype, most) in channels.items():
        assert (boxes[kind].shape, boxes[kind].dtype) == ((height, width, number), dtype)
        assert (boxes[kind].low.min(), boxes[kind].high.max()) == (0, most)
    assert envs.observation_space.contains(observation)
    assert envs.images.names == ("", "cabinet", "block")


def test_returned_images_are_not_written_to_again(make_env):
    """Unless the environment is made with copy=False, where they are the same tensors."""
    for copy in (True, False):
        envs = make_env(2, images=IMAGES, sim_config={"copy": copy})
        first = envs.reset(seed=0)[0]["images"]["overview"]["depth"]
        kept = first.clone()
        second = envs.step(torch.full((2, 5), 0.5))[0]["images"]["overview"]["depth"]
        assert torch.equal(first, kept) == copy
        assert (first.data_ptr() == second.data_ptr()) != copy


@pytest.mark.parametrize(
    ("images", "more", "error", "message"),
    [
        (["overview"], {}, ArgumentTypeError, r"images should be an ImageConfig"),
        ({"every": 2}, {}, ArgumentError, r"images: cameras should be \{'camera'.*got \{\}"),
        ({"evry": 2}, {}, UnknownNameError, r"images: unknown field 'evry'\. Did you mean 'every'"),
        ({"overview": {"size": (8, 8)}, "every": 2}, {}, UnknownNameError, r"images: unknown field 'overview'"),
        ({"cameras": {"overview": 3}}, {}, ArgumentError, r"images: cameras should be .*got \{'overview': 3\}"),
        ({"overview": {}}, {}, ArgumentError, r"images\['overview'\] should have a 'size'"),
        ({"overview": {"size": 84}}, {}, ArgumentError, r"images\['overview'\]\['size'\] should be \(width, height\)"),
        ({"overview": {"size": (0, 8)}}, {}, ArgumentError, r"images\['overview'\]\['size'\]\[0\]"),
        ({"overview": {"size": (8, 8), "data": ()}}, {}, ArgumentError, r"at least one of rgb, depth, segm"),
        ({"overview": {"size": (8, 8), "data": "rbg"}}, {}, UnknownNameError, r"'rbg'.*Did you mean 'rgb'"),
        ({"overview": {"size": (8, 8), "data": None}}, {}, UnknownNameError, r"kind of picture 'None'.*rgb"),
        ({"overview": {"sise": (8, 8)}}, {}, UnknownNameError, r"'sise'.*Did you mean 'size'"),
        ({"overview": {"size": (8, 8), "thin": 1}}, {}, ArgumentTypeError, r"images\['overview'\]\['thin'\] should be"),
        ({"overwiev": {"size": (8, 8)}}, {}, UnknownNameError, r"camera 'overwiev'.*Did you mean 'overview'"),
        ({"cameras": IMAGES, "every": 0}, {}, ArgumentError, r"images: every"),
    ],
)
def test_wrong_words_are_refused(make_env, images: Any, more: dict[str, Any], error: type, message: str):
    """With the argument, and what would be right."""
    with pytest.raises(error, match=message):
        make_env(1, images=images, **more)


def test_no_pictures_are_no_channels():
    """Refused by name, rather than by torch."""
    with pytest.raises(ArgumentError, match="as_channels: pictures should have at least one kind"):
        as_channels({})
