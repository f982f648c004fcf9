"""The `settle` command: a file of heaps, and what is asked for wrongly."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sceniris_gym import cli
from sceniris_gym.commands.settle import settle
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, UnknownNameError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.scene.heaping import THINGS, folder, words


def test_rows_are_written_where_the_scene_names_them(tmp_path: Path, capfd: pytest.CaptureFixture):
    """Relative to the scene file, which can be compiled then."""
    scene = words(folder(), rows=None)
    scene["heaps"]["pile"]["rows"] = "rows.npz"
    (tmp_path / "scene.yaml").write_text(json.dumps(scene))
    cli.main(["settle", str(tmp_path / "scene.yaml"), "--rows", "2", "--json"])
    found = json.loads(capfd.readouterr().out)
    assert found == {"heap": "pile", "things": list(THINGS), "rows": 2, "file": str(tmp_path / "rows.npz")}
    plan = build_plan(build_model(SceneConfig.load(tmp_path / "scene.yaml")))
    assert [len(o.heap.pos) for o in plan.objects if o.heap is not None] == [2, 2, 2]


def test_what_is_asked_for_wrongly_is_an_error():
    """No file, no heap of that name, none at all."""
    config = SceneConfig.load(words(folder(), rows=None))
    with pytest.raises(NotSupportedError, match=r"no file to write. Give -o ROWS\.npz, or heaps\.pile\.rows"):
        settle(config, None, 1, None, 0)
    with pytest.raises(UnknownNameError, match=r"unknown heap 'pil'\. Did you mean 'pile'"):
        settle(config, "pil", 1, None, 0)
    with pytest.raises(NotSupportedError, match="Give --heap NAME"):
        settle(SceneConfig.load("mid"), None, 1, None, 0)
