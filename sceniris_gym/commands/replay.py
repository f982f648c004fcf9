"""The `replay` command: makes layouts again from their ids `scenehash:split:seed:episode`."""

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.layouts import LayoutStatus, view_of
from sceniris_gym.layout.params import ParamTable, params_in
from sceniris_gym.layout.world_columns import WorldColumns
from sceniris_gym.pictures.layout_picture import SIZE, contact_sheet, render, save
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.progress import tell
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.draws import drawn_fields, nominal_values
from sceniris_gym.scene.field_table import OPTIONS
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.scene.model import SceneModel

_LISTED = 5
"""Number of layouts that a report lists, if there are several."""


def find_scene(scenehash: str, config: SceneConfig | None = None) -> SceneModel:
    """Return the scene with the hash `scenehash`: the scene of `config` or, without `config`, a shipped scene.

    Raises:
        UnknownNameError: No shipped scene has this hash.
        SceneMismatchError: The scene of `config` has another hash.
    """
    if config is not None:
        model = build_model(config)
        model.check_hash(scenehash, "replay: this layout", "Give the scene file as it was, or take new ids.")
        return model
    valid = []
    for candidate in map(SceneConfig.load, shipped("envs", ".yaml")):
        model = build_model(candidate)
        if model.hash == scenehash:
            return model
        valid.append(f"{model.hash} ({candidate.name})")
    raise UnknownNameError("scene hash", scenehash, "replay: give --scene if the scene is your own", valid)


def replay(compiled: CompiledScene, layout: LayoutId) -> LayoutTable:
    """Make a layout again, and return it as a table of one row."""
    named = params_in(layout.params)
    generator = LayoutGenerator(compiled, 1, split=layout.split, params=tuple(named))
    generator.set_params(named)
    generator.reseed(layouts={"seed": layout.seed, "episode": layout.episode})
    generator.generate()
    return generator.table()


def drawn(compiled: CompiledScene, table: LayoutTable) -> tuple[mujoco.MjModel, dict[str, list[float]]]:
    """Return the model with physics and appearance of a table's first layout, and all randomized values by name."""
    draws, mjm = compiled.scene.draws, copy.copy(compiled.mjm)
    if not draws:
        return mjm, {}
    with wp.ScopedDevice(compiled.device):
        nominal = {name: wp.array(nominal_values(mjm, name)[None], dtype=float) for name in drawn_fields(draws)}
        arrays = {name: wp.clone(values) for name, values in nominal.items()}
    world = WorldColumns(1, arrays, nominal, draws, params=ParamTable(compiled, table.params))
    rows = {name: getattr(table, name)[:1] for name in ("param", *columns("draw"))}
    world.launch(None, view_of(1, compiled.device, rows))
    for name, array in arrays.items():
        field = getattr(mjm.opt if name in OPTIONS else mjm, name)
        field[:] = array.numpy().reshape(field.shape)
    return mjm, {name: numbers.numpy()[0].tolist() for name, numbers in world.numbers.items()}


def shown(ids: Sequence[str], config: SceneConfig | None, picture: Path, device: str | None) -> dict:
    """Make layouts again from their ids, describe each, and draw all layouts as tiles of one picture.

    `config` is the scene of the layouts, or None if they belong to a shipped scene.
    """
    compiled: dict[str, CompiledScene] = {}
    found, tiles = [], []
    size = SIZE if len(ids) > 1 else (2 * SIZE[0], 2 * SIZE[1])
    for done, text in enumerate(ids, 1):
        name = LayoutId.parse(text)
        if name.scene not in compiled:
            compiled[name.scene] = compile_scene(find_scene(name.scene, config), device)
        scene = compiled[name.scene]
        mjm, numbers = drawn(scene, table := replay(scene, name))
        tiles.append(render(mjm, table, size=size, device=scene.device))
        found.append({"id": text, **describe(scene, table), **({"drawn": numbers} if numbers else {})})
        tell("layouts", done, len(ids))
    save(contact_sheet(np.concatenate(tiles), ids), picture)
    return {"layouts": found, "picture": str(picture)}


def describe(compiled: CompiledScene, table: LayoutTable) -> dict:
    """Return the first layout of a table by object name, unrounded: poses in the world frame, joints in m and rad.

    `absent` lists the objects of the scene file that are not present.
    """
    mjm, data = compiled.mjm, mujoco.MjData(compiled.mjm)
    table.put(data, 0)
    mujoco.mj_kinematics(mjm, data)
    # MuJoCo normalises the layout's quaternions, which changes their last bits.
    free, mocap = np.flatnonzero(mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE), mjm.body_mocapid >= 0
    data.xquat[mjm.jnt_bodyid[free]] = data.qpos[mjm.jnt_qposadr[free][:, None] + np.arange(3, 7)]
    data.xquat[mocap] = data.mocap_quat[mjm.body_mocapid[mocap]]
    owners, objects = compiled.config.owners, {}
    present = dict(zip(compiled.slots, table.present[0], strict=True))
    for name, body in compiled.scene.bodies.items():
        if not present.get(name, True):
            continue
        joints = {joint: float(data.qpos[mjm.jnt_qposadr[i]]) for joint, i in compiled.scene.joints(name).items()}
        objects[name] = {"pos": data.xpos[body].tolist(), "quat": data.xquat[body].tolist(), "joints": joints}
    for k, target in enumerate(() if compiled.reaching is None else compiled.reaching.targets):
        if table.grasp[0, k] >= 0:
            objects[target.name]["grasp"] = {
                "name": target.grasp_set.grasps[table.grasp[0, k]].name,
                "pos": table.grasp_pose[0, k, :3].tolist(),
                "quat": table.grasp_pose[0, k, 3:].tolist(),
                "qpos": _known(table.grasp_qpos[0, k]),
                "pregrasp_qpos": _known(table.pregrasp_qpos[0, k]),
            }
    return {
        "scene": compiled.config.name,
        "status": LayoutStatus(int(table.status[0])).name.lower(),
        "first_pass_valid": bool(table.first_pass_valid[0]),
        "attempts": int(table.attempts[0]),
        **({"start": int(table.start[0])} if compiled.config.start else {}),
        "objects": objects,
        "absent": sorted({owners.get(name, name) for name in present} - {owners.get(name, name) for name in objects}),
    }


def _known(qpos: np.ndarray) -> list[float] | None:
    return None if np.isnan(qpos).any() else qpos.tolist()


def report(found: Mapping) -> str:
    """Return a single layout as text, with angles in degrees. Of several layouts, list only the first `_LISTED`."""
    layouts = found["layouts"]
    texts = [_text(layout) for layout in layouts[:_LISTED]]
    lines = texts if len(layouts) == 1 else [text.partition("\n")[0] for text in texts]
    if len(layouts) > _LISTED:
        lines.append(f"and {len(layouts) - _LISTED} more. Poses of all layouts: --json, or a single ID")
    return "\n".join([*lines, f"picture: {found['picture']}"])


def _text(found: Mapping) -> str:
    """Return one layout as text."""
    lines = [f"{found['id']} of scene '{found['scene']}': {found['status']}, {found['attempts']} candidates"]
    width = max([12, *map(len, (*found["objects"], *found["absent"]))])
    lines += [f"  {'start':<{width}} {found['start']}"] if "start" in found else []
    for name, part in found["objects"].items():
        (x, y, z), turn = part["pos"], matrix(part["quat"])
        yaw, tilt = np.degrees([np.arctan2(turn[1, 0], turn[0, 0]), np.arccos(np.clip(turn[2, 2], -1.0, 1.0))])
        tilted = f"  tilt {tilt:.1f} deg" if tilt > 0.1 else ""
        joints = "".join(f"  {joint} {value:.4f}" for joint, value in part["joints"].items())
        grasp = f"  grasp '{part['grasp']['name']}'" if "grasp" in part else ""
        lines.append(
            f"  {name:<{width}} x {x:+.4f}  y {y:+.4f}  z {z:+.4f} m  yaw {yaw:+7.1f} deg{tilted}{joints}{grasp}"
        )
    lines += [f"  {name:<{width}} absent" for name in found["absent"]]
    for name, numbers in found.get("drawn", {}).items():
        lines.append(f"  {name:<{width}} {' '.join(f'{number:.4g}' for number in numbers)}")
    return "\n".join(lines)


def default_picture(ids: Sequence[str]) -> Path:
    """Return the default path of a picture of layouts."""
    return Path("demo") / (f"{ids[0][:200]}.png".replace(":", "-") if len(ids) == 1 else "replay.png")
