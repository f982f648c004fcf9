"""Scenes of other packages as they come: what it takes to place things in them, judged by MuJoCo C.

    pip download --no-deps -d wheels metaworld gymnasium-robotics dm-control robosuite mjlab
    for wheel in wheels/*.whl; do unzip -q -o "$wheel" -d foreign; done
    pip install --no-deps --target foreign numba llvmlite termcolor opencv-python-headless    # what robosuite imports
    python -m tests.stress.foreign_scenes foreign        # 10,000 layouts of each scene

Only files are read, but of robosuite, which puts its models together in Python: its own code makes and compiles them,
and they are handed over in memory, with the arm at qpos0. Its controllers need a MuJoCo before 3.11 and do not run.
mjlab does the same, but needs MuJoCo 3.11; here its model is put together by MuJoCo's own `attach`. Of every layout the
deepest contact counts in which something takes part that was placed.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
import tyro

from sceniris_gym import SceneConfig, compile_scene
from sceniris_gym.errors import ScenirisError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.model_files import load_model

NWORLD = 1000
DEEP = 1e-4
"""Depth [m] above which a contact is a penetration."""
METAWORLD = "metaworld/assets/sawyer_xyz/sawyer_"
ROBOTICS = "gymnasium_robotics/envs/assets/"
SUITE = "dm_control/suite/"
SCENES = {
    f"{METAWORLD}pick_place_v3.xml": """
        objects:
          obj: {on: tablelink, region: {box: [[-0.3, -0.2], [0.3, 0.2]]}}
    """,
    f"{METAWORLD}bin_picking.xml": """
        objects:
          bin_start: {kind: fixture, on: tablelink, region: {box: [[-0.3, -0.1], [-0.1, 0.2]]}, orientation: fixed}
          bin_goal: {kind: fixture, on: tablelink, region: {box: [[0.1, -0.1], [0.3, 0.2]]}, orientation: fixed}
          obj: {on: bin_start/binA}
    """,
    f"{METAWORLD}shelf_placing.xml": """
        objects:
          shelf: {kind: fixture, on: tablelink, region: {box: [[-0.2, 0.1], [0.2, 0.25]]}, orientation: fixed}
          obj: {on: tablelink, region: {box: [[-0.3, -0.3], [0.3, 0.3]]}}
    """,
    f"{METAWORLD}assembly_peg.xml": """
        objects:
          peg: {kind: fixture, on: tablelink, region: {box: [[-0.3, 0.0], [0.3, 0.25]]}}
          RoundNut: {on: tablelink, region: {box: [[-0.3, -0.2], [0.3, 0.2]]}}
    """,
    f"{METAWORLD}sweep_tool.xml": """
        objects:
          club: {on: tablelink, region: {box: [[-0.3, -0.2], [0.3, 0.2]]}}
          obj: {on: tablelink, relations: [{near: club, distance: {max: 0.3}}]}
    """,
    f"{METAWORLD}drawer.xml": """
        objects:
          drawer:
            kind: fixture
            on: tablelink
            region: {box: [[-0.2, 0.1], [0.2, 0.25]]}
            orientation: {yaw: [-10, 10]}
            joints: {"*": {fraction: [0.0, 0.8]}}
    """,
    f"{ROBOTICS}fetch/pick_and_place.xml": """
        objects:
          object0: {on: table0}
    """,
    f"{ROBOTICS}fetch/slide.xml": """
        objects:
          object0: {on: table0}
    """,
    f"{ROBOTICS}hand/manipulate_block.xml": """
        objects:
          object: {region: {box: [[0.9, 0.8, 0.22], [1.1, 0.95, 0.4]]}, orientation: any}
          target: {region: {box: [[0.9, 0.8, 0.22], [1.1, 0.95, 0.4]]}, orientation: any}
    """,
    f"{ROBOTICS}kitchen_franka/kitchen_assets/kitchen_env_model.xml": """
        objects:
          kettle: {on: ovenroot}
    """,
    f"{SUITE}dog.xml": """
        objects:
          ball: {on: floor, region: {box: [[-1, -1], [1, 1]]}}
    """,
    f"{SUITE}humanoid.xml": """
        objects:
          torso: {region: {box: [[-2, -2, 0.1], [2, 2, 0.5]]}, joints: {"*knee*": {fraction: [0.2, 0.8]}}}
    """,
    f"{SUITE}fish.xml": """
        objects:
          torso: {region: {box: [[-0.4, -0.4, 0.3], [0.4, 0.4, 1.2]]}, orientation: any}
    """,
    "robosuite/Lift": """
        objects:
          cube_main: {on: table}
    """,
    "robosuite/Stack": """
        objects:
          cubeA_main: {on: table}
          cubeB_main: {on: table, relations: [{near: cubeA_main, distance: {max: 0.2}}]}
    """,
    "robosuite/NutAssembly": """
        objects:
          SquareNut_main: {on: table}
          RoundNut_main: {on: table}
    """,
    "robosuite/PickPlace": """
        objects:
          Milk_main: {on: bin1}
          Bread_main: {on: bin1}
          Cereal_main: {on: bin1, clearance: 0.01}
          Can_main: {on: bin1}
    """,
    "robosuite/ToolHang": """
        objects:
          stand_root: {on: table}
          frame_root: {on: table}
          tool_root: {on: table}
    """,
    "mjlab": """
        home: init_state
        objects:
          a: {body: cube_0/cube, on: terrain, region: {box: [[0.25, -0.15], [0.4, 0.15]]}}
          b: {body: cube_1/cube, on: terrain, region: {box: [[0.25, -0.15], [0.4, 0.15]]}}
          c: {body: cube_2/cube, on: terrain, region: {box: [[0.25, -0.15], [0.4, 0.15]]}}
          d: {body: cube_3/cube, on: terrain, region: {box: [[0.25, -0.15], [0.4, 0.15]]}}
    """,
}
"""What is written for each model, by its path or package; `model: PATH` is one line more."""


@dataclass(frozen=True)
class Arguments:
    """Folder of the unpacked wheels, and extent of the measurement."""

    folder: Annotated[Path, tyro.conf.Positional]
    layouts: int = 10_000
    only: str = ""
    """Only models whose path has this in it."""


class _CompiledError(Exception):
    """Ends the constructor of an environment of robosuite once its model is there."""


def robosuite_model(folder: Path, task: str) -> mujoco.MjModel:
    """Return the model of a task of robosuite with a Panda, as its environment compiles it."""
    if str(folder) not in sys.path:
        sys.path.append(str(folder))  # after what is installed
    environments = importlib.import_module("robosuite.environments.base").REGISTERED_ENVS

    class Environment(environments[task]):
        def _initialize_sim(self, xml_string: str | None = None) -> None:
            super()._initialize_sim(xml_string)
            raise _CompiledError(self.sim.model._model)

    try:
        Environment(robots="Panda", has_renderer=False, has_offscreen_renderer=False, use_camera_obs=False)
    except _CompiledError as compiled:
        return compiled.args[0]
    raise AssertionError(f"robosuite's {task} compiled no model")


def mjlab_model(folder: Path) -> mujoco.MjModel:
    """Return a plane with mjlab's robot for manipulation and four cubes of its task."""
    spec = mujoco.MjSpec.from_file(str(folder / "mjlab/scene/scene.xml"))
    terrain = spec.worldbody.add_body(name="terrain")
    terrain.add_geom(name="terrain", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.01])
    arm = load_model(folder / "mjlab/asset_zoo/robots/i2rt_yam/xmls/yam.xml", "mjlab")
    spec.attach(arm, prefix="robot/", frame=spec.worldbody.add_frame(pos=[0, 0, 0.01]))
    for i in range(4):
        cube = spec.worldbody.add_body(name=f"cube_{i}/cube")
        cube.add_freejoint()
        cube.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02] * 3, mass=0.05)
    pose = [0.0, 1.047, 1.05, -0.9, 0.0, 0.0, 0.01875, -0.01875]
    spec.add_key(name="init_state", qpos=pose + [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0] * 4)
    return spec.compile()


COMPOSED: dict[str, Callable[[Path], mujoco.MjModel]] = {
    **{path: partial(robosuite_model, task=Path(path).name) for path in SCENES if path.startswith("robosuite/")},
    "mjlab": mjlab_model,
}
"""How models come about that are handed over in memory."""


def compiled_scene(path: str, words: str, folder: Path, scratch: Path) -> CompiledScene:
    """Compile a scene as its user does: from a file with a path in it, or with a model in memory."""
    lines = [line[8:] for line in words.strip("\n").rstrip().splitlines()]
    file = scratch / "scene.yaml"
    if path in COMPOSED:
        file.write_text("\n".join(lines))
        return compile_scene(SceneConfig.load(file, {"model": COMPOSED[path](folder)}), "cpu")
    file.write_text("\n".join([f"model: {(folder / path).resolve()}", *lines]))
    return compile_scene(file, "cpu")


def depths(compiled: CompiledScene, qpos: np.ndarray, mocap_pos: np.ndarray, mocap_quat: np.ndarray) -> np.ndarray:
    """Return the deepest contact [m] of anything that was placed, for each layout, by MuJoCo C."""
    scene, mjm = compiled.scene, compiled.mjm
    placed = {body for name in compiled.placed for body in scene.subtree(name)}
    data, found = mujoco.MjData(mjm), np.zeros(len(qpos))
    for row in range(len(qpos)):
        data.qpos[:] = qpos[row]
        data.mocap_pos[:], data.mocap_quat[:] = mocap_pos[row, : mjm.nmocap], mocap_quat[row, : mjm.nmocap]
        mujoco.mj_fwdPosition(mjm, data)
        for contact in data.contact:
            bodies = {int(mjm.geom_bodyid[geom]) for geom in contact.geom}
            if bodies & placed and not _within(scene, compiled.placed, bodies):
                found[row] = max(found[row], -contact.dist)
    return found


def _within(scene: Any, placed: tuple[str, ...], bodies: set[int]) -> bool:
    """Return whether a contact is of parts of one object, which are as its maker has them."""
    return any(bodies <= set(scene.subtree(name)) for name in placed)


def main(arguments: Arguments) -> int:
    """Print a row for each scene, and return 1 if one cannot be placed or is penetrated."""
    failed = False
    print(
        "| scene | placed | lines of YAML | seconds to compile | layouts | from the bank | over 0.1 mm | deepest [mm] |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for path, words in SCENES.items():
        if arguments.only not in path:
            continue
        count = len(words.strip().splitlines()) + (path not in COMPOSED)
        started = time.perf_counter()
        try:
            with tempfile.TemporaryDirectory() as scratch:
                compiled = compiled_scene(path, words, arguments.folder, Path(scratch))
        except ScenirisError as error:
            print(f"| {path} | refused: {error} | {count} | | | | | |", flush=True)
            failed = True
            continue
        seconds = time.perf_counter() - started
        generator = LayoutGenerator(compiled, NWORLD)
        found, fallbacks = [], 0
        while sum(map(len, found)) < arguments.layouts:
            generator.generate()
            rows = generator.layouts
            found.append(depths(compiled, rows.qpos.numpy(), rows.mocap_pos.numpy(), rows.mocap_quat.numpy()))
            fallbacks += int((rows.status.numpy() != 1).sum())
        depth = np.concatenate(found)
        failed |= bool((depth > DEEP).any())
        print(
            f"| {path} | {', '.join(compiled.placed)} | {count} | {seconds:.1f} | {len(depth)} | {fallbacks} | "
            f"{int((depth > DEEP).sum())} | {1000.0 * depth.max():.3f} |",
            flush=True,
        )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(tyro.cli(Arguments, description=__doc__)))
