"""A scene in a zip file: nothing in it leads out of the folder that it is unpacked in, and stock MuJoCo opens it."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.archive import write_zip
from sceniris_gym.scene.build import build_model

MESH = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("form", ["part.obj", "../part.obj", "{folder}/part.obj", "../other/part.obj"])
def test_members_have_names_of_their_own(tmp_path: Path, form: str):
    """Whatever the user's MJCF calls its meshes, and they stay what they are."""
    home = tmp_path / "home"
    file = form.format(folder=tmp_path)
    for folder in (home, tmp_path / "other"):
        folder.mkdir()
    (home / file).resolve().write_text(MESH)
    (home / "thing.xml").write_text(
        f'<mujoco><asset><mesh name="part" file="{file}"/></asset><worldbody><body name="thing">'
        '<geom type="mesh" mesh="part"/></body></worldbody></mujoco>'
    )
    objects = {"thing": {"asset": str(home / "thing.xml"), "on": "floor"}}
    scene = build_model(SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects}))
    written = io.BytesIO()
    write_zip(scene.spec, written)
    for name in zipfile.ZipFile(written).namelist():
        assert ".." not in name.split("/")
        assert not name.startswith("/")
    written.seek(0)
    again = mujoco.MjSpec.from_zip(written).compile()
    np.testing.assert_allclose(again.mesh_vert, scene.mjm.mesh_vert, atol=1e-7)
