"""Data sets: what is in them, and that stock MuJoCo understands it."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.tools.commands.generate import write_dataset
from sceniris_gym.tools.tables import make_table
from tests.layout.scenes import compile_on_cpu


def test_a_data_set_is_a_table_and_a_model_that_fit(tmp_path: Path):
    """Columns of the table bit by bit, the names of the objects, and the scene as MuJoCo reads it from the archive."""
    compiled = compile_on_cpu("mid")
    table = make_table(compiled, 5, 3)
    write_dataset(compiled, table, tmp_path / "new" / "folder")
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == ["layouts.npz", "scene.zip"]
    stored = np.load(tmp_path / "new" / "folder" / "layouts.npz")
    assert stored["object_names"].tolist() == ["cabinet", "apple", "banana"]
    assert not {"grasp", "grasp_pose", "grasp_qpos", "pregrasp_qpos", "reachable_names"} & set(stored.files)
    for name in set(stored.files) - {"object_names"}:
        np.testing.assert_array_equal(stored[name], getattr(table, name), err_msg=name)
        assert stored[name].dtype == getattr(table, name).dtype, name
    with (tmp_path / "new" / "folder" / "scene.zip").open("rb") as file:
        mjm = mujoco.MjSpec.from_zip(file).compile()
    data, own = mujoco.MjData(mjm), mujoco.MjData(compiled.mjm)
    table.put(data, 2)
    table.put(own, 2)
    for model, state in ((mjm, data), (compiled.mjm, own)):
        mujoco.mj_kinematics(model, state)
    for name in ("cabinet/upper_drawer", "apple", "banana"):
        np.testing.assert_allclose(data.body(name).xpos, own.body(name).xpos, atol=1e-6)


def test_a_data_set_says_where_the_tcp_takes_each_reachable_object(crane: CompiledScene, tmp_path: Path):
    """Index, pose in the world and joints by object; the cube is taken at its middle, straight from above."""
    table = make_table(crane, 40, 3)
    write_dataset(crane, table, tmp_path)
    stored = np.load(tmp_path / "layouts.npz")
    assert stored["reachable_names"].tolist() == ["thing"]
    assert stored["grasp"].shape == (40, 1)
    assert stored["grasp_qpos"].shape == stored["pregrasp_qpos"].shape == (40, 1, 4)
    assert np.isnan(stored["grasp_qpos"]).all()
    adr = crane.mjm.jnt_qposadr[crane.mjm.joint("thing/free").id]
    assert np.allclose(stored["grasp_pose"][:, 0, :3], stored["qpos"][:, adr : adr + 3] + [0.0, 0.0, 0.02], atol=1e-5)
    for quat in stored["grasp_pose"][:, 0, 3:]:
        turned = np.zeros(3)
        mujoco.mju_rotVecQuat(turned, np.array([0.0, 0.0, 1.0]), quat.astype(float))
        assert np.allclose(turned, [0.0, 0.0, -1.0], atol=1e-5)
