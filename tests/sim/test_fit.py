"""A Model and Data that somebody else made: those of the scene are taken, and any others are refused by name."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.fit import check_fit, check_model
from sceniris_gym.sim.randomizer import ResetRandomizer

NWORLD = 2
MODEL = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <body name="tray" pos="0 .5 0"><joint name="slide" type="{joint}" axis="1 0 0" range="0 .2" ref="{ref}"/>
      <geom name="tray" type="box" size=".1 .1 .01" contype="{contype}"/></body>
    {bodies}
  </worldbody>
  {after}
</mujoco>
"""
SMALL = '<body name="small" pos="0 0 .1"><freejoint name="{j}"/><geom name="s" type="box" size=".02 .02 .02"/></body>'
LARGE = '<body name="large" pos=".3 0 .1"><freejoint/><geom name="l" type="box" size=".1 .1 {z}"/></body>'
TWIN = '<body name="{name}" pos="{x} 0 .5"><freejoint/><geom type="box" size=".02 .02 .02"/></body>'


def model(*bodies: str, joint: str = "slide", contype: int = 1, ref: float = 0.0, after: str = "") -> mujoco.MjModel:
    """Return a model with these free bodies, by default a small box before a large one."""
    bodies = bodies or (SMALL, LARGE)
    text = "".join(bodies).replace("{j}", "loose").replace("{z}", ".1")
    return mujoco.MjModel.from_xml_string(MODEL.format(bodies=text, joint=joint, contype=contype, ref=ref, after=after))


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the scene of that model."""
    objects = {"small": {"on": "ground"}, "large": {"on": "ground"}}
    return compile_scene({"model": model(), "objects": objects, "bank": 2}, "cpu")


def put(mjm: mujoco.MjModel) -> tuple[mjw.Model, mjw.Data]:
    """Return the model and data of worlds, as somebody else makes them."""
    with wp.ScopedDevice("cpu"):
        return mjw.put_model(mjm), mjw.make_data(mjm, NWORLD)


@pytest.mark.oldest
def test_a_model_and_data_of_somebody_else_are_taken(compiled: CompiledScene):
    """Compiled from the same MJCF on its own; masses, frictions and gains may be others, also in each world."""
    mjm = model()
    mjm.body_mass[2:] *= 3.0
    mjm.geom_friction[:, 0] = 0.1
    randomizer = ResetRandomizer(compiled, *put(mjm), mjm=mjm)
    randomizer.reset()
    expected = LayoutGenerator(compiled, NWORLD)
    expected.generate()
    np.testing.assert_array_equal(randomizer.data.qpos.numpy(), expected.layouts.qpos.numpy())


FOREIGN: dict[str, tuple[Callable[[], mujoco.MjModel], str]] = {
    "another order of bodies": (lambda: model(LARGE, SMALL), r"model\.body_pos of body 'small' is \[0\.3, 0, 0\.1\]"),
    "another joint type": (lambda: model(joint="hinge"), r"model\.jnt_type of joint 'slide' is 3, but should be 2"),
    "another size of a geom": (
        lambda: model(SMALL, LARGE.replace("{z}", ".11")),
        r"model\.geom_size of geom 'l' is \[0\.1, 0\.1, 0\.11\], but should be \[0\.1, 0\.1, 0\.1\]",
    ),
    "another type of a geom": (
        lambda: model(SMALL.replace('type="box"', 'type="sphere"'), LARGE),
        r"model\.geom_type of geom 's' is 2, but should be 6",
    ),
    "other contact bits": (lambda: model(contype=2), r"model\.geom_contype of geom 'tray' is 2, but should be 1"),
    "one more geom": (
        lambda: model(SMALL.replace("<geom", '<geom size=".01" pos="0 0 .02"/><geom'), LARGE),
        r"model\.ngeom is 5, but should be 4",
    ),
    "another reference of a joint": (
        lambda: model(ref=0.1),
        r"model\.qpos0 of joint 'slide' is 0\.1, but should be 0, as in the compiled scene",
    ),
    "another place of a joint": (
        lambda: model(SMALL, LARGE.replace("<freejoint/>", "<joint/>")),
        r"model\.nq is 9, but should be 15",
    ),
    "a pair that does not collide": (
        lambda: model(after='<contact><exclude body1="small" body2="large"/></contact>'),
        r"model\.nexclude is 1, but should be 0",
    ),
    "a pair that always collides": (
        lambda: model(after='<contact><pair geom1="s" geom2="l"/></contact>'),
        r"model\.npair is 1, but should be 0",
    ),
}


@pytest.mark.oldest
@pytest.mark.parametrize(("make", "says"), FOREIGN.values(), ids=FOREIGN.keys())
def test_a_foreign_model_is_refused(compiled: CompiledScene, make: Callable[[], mujoco.MjModel], says: str):
    """The error names the difference, and what should be there."""
    with pytest.raises(SceneMismatchError, match=says):
        ResetRandomizer(compiled, *put(make()))


def test_an_mjmodel_of_somebody_else_is_taken(compiled: CompiledScene):
    """Sizes that nothing collides with may differ: those of the ground's picture, and those a sphere has no use for."""
    mjm = model()
    mjm.geom_size[mjm.geom("ground").id] = 0.0
    check_model(compiled, mjm, "loop", "")
    with pytest.raises(SceneMismatchError, match=r"loop: the name of body 2 is 'large'.* Take another\.$"):
        check_model(compiled, model(LARGE, SMALL), "loop", "Take another.")
    ball = '<body name="ball" pos="0 0 .1"><freejoint/><geom type="sphere" size=".02"/></body>'
    mjm = model(ball)
    round_scene = compile_scene({"model": model(ball), "objects": {"ball": {"on": "ground"}}, "bank": 2}, "cpu")
    mjm.geom_size[2, 1:] = 0.5
    check_model(round_scene, mjm, "loop", "")
    mjm.geom_size[2, 0] = 0.03
    with pytest.raises(SceneMismatchError, match=r"loop: model\.geom_size of geom 2 is \[0\.03, 0\.5, 0\.5\]"):
        check_model(round_scene, mjm, "loop", "")


def test_twins_in_another_order_are_told_apart_by_their_places_and_by_their_names():
    """Boxes alike in everything but their names, of which a mujoco_warp Model has none."""
    a, b = (TWIN.format(name=name, x=x) for name, x in (("a", 0), ("b", 0.5)))
    objects = {"a": {"on": "ground"}, "b": {"on": "ground"}}
    compiled = compile_scene({"model": model(a, b), "objects": objects, "bank": 2}, "cpu")
    with pytest.raises(SceneMismatchError, match=r"model\.body_pos of body 'a'"):
        ResetRandomizer(compiled, *put(model(b, a)))
    other = model(*(TWIN.format(name=name, x=x) for name, x in (("b", 0), ("a", 0.5))))
    with pytest.raises(SceneMismatchError, match="the name of body 2 is 'b', but should be 'a'"):
        ResetRandomizer(compiled, *put(other), mjm=other)


def test_other_pairs_that_never_collide_are_told_apart():
    """As many of them, but of other bodies: layouts let the boxes overlap that this model pushes apart."""
    exclude = '<contact><exclude body1="{}" body2="large"/></contact>'
    objects = {"small": {"on": "ground"}, "large": {"on": "ground"}}
    ours = model(after=exclude.format("small"))
    compiled = compile_scene({"model": ours, "objects": objects, "bank": 2}, "cpu")
    ResetRandomizer(compiled, *put(ours))
    with pytest.raises(SceneMismatchError, match=r"model\.exclude_signature of exclude 0 is"):
        ResetRandomizer(compiled, *put(model(after=exclude.format("tray"))))


def test_all_worlds_are_compared_where_they_differ(compiled: CompiledScene):
    """A size that one world alone has; where free bodies start is no matter then."""
    m, d = put(model())
    layouts = LayoutGenerator(compiled, NWORLD).layouts
    places = np.repeat(m.body_pos.numpy(), NWORLD, axis=0)
    places[1, 2] += 1.0
    m.body_pos = wp.array(places, dtype=wp.vec3, device="cpu")
    check_fit(compiled, m, d, layouts)
    sizes = np.repeat(m.geom_size.numpy(), NWORLD, axis=0)
    sizes[1, 2, 0] = 0.03
    m.geom_size = wp.array(sizes, dtype=wp.vec3, device="cpu")
    with pytest.raises(SceneMismatchError, match=r"model\.geom_size of geom 's' in world 1 is \[0\.03"):
        check_fit(compiled, m, d, layouts)
