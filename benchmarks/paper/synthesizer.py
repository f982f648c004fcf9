"""Scene Synthesizer on our meshes: the program that the paper speeds up, in one process and in one for each core."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import trimesh
from trimesh.transformations import euler_from_matrix, quaternion_from_matrix, quaternion_matrix

from sceniris_gym.audit.geometry import Form, solids_of
from sceniris_gym.errors import MissingExtraError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable

_OBJECTS = ("cabinet", "apple", "banana")
_JOINTS = ("upper", "lower")


def check_installed() -> None:
    """Make sure that Scene Synthesizer is there, before anything is measured.

    Raises:
        MissingExtraError: It is not.
    """
    if importlib.util.find_spec("scene_synthesizer") is None:
        raise MissingExtraError("scene_synthesizer", "peers")


def measure(compiled: CompiledScene, seconds: float, processes: int) -> tuple[dict[str, float], LayoutTable]:
    """Let processes make scenes of Mid side by side, each with meshes that it loads once.

    Args:
        compiled: The scene `mid` or `mid_16k`.
        seconds: How long each process makes scenes [s].
        processes: Their number.

    Returns:
        `processes`; `cold_s`, from the start of the processes until the first scene of the last one [s]; `scene_s`, the
        mean time of a scene in a process; `made`; `valid`, the share of scenes in which everything could be placed;
        `valid_per_s`, of all processes together, loading not counted. And the valid scenes, as rows of our model.
    """
    with tempfile.TemporaryDirectory() as folder:
        words = _words(compiled, Path(folder)) | {"seconds": seconds}
        start = time.perf_counter()
        running = [_start(words | {"seed": seed}) for seed in range(processes)]
        started = time.perf_counter() - start
        answers = [_answer(process) for process in running]
        whole = time.perf_counter() - start
    made = sum(a["made"] for a in answers)
    scenes = [scene for a in answers for scene in a["scenes"]]
    after_first = min(a["elapsed_s"] - a["first_s"] for a in answers)
    figures = {
        "processes": processes,
        "cold_s": max(whole - after_first, started),
        "scene_s": sum(a["elapsed_s"] for a in answers) / made,
        "made": made,
        "valid": len(scenes) / made,
        "valid_per_s": sum(len(a["scenes"]) / a["elapsed_s"] for a in answers),
    }
    return figures, _table(compiled, scenes)


def _start(words: Mapping[str, Any]) -> subprocess.Popen:
    # a process is to use one core, as the libraries below it may not know
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "benchmarks.paper.synthesizer_process"]
    process = subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None
    process.stdin.write(json.dumps(words) + "\n")
    process.stdin.flush()
    return process


def _answer(process: subprocess.Popen) -> dict[str, Any]:
    said, _ = process.communicate()
    if process.returncode:
        raise RuntimeError(f"a process of Scene Synthesizer ended with {process.returncode}; see its messages above.")
    return json.loads(said.splitlines()[-1])


def _words(compiled: CompiledScene, folder: Path) -> dict[str, Any]:
    """Write the rendered meshes of the scene for Scene Synthesizer, and describe the scene to its process."""
    config = compiled.config
    assert config.floor is not None
    for name in _OBJECTS:
        _write_urdf(compiled.mjm, compiled.scene.bodies[name], folder / f"{name}.urdf")
    ranges = {}
    for joint in _JOINTS:
        low, high = compiled.mjm.joint(f"cabinet/{joint}").range
        fraction = np.array(config.objects["cabinet"].joints[joint].fraction)
        ranges[_plain(f"cabinet/{joint}")] = (low + fraction * (high - low)).tolist()
    return {
        **{name: str(folder / f"{name}.urdf") for name in _OBJECTS},
        "floor": list(config.floor.size),
        "joints": ranges,
        "drawer": _plain("cabinet/upper_drawer"),
        "attempts": compiled.attempts,
    }


def _plain(name: str) -> str:
    """Return a name without slashes, which Scene Synthesizer puts between an object and its parts."""
    return name.replace("/", "_")


def _write_urdf(mjm: mujoco.MjModel, root: int, path: Path) -> None:
    """Write a body and those below it as URDF, each drawn geom as a mesh for the eye and for collisions."""
    robot = ElementTree.Element("robot", name=_plain(mjm.body(root).name))
    drawn = [solid for solid in solids_of(mjm, "visual") if solid.form is Form.POLYHEDRON]
    links = [body for body in range(root, mjm.nbody) if mjm.body_rootid[body] == root]
    for body in links:
        link = ElementTree.SubElement(robot, "link", name=_plain(mjm.body(body).name))
        for solid in (solid for solid in drawn if mjm.geom_bodyid[solid.geom] == body):
            mesh = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
            mesh.apply_transform(_pose(mjm.geom_pos[solid.geom], mjm.geom_quat[solid.geom]))
            name = f"{_plain(mjm.body(body).name)}_{solid.geom}.ply"
            mesh.export(path.parent / name)
            for use in ("visual", "collision"):
                geometry = ElementTree.SubElement(ElementTree.SubElement(link, use), "geometry")
                ElementTree.SubElement(geometry, "mesh", filename=str(path.parent / name))
        if body != root:
            _write_joint(mjm, body, robot)
    ElementTree.ElementTree(robot).write(path)


def _write_joint(mjm: mujoco.MjModel, body: int, robot: ElementTree.Element) -> None:
    """Write the slide that ties a body to its parent."""
    joint = mjm.joint(mjm.body_jntadr[body])
    element = ElementTree.SubElement(robot, "joint", name=_plain(joint.name), type="prismatic")
    pose = _pose(mjm.body_pos[body], mjm.body_quat[body])
    turn = _numbers(euler_from_matrix(pose, "sxyz"))
    ElementTree.SubElement(element, "origin", xyz=_numbers(pose[:3, 3]), rpy=turn)
    ElementTree.SubElement(element, "parent", link=_plain(mjm.body(mjm.body_parentid[body]).name))
    ElementTree.SubElement(element, "child", link=_plain(mjm.body(body).name))
    ElementTree.SubElement(element, "axis", xyz=_numbers(joint.axis))
    low, high = (f"{bound:.9g}" for bound in joint.range)
    ElementTree.SubElement(element, "limit", lower=low, upper=high, effort="100", velocity="1")


def _pose(pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Return a 4 x 4 pose; quaternions are (w, x, y, z) here and in trimesh."""
    pose = quaternion_matrix(quat)
    pose[:3, 3] = pos
    return pose


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _table(compiled: CompiledScene, scenes: Sequence[Mapping[str, Any]]) -> LayoutTable:
    """Return scenes as rows of our model."""
    mjm, n = compiled.mjm, len(scenes)
    qpos = np.tile(mjm.qpos0, (n, 1))
    mocap_pos, mocap_quat = np.zeros((n, mjm.nmocap, 3)), np.zeros((n, mjm.nmocap, 4))
    for i, scene in enumerate(scenes):
        for joint in _JOINTS:
            name = f"cabinet/{joint}"
            qpos[i, mjm.jnt_qposadr[mjm.joint(name).id]] = scene["joints"][_plain(name)]
        for name in _OBJECTS:
            pose, body = np.array(scene["poses"][name]), compiled.scene.bodies[name]
            state = np.concatenate([pose[:3, 3], quaternion_from_matrix(pose)])
            if mjm.body_mocapid[body] >= 0:
                mocap_pos[i, mjm.body_mocapid[body]], mocap_quat[i, mjm.body_mocapid[body]] = state[:3], state[3:]
            else:
                first = mjm.jnt_qposadr[mjm.body_jntadr[body]]
                qpos[i, first : first + 7] = state
    return LayoutTable.from_states(qpos, mocap_pos, mocap_quat, np.ones((n, len(compiled.slots)), bool))
