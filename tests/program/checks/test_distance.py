"""Scenes far from the origin: refused by name where single precision would decide, else left alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.scene.build import build_model

CRATE = '<body name="crate"><freejoint/><geom type="box" size=".05 .05 .05"/></body>'


def _upload(folder: Path, bodies: str, objects: dict[str, Any], **words: Any) -> None:
    path = folder / "own.xml"
    path.write_text(f"<mujoco><worldbody>{bodies}{CRATE}</worldbody></mujoco>")
    scene = {"model": str(path), "floor": {"size": [1, 1]}, "objects": objects, **words}
    upload_scene(build_model(SceneConfig.load(scene)), "cpu")


def _slab(half: float, at: str = "0 0 -1") -> str:
    return f'<body name="slab" pos="{at}"><geom name="top" type="box" size="{half} {half} 1"/></body>'


def test_a_support_of_five_kilometres_needs_a_region(tmp_path: Path):
    """An object on it could get as far as it reaches; a region near the origin does not cure its corners."""
    objects = {"slab": {"kind": "static"}, "crate": {"on": "slab"}}
    with pytest.raises(SceneKeyError, match=r"objects\.crate\.on: 'slab' reaches 400 m .* within 100 m .* 'region'"):
        _upload(tmp_path, _slab(400), objects)
    near = {"region": {"box": [[-1, -1], [1, 1]]}}
    _upload(tmp_path, _slab(400), {**objects, "crate": {"on": "slab", **near}})
    with pytest.raises(SceneKeyError, match=r"geom 'top': reaches 2500 m .* Use a plane"):
        _upload(tmp_path, _slab(2500), {**objects, "crate": {"on": "slab", **near}})


@pytest.mark.parametrize(("half", "fits"), [(100, True), (101, False)])
def test_a_support_may_reach_as_far_as_a_floor(tmp_path: Path, half: float, fits: bool):
    """To 100 m along each axis."""
    objects = {"slab": {"kind": "static"}, "crate": {"on": "slab"}}
    if fits:
        _upload(tmp_path, _slab(half), objects)
    else:
        with pytest.raises(SceneKeyError, match="should be placed within 100 m"):
            _upload(tmp_path, _slab(half), objects)


def test_a_scene_built_far_away_is_refused(tmp_path: Path):
    """A support, an anchor or a robot at 5 km, each by its name; the sides of the origin are all the same."""
    with pytest.raises(SceneKeyError, match=r"objects\.slab: stands at \(5000, 0, -1\) m"):
        _upload(tmp_path, _slab(1, "5000 0 -1"), {"slab": {"kind": "static"}, "crate": {"on": "slab"}})
    with pytest.raises(SceneKeyError, match=r"objects\.slab: stands at \(0, -5000, -1\) m"):
        _upload(tmp_path, _slab(1, "0 -5000 -1"), {"slab": {"kind": "static"}, "crate": {"on": "floor"}})
    with pytest.raises(SceneKeyError, match=r"robot\.base\.2: 5000 should be from -100 to 100 m"):
        _upload(tmp_path, "", {}, robot={"asset": "panda", "base": [0, 0, 5000]})


def test_what_is_placed_near_may_come_from_far_away(tmp_path: Path):
    """A free body that the model keeps far away stands wherever it is placed."""
    far = CRATE.replace('"crate"', '"other" pos="5000 0 0"')
    _upload(tmp_path, far, {"other": {"on": "floor"}})
    with pytest.raises(SceneKeyError, match=r"objects\.other: stands at"):
        _upload(tmp_path, far, {"other": {}})


def test_what_nothing_can_meet_is_left_alone(tmp_path: Path):
    """A house at 5 km that is no object; the same house with a wing that comes near is refused."""
    _upload(tmp_path, _slab(1, "5000 0 0"), {"crate": {"on": "floor"}})
    with pytest.raises(SceneKeyError, match="geom 'top': reaches"):
        _upload(tmp_path, _slab(4990, "5000 0 -1"), {"crate": {"on": "floor"}})


def test_what_is_placed_ends_near_its_own_origin(tmp_path: Path):
    """A geom at 1e8 m cancels against the object's place, and leaves a rest of metres."""
    far = CRATE.replace('"crate"', '"other"').replace("/></body>", '/><geom size=".01" pos="0 90000 0"/></body>')
    with pytest.raises(SceneKeyError, match=r"objects\.other: geom .* reaches 9e\+04 m .* within 100 m"):
        _upload(tmp_path, far, {"other": {"on": "floor"}})


def test_limits_that_are_no_limits_are_not_drawn_from(tmp_path: Path):
    """A fraction of [-1e30, 1e30] is a number of no meaning."""
    arm = '<body name="arm"><joint name="turn" limited="true" range="-1e30 1e30"/><geom size=".01"/></body>'
    turned = {"joints": {"turn": {"fraction": [0, 1]}}, "kind": "static"}
    with pytest.raises(SceneKeyError, match=r"objects\.arm\.joints: 'arm/turn' is drawn between -1.* from -100 to 100"):
        _upload(tmp_path, arm.replace('name="turn"', 'name="arm/turn"'), {"arm": turned})


def test_a_plane_has_no_end(tmp_path: Path):
    """Wherever its middle is: only its height and slope are used."""
    _upload(tmp_path, '<geom type="plane" size="1 1 .1" pos="5000 0 -1"/>', {"crate": {"on": "floor"}})
