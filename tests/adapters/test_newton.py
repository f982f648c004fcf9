"""Layouts in Newton's states: the poses that plain MuJoCo-Warp has, no contacts, and nothing else is touched.

Newton needs MuJoCo 3.17, so this runs in a venv of its own, on a GPU if there is one: `make test-newton`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import (
    ArgumentError,
    ArgumentTypeError,
    NotSupportedError,
    SceneMismatchError,
    UnknownNameError,
)
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.randomizer import ResetRandomizer

newton: Any = pytest.importorskip("newton", reason="needs Newton: make test-newton")
from sceniris_gym.adapters.newton import NewtonRandomizer  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "newton.md"
DEVICE = str(wp.get_preferred_device())
WORLDS = 5
DT = 0.005
REGION = {"box": [[-0.25, -0.25], [0.25, 0.25]]}
ROOM = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <body name="cabinet" pos=".6 0 0" mocap="true">
      <geom name="case" type="box" size=".1 .1 .1" pos="0 0 .1"/>
    </body>
    <body name="chest" pos="-.6 0 .1" euler="0 0 30">
      <geom name="box" type="box" size=".1 .1 .1"/>
      <body name="drawer" pos="0 .1 .15" euler="0 0 20">
        <joint name="slide" type="slide" axis="1 0 0" ref=".02" range="0 .2" pos=".01 0 0"/>
        <geom name="tray" type="box" size=".1 .1 .01"/>
      </body>
      <body name="door" pos=".3 0 .2">
        <joint name="hinge" type="hinge" axis="0 0 1" pos="0 .1 0" range="-1 1"/>
        <geom name="leaf" type="box" size=".01 .1 .1"/>
      </body>
    </body>
    <body name="brick" pos="0 0 .2" euler="0 0 30">
      <freejoint/><geom type="box" size=".03 .02 .04" pos=".01 0 .005"/>
    </body>
    <body name="ball" pos="0 .2 .2"><freejoint/><geom type="sphere" size=".03"/></body>
  </worldbody>
</mujoco>
"""


BODIES = ("cabinet", "chest", "brick", "ball")
SCENE = {
    "objects": {
        "worldbody_cabinet": {"kind": "fixture", "on": "worldbody/ground_6", "region": REGION},
        "worldbody_chest": {
            "kind": "fixture",
            "on": "worldbody/ground_6",
            "region": {"box": [[-0.9, -0.9], [-0.3, 0.9]]},
            "joints": {"worldbody_chest_drawer_slide": {"range": [0.05, 0.15]}},
        },
        "worldbody_brick": {"on": "worldbody_chest/worldbody_chest_drawer"},
        "worldbody_ball": {"on": "worldbody/ground_6", "region": REGION},
        "puck": {"on": "worldbody/ground_6", "region": REGION},
    },
    "bank": 2,
}


def room(worlds: int = WORLDS, **spread: Any) -> tuple[Any, Any]:
    """Return Newton's model and solver of a room, in which anchors of joints are not the frames of bodies."""
    world = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(world)
    world.add_mjcf(ROOM)
    puck = world.add_link(xform=wp.transform(wp.vec3(0.0, -0.2, 0.2), wp.quat_identity()), label="puck")
    world.add_shape_box(puck, hx=0.02, hy=0.03, hz=0.01)
    anchors = [
        wp.transform(wp.vec3(*pos), wp.quat_from_axis_angle(wp.normalize(wp.vec3(*axis)), angle))
        for pos, axis, angle in (((0.1, 0.2, 0.3), (1.0, 2.0, 0.5), 0.7), ((0.02, 0.0, 0.01), (0.0, 1.0, 1.0), -1.1))
    ]
    joint = world.add_joint_free(puck, parent_xform=anchors[0], child_xform=anchors[1])
    world.add_articulation([joint])
    builder = newton.ModelBuilder()
    builder.replicate(world, worlds, **spread)
    model = builder.finalize(device=DEVICE)
    return model, newton.solvers.SolverMuJoCo(model)


@pytest.fixture
def parts() -> tuple[Any, Any, CompiledScene]:
    """A room, its solver and its scene."""
    model, solver = room()
    return model, solver, compile_scene({"model": solver.mj_model, **SCENE}, DEVICE)


def poses(model: Any, solver: Any, state: Any) -> np.ndarray:
    """Return the poses of MuJoCo's bodies as Newton has them: position and wxyz, shape (nworld, nbody - 1, 7)."""
    body_q = state.body_q.numpy()[solver.mjc_body_to_newton.numpy()[:, 1:]]
    return body_q[..., [0, 1, 2, 6, 3, 4, 5]]


def plain(compiled: CompiledScene, mjm: mujoco.MjModel, episodes: list[int], seed: int) -> Any:
    """Return MuJoCo-Warp's data with the layouts of these episodes, without Newton."""
    m, d = mjw.put_model(mjm), mjw.make_data(mjm, nworld=len(episodes))
    ResetRandomizer(compiled, m, d, seed=seed).reset(
        layouts={"seed": [seed + i for i in range(len(episodes))], "episode": episodes}
    )
    return d


def assert_equal_poses(found: np.ndarray, d: Any) -> None:
    """Positions within 10 micrometres, and orientations, whose quaternions may differ in their sign."""
    np.testing.assert_allclose(found[..., :3], d.xpos.numpy()[:, 1:], atol=1e-5)
    along = np.abs((found[..., 3:] * d.xquat.numpy()[:, 1:]).sum(axis=-1))
    np.testing.assert_allclose(along, 1.0, atol=1e-6)


def test_bodies_stand_where_plain_mujoco_warp_has_them(parts: tuple[Any, Any, CompiledScene]):
    """With fixed roots, drawn joints with a reference, and free joints between anchors; in all states, at rest."""
    model, solver, compiled = parts
    states = model.state(), model.state()
    for state in states:
        state.joint_qd.fill_(3.0)
    randomizer = NewtonRandomizer(compiled, model, solver, *states, seed=4)
    for episode in range(2):
        randomizer.reset()
        d = plain(compiled, solver.mj_model, [episode] * WORLDS, 4)
        for state in states:
            assert_equal_poses(poses(model, solver, state), d)
            assert not state.joint_qd.numpy().any() and not state.body_qd.numpy().any()
    assert randomizer.layouts.episode.cpu().numpy().tolist() == [1] * WORLDS


def test_the_solver_starts_from_the_layout_without_contacts(parts: tuple[Any, Any, CompiledScene]):
    """Its own data, which a step fills from the state, by MuJoCo C; then it falls as without Newton."""
    model, solver, compiled = parts
    states, control = (model.state(), model.state()), model.control()
    randomizer = NewtonRandomizer(compiled, model, solver, *states, seed=4)
    randomizer.reset()
    solver.step(states[0], states[1], control, None, 1e-6)
    mjm, data = solver.mj_model, mujoco.MjData(solver.mj_model)
    for world in range(WORLDS):
        for name in ("qpos", "mocap_pos", "mocap_quat"):
            getattr(data, name)[:] = getattr(solver.mjw_data, name).numpy()[world]
        mujoco.mj_fwdPosition(mjm, data)
        assert not [contact.dist for contact in data.contact if contact.dist < 0.0]
    d = plain(compiled, mjm, [0] * WORLDS, 4)
    m = mjw.put_model(mjm)
    m.opt.timestep.fill_(DT)
    for _ in range(2):
        solver.step(states[1], states[0], control, None, DT)
        solver.step(states[0], states[1], control, None, DT)
        mjw.step(m, d)
        mjw.step(m, d)
    mjw.kinematics(m, d)
    found, free = poses(model, solver, states[1]), [mjm.body(f"worldbody_{name}").id for name in ("brick", "ball")]
    np.testing.assert_allclose(found[:, np.array(free) - 1, :3], d.xpos.numpy()[:, free], atol=1e-4)


def test_other_worlds_keep_their_bits(parts: tuple[Any, Any, CompiledScene]):
    """In the middle of a fall: states, the model, and what the solver carries from step to step."""
    model, solver, compiled = parts
    states, control = (model.state(), model.state()), model.control()
    randomizer = NewtonRandomizer(compiled, model, solver, *states, seed=4)
    randomizer.reset()
    for _ in range(5):
        solver.step(states[0], states[1], control, None, DT)
        solver.step(states[1], states[0], control, None, DT)

    def everything() -> dict[str, np.ndarray]:
        found = {f"{i}.{name}": getattr(state, name) for i, state in enumerate(states) for name in OF_STATE}
        found |= {name: getattr(solver.mjw_data, name) for name in OF_DATA} | {"joint_X_p": model.joint_X_p}
        return {name: array.numpy().copy().reshape(WORLDS, -1) for name, array in found.items()}

    before = everything()
    randomizer.reset(np.array([False, True, False, False, True]))
    after, others = everything(), [0, 2, 3]
    assert not [name for name in before if before[name][others].tobytes() != after[name][others].tobytes()]
    same = {name for name in before if np.array_equal(before[name][[1, 4]], after[name][[1, 4]])}
    assert same <= {"qpos", "qvel", "ctrl", "act"}  # of the solver's data, which the next step fills
    assert not after["qacc_warmstart"][[1, 4]].any()
    assert randomizer.layouts.episode.cpu().numpy().tolist() == [0, 1, 0, 0, 1]
    assert_equal_poses(poses(model, solver, states[0])[[1, 4]], part(plain(compiled, solver.mj_model, [1] * 5, 4)))


OF_STATE = ("joint_q", "joint_qd", "body_q", "body_qd")
OF_DATA = ("qpos", "qvel", "qacc_warmstart", "ctrl", "act")


def part(d: Any) -> Any:
    """Return the second and the last world of data."""
    return type("Part", (), {name: wp.array(getattr(d, name).numpy()[[1, 4]]) for name in ("xpos", "xquat")})


def played(parts: tuple[Any, Any, CompiledScene], captured: bool) -> np.ndarray:
    """Return the poses of all bodies after each reset and after the steps that follow, in one graph or without.

    The first axis is the replay, the second before a reset, after it, and after the steps.
    """
    model, solver, compiled = parts
    states, control = (model.state(), model.state()), model.control()
    randomizer = NewtonRandomizer(compiled, model, solver, *states, seed=4)
    randomizer.reset()
    mask, start, rows = wp.zeros(WORLDS, dtype=wp.bool, device=DEVICE), wp.clone(states[0].body_q), []

    def turn() -> None:
        randomizer.reset(mask)
        wp.copy(start, states[0].body_q)
        solver.step(states[0], states[1], control, None, DT)
        solver.step(states[1], states[0], control, None, DT)

    if captured:
        with wp.ScopedCapture(DEVICE) as capture:
            turn()
    for values in MASKS:
        mask.assign(values)
        before = states[0].body_q.numpy().copy()
        wp.capture_launch(capture.graph) if captured else turn()  # pyrefly: ignore[unbound-name]
        rows.append([before, start.numpy().copy(), states[0].body_q.numpy().copy()])
    assert randomizer.layouts.episode.cpu().numpy().tolist() == [1, 0, 2, 1, 0]
    return np.reshape(rows, (len(MASKS), 3, WORLDS, -1))


MASKS = [[True, False, True, False, False], [False, False, True, True, False]]


def test_a_captured_reset_gives_the_same_states(parts: tuple[Any, Any, CompiledScene]):
    """In one graph with the step, with a mask that changes between replays.

    Resets have the same bits with a graph and without, and leave those of other worlds. So have steps on a CPU; on a
    GPU, where steps sum in any order, they are as near each other as those of two runs without a graph.
    """
    plain, captured = played(parts, captured=False), played(parts, captured=True)
    for values, rows, others in zip(np.array(MASKS), plain, captured, strict=True):
        assert np.array_equal(rows[1][values], others[1][values])
        for before, start, _ in (rows, others):
            assert np.array_equal(before[~values], start[~values])
            assert not np.array_equal(before[values], start[values])
    spread = 0.0 if DEVICE == "cpu" else max(1e-6, 10.0 * np.abs(plain - played(parts, captured=False)).max())
    np.testing.assert_allclose(captured, plain, rtol=0.0, atol=spread)


def test_layouts_made_ahead_are_those_made_in_place(parts: tuple[Any, Any, CompiledScene]):
    """Reset after reset, of some worlds and of all."""
    model, solver, compiled = parts
    found = []
    for prefetch in (False, True):
        state = model.state()
        randomizer = NewtonRandomizer(compiled, model, solver, state, seed=4, prefetch=prefetch)
        assert (randomizer.pipeline.ahead is not None) == prefetch
        for step in range(4):
            randomizer.reset(np.arange(WORLDS) % (step + 1) == 0)
            found.append(state.joint_q.numpy().copy())
    np.testing.assert_array_equal(found[:4], found[4:])


def test_chosen_worlds_get_the_layouts_of_ids(parts: tuple[Any, Any, CompiledScene]):
    """In the order of the worlds, by ids or by seeds and episodes; others keep their bits, and episodes go on."""
    model, solver, compiled = parts
    state = model.state()
    randomizer = NewtonRandomizer(compiled, model, solver, state, seed=4)
    starts, ids = [], []
    for _ in range(3):
        randomizer.reset()
        starts.append(state.joint_q.numpy().reshape(WORLDS, -1).copy())
        ids.append(randomizer.pipeline.ids("train"))
    randomizer.reset([3, 1], layouts=[ids[0][2], ids[1][4]])
    joint_q = state.joint_q.numpy().reshape(WORLDS, -1)
    # bodies with a mocap root have no joint_q, so a world takes the joints of any other world
    assert np.array_equal(joint_q[[3, 1]], [starts[0][2], starts[1][4]])
    assert np.array_equal(joint_q[[0, 2, 4]], starts[2][[0, 2, 4]])
    randomizer.reset([3, 1])
    assert np.array_equal(state.joint_q.numpy().reshape(WORLDS, -1)[[3, 1]], [starts[1][2], starts[2][4]])
    randomizer.reset(layouts={"seed": randomizer.layouts.seed, "episode": 0})
    assert [name.rsplit(":", 2)[1:] for name in randomizer.pipeline.ids("train")] == [
        [str(seed), "0"] for seed in (4, 8, 6, 6, 8)
    ]
    name = "objects.worldbody_ball.region"
    with pytest.raises(SceneMismatchError, match="belongs to scene"):
        randomizer.reset([1], layouts="a:train:0:0")
    with pytest.raises(UnknownNameError, match=f"unknown param '{name}'"):
        randomizer.reset([1], layouts=f"{ids[0][0]}:{name}={'00000000' * 4}")


def test_params_of_a_generator_narrow_the_next_layouts(parts: tuple[Any, Any, CompiledScene]):
    """In the chosen worlds, from their next reset on, and again by ids. Other worlds have no params."""
    model, solver, compiled = parts
    name, state = "objects.worldbody_ball.region", model.state()
    with pytest.raises(UnknownNameError, match="unknown param"):
        NewtonRandomizer(compiled, model, solver, state).pipeline.set_params({name: REGION["box"]})
    source = LayoutGenerator(compiled, WORLDS, seed=4, params=name)
    randomizer = NewtonRandomizer(compiled, model, solver, state, layout_source=source)
    ball = solver.mj_model.body("worldbody_ball").id - 1

    def starts() -> tuple[Any, list[str]]:
        found = poses(model, solver, state)[:, ball, :2]
        return (np.abs(found) <= 0.0501).all(axis=1), randomizer.pipeline.ids("train")

    randomizer.reset()
    randomizer.pipeline.set_params({name: [[-0.05, -0.05], [0.05, 0.05]]}, [1, 3])
    randomizer.reset()
    narrow, ids = starts()
    assert narrow[[1, 3]].all() and not narrow[[0, 2, 4]].all()
    assert [one.count("=") for one in ids] == [0, 1, 0, 1, 0]
    joint_q = state.joint_q.numpy().copy()
    randomizer.pipeline.set_params({name: REGION["box"]})
    randomizer.reset()
    assert not starts()[0][[1, 3]].all() and not any("=" in one for one in starts()[1])
    randomizer.reset(layouts=ids)
    assert np.array_equal(state.joint_q.numpy(), joint_q) and starts()[1] == ids


def test_conditions_park_bodies_of_newton():
    """The brick is absent with the chest, and the puck without the ball; all are where MuJoCo-Warp has them."""
    model, solver = room()
    objects = {**SCENE["objects"], "puck": {**SCENE["objects"]["puck"], "if": "worldbody_ball"}}
    groups = {
        "some": {"of": ["worldbody_chest", "pair"], "count": [0, 2]},
        "pair": {"of": ["worldbody_ball"], "count": 1},
    }
    compiled = compile_scene({"model": solver.mj_model, **SCENE, "objects": objects, "groups": groups}, DEVICE)
    state = model.state()
    randomizer = NewtonRandomizer(compiled, model, solver, state, seed=3)
    for episode in range(3):
        randomizer.reset()
        found = poses(model, solver, state)
        assert_equal_poses(found, plain(compiled, solver.mj_model, [episode] * WORLDS, 3))
        there = dict(zip(compiled.slots, randomizer.layouts.present.cpu().numpy().T == 1, strict=True))
        for name in compiled.slots:
            near = np.abs(found[:, compiled.scene.bodies[name] - 1, 0]) < 3.0
            np.testing.assert_array_equal(near, there[name], err_msg=name)
        np.testing.assert_array_equal(there["worldbody_brick"], there["worldbody_chest"])
        np.testing.assert_array_equal(there["puck"], there["worldbody_ball"])
    assert len(np.unique(randomizer.layouts.present.cpu().numpy(), axis=0)) > 1


def test_several_supports_are_refused():
    """By the name of the object, with a remedy: all worlds share one model."""
    model, solver = room()
    objects = {"apple": {"asset": "apple", "on": ["floor", "shelf"]}, "shelf": {"asset": "table", "kind": "static"}}
    other = compile_scene({"floor": {"size": [2, 2]}, "objects": objects, "bank": 2}, DEVICE)
    with pytest.raises(SceneMismatchError, match=r"objects\.apple has variants or several supports.*name one support"):
        NewtonRandomizer(other, model, solver, model.state())


def test_words_of_randomize_are_refused():
    """By the name of the first, as nothing draws them here."""
    model, solver = room()
    ball = {**SCENE["objects"]["worldbody_ball"], "randomize": {"mass": {"scale": [0.5, 2.0]}}}
    drawn = {"model": solver.mj_model, "objects": {"worldbody_ball": ball}, "bank": 2}
    with pytest.raises(NotSupportedError, match=r"'randomize' \(worldbody_ball\.mass\), .* Remove it"):
        NewtonRandomizer(compile_scene(drawn, DEVICE), model, solver, model.state())


def test_other_models_are_refused():
    """Worlds that differ or are apart, a solver on MuJoCo C, an unknown start, and arguments of other types."""
    model, solver = room()
    compiled = compile_scene({"model": solver.mj_model, **SCENE}, DEVICE)
    apart, apart_solver = room(spacing=(2.0, 0.0, 0.0))
    with pytest.raises(SceneMismatchError, match=r"NewtonRandomizer: model\.body_pos of .*without spacing"):
        NewtonRandomizer(compiled, apart, apart_solver, apart.state())
    sizes = model.shape_scale.numpy()
    sizes[len(sizes) // WORLDS * 2 + 1] *= 1.5  # a thing in the world 2
    model.shape_scale.assign(sizes)
    solver.notify_model_changed(newton.ModelFlags.SHAPE_PROPERTIES)
    with pytest.raises(SceneMismatchError, match=r"model\.geom_size of geom '.*' in world 2"):
        NewtonRandomizer(compiled, model, solver, model.state())
    model, solver = room()
    start = model.joint_q.numpy()
    start[int(model.joint_q_start.numpy()[model.joint_label.index("worldbody/chest/door/hinge")])] = 0.5
    model.joint_q.assign(start)
    without = {name: words for name, words in SCENE["objects"].items() if name in ("worldbody_ball", "puck")}
    small = compile_scene({"model": solver.mj_model, "objects": without, "bank": 2}, DEVICE)
    with pytest.raises(SceneMismatchError, match=r"joint 'worldbody/chest/door/hinge' starts at \[0\.5\].* \[0\.0\]"):
        NewtonRandomizer(small, model, solver, model.state())
    on_cpu = newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True, separate_worlds=True)
    with pytest.raises(ArgumentError, match="use_mujoco_cpu=False"):
        NewtonRandomizer(compiled, model, on_cpu, model.state())
    model, solver = room()
    for args, name in (((model, solver), "states"), ((solver, model, model.state()), "model")):
        with pytest.raises(ArgumentTypeError, match=rf"NewtonRandomizer: {name} should be a"):
            NewtonRandomizer(compiled, *args)
    other, _ = room(2)
    with pytest.raises(ArgumentError, match=r"solver should be a SolverMuJoCo of the model"):
        NewtonRandomizer(compiled, model, room()[1], model.state())
    with pytest.raises(ArgumentError, match=r"each state should come from model\.state\(\) of the same model"):
        NewtonRandomizer(compiled, model, solver, model.state(), other.state())
    with pytest.raises(SceneMismatchError, match=r"NewtonRandomizer: layout_source makes layouts for 2 worlds"):
        NewtonRandomizer(compiled, model, solver, model.state(), layout_source=LayoutGenerator(compiled, 2))
    with pytest.raises(ArgumentError, match=r"shape \(5,\)"):
        NewtonRandomizer(compiled, model, solver, model.state()).reset(np.ones(3, bool))


def test_the_program_of_the_page_runs():
    """As it stands, with fewer worlds and steps, and resets that come sooner."""
    program, narrowing = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    lines = program.splitlines()
    assert len(lines) <= 40
    about = [line for line in lines if re.search("sceniris|region|things|compiled|randomizer", line)]
    assert len(about) == 8  # as the page says
    for before, after in (("4096", "6"), ("range(1000)", "range(20)"), ("100 == 99", "10 == 9")):
        assert before in program
        program = program.replace(before, after)
    names: dict[str, Any] = {}
    exec(compile(program, "newton.md", "exec"), names)
    assert names["randomizer"].layouts.episode.cpu().numpy().tolist() == [2] * 6
    exec(compile(narrowing, "newton.md", "exec"), names)
    names["randomizer"].reset()
    assert names["randomizer"].layouts.param[0].tolist() == pytest.approx([-0.1, -0.1, 0.1, 0.1])
