"""Layouts of stacks: all of them stand, and those that would fall are rejected as `falls`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import box_mjcf, compile_on_cpu, make, read
from tests.layout.sizes import sizes
from tests.oracle.balance import Balance
from tests.oracle.stack_judge import STILL, StackJudge

_LAYOUTS = 64
ROOT = Path(__file__).parents[3]


def tower(folder: Path, **words: Any) -> CompiledScene:
    """Compile the scene of four cubes of 5 cm on each other."""
    cube = box_mjcf(folder, "cube", 0.05, 0.05, 0.05)
    objects = {
        name: {"asset": cube, "on": below, **(words if below != "floor" else {})}
        for below, name in (("floor", "a"), ("a", "b"), ("b", "c"), ("c", "d"))
    }
    return compile_on_cpu({"floor": {"size": [1, 1]}, "attempts": 100, "objects": objects}, bank=8)


def moving(compiled: CompiledScene, generator: LayoutGenerator) -> np.ndarray:
    """Return which layouts have something that moves in MuJoCo C, shape (nworld,)."""
    rows, judge, nmocap = read(generator.layouts), StackJudge(compiled.mjm), compiled.mjm.nmocap
    far = [judge.moves(rows.qpos[i], rows.mocap_pos[i][:nmocap], rows.mocap_quat[i][:nmocap]) for i in range(_LAYOUTS)]
    return np.max(far, axis=1) > STILL


def test_a_tower_stands(tmp_path: Path):
    """In no layout a cube moves by 1 cm, or falls by statics, and many candidates are rejected for each that is not."""
    compiled = tower(tmp_path)
    generator = LayoutGenerator(compiled, _LAYOUTS)
    generator.generate()
    assert (generator.layouts.status.numpy() == LayoutStatus.VALID).all()
    assert not moving(compiled, generator).any()
    assert Balance(Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)).falling(generator.table()) == []
    counts = generator.rejection_counts()
    assert counts["a"]["falls"] == 0
    assert min(counts[name]["falls"] for name in "bcd") > 0


def test_what_is_on_a_variant_stands(tmp_path: Path):
    """Half of the places on a cube of one of two sizes are too near its edge; where the cube is does not matter."""
    sizes = {
        f"side{side}": {"asset": box_mjcf(tmp_path, f"c{side}", side / 100, side / 100, side / 100)} for side in (5, 6)
    }
    objects = {"low": {"variants": sizes, "on": "floor"}, "top": {"asset": sizes["side5"]["asset"], "on": "low"}}
    compiled = compile_on_cpu({"floor": {"size": [2, 2]}, "attempts": 10, "objects": objects}, bank=8)
    generator = LayoutGenerator(compiled, _LAYOUTS)
    generator.generate()
    assert generator.layouts.first_pass_valid.numpy().mean() > 0.9
    assert not moving(compiled, generator).any()
    counts = generator.rejection_counts()
    assert 0 < counts["top/@low:side6"]["falls"] < counts["top/@low:side5"]["falls"] < _LAYOUTS


def test_a_tower_of_hulls_stands_and_is_not_hard_to_make():
    """The scene whose rate is measured: nothing moves, and most layouts come about in the first restart."""
    compiled = compile_on_cpu(str(ROOT / "benchmarks" / "five_blocks.yaml"), bank=8)
    generator = LayoutGenerator(compiled, _LAYOUTS)
    generator.generate()
    assert not moving(compiled, generator).any()
    assert generator.layouts.first_pass_valid.numpy().mean() > 0.4


def test_a_tower_that_may_fall_does(tmp_path: Path):
    """With `stands: false` there is neither a test nor a count, and most towers fall."""
    compiled = tower(tmp_path, stands=False)
    assert compiled.statics is None
    generator = LayoutGenerator(compiled, _LAYOUTS)
    generator.generate()
    assert moving(compiled, generator).mean() > 0.5
    assert "falls" not in generator.rejection_counts()["b"]


@pytest.mark.parametrize("size", ["7-3-100-1", "64-512-100-3", "4096-64-0-3"])
def test_the_size_of_a_search_changes_nothing(tmp_path: Path, size: str):
    """All layouts keep their bits."""
    compiled = tower(tmp_path)
    small = make(compiled, 16, size=sizes("cpu")["1-3-0-1"])
    assert make(compiled, 16, size=sizes("cpu")[size]).bits() == small.bits()


def test_contact_margins_are_no_fall(tmp_path: Path):
    """Cubes that MuJoCo carries from 1 cm on stand as others do, although they are put down that high."""
    cube = '<geom name="{}" type="box" size=".025 .025 .025" margin=".005"/>'
    bodies = "".join(f'<body name="{n}" pos="{i} 0 2"><freejoint/>{cube.format(n)}</body>' for i, n in enumerate("ab"))
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    scene = {"model": spec, "floor": {"size": [1, 1]}, "objects": {"a": {"on": "floor"}, "b": {"on": "a"}}}
    compiled = compile_on_cpu(scene, bank=8)
    generator = LayoutGenerator(compiled, _LAYOUTS)
    generator.generate()
    assert generator.layouts.first_pass_valid.numpy().mean() > 0.9
    assert not moving(compiled, generator).any()


DRUM = """<mujoco><worldbody><body name="drum" pos="0 0 1"><freejoint/><geom type="cylinder" size="{r} .04"/></body>
  <body name="box" pos="9 0 1"><freejoint/>{top}</body></worldbody></mujoco>"""
_BOX = '<geom type="box" size="{w} {w} {h}"/>'
_TEE = _BOX + '<geom type="box" size="{w} {w} .004" pos="0 0 {h}"/>'


@pytest.mark.parametrize(
    ("radius", "top"),
    [(0.02, _BOX.format(w=0.02, h=0.02)), (0.3, _BOX.format(w=0.08, h=0.04)), (0.3, _TEE.format(w=0.2, h=0.1))],
    ids=["small", "large", "two geoms"],
)
def test_what_hangs_over_a_round_rim_stands(radius: float, top: str):
    """On drums of 4 cm and 60 cm, of 512 boxes the 64 that are farthest out stand in MuJoCo C."""
    spec = mujoco.MjSpec.from_string(DRUM.format(r=radius, top=top))
    scene = {"model": spec, "floor": {"size": [2, 2]}, "objects": {"drum": {"on": "floor"}, "box": {"on": "drum"}}}
    compiled = compile_on_cpu(scene, bank=8)
    rows, judge = make(compiled, 512), StackJudge(compiled.mjm)
    off = np.linalg.norm(rows.qpos[:, 7:9] - rows.qpos[:, :2], axis=1)
    far = np.argsort(-off)[:_LAYOUTS]
    assert off[far].min() > 0.5 * radius
    nothing = np.zeros((0, 3)), np.zeros((0, 4))
    assert [i for i in far if judge.moves(rows.qpos[i], *nothing).max() > STILL] == []


POST = """<mujoco><option timestep=".004"/><default><geom solref=".03 1.2"/></default><asset>{mesh}</asset><worldbody>
  <body name="post" pos="0 0 1"><freejoint/><geom type="box" size=".03 .027 .042" density="2600"/></body>
  <body name="top" pos="9 0 1"><freejoint/>{top}</body></worldbody></mujoco>"""
_RING = [(0.016 * np.cos(0.25 * np.pi * i), 0.016 * np.sin(0.25 * np.pi * i)) for i in range(8)]
_OCTAGON = " ".join(f"{x:.6f} {y:.6f} {z}" for z in (-0.012, 0.012) for x, y in _RING)
_END = '<geom type="ellipsoid" size=".02 .03 .02" pos="{} 0 0"/>'


@pytest.mark.parametrize(
    ("mesh", "top"),
    [
        (f'<mesh name="octagon" vertex="{_OCTAGON}"/>', '<geom type="mesh" mesh="octagon" density="2900"/>'),
        ("", _END.format(-0.06) + _END.format(0.06)),
    ],
    ids=["a foot with eight corners", "two round feet"],
)
def test_what_hangs_over_a_straight_edge_stands(mesh: str, top: str):
    """MuJoCo drops some of more than four corners, and between two feet there is nothing."""
    spec = mujoco.MjSpec.from_string(POST.format(mesh=mesh, top=top))
    scene = {"model": spec, "floor": {"size": [2, 2]}, "objects": {"post": {"on": "floor"}, "top": {"on": "post"}}}
    try:
        compiled = compile_on_cpu(scene, bank=8)
    except InfeasibleSceneError:  # it would always fall
        assert not mesh
        return
    rows, judge = make(compiled, 4096), StackJudge(compiled.mjm)
    off = np.linalg.norm(rows.qpos[:, 7:9] - rows.qpos[:, :2], axis=1)
    nothing = np.zeros((0, 3)), np.zeros((0, 4))
    assert [i for i in np.argsort(-off)[: 4 * _LAYOUTS] if judge.moves(rows.qpos[i], *nothing).max() > STILL] == []


ROLLING = """<mujoco><worldbody><body name="ball" pos="0 0 1"><freejoint/>
  <inertial pos="0 0 -.02" mass="{mass}" diaginertia="1e-3 1e-3 1e-3"/><geom type="sphere" size=".04"/>
  <geom type="box" size=".06 .06 .005" pos="0 0 .045"/></body>
  <body name="brick" pos="9 0 1"><freejoint/><geom type="box" size=".03 .03 .02" mass=".2"/></body>
  </worldbody></mujoco>"""


def test_a_load_may_not_make_a_curved_foot_roll_over():
    """A ball that is heavy below carries a brick near its middle; a light one carries it nowhere."""
    objects = {"ball": {"on": "floor"}, "brick": {"on": "ball"}}
    scenes = [
        {"model": mujoco.MjSpec.from_string(ROLLING.format(mass=mass)), "floor": {"size": [1, 1]}, "objects": objects}
        for mass in (2, 0.1)
    ]
    compiled = compile_on_cpu(scenes[0], bank=8)
    generator = LayoutGenerator(compiled, _LAYOUTS)
    generator.generate()
    assert generator.rejection_counts()["brick"]["falls"] > 0
    assert not moving(compiled, generator).any()
    with pytest.raises(InfeasibleSceneError, match="'brick' could not be placed, mostly because of falls"):
        compile_on_cpu(scenes[1])


def test_what_leans_with_gravity_needs_a_wider_foot():
    """A slab of 30 cm on 6 mm falls where gravity leans by 0.9 degrees, and one on 20 mm stands everywhere."""
    body = '<body name="slab"><freejoint/><geom type="box" size="{} .05 .15"/></body>'
    text = f'<mujoco><option gravity=".154 0 -9.81"/><worldbody>{body}</worldbody></mujoco>'
    scene = {"floor": {"size": [1, 1]}, "objects": {"slab": {"on": "floor"}}}
    compiled = compile_on_cpu({"model": mujoco.MjSpec.from_string(text.format(0.01)), **scene}, bank=8)
    generator = LayoutGenerator(compiled, _LAYOUTS)
    generator.generate()
    assert (generator.layouts.status.numpy() == LayoutStatus.VALID).all()
    assert not moving(compiled, generator).any()
    with pytest.raises(InfeasibleSceneError, match="falls"):
        compile_on_cpu({"model": mujoco.MjSpec.from_string(text.format(0.003)), **scene}, bank=8)
