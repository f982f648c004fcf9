"""A stand-in for the Panda of MuJoCo Menagerie, which MuJoCo Playground downloads: what its tasks need of it."""

from __future__ import annotations

from pathlib import Path

import mujoco

PANDA = Path(__file__).parents[2] / "assets" / "panda.xml"
COLLIDING = {"left_pad": "left_finger_pad", "right_pad": "right_finger_pad"}


def write_menagerie(folder: Path) -> Path:
    """Write the arm of this package under the names of Menagerie's Panda, and return the folder for MENAGERIE_PATH.

    As there, a capsule around the hand and the pads of the fingers collide, and nothing else of the arm.
    """
    spec = mujoco.MjSpec.from_file(str(PANDA))
    spec.body("panda").name = "link0"
    for geom in [g for g in spec.geoms if g.name not in COLLIDING]:
        spec.delete(geom)
    for name, new in COLLIDING.items():
        geom = spec.geom(name)
        geom.name, geom.contype, geom.conaffinity = new, 0, 3
    hand = spec.body("hand")
    hand.add_geom(
        name="hand_capsule",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[0.04, 0.06, 0.0],
        quat=[0.7071068, 0.7071068, 0.0, 0.0],
        pos=[0.0, 0.0, 0.03],
        contype=0,
        conaffinity=1,
    )
    spec.site("tcp").name = "gripper"
    for element in [*spec.meshes, *spec.excludes, *spec.keys]:
        spec.delete(element)
    spec.compile()
    arm = folder / "franka_emika_panda"
    (arm / "assets").mkdir(parents=True)
    (arm / "mjx_panda.xml").write_text(spec.to_xml())
    return folder
